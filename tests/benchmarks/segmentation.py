"""Prints a Markdown table: how long sweeps take to segment, and how pure their segments are.

python tests/benchmarks/segmentation.py [--rounds 5] [--frames 20] [--columns 1875]

Synthetic sweeps of 64 x 1875 rays, 120,000 each, unless told otherwise; the same number of rays in other patterns. The
direction of up is estimated within the time. Medians. Purity is the share of points in segments that have the class of
most of their segment, where the classes of the ground are one.
"""

from __future__ import annotations

from collections.abc import Iterator
from statistics import median
from time import perf_counter

import numpy as np
from benchmark import script, table

from semcal_cli import core
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.observations.cues.segments import SegmentationConfig

SEED = 5100
GROUND_CLASSES = ("road", "road_line", "sidewalk", "terrain")
PATTERNS = {"64 rings": {}, "16 rings": {"channels": 16}, "rosette": {"pattern": "rosette"}}


def sweeps(config: SynthConfig) -> list[core.RenderedFrame]:
    camera = core.Camera("plumb_bob", 64, 48, [[32, 0, 31.5], [0, 32, 23.5], [0, 0, 1]], [0.0] * 5)
    forward = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])
    renderer = core.Renderer(camera, forward, config)
    return [renderer.frame(config.seed, number) for number in range(config.num_frames)]


def purity(frames: list[core.RenderedFrame], found: list[core.SegmentedSweep]) -> tuple[float, float]:
    """Share of the points in segments that are of their segment's class, and share of all points that have one."""
    ground = [number for number, name in core.synthetic_classes() if name in GROUND_CLASSES]
    num_pure = num_in_segments = 0
    for frame, sweep in zip(frames, found, strict=True):
        classes = (frame.point_labels & 0xFFFF).astype(np.int64)
        classes[np.isin(classes, ground)] = ground[0]
        has = sweep.ids != core.NO_SEGMENT
        counts = np.zeros((sweep.num_segments, 256), int)
        np.add.at(counts, (sweep.ids[has], classes[has]), 1)
        num_pure += int(counts.max(axis=1, initial=0).sum())
        num_in_segments += int(has.sum())
    return num_pure / num_in_segments, num_in_segments / sum(len(frame.points) for frame in frames)


def row(name: str, config: SynthConfig, rounds: int) -> tuple[str, ...]:
    frames = sweeps(config)
    points = [np.ascontiguousarray(frame.points[:, :3]) for frame in frames]
    times = []
    for _ in range(rounds):
        start = perf_counter()
        found = core.segment_sweeps(points, SegmentationConfig())
        times.append(perf_counter() - start)
    pure, segmented = purity(frames, found)
    num_points, num_segments = (
        sum(counts) / len(frames) for counts in (map(len, points), (each.num_segments for each in found))
    )
    counted = f"{num_points:.0f}", f"{median(times):.2f}", f"{num_segments:.0f}"
    return name, *counted, f"{pure:.3f}", f"{segmented:.3f}"


def main(*, rounds: int = 5, frames: int = 20, columns: int = 1875) -> Iterator[str]:
    header = f"{frames} sweeps | returns of one | s | segments of one | purity | share in segments"
    size = {"num_frames": frames, "columns": columns, "seed": SEED, "width": 64, "height": 48}
    found = (row(name, SynthConfig(**size, **more), rounds) for name, more in PATTERNS.items())
    yield from table(header, found)


if __name__ == "__main__":
    script(main)
