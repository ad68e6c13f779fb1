"""Draw where each frame of a drive puts the camera on its own: a synthetic drive whose camera was knocked half-way.

    python tests/benchmarks/knocked_drive.py -o docs/pictures/knocked.png

Prints what the calibration says of the knock, and the truth. It is the image of `semcal report`, by matplotlib.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmark import script, street
from laboratory.raw_drive import read_raw_drive, write_raw_drive
from laboratory.spoiling import knocked, wrong_labels
from matplotlib.figure import Figure

from semcal_cli.estimation.adjust.frame_offsets import FrameOffsets, frame_offsets
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.loading import load
from semcal_cli.pipeline import calibrate

NOISE = 0.1
"""Share of wrong labels on both sides."""
PANELS = (("camera centre, cm", 100.0, slice(0, 3)), ("rotation, degrees", 1.0, slice(3, 6)))


def draw(found: FrameOffsets) -> Figure:
    """Draw offsets with 95 % intervals, and the poses of the parts as steps."""
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    frames = np.arange(len(found.offsets))
    for axes, (title, scale, part) in zip(figure.subplots(1, 2), PANELS, strict=True):
        for index, name in enumerate("xyz"):
            column = range(6)[part][index]
            offsets, halves = scale * found.offsets[:, column], scale * found.half_widths_95[:, column]
            shown = axes.errorbar(frames + 0.15 * (index - 1), offsets, halves, fmt="o", ms=4, label=name)
            color = shown[0].get_color()
            axes.step(frames, scale * found.of_parts[:, column], where="mid", color=color, ls="--", lw=1.0)
        axes.axhline(0.0, color="gray", lw=0.5)
        axes.set_xticks(frames)
        axes.set_xlabel("frame")
        axes.set_title(title, fontsize=10)
    axes.legend(title="axis of the camera", fontsize=8, title_fontsize=8)
    return figure


def main(
    *,
    output: Path,
    seed: int = 7,
    frames: int = 12,
    width: int = 1280,
    angle_deg: float = 0.5,
    distance_m: float = 0.05,
) -> Iterator[str]:
    """Knock a camera, calibrate, and draw."""
    rng = np.random.default_rng(seed)
    with TemporaryDirectory() as good, TemporaryDirectory() as folder:
        raw = wrong_labels(read_raw_drive(*street(Path(good), seed, frames, width)), rng, NOISE)
        raw = knocked(raw, rng, angle_deg, distance_m, share=0.5)
        data = load(write_raw_drive(raw, Path(folder)))
        found = calibrate(data)
    yield f"found: {'; '.join(found.reasons) or 'nothing'}"
    before, after = raw.truths
    truth = compare_poses(after, before)
    yield f"truth: frame {raw.knock}, {truth.rotation_deg:.2f} degrees, {truth.camera_center_cm:.1f} cm"
    draw(frame_offsets(data.observations, found.pose, found.parts)).savefig(output, dpi=100)


if __name__ == "__main__":
    script(main)
