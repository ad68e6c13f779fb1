"""Prints a Markdown table: the mounting's rotation by camera motion against LiDAR motion, and edges that start there.

    python tests/benchmarks/hand_eye.py [--drives 10] [--without-edges] [--folder DIR]
    python tests/benchmarks/hand_eye.py --check --drives 16 --first-seed 201 --width 640
    python tests/benchmarks/hand_eye.py --kitti ../shared/data/kitti_raw_right

Each drive has three images a sweep, in 20 streets, and no labels; the camera looks anywhere. In turning drives each
street has another speed and turn, in straight ones none turns. Drives are kept in a folder, if one is named, and those
that are there are not made again.

`--check` turns right poses of turning drives by 0.5 to 5 degrees about many axes, and counts those that the check
`camera-motion` tells. `--kitti` is a folder of KITTI raw with oxts, whose drives are taken together, with the motion of
oxts and with that of the sweeps: needs the extra `odometry`. Pairs of images are set beside that motion, too, as the
published calibration carries it to the camera.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from benchmark import script, table
from consecutive_images import LongSweeps, write_images
from odometry import kitti_poses
from real_data import READERS

from semcal_cli.api.calls import calibrate
from semcal_cli.checks.camera_motion import CAMERA_MOTION, standard_errors
from semcal_cli.config import CalibrationConfig
from semcal_cli.config.nanoseconds import NS
from semcal_cli.drive.document import DRIVE_FILE, Drive, read_drive
from semcal_cli.drive.stated_motion import Motion
from semcal_cli.errors import InputError
from semcal_cli.estimation.search.hand_eye import NotDetermined, choose_pairs, hand_eye
from semcal_cli.estimation.search.visual_motion import camera_motions
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses, inverse, rotation_error_deg
from semcal_cli.geometry.twists import rotation_matrix
from semcal_cli.importing.stamps import tum_text

TURNED_DEG = (0.0, 0.5, 1.0, 2.0, 5.0)
NUM_AXES = 50
APART_S = 100
"""Time from one drive of KITTI to the next: no pair of images spans it."""


def drive_of(folder: Path, config: LongSweeps) -> tuple[Drive, Pose]:
    """Read a drive and its true pose; a drive that is not there yet is made."""
    if not (folder / DRIVE_FILE).exists():
        write_images(config, folder)
    return read_drive(folder), read_transform(folder)


def row(folder: Path, config: LongSweeps, *, without_edges: bool) -> tuple[str, ...]:
    drive, truth = drive_of(folder, config)
    name = f"{config.motion}, seed {config.seed}"
    return name, *(by_motion_alone if without_edges else by_edges)(drive, truth)


def undetermined(why: str) -> str:
    return "not determined" if "too few turns" in why else why


def by_motion_alone(drive: Drive, truth: Pose) -> tuple[str, ...]:
    found = hand_eye(drive)
    if isinstance(found, NotDetermined):
        return undetermined(found.why), "-", "-", "-"
    off = compare_poses(found.T_camera_lidar, truth)
    start = f"{off.rotation_deg:.2f} deg, {off.camera_center_cm:.0f} cm"
    return start, f"+- {found.half_width_deg:.2f} deg", "-", "-"


def by_edges(drive: Drive, truth: Pose) -> tuple[str, ...]:
    try:
        result = calibrate(drive, CalibrationConfig(cues=("edges",)))
    except InputError as error:
        return undetermined(str(error)), "-", "-", "refused"
    by_motion: Any = result.settings.options["hand_eye"]
    start, end = (
        compare_poses(np.array(stage.T_camera_lidar), truth)
        for stage in (result.stages["initial"], result.stages["polished"])
    )
    return (
        f"{start.rotation_deg:.2f} deg, {start.camera_center_cm:.0f} cm",
        f"+- {by_motion['half_width_95_deg']:.2f} deg",
        f"{end.rotation_deg:.3f} deg, {end.camera_center_cm:.2f} cm",
        result.status.replace("_", " "),
    )


def check_rows(cases: list[tuple[Path, LongSweeps]]) -> Iterator[tuple[str, ...]]:
    """How many standard errors poses are off that are turned by some angle, and the share that is told."""
    sigmas: dict[float, list[float]] = {angle: [] for angle in TURNED_DEG}
    num_found = 0
    for folder, config in cases:
        drive, truth = drive_of(folder, config)
        found = hand_eye(drive)
        if isinstance(found, NotDetermined):
            continue
        num_found += 1
        axes = np.random.default_rng(config.seed).normal(size=(NUM_AXES, 3))
        for angle, off in sigmas.items():
            for axis in axes / np.linalg.norm(axes, axis=1)[:, None] if angle else axes[:1]:
                turned = truth.copy()
                turned[:3, :3] = rotation_matrix(np.radians(angle) * axis) @ truth[:3, :3]
                off.append(standard_errors(found, turned))
    for angle, off in sigmas.items():
        told = sum(each > CAMERA_MOTION.limit() for each in off)
        spread = f"{min(off):.1f}, {np.median(off):.1f}, {max(off):.1f}"
        yield f"{angle:g} deg", f"{num_found} of {len(cases)}", f"{told} of {len(off)}", spread


def kitti_rows(data: Path) -> Iterator[tuple[str, ...]]:
    with tempfile.TemporaryDirectory() as name:
        (real,) = READERS["kitti_raw_right"](data, Path(name))
        drive, truth = read_drive(real.path), read_transform(real.path)
        poses, stamps = kitti_motion(data)
        frames = tuple(
            frame.model_copy(update={"points_stamp": stamp, "image_stamp": stamp})
            for frame, stamp in zip(drive.frames, stamps, strict=True)
        )
        for by, of_drives in poses.items():
            drive.resolve(f"{by}.txt").write_text(tum_text(of_drives))
            update = {"frames": frames, "motion": Motion(poses=f"{by}.txt")}
            yield by, *kitti_cells(drive.model_copy(update=update), truth)


def kitti_motion(data: Path) -> tuple[dict[str, dict[int, Pose]], list[float]]:
    """Poses of all drives by oxts and by KISS-ICP, a hundred seconds apart, and the stamps of their frames."""
    poses: dict[str, dict[int, Pose]] = {"oxts": {}, "KISS-ICP": {}}
    stamps: list[float] = []
    for index, folder in enumerate(sorted(path.parent for path in data.glob("*/*_sync/oxts"))):
        start_ns = index * APART_S * NS
        by_sweeps, by_oxts = kitti_poses(folder)
        poses["KISS-ICP"] |= {start_ns + stamp_ns: T for stamp_ns, T in by_sweeps.items()}
        own_ns = [start_ns + (number + 1) * NS // 10 for number in range(len(by_oxts))]
        poses["oxts"] |= dict(zip(own_ns, by_oxts, strict=True))
        stamps += [each / NS for each in own_ns]
    return poses, stamps


def kitti_cells(drive: Drive, truth: Pose) -> tuple[str, ...]:
    """What hand-eye says, and how far pairs of images are from the motion as the published pose carries it."""
    pairs, found = choose_pairs(drive), hand_eye(drive)
    seen = camera_motions(drive, [frames for frames, _ in pairs])
    turns, ways = [], []
    for motion, (_, T_B) in zip(seen, pairs, strict=True):
        if motion is None:
            continue
        T_A = truth @ T_B @ inverse(truth)
        R = np.eye(4)
        R[:3, :3] = motion.R
        turns.append(rotation_error_deg(R, T_A))
        along = T_A[:3, 3] / np.linalg.norm(T_A[:3, 3])
        ways.append(np.degrees(np.arccos(np.clip(along @ motion.direction, -1.0, 1.0))))
    if isinstance(found, NotDetermined):
        told = f"not determined: {found.why}"
    else:
        off = rotation_error_deg(found.T_camera_lidar, truth)
        told = f"{off:.2f} deg off, +- {found.half_width_deg:.2f} deg"
    off_deg = (f"{np.median(each):.2f}, {max(each):.2f}" if each else "-" for each in (turns, ways))
    return f"{len(turns)} of {len(pairs)}", *off_deg, told


def main(
    *,
    drives: int = 10,
    first_seed: int = 101,
    width: int = 1280,
    folder: str = "",
    without_edges: bool = False,
    check: bool = False,
    kitti: str = "",
) -> Iterator[str]:
    """Print the table, turning drives first, or that of the check, or of KITTI."""
    if kitti:
        header = "motion | pairs | rotation off, deg: median, worst | direction off, deg | hand-eye"
        yield from table(header, kitti_rows(Path(kitti)))
        return
    with tempfile.TemporaryDirectory() as name:
        root = Path(folder or name)
        size = {"width": width, "height": width * 9 // 16}
        # Hand-eye alone needs no points.
        points = {"columns": 64, "channels": 16} if check else {}
        cases = [
            (root / f"{motion}_{seed}", LongSweeps(num_frames=20, seed=seed, motion=motion, **size, **points))
            for motion in (("mixed",) if check else ("mixed", "steady"))
            for seed in range(first_seed, first_seed + drives)
        ]
        if check:
            header = "poses rotated by | drives determined | doubted | standard errors: least, median, most"
            yield from table(header, check_rows(cases))
            return
        header = "drive | hand-eye | its 95 % interval | edges from there | verdict"
        yield from table(header, (row(*case, without_edges=without_edges) for case in cases))


if __name__ == "__main__":
    script(main)
