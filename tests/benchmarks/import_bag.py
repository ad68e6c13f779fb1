"""Prints a Markdown table: how long recordings take to import, against reading their bytes, and the peak memory.

    python tests/benchmarks/import_bag.py -o DIR [--gigabytes 5] [--rounds 3] [--only mcap] [--kitti DIR] [--before DIR]

Writes recordings of 84 MB a second into DIR: sweeps of 131,072 points ten times a second, and raw images of 1280 x
720 pixels twenty times a second. With `--kitti` they are the frames of KITTI object in this folder, over and over, a
tenth of a second apart, besides an inertial sensor and transforms a hundred times a second, and poses each second.
`--before` also imports with an earlier version, whose core is built in this checkout, in turns, and tells the ratio of
processor times. Both ways start with an empty page cache, where the system allows that; "of reading"
is the time to read all bytes divided by that of the import, whole process and all, in pairs one after another. Medians.
Needs the extra `bag`, and `mcap`.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from itertools import cycle
from pathlib import Path
from shutil import rmtree
from statistics import median
from time import perf_counter

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from bags import NS, START_NS, BagWriter, header
from benchmark import SEMCAL, Ended, run_process, script, table

from semcal_cli.drive.camera import Camera
from semcal_cli.files.image_files import read_image

RECORD = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("time", "<f4")]
KINDS = {"mcap": "mcap library", "ros1": "ros1", "sqlite3": "sqlite3"}
BLOCK_BYTES = 1 << 20


def write(folder: Path, kind: str, num_bytes: float, num_points: int, width: int) -> Path:
    """Write a recording of about so many bytes."""
    folder.mkdir(parents=True)
    height = width * 9 // 16
    generator = np.random.default_rng(1)
    cloud = np.zeros(num_points, RECORD)
    for axis in "xyz":
        cloud[axis] = generator.normal(0.0, 20.0, num_points)
    cloud["time"] = np.linspace(0.0, 0.1, num_points)
    base = generator.integers(0, 255, (height, width, 3), np.uint8)
    K = ((width / 2, 0.0, width / 2), (0.0, width / 2, height / 2), (0.0, 0.0, 1.0))
    camera = Camera(model="plumb_bob", width=width, height=height, K=K)
    with BagWriter(folder, kind) as bag:
        written, index = 0, 0
        while written < num_bytes or index < 4:
            stamp = START_NS + index * NS // 20
            bag.write("/camera/camera_info", bag.camera_info(camera, stamp), stamp)
            # A block of its own brightness wanders through the noise, so that images differ.
            base[:, (index * 8) % width : (index * 8) % width + 8] = index % 256
            bag.write("/camera/image_raw", bag.image(base, "bgr8", stamp), stamp + NS // 100)
            written += base.nbytes
            if index % 2 == 0:
                bag.write("/points", bag.cloud(cloud, stamp), stamp + NS // 50)
                written += cloud.nbytes
            index += 1
    return bag.path


def write_kitti(folder: Path, kind: str, num_bytes: float, kitti: Path) -> Path:
    """Write a recording of about so many bytes, of the frames of KITTI object."""
    folder.mkdir(parents=True)
    frames = []
    for path in sorted((kitti / "velodyne").glob("*.bin")):
        records = np.fromfile(path, "<f4").view([(name, "<f4") for name in ("x", "y", "z", "intensity")])
        frames.append((records, read_image(kitti / "image_2" / f"{path.stem}.png")))
    frames = [frame for frame in frames if frame[1].shape == frames[0][1].shape]
    height, width = frames[0][1].shape[:2]
    (P2,) = re.findall("^P2: (.*)$", (kitti / "calib.txt").read_text(), re.MULTILINE)
    K = np.array(P2.split(), float).reshape(3, 4)[:, :3]
    camera, written = Camera(model="plumb_bob", width=width, height=height, K=K.tolist()), 0
    with BagWriter(folder, kind) as bag:
        for index, (cloud, pixels) in enumerate(cycle(frames)):
            if written >= num_bytes:
                break
            stamp = START_NS + index * NS // 10
            bag.write("/camera/camera_info", bag.camera_info(camera, stamp), stamp)
            bag.write("/points", bag.cloud(cloud, stamp), stamp)
            bag.write("/camera/image_raw", bag.image(pixels, "bgr8", stamp), stamp)
            if index % 10 == 0:
                bag.write("/pose", bag.pose(np.eye(4), stamp), stamp)
            for small in range(stamp, stamp + NS // 10, NS // 100):
                bag.write("/imu", bag.make("sensor_msgs/msg/Imu", header=header(small, "imu")), small)
                bag.write("/tf", bag.transforms({("base", "wheel"): np.eye(4)}, small), small)
            written += cloud.nbytes + pixels.nbytes
    return bag.path


def files(path: Path) -> list[Path]:
    return sorted(path.iterdir()) if path.is_dir() else [path]


def forget(path: Path) -> None:
    """Empty the page cache of a recording, where the system allows that."""
    for file in files(path):
        with file.open("rb") as stream:
            os.fsync(stream.fileno())
            if hasattr(os, "posix_fadvise"):
                os.posix_fadvise(stream.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def reading_s(path: Path) -> float:
    forget(path)
    start = perf_counter()
    for file in files(path):
        with file.open("rb", buffering=0) as stream:
            while stream.read(BLOCK_BYTES):
                pass
    return perf_counter() - start


def imported(path: Path, out: Path, source: str = "") -> Ended:
    """Import a recording by the installed semcal, or by that of a checkout."""
    forget(path)
    environment = ["env", f"PYTHONPATH={source}"] if source else []
    return run_process([*environment, *SEMCAL, "import", "bag", str(path), "-o", str(out), "-q"])


def row(name: str, path: Path, out: Path, rounds: int, before: str) -> tuple[str, ...]:
    reads, ends, ratios = [], [], []
    for _ in range(rounds):
        reads.append(reading_s(path))
        ends.append(imported(path, out))
        if before:
            ratios.append(ends[-1].cpu_s / imported(path, out.with_name("before"), before).cpu_s)
    gigabytes = sum(file.stat().st_size for file in files(path)) / 1e9
    read, import_s = median(reads), median(end.seconds for end in ends)
    share = median(read_s / end.seconds for read_s, end in zip(reads, ends, strict=True))
    frames = len(list(out.glob("points/*/*.pcd")))
    peak_mb = max(end.peak_gib for end in ends) * 2**30 / 1e6
    times = f"{read:.1f}", f"{import_s:.1f}", f"{share:.2f}", f"{1000 * gigabytes / import_s:,.0f}"
    shown = [f"{median(ratios):.3f}"] if before else []
    return name, f"{gigabytes:.2f}", *times, str(frames), f"{peak_mb:.0f}", *shown


def main(
    *,
    output: Path,
    gigabytes: float = 5.0,
    rounds: int = 3,
    points: int = 131_072,
    width: int = 1280,
    only: str = "",
    kitti: str = "",
    before: str = "",
) -> Iterator[str]:
    """Print the table, of all kinds of recordings or one."""

    def rows() -> Iterator[tuple[str, ...]]:
        for name, kind in KINDS.items():
            if only in ("", name):
                folder, num_bytes = output / name, gigabytes * 1e9
                if kitti:
                    path = write_kitti(folder, kind, num_bytes, Path(kitti))
                else:
                    path = write(folder, kind, num_bytes, points, width)
                yield row(name, path, folder / "drive", rounds, before)
                rmtree(folder)

    head = "recording | GB | reading s | import s | of reading | MB/s | frames | peak MB"
    yield from table(f"{head} | of before" if before else head, rows())


if __name__ == "__main__":
    script(main)
