"""How far the numbers of right and of misread `.bin` files are from the limits of `rust/point_cloud/record_layout.rs`.

    python tests/benchmarks/bin_layouts.py ../shared/data

DATA is a folder with sweeps in float32: x y z intensity in `.bin`, and with ring in `.pcd.bin`. Each is read as it is,
and after it was written with other columns; the reader has to take the first and refuse the others. The table has, of
the information of another number of columns beyond that of the columns that are read, the worst sweep's, in nats. The
last row is a VLP-16 in a street, whose beams fire up and down in turn.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmark import script

from semcal_cli import core
from semcal_cli.errors import InputError
from semcal_cli.experiments.summary import markdown_table
from semcal_cli.geometry.arrays import Array

MAX_COLUMNS = 16
HEADINGS = ("written", "sweeps", "refused", "other columns, worst", "multiples, worst")
VLP16_DEG = (-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15)
"""Elevations of a VLP-16 in the order in which its beams fire. Source: Velodyne's manual, 63-9243."""


def information(words: Array, num_columns: int) -> float:
    """Mutual information of a word's column and its sign and exponent, nats."""
    words = words[: len(words) // num_columns * num_columns]
    counts = np.zeros((num_columns, 512))
    np.add.at(counts, (np.arange(len(words)) % num_columns, words >> 23), 1.0)
    entropies = []
    for table in (counts.sum(0), counts.sum(1), counts):
        shares = table[table > 0.0] / len(words)
        entropies.append(-np.sum(shares * np.log(shares)) + (len(shares) - 1) / (2 * len(words)))
    return float(entropies[0] + entropies[1] - entropies[2])


def excesses(content: bytes, num_columns: int) -> tuple[float, float]:
    """Return how much more the best other number of columns, and the best multiple, tells than the one that is read."""
    words = np.frombuffer(content, "<u4", len(content) // 4)
    known = information(words, num_columns)
    others = {count: information(words, count) - known for count in range(3, MAX_COLUMNS + 1)}
    is_multiple = {count: count % num_columns == 0 for count in others}
    return (
        max(excess for count, excess in others.items() if not is_multiple[count]),
        max(excess for count, excess in others.items() if is_multiple[count] and count > num_columns),
    )


def rewritten(points: Array) -> Iterator[tuple[str, bytes]]:
    """Write the points of a sweep (N, 4) with other columns, as many as make a whole number of records of 16 bytes."""
    generator = np.random.default_rng(0)
    points = points[: len(points) // 4 * 4].astype(np.float64)
    count, colors = len(points), generator.integers(0, 256, (len(points), 3))
    ring, time_s = generator.integers(0, 64, (count, 1)), np.linspace(0.0, 0.1, count)[:, None]
    padding = np.zeros((count, 3))
    columns = {
        "x y z": [points[:, :3]],
        "x y z i ring": [points, ring],
        "x y z r g b": [points[:, :3], colors],
        "x y z i ring time": [points, ring, time_s],
        "x y z r g b label": [points[:, :3], colors, ring],
        "x y z _ i _ _ _ (PCL)": [points[:, :3], padding[:, :1] + 1.0, points[:, 3:], padding],
        "x y z r g b and normals": [points[:, :3], colors / 255.0, generator.normal(size=(count, 3))],
    }
    for name, parts in columns.items():
        yield f"{name}, float32", np.hstack(parts).astype("<f4").tobytes()
    yield "x y z, float64", points[:, :3].astype("<f8").tobytes()
    yield "x y z i, float64", points.astype("<f8").tobytes()


def street_of_vlp16() -> Array:
    """Ray-cast a street between walls with a VLP-16, beam by beam; (N, 4) x y z intensity."""
    azimuths = np.repeat(np.arange(0.0, 2.0 * np.pi, np.radians(0.2)), len(VLP16_DEG))
    elevations = np.radians(np.tile(VLP16_DEG, len(azimuths) // len(VLP16_DEG)))
    walls_m = np.clip(30.0 + 20.0 * np.sin(5.0 * azimuths), 2.0, 60.0)
    ranges_m = np.where(elevations < 0.0, np.minimum(1.8 / np.sin(np.abs(elevations)), walls_m), walls_m)
    x, y = (ranges_m * np.cos(elevations) * along(azimuths) for along in (np.cos, np.sin))
    intensity = np.random.default_rng(0).integers(0, 101, len(x))
    return np.stack([x, y, ranges_m * np.sin(elevations), intensity], axis=1)


def main(data: Path, *, only: str = "") -> Iterator[str]:
    """Yield the table, of all sweeps or of those with a text in their path."""
    measured: dict[str, list[tuple[bool, float, float]]] = {}
    with TemporaryDirectory() as folder:

        def measure(name: str, content: bytes, suffix: str, num_columns: int) -> None:
            path = Path(folder) / f"a{suffix}"
            path.write_bytes(content)
            is_refused = False
            try:
                core.read_point_clouds([(path, None)])
            except InputError:
                is_refused = True
            measured.setdefault(name, []).append((is_refused, *excesses(content, num_columns)))

        for path in sorted(data.rglob("*.bin")):
            if only not in str(path):
                continue
            suffix, num_columns = (".pcd.bin", 5) if path.name.endswith(".pcd.bin") else (".bin", 4)
            measure("as it is", path.read_bytes(), suffix, num_columns)
            points = np.fromfile(path, "<f4").reshape(-1, num_columns)[:, :4]
            for name, content in rewritten(points):
                measure(name, content, ".bin", 4)
        measure("a VLP-16 in a street", street_of_vlp16().astype("<f4").tobytes(), ".bin", 4)
    rows = []
    for name, results in measured.items():
        refused, others, multiples = zip(*results, strict=True)
        worst = max if not any(refused) else min
        rows.append(
            [name, f"{len(results)}", f"{sum(refused)}", f"{worst(others):.2f}", f"{worst(multiples):.2f}"]
        )
    yield from markdown_table(HEADINGS, rows).splitlines()


if __name__ == "__main__":
    script(main)
