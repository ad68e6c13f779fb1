"""Measures what drives ask of their intrinsics, with the right K and with wrong ones, and which poses are trusted.

    python tests/benchmarks/intrinsics.py DATA [--only NAME] [--cue edges] [--halves] [--synthetic 0]

Each drive is calibrated from 1 degree and 0.1 m off, or by labels from nothing, with its own K and with each error of
`ERRORS`. Halves, every second frame, have the right K alone; `--synthetic` takes synthetic drives instead. Prints a
Markdown table: the pose's error, the verdict, and the intrinsic that is farthest from its value in the drive, in units
of its limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import cv2
import numpy as np
import yaml
from benchmark import script, street
from real_data import RealDrive, real_drives

from semcal_cli.config import CalibrationConfig, CueName
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import CalibrationError
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.experiments.summary import table_row
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.loading import load
from semcal_cli.pipeline import calibration

START_DEG, START_M = 1.0, 0.1
BEYOND_DEG = 0.3
"""A trusted pose is wrong if it is farther off than this beyond its interval."""
NOT_CONFIRMED = "if K is right"
FIRST_SEED, NUM_FRAMES, WIDTH, NOISE = 61, 12, 1280, 0.05
"""Seed of the first synthetic drive, frames of each, columns of their images, and fraction of wrong labels."""


class KError(NamedTuple):
    """What is wrong with K: shifts in pixels, focal lengths by shares, and what was cut off the images."""

    cx_px: float = 0.0
    cy_px: float = 0.0
    fx: float = 0.0
    fy: float = 0.0
    left_px: int = 0
    top_px: int = 0
    resized: float = 1.0
    """Scale by which the images were resized without their K."""

    @property
    def named(self) -> tuple[str, ...]:
        """Intrinsics that a check should name first."""
        if self == KError():
            return ()
        if self.fx or self.fy or self.resized != 1.0:
            both = ("fx", self.fx or self.resized != 1.0), ("fy", self.fy or self.resized != 1.0)
            return tuple(name for name, is_off in both if is_off)
        return ("cx",) if self.cx_px or self.left_px else ("cy",)


RIGHT = "right K"
ERRORS = {
    RIGHT: KError(),
    "cx +20 px": KError(cx_px=20),
    "cx -25 px": KError(cx_px=-25),
    "cx +40 px": KError(cx_px=40),
    "cy +22 px": KError(cy_px=22),
    "cy -22 px": KError(cy_px=-22),
    "cy +35 px": KError(cy_px=35),
    "fx, fy +3 %": KError(fx=0.03, fy=0.03),
    "fx, fy -3 %": KError(fx=-0.03, fy=-0.03),
    "fx +3 %": KError(fx=0.03),
    "fy +3 %": KError(fy=0.03),
    "fx, fy +5 %": KError(fx=0.05, fy=0.05),
    "30 columns cropped": KError(left_px=30),
    "20 rows cropped": KError(top_px=20),
    "resized to 96 %": KError(resized=0.96),
}


@dataclass(frozen=True)
class Row:
    """One calibration."""

    name: str
    error: str
    error_deg: float
    error_cm: float
    half_width_deg: float
    verdict: str
    named: str
    """Intrinsic that is named first, and by how many limits it is off."""
    is_named: bool
    """Whether K is named, with the right intrinsic first."""

    @property
    def is_trusted_and_wrong(self) -> bool:
        """Whether the pose is trusted, without a word about K, and far beyond its interval."""
        return self.verdict == "trusted" and self.error_deg > self.half_width_deg + BEYOND_DEG


def spoiled(source: Path, folder: Path, error: KError, frames: slice = slice(None)) -> Path:
    """Write a drive with a wrong K, or with images that K does not belong to."""
    folder.mkdir(parents=True)
    document = yaml.safe_load((source / "drive.yaml").read_text())
    document["frames"] = document["frames"][frames]
    camera = document["camera"]
    camera["K"][0][2] += error.cx_px
    camera["K"][1][2] += error.cy_px
    camera["K"][0][0] *= 1.0 + error.fx
    camera["K"][1][1] *= 1.0 + error.fy
    for number, frame in enumerate(document["frames"]):
        for key in ("points", "image", "image_labels", "point_labels"):
            if key in frame:
                frame[key] = str((source / frame[key]).resolve())
        if error.left_px or error.top_px or error.resized != 1.0:
            for key in ("image", "image_labels"):
                if key in frame:
                    target = folder / f"{key}_{number:03d}.png"
                    frame[key] = str(_changed(Path(frame[key]), target, error, camera))
    (folder / "drive.yaml").write_text(yaml.safe_dump(document))
    return folder


def _changed(source: Path, path: Path, error: KError, camera: dict[str, object]) -> Path:
    """Crop or resize an image, and state its size."""
    whole = cv2.imread(str(source), cv2.IMREAD_UNCHANGED)
    assert whole is not None
    image = whole[error.top_px :, error.left_px :]
    if error.resized != 1.0:
        how = cv2.INTER_NEAREST if image.ndim == 2 else cv2.INTER_AREA
        image = cv2.resize(image, None, fx=error.resized, fy=error.resized, interpolation=how)
    camera["height"], camera["width"] = image.shape[:2]
    cv2.imwrite(str(path), image)
    return path


def _run(name: str, label: str, drive: Path, cue: CueName, named: tuple[str, ...]) -> Row:
    config = CalibrationConfig(cues=(cue,))
    data = load(read_drive(drive), config)
    T_true = np.array(data.drive.T_camera_lidar)
    start = displace(T_true, START_DEG, START_M, np.random.default_rng(0))
    initial = None if cue == "labels" else InitialPose(start, "start")
    try:
        found = calibration.calibrate(data, config, initial_pose=initial)
    except CalibrationError:
        return Row(name, label, math.nan, math.nan, math.nan, "failed", "", False)
    error = compare_poses(found.T_camera_lidar, T_true)
    width = math.nan
    if found.uncertainty is not None:
        width = float(np.linalg.norm(found.uncertainty.half_width_95_rotation_deg))
    checked, first, by = found.checked_intrinsics, "", 0.0
    if checked is not None:
        by, first = max(
            (abs(each.found - each.given) / (3.0 * each.sigma), key)
            for key, each in checked.intrinsics.items()
            if each.sigma
        )
    verdict = found.status.replace("_", " ")
    if found.status == "trusted" and not found.is_camera_confirmed:
        verdict = f"trusted, {NOT_CONFIRMED}"
    is_named = "intrinsics" in found.topics and first in named
    return Row(
        name,
        label,
        error.rotation_deg,
        100.0 * error.camera_center_m,
        width,
        verdict,
        f"{first} {by:.2f}" if first else "",
        is_named,
    )


def drives(
    data: Path, only: tuple[str, ...], cue: CueName, synthetic: int, folder: Path
) -> Iterator[RealDrive]:
    """List the real drives whose files allow the cue, or make synthetic ones, each with another rig."""

    def is_chosen(name: str) -> bool:
        return not only or any(part in name for part in only)

    if synthetic:
        for seed in range(FIRST_SEED, FIRST_SEED + synthetic):
            name, path = f"synthetic {seed}", folder / f"synthetic_{seed}"
            if is_chosen(name):
                street(path, seed, NUM_FRAMES, WIDTH, label_noise=NOISE)
                yield RealDrive(name, path)
        return
    for drive in real_drives(data, folder):
        if drive.files_allow([cue]) and is_chosen(drive.name):
            yield drive


def rows(data: Path, only: tuple[str, ...], cue: CueName, *, halves: bool, synthetic: int) -> Iterator[Row]:
    """Calibrate each drive with all errors, or both halves of it with the right K."""
    with TemporaryDirectory() as folder:
        for drive in drives(data, only, cue, synthetic, Path(folder)):
            for label, error in ERRORS.items() if not halves else ():
                path = spoiled(drive.path, Path(folder) / f"{drive.path.name}_{label}", error)
                yield _run(drive.name, label, path, cue, error.named)
            for first in (0, 1) if halves else ():
                half = slice(first, None, 2)
                path = spoiled(drive.path, Path(folder) / f"{drive.path.name}_{first}", KError(), half)
                yield _run(f"{drive.name}, half {first + 1}", RIGHT, path, cue, ())


def main(
    data: Path,
    *,
    only: tuple[str, ...] = (),
    cue: CueName = "edges",
    halves: bool = False,
    synthetic: int = 0,
) -> Iterator[str]:
    """Run all errors on all drives."""
    found = []
    yield "| drive | K | error, deg | cm | +- deg | verdict | first, limits |\n|---|---|---|---|---|---|---|"
    for row in rows(data.resolve(), only, cue, halves=halves, synthetic=synthetic):
        found.append(row)
        yield table_row(
            row.name,
            row.error,
            f"{row.error_deg:.2f}",
            f"{row.error_cm:.1f}",
            f"{row.half_width_deg:.2f}",
            f"**{row.verdict}**" if row.is_trusted_and_wrong else row.verdict,
            row.named,
        )
    right, wrong = ([row for row in found if (row.error == RIGHT) == is_right] for is_right in (True, False))
    yield (
        f"\n{len(wrong)} with a wrong K: {sum(row.is_trusted_and_wrong for row in wrong)} trusted and wrong, "
        f"{sum(row.is_named for row in wrong)} named with the right intrinsic first. {len(right)} with the right K: "
        f"{sum(row.verdict == 'trusted' for row in right)} trusted, "
        f"{sum(NOT_CONFIRMED in row.verdict for row in right)} only if K is right."
    )


if __name__ == "__main__":
    script(main)
