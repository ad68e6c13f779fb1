"""Searches for poses that are trusted and wrong: every way in which the drive of a user is wrong, by each cue.

    python tests/benchmarks/confident_and_wrong.py DATA [--only KIND] [--drive NAME] [--cue edges] [--synthetic 0]

The kinds are wrong intrinsics (`intrinsics.py`), images of another moment or of other frames, a camera that was
knocked, clouds that are mirrored, turned, permuted or scaled, and a start that is inverted. Drives are calibrated from
1 degree and 0.1 m, or by labels from nothing; `--synthetic` takes synthetic drives instead. Prints a row for each kind:
how many are trusted and right, trusted and wrong, and not trusted, and which reasons come first.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import intrinsics
import numpy as np
import yaml
from benchmark import script, table

from semcal_cli.config import CalibrationConfig, CueName
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import SemcalError
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.files.point_clouds import read_point_clouds
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses, inverse
from semcal_cli.geometry.twists import displace, pose_at
from semcal_cli.observations.loading import load
from semcal_cli.pipeline import calibrate

Document = dict[str, Any]
Spoil = Callable[[Document, Path], None]
"""Changes the document of a drive in place, and may write files into its folder."""
WRONG_DEG, WRONG_M = 0.3, 0.1
"""A trusted pose is wrong if it is farther off than this beyond its interval."""
RAW_DISTORTION = [-0.37, 0.2, 0.0, 0.0, -0.07]
"""That of KITTI's raw images, about, stated for rectified ones."""


def _images_moved(by: int) -> Spoil:
    """Give each sweep the image of another frame, so many places on."""

    def spoil(document: Document, folder: Path) -> None:
        frames = document["frames"]
        of_images = [
            {key: frame[key] for key in ("image", "image_labels") if key in frame} for frame in frames
        ]
        kept = frames[max(-by, 0) : len(frames) - max(by, 0)]
        document["frames"] = [
            {**frame, **of_images[place + max(-by, 0) + by]} for place, frame in enumerate(kept)
        ]

    return spoil


def _two_swapped(document: Document, folder: Path) -> None:
    first, second = document["frames"][:2]
    for key in ("image", "image_labels"):
        if key in first:
            first[key], second[key] = second[key], first[key]


def _clouds(change: Callable[[np.ndarray, int, int], np.ndarray]) -> Spoil:
    """Change the points (N, 3) of each frame, given its number and the number of frames; intensities stay."""

    def spoil(document: Document, folder: Path) -> None:
        frames = document["frames"]
        for number, frame in enumerate(frames):
            (cloud,) = read_point_clouds([(Path(frame["points"]), None)])
            columns = [change(cloud.points, number, len(frames))]
            if cloud.intensity is not None:
                columns.append(cloud.intensity[:, None])
            path = folder / f"{number:06d}.npy"
            np.save(path, np.hstack(columns).astype(np.float32))
            frame["points"] = str(path)

    return spoil


def _knocked(points: np.ndarray, number: int, count: int) -> np.ndarray:
    T: Pose = pose_at(np.eye(4), np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.radians(1.0)]))
    return points if 2 * number < count else points @ T[:3, :3].T


def _stated_distortion(document: Document, folder: Path) -> None:
    document["camera"]["distortion"] = RAW_DISTORTION


def _as_they_are(document: Document, folder: Path) -> None:
    """The drive is right."""


RIGHT = "right"
KINDS: dict[str, Spoil] = {
    RIGHT: _as_they_are,
    "raw distortion for rectified images": _stated_distortion,
    "images one frame late": _images_moved(1),
    "images one frame early": _images_moved(-1),
    "images four frames late": _images_moved(4),
    "two images swapped": _two_swapped,
    "knocked by 1 degree half-way": _clouds(_knocked),
    "mirrored clouds": _clouds(lambda points, *_: points * [1.0, -1.0, 1.0]),
    "upside-down clouds": _clouds(lambda points, *_: points * [1.0, -1.0, -1.0]),
    "permuted axes": _clouds(lambda points, *_: points[:, [1, 2, 0]]),
    "clouds 10 % too large": _clouds(lambda points, *_: 1.1 * points),
}
INVERTED = "inverted start"
MOVES_TRUTH = {
    "upside-down clouds": np.diag([1.0, -1.0, -1.0, 1.0]),
    "permuted axes": np.eye(4)[[1, 2, 0, 3]],
}
"""Turns of the clouds, which turn the true pose: a pose that follows them is right."""


def _kinds() -> Iterator[tuple[str, intrinsics.KError, Spoil]]:
    for name, error in intrinsics.ERRORS.items():
        if name != intrinsics.RIGHT:
            yield name, error, _as_they_are
    for name, spoil in KINDS.items():
        yield name, intrinsics.KError(), spoil
    yield INVERTED, intrinsics.KError(), _as_they_are


def _outcome(path: Path, kind: str, cue: CueName, seed: int) -> tuple[str, str]:
    """Calibrate a drive, and say whether it is trusted and right, with the topic that comes first."""
    config = CalibrationConfig(cues=(cue,), seed=seed)
    drive = read_drive(path)
    T_true = np.array(drive.T_camera_lidar) @ inverse(MOVES_TRUTH.get(kind, np.eye(4)))
    start = displace(T_true, intrinsics.START_DEG, intrinsics.START_M, np.random.default_rng(seed))
    initial = InitialPose(inverse(start) if kind == INVERTED else start, "start")
    try:
        found = calibrate(load(drive, config), config, initial_pose=None if cue == "labels" else initial)
    except SemcalError as failure:
        return "not trusted", type(failure).__name__
    error = compare_poses(found.pose, T_true)
    widths = np.zeros(6) if found.uncertainty is None else np.array(found.uncertainty.half_widths)
    is_wrong = (
        error.rotation_deg > np.linalg.norm(widths[3:]) + WRONG_DEG
        or error.camera_center_m > np.linalg.norm(widths[:3]) + WRONG_M
    )
    first = found.topics[0] if found.topics else ""
    if not found.trusted:
        return "not trusted, right" if not is_wrong else "not trusted", first
    if not found.is_camera_confirmed:
        return "trusted, if K is right", first
    return "trusted and wrong" if is_wrong else "trusted and right", first


COLUMNS = (
    "trusted and right",
    "trusted and wrong",
    "trusted, if K is right",
    "not trusted",
    "not trusted, right",
)


def main(
    data: Path,
    *,
    only: tuple[str, ...] = (),
    drive: tuple[str, ...] = (),
    cue: CueName = "edges",
    synthetic: int = 0,
    starts: int = 1,
) -> Iterator[str]:
    """Run all kinds on all drives."""

    def rows() -> Iterator[tuple[object, ...]]:
        with TemporaryDirectory() as folder:
            listed = list(intrinsics.drives(data.resolve(), drive, cue, synthetic, Path(folder)))
            for number, (kind, error, spoil) in enumerate(_kinds()):
                if only and not any(name in kind for name in only):
                    continue
                outcomes, topics = Counter[str](), Counter[str]()
                for source in listed:
                    path = intrinsics.spoiled(
                        source.path, Path(folder) / f"{source.path.name}_{number}", error
                    )
                    document = yaml.safe_load((path / "drive.yaml").read_text())
                    spoil(document, path)
                    (path / "drive.yaml").write_text(yaml.safe_dump(document))
                    for seed in range(starts):
                        outcome, topic = _outcome(path, kind, cue, seed)
                        outcomes[outcome] += 1
                        topics[topic] += bool(topic)
                first = ", ".join(f"{count} {topic}" for topic, count in topics.most_common(4) if count)
                yield kind, *(outcomes[name] for name in COLUMNS), first

    yield from table(" | ".join(("what is wrong", *COLUMNS, "first reason")), rows())


if __name__ == "__main__":
    script(main)
