"""Synthetic drives with three images a sweep, in each of several streets: motion of the camera shows in them.

The rig goes through each street at another speed and turn, or straight on, and no image has labels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import DRIVE_FILE
from semcal_cli.files.documents import document_text, read_document
from semcal_cli.files.image_files import write_image
from semcal_cli.synthetic.street_motion import lidar_twist
from semcal_cli.synthetic.synthesis import make_renderer, mounting, synthesize

APART_S = 0.2
"""Time from one image to the next; the second one is of the middle of the sweep."""


@dataclass(frozen=True)
class LongSweeps(SynthConfig):
    """Sweeps that last from the first image to the last, so that the street is the same in all of them."""

    sweep_s: ClassVar[float] = 2.0 * APART_S


def write_images(config: LongSweeps, folder: Path) -> Path:
    """Write a drive in motion, with its true motion and transform, and return its drive.yaml."""
    synthesize(config, folder)
    document, frames = read_document(folder / DRIVE_FILE), []
    for number, frame in enumerate(document["frames"]):
        kept = {name: frame[name] for name in ("points", "image", "points_stamp", "image_stamp")}
        for late_s in (-APART_S, 0.0, APART_S):
            frames.append(kept if late_s == 0.0 else _at(config, folder, number, kept, late_s))
    document["frames"] = frames
    del document["classes"]
    (folder / DRIVE_FILE).write_text(document_text(document, "yaml"))
    return folder / DRIVE_FILE


def _at(
    config: LongSweeps, folder: Path, number: int, frame: dict[str, object], late_s: float
) -> dict[str, object]:
    """Write another image of a street, and return its frame, of the same sweep."""
    shifted = replace(config, columns=1, delay_ms=1e3 * late_s)
    seen = make_renderer(shifted, mounting(config)).frame(config.seed, number, lidar_twist(config, number))
    name = f"images/{number:06d}_{'before' if late_s < 0.0 else 'after'}.png"
    write_image(seen.image_rgb[..., ::-1], folder / name)
    return frame | {"image": name, "image_stamp": float(str(frame["image_stamp"])) + late_s}
