"""Calibrate a drive from arrays and from its files, in turns, and print seconds and peak memory as a Markdown table.

    python tests/benchmarks/arrays.py --pairs 20

Arrays are loaded before the clock starts. Memory is the peak of a process of its own for each, which loads nothing but
what it calibrates; that of arrays is told without the arrays themselves.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, cast

import cv2
import numpy as np
from benchmark import script, street, table

from semcal_cli.api.calls import calibrate
from semcal_cli.config import CalibrationConfig, CueName
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.held_arrays import ArrayInput
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.reading import read_clouds

MIB = float(1 << 20)


def arrays_of(drive: Drive) -> ArrayInput:
    """Load the files of a synthetic drive as a program would, and give them with what else its document says."""
    found: dict[str, Any] = {}

    def load(argument: str, key: str, read: Any) -> None:
        if drive.frames[0].model_dump()[key] is not None:
            found[argument] = [read(drive.resolve(getattr(frame, key))) for frame in drive.frames]

    if drive.motion is None:
        load("points", "points", lambda path: np.fromfile(path, np.float32).reshape(-1, 4))
    else:
        clouds = read_clouds(drive)
        found["points"] = [np.column_stack([cloud.points, cloud.intensity]) for cloud in clouds]
        found["point_times"] = [cloud.time for cloud in clouds]
    load("point_labels", "point_labels", lambda path: np.fromfile(path, np.uint32) & 0xFFFF)
    load("image_labels", "image_labels", lambda path: cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
    load("images", "image", lambda path: cv2.imread(str(path))[..., ::-1])
    for name in ("point_features", "image_features"):
        load(name, name, np.load)
    for argument, key in (("points_stamps", "points_stamp"), ("image_stamps", "image_stamp")):
        if getattr(drive.frames[0], key) is not None:
            found[argument] = [getattr(frame, key) for frame in drive.frames]
    motion = drive.motion
    if motion is not None and motion.poses is not None:
        found["poses"] = np.loadtxt(drive.resolve(motion.poses))
        motion = motion.model_copy(update={"poses": "poses"})
    keys = ("camera", "lidar", "ignore", "classes", "synchronization", "T_camera_lidar")
    same = {key: getattr(drive, key) for key in keys}
    return {**found, **same, "motion": motion, "time_offset_s": drive.time_offset_s}  # type: ignore[typeddict-item]


def main(
    *, pairs: int = 20, width: int = 1280, cue: tuple[str, ...] = ("labels", "edges"), repeats: int = 5
) -> Iterator[str]:
    """Calibrate by each cue, as `segments,edges`; cues that tell no mountings apart start at the truth."""
    yield f"{pairs} pairs of {width} x {width * 9 // 16} pixels, {repeats} runs of each in turns\n"
    head = "cue | answer | files, s | arrays, s | arrays / files | files, MiB | arrays, MiB beside the data | data, MiB"
    with TemporaryDirectory() as folder:
        drive, T = street(Path(folder) / "drive", 0, pairs, width)
        yield from table(head, (_row(drive, T, each, repeats) for each in cue))


def _row(drive: Drive, T: Pose, cue: str, repeats: int) -> tuple[object, ...]:
    """Time one cue both ways, and measure the memory of a process of its own for either."""
    arrays = arrays_of(drive)
    runs = [(_timed(drive, T, cue), _timed(Drive.from_arrays(**arrays), T, cue)) for _ in range(repeats)]
    files_s, arrays_s = (median(seconds for seconds, _ in each) for each in zip(*runs, strict=True))
    ratio = median(of_arrays / of_files for (of_files, _), (of_arrays, _) in runs)
    is_same = all(of_files == of_arrays for (_, of_files), (_, of_arrays) in runs)
    size = sum(each.nbytes for each in Drive.from_arrays(**arrays).arrays.by_name.values()) / MIB
    with get_context("spawn").Pool(1, maxtasksperchild=1) as processes:
        ways = [(drive.path, T, cue, with_arrays) for with_arrays in (False, True)]
        files_mib, arrays_mib = processes.starmap(_peak_mib, ways, chunksize=1)
    figures = files_s, arrays_s, ratio, files_mib, arrays_mib - size, size
    answer = "the same" if is_same else "another"
    return (cue, answer, *(f"{each:.2f}" for each in figures[:3]), *(f"{each:.0f}" for each in figures[3:]))


def _timed(drive: Drive, T: Pose, cue: str) -> tuple[float, dict[str, Any]]:
    """Calibrate by cues joined by commas, and give the seconds and the answer."""
    start, cues = perf_counter(), tuple(cast(CueName, each) for each in cue.split(","))
    is_searched = "labels" in cues or "segments" in cues
    found = calibrate(
        drive, CalibrationConfig(cues=cues), initial_pose=None if is_searched else InitialPose(T, "the truth")
    )
    return perf_counter() - start, found.model_dump(exclude={"input"})


def _peak_mib(path: Path, T: Pose, cue: str, with_arrays: bool) -> float:
    """Calibrate in this process, and give the most memory that it ever had."""
    drive = read_drive(path)
    if with_arrays:
        drive = Drive.from_arrays(**arrays_of(drive))
    _timed(drive, T, cue)
    found = re.search(r"^VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text(), re.MULTILINE)
    assert found is not None
    return int(found[1]) / 1024.0


if __name__ == "__main__":
    script(main)
