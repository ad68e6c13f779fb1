"""Segments of synthetic sweeps are pure: nearly every point's class is that of most of its segment's points."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from semcal_cli import core
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.observations.cues.segments import SegmentationConfig

CONFIG = SegmentationConfig()
SMALL = SynthConfig(num_frames=2, seed=5100, width=64, height=48)
CLASS_IDS = {name: number for number, name in core.synthetic_classes()}
GROUND_CLASSES = {CLASS_IDS[name]: CLASS_IDS["road"] for name in ("road_line", "sidewalk", "terrain")}
"""Classes of the ground are one here: geometry tells no road from the line on it, nor from the lawn beside it."""
PATTERNS = {
    "64 rings": SMALL,
    "16 rings": replace(SMALL, channels=16),
    "rosette": replace(SMALL, pattern="rosette"),
}
LEAST_PURITY, LEAST_SHARE = 0.93, 0.88
EVERY_WAY_UP = {
    "upright": np.eye(3),
    "upside down": np.diag([1.0, -1.0, -1.0]),
    "on its side": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
}

Sweep = tuple[NDArray[np.float32], NDArray[np.int64]]


def sweeps(config: SynthConfig) -> list[Sweep]:
    """Points and classes."""
    camera = core.Camera("plumb_bob", 64, 48, [[32, 0, 31.5], [0, 32, 23.5], [0, 0, 1]], [0.0] * 5)
    forward = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])
    renderer = core.Renderer(camera, forward, config)
    frames = [renderer.frame(config.seed, number) for number in range(config.num_frames)]
    return [
        (np.ascontiguousarray(f.points[:, :3]), (f.point_labels & 0xFFFF).astype(np.int64)) for f in frames
    ]


@pytest.mark.parametrize("pattern", PATTERNS)
def test_segments_are_pure(pattern: str) -> None:
    all_sweeps = sweeps(PATTERNS[pattern])
    num_pure = num_in_segments = num_points = 0
    for (_, classes), found in zip(
        all_sweeps, core.segment_sweeps([points for points, _ in all_sweeps], CONFIG), strict=True
    ):
        merged = np.array([GROUND_CLASSES.get(number, number) for number in range(256)])[classes]
        has = found.ids != core.NO_SEGMENT
        counts = np.zeros((found.num_segments, 256), int)
        np.add.at(counts, (found.ids[has], merged[has]), 1)
        num_pure += counts.max(axis=1).sum()
        num_in_segments += has.sum()
        num_points += len(classes)
    assert num_pure / num_in_segments > LEAST_PURITY
    assert num_in_segments / num_points > LEAST_SHARE


@pytest.mark.parametrize("way_up", EVERY_WAY_UP)
def test_up_is_found_whichever_way_the_lidar_is_mounted(way_up: str) -> None:
    rotation = EVERY_WAY_UP[way_up]
    turned = [(points @ rotation.T).astype(np.float32) for points, _ in sweeps(SMALL)]
    up = core.estimate_up(turned)
    assert up is not None
    assert up.direction @ rotation[:, 2] > np.cos(np.radians(4.0))
    assert 1.0 < up.height_m < 3.0
    found = core.segment_sweeps(turned, CONFIG)[0]
    assert found.up == pytest.approx(up.direction)
    assert set(found.kinds) == {core.GROUND, core.OBJECT}


def test_returns_that_are_none_have_no_segment() -> None:
    bad = np.array([[0, 0, 0], [np.nan, 1, 1], [np.inf, 0, 0], [1e38, 1e38, 1e38]], np.float32)
    points = np.concatenate([bad, sweeps(SMALL)[0][0]])
    (segmented,) = core.segment_sweeps([points], CONFIG)
    assert set(segmented.ids[:4]) == {core.NO_SEGMENT}
    (empty,) = core.segment_sweeps([np.zeros((0, 3), np.float32)], CONFIG)
    assert empty.num_segments == len(empty.ids) == 0
    assert empty.up is None
