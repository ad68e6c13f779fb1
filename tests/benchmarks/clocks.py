"""Prints a Markdown table: real drives whose images are of another moment, and drives whose clocks are right.

    python tests/benchmarks/clocks.py ../shared/data [--starts 3] [--only NAME]

KITTI raw's right camera drives at 7 to 9 m/s. Each of its sweeps gets the image of the next or of the last one, 0.1 s
away, in each of three drives apart and in all together, as a drive that says nothing of its clocks and as one that says
`hardware`. All real drives follow as they are, each with what its data set says of its clocks. Runs are by edges, from
1 degree and 0.1 m.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from benchmark import script, summary
from real_data import READERS, real_drives

from semcal_cli.config import CalibrationConfig
from semcal_cli.config.synchronization import Synchronization
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.frames import Frame
from semcal_cli.errors import SemcalError
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.experiments.summary import NUMBER, Column, common, count, digits, measure_of, median
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.pipeline import calibrate

KITTI = "kitti_raw_right"
START = (1.0, 0.1)
"""Distance of a start from the published pose, degrees and metres."""
FIRST_SEED = 90


class Run(NamedTuple):
    """What one calibration says."""

    drive: str
    synchronization: str
    camera_center_cm: float = np.inf
    is_trusted: bool = False
    topics: tuple[str, ...] = ()


def runs(name: str, drive: Drive, T_published: Pose, starts: int) -> list[Run]:
    """Calibrate a drive from several starts."""
    made = []
    for seed in range(FIRST_SEED, FIRST_SEED + starts):
        start = InitialPose(displace(T_published, *START, np.random.default_rng(seed)), "start")
        run = Run(name, drive.synchronization)
        try:
            found = calibrate(drive, CalibrationConfig(cues=("edges",), seed=seed), initial_pose=start)
        except SemcalError:
            made.append(run)
            continue
        error_cm = compare_poses(found.pose, T_published).camera_center_cm
        made.append(run._replace(camera_center_cm=error_cm, is_trusted=found.trusted, topics=found.topics))
    return made


def shifted(drive: Drive, late: bool) -> list[Frame]:
    """Pair each sweep with the image of the next one, or of the last one, of the same folder."""
    frames = []
    for first, second in pairwise(drive.frames):
        if Path(first.points).parent == Path(second.points).parent:
            of_sweep, of_image = (first, second) if late else (second, first)
            frames.append(of_sweep.model_copy(update={"image": of_image.image, "image_labels": None}))
    return frames


def with_wrong_images(drive: Drive) -> Iterator[tuple[str, Drive]]:
    """Make the drives whose images are of another moment, with their names."""
    parts = sorted({Path(frame.points).parents[2].name for frame in drive.frames})
    says: Sequence[Synchronization] = ("unknown", "hardware")
    for late in (True, False):
        for part in [*parts, ""]:
            frames = tuple(frame for frame in shifted(drive, late) if part in frame.points)
            name = f"{part[11:].removesuffix('_sync') or 'all three'}, images {'late' if late else 'early'}"
            for synchronization in says:
                update = {"frames": frames, "classes": None, "synchronization": synchronization}
                yield name, drive.model_copy(update=update)


def _says(topic: str) -> Column:
    return count(topic, lambda run: topic in run.topics)


COLUMNS = (
    common("drive", "real drive"),
    common("synchronization", "synchronization"),
    NUMBER,
    Column("camera centre, cm: median", {"cm": measure_of("camera_center_cm", median)}, digits(1)),
    count("trusted", lambda run: run.is_trusted),
    _says("untied-clocks"),
    _says("other-names"),
)


def main(data: Path, *, starts: int = 3, only: str = "") -> Iterator[str]:
    with TemporaryDirectory() as folder:
        yield from summary(_groups(data.resolve(), Path(folder), starts, only), COLUMNS)


def _groups(data: Path, folder: Path, starts: int, only: str) -> Iterator[list[Run]]:
    for name in ("shifted", "right"):
        (folder / name).mkdir()
    if (data / KITTI).is_dir():
        (real,) = READERS[KITTI](data / KITTI, folder / "shifted")
        for name, drive in with_wrong_images(read_drive(real.path)):
            if only in name:
                yield runs(name, drive, read_transform(real.path), starts)
    for real in real_drives(data, folder / "right"):
        if only in real.name:
            yield runs(real.name, read_drive(real.path), read_transform(real.path), starts)


if __name__ == "__main__":
    script(main)
