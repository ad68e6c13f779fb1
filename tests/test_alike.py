"""Frames of one scene: the share of directions in which two sweeps see the same range."""

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.observations.scenes import alike_frames

NUM_DIRECTIONS = 20


def ring(ranges_m: npt.ArrayLike) -> npt.NDArray[np.float32]:
    """One point in the middle of each of 20 cells of directions; none where the range is 0."""
    angles = np.radians(18.0 * np.arange(NUM_DIRECTIONS) + 1.0)
    points = np.asarray(ranges_m)[:, None] * np.stack([np.cos(angles), np.sin(angles), np.full(20, 0.02)], 1)
    return points[np.asarray(ranges_m) > 0.0].astype(np.float32)


def test_the_share_is_of_directions_that_either_frame_sees() -> None:
    whole, fewer = np.full(NUM_DIRECTIONS, 10.0), np.full(NUM_DIRECTIONS, 10.0)
    # Unseen, another range, and one within the tolerance.
    fewer[:4], fewer[4:9], fewer[9:12] = 0.0, 11.0, 10.1
    unseen = np.zeros(NUM_DIRECTIONS)
    shares = core.shares_alike(core.nearest_ranges([ring(each) for each in (whole, fewer, unseen)]))
    np.testing.assert_array_equal(shares, [[1.0, 11 / 20, 0.0], [11 / 20, 1.0, 0.0], [0.0, 0.0, 0.0]])


def test_frames_show_one_scene_by_way_of_others() -> None:
    """Each changes a quarter of what the one before it sees: alike enough with that one alone."""
    ranges = np.full((4, NUM_DIRECTIONS), 10.0)
    ranges[1:, :5], ranges[2:, 5:10], ranges[3:] = 12.0, 12.0, 20.0
    first, second, third, other = (ring(each) for each in ranges)
    assert alike_frames(core.nearest_ranges([first, other, third, second])) == [0, 1, 0, 0]
    assert alike_frames(core.nearest_ranges([first, other, third])) == [0, 1, 2]
    assert alike_frames(core.nearest_ranges([first])) == [0]
    assert alike_frames(core.nearest_ranges([])) == []
