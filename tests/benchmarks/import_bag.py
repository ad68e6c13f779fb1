"""Prints a Markdown table: how long recordings take to import, against reading their bytes, and the peak memory.

    python tests/benchmarks/import_bag.py -o DIR [--gigabytes 5] [--rounds 3] [--only mcap]

Writes recordings of 84 MB a second into DIR: sweeps of 131,072 points ten times a second, and raw images of 1280 x
720 pixels twenty times a second. Both ways start with an empty page cache, where the system allows that; "of reading"
is the time to read all bytes divided by that of the import, whole process and all, in pairs one after another. Medians.
Needs the extra `bag`, and `mcap`.
"""

from __future__ import annotations

import os
import resource
import sys
from collections.abc import Iterator
from pathlib import Path
from shutil import rmtree
from statistics import median
from time import perf_counter

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from bags import NS, START_NS, BagWriter
from benchmark import script, seconds_of, table

from semcal_cli.drive.camera import Camera

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


def row(name: str, path: Path, out: Path, rounds: int) -> tuple[str, ...]:
    pairs = []
    for _ in range(rounds):
        read_s = reading_s(path)
        forget(path)
        pairs.append((read_s, seconds_of("import", "bag", path, "-o", out)))
    gigabytes = sum(file.stat().st_size for file in files(path)) / 1e9
    read, imported = (median(each) for each in zip(*pairs, strict=True))
    share = median(read / imported for read, imported in pairs)
    frames = len(list(out.glob("points/*/*.pcd")))
    peak_mb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024 / 1e6
    times = f"{read:.1f}", f"{imported:.1f}", f"{share:.2f}"
    return name, f"{gigabytes:.2f}", *times, str(frames), f"{peak_mb:.0f}"


def main(
    *,
    output: Path,
    gigabytes: float = 5.0,
    rounds: int = 3,
    points: int = 131_072,
    width: int = 1280,
    only: str = "",
) -> Iterator[str]:
    """Print the table, of all kinds of recordings or one."""

    def rows() -> Iterator[tuple[str, ...]]:
        for name, kind in KINDS.items():
            if only in ("", name):
                folder = output / name
                path = write(folder, kind, gigabytes * 1e9, points, width)
                yield row(name, path, folder / "drive", rounds)
                rmtree(folder)

    yield from table("recording | GB | reading s | import s | of reading | frames | peak MB", rows())


if __name__ == "__main__":
    script(main)
