"""Prints Markdown tables: how long point clouds take to read, beside what else reads them.

pip install pypcd4 plyfile && python tests/benchmarks/point_clouds.py [--rounds 15]

Warm cache, one thread. Every contender ends in owned x y z (N, 3) float32 without no-returns, and labels where the file
has them. Formats whose contender is not installed are left out. Contenders take turns, so that a busy machine is busy
for all; medians, and their ratio. The sweep is made: 64 x 2048 entries unless told otherwise, four tenths no-returns,
as an Ouster's.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np
import numpy.typing as npt
from benchmark import script, table

from semcal_cli import core

try:
    from pypcd4 import Encoding, PointCloud
except ImportError:
    PointCloud = None
try:
    from plyfile import PlyData, PlyElement
except ImportError:
    PlyData = None

NUM_FRAMES = 20
RECORD = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("label", "<u2")]
)
Arrays = tuple[npt.NDArray[np.float32], npt.NDArray[np.integer]] | npt.NDArray[np.float32]


def sweep(num_columns: int) -> npt.NDArray[np.void]:
    """An organised sweep of 64 rows in which rays come back in runs."""
    rng = np.random.default_rng(0)
    rows, columns = np.mgrid[:64, :num_columns]
    azimuth, elevation = columns * 2 * np.pi / num_columns, np.radians(16.6 - rows * 33.2 / 63)
    depth = 10 + 5 * np.sin(5 * azimuth) + rng.normal(0, 0.02, rows.shape)
    cloud = np.zeros(rows.shape, RECORD)
    cloud["x"] = depth * np.cos(elevation) * np.cos(azimuth)
    cloud["y"] = depth * np.cos(elevation) * np.sin(azimuth)
    cloud["z"] = depth * np.sin(elevation)
    cloud["intensity"], cloud["ring"] = rng.integers(0, 800, rows.shape), rows
    cloud["label"] = (columns // 100 + rows // 20) % 20
    cloud[np.sin(9 * azimuth + rows / 20) > 0.3] = 0
    return cloud.ravel()


def returns(points: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    return np.isfinite(points).all(axis=1) & (points != 0).any(axis=1)


def by_core(path: Path) -> Callable[[], object]:
    return lambda: core.read_point_clouds([(path, None)])


def by_numpy(path: Path) -> Arrays:
    points = np.fromfile(path, np.float32).reshape(-1, 4)
    return points[returns(points[:, :3]), :3].copy()


def by_pypcd4(path: Path) -> Arrays:
    cloud = PointCloud.from_path(path)
    points = cloud.numpy(("x", "y", "z")).astype(np.float32, copy=False)
    keep = returns(points)
    return points[keep], cloud.pc_data["label"][keep]


def by_plyfile(path: Path) -> Arrays:
    vertices = PlyData.read(str(path))["vertex"].data
    points = np.stack([vertices["x"], vertices["y"], vertices["z"]], axis=1)
    keep = returns(points)
    return points[keep], vertices["label"][keep]


Contender = tuple[Path, Callable[[Path], Arrays], str]


def write_all(cloud: npt.NDArray[np.void], folder: Path) -> dict[str, Contender]:
    """Write the sweep in all formats, and give the contender of each."""
    np.stack([cloud[name] for name in ("x", "y", "z", "intensity")], axis=1).tofile(folder / "a.bin")
    return {
        "KITTI .bin": (folder / "a.bin", by_numpy, "numpy.fromfile, mask, copy"),
        **(write_pcd(cloud, folder) if PointCloud is not None else {}),
        **(write_ply(cloud, folder) if PlyData is not None else {}),
    }


def write_pcd(cloud: npt.NDArray[np.void], folder: Path) -> dict[str, Contender]:
    names = list(RECORD.names or ())
    made = PointCloud.from_points(
        [cloud[name] for name in names], names, [RECORD[name].type for name in names]
    )
    found = {}
    for file, encoding in (("a", Encoding.ASCII), ("b", Encoding.BINARY), ("c", Encoding.BINARY_COMPRESSED)):
        made.save(folder / f"{file}.pcd", encoding=encoding)
        found[f"PCD {encoding.value}"] = folder / f"{file}.pcd", by_pypcd4, "pypcd4"
    return found


def write_ply(cloud: npt.NDArray[np.void], folder: Path) -> dict[str, Contender]:
    found = {}
    for file, encoding in (("a", "ascii"), ("b", "binary")):
        ply = PlyData([PlyElement.describe(cloud, "vertex")], text=encoding == "ascii")
        ply.write(str(folder / f"{file}.ply"))
        found[f"PLY {encoding}"] = folder / f"{file}.ply", by_plyfile, "plyfile"
    return found


def alternate(contenders: list[Callable[[], object]], rounds: int) -> list[float]:
    """The median milliseconds of each, after a round that warms up."""
    milliseconds: list[list[float]] = [[] for _ in contenders]
    for _ in range(rounds + 1):
        for contender, times in zip(contenders, milliseconds, strict=True):
            start = perf_counter()
            contender()
            times.append(1e3 * (perf_counter() - start))
    return [median(times[1:]) for times in milliseconds]


def threaded(paths: list[Path], num_threads: int) -> Callable[[], object]:
    def read() -> None:
        core.set_num_threads(num_threads)
        core.read_point_clouds([(path, None) for path in paths])

    return read


def formats(cloud: npt.NDArray[np.void], folder: Path, rounds: int) -> Iterator[tuple[str, ...]]:
    for name, (path, rival, who) in write_all(cloud, folder).items():
        few = rounds if "ascii" not in name else max(3, rounds // 5)
        ours, theirs = alternate([by_core(path), partial(rival, path)], few)
        yield name, f"{ours:.2f}", who, f"{theirs:.2f}", f"{theirs / ours:.2f}"


def threads(folder: Path, rounds: int) -> Iterator[tuple[str, ...]]:
    for name, file in (("KITTI .bin", "a.bin"), ("PCD binary_compressed", "c.pcd"), ("PLY ascii", "a.ply")):
        if (folder / file).exists():
            paths = [folder / file] * NUM_FRAMES
            one, two = alternate([threaded(paths, 1), threaded(paths, 2)], rounds)
            yield name, f"{one:.1f}", f"{two:.1f}", f"{one / two:.2f}"


def main(*, rounds: int = 15, columns: int = 2048) -> Iterator[str]:
    """Print both tables, of a sweep of so many columns."""
    core.set_num_threads(1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        yield from table(
            "one sweep | semcal, ms | beside | ms | ratio", formats(sweep(columns), folder, rounds)
        )
        yield ""
        header = f"{NUM_FRAMES} sweeps | 1 thread, ms | 2 threads, ms | ratio"
        yield from table(header, threads(folder, rounds))
    for package, module in (("pypcd4", PointCloud), ("plyfile", PlyData)):
        if module is None:
            yield f"\n{package} is not installed: its formats are left out"


if __name__ == "__main__":
    script(main)
