"""The points of a frame at one or more poses: where they land, whether they agree, and how far away they are."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from semcal_cli.drive.frame_selection import evenly_spaced
from semcal_cli.report.overlay import View, kinds_of
from semcal_cli.report.palette import AGREES, DISAGREES, HIDDEN, depth_levels

NOT_SEEN = 255
"""Kind of a point outside the picture."""
TOP = 65_535
"""Largest number of the packed positions: that of the picture's longer side."""


@dataclass(frozen=True)
class PosePoints:
    """Points of a frame at one pose, all arrays in one order."""

    positions: npt.NDArray[np.float64]
    """(N, 2), (u, v); an integer pixel is a pixel centre."""
    kinds: npt.NDArray[np.uint8]
    """(N,) an index in `AGREEMENT_COLORS`, `NO_PAIR`, or `NOT_SEEN`."""
    levels: npt.NDArray[np.uint8]
    """(N,) see `depth_levels`."""

    @property
    def is_visible(self) -> npt.NDArray[np.bool_]:
        """(N,) whether a point is in the picture and not hidden."""
        return np.asarray((self.kinds != NOT_SEEN) & (self.kinds != HIDDEN))

    @property
    def num_agreeing(self) -> int:
        """Number of visible points whose class and that of their pixel go together."""
        return int((self.kinds == AGREES).sum())

    @property
    def num_judged(self) -> int:
        """Number of visible points with a label on both sides."""
        return self.num_agreeing + int((self.kinds == DISAGREES).sum())

    @property
    def agreement(self) -> float | None:
        """Share of the visible points that agree; None if none has labels on both sides."""
        return self.num_agreeing / self.num_judged if self.num_judged else None


@dataclass(frozen=True)
class FramePoints:
    """Points of a frame that some pose puts into the picture, farthest first."""

    indices: npt.NDArray[np.intp]
    """(N,) index of each point in its cloud."""
    classes: npt.NDArray[np.uint8]
    """(N,) class of each point."""
    poses: tuple[PosePoints, ...]

    def thinned(self, count: int, is_first: npt.NDArray[np.bool_] | None = None) -> FramePoints:
        """Keep at most this number of points, evenly spaced in their order: those of a mask (N,) before all others."""
        first = np.zeros(len(self.classes), bool) if is_first is None else is_first
        chosen = evenly_spaced(np.flatnonzero(first).tolist(), count)
        others = evenly_spaced(np.flatnonzero(~first).tolist(), count - len(chosen))
        kept = np.sort(np.array([*chosen, *others], np.intp))
        poses = (PosePoints(p.positions[kept], p.kinds[kept], p.levels[kept]) for p in self.poses)
        return FramePoints(self.indices[kept], self.classes[kept], tuple(poses))

    def moved_px(self) -> npt.NDArray[np.float64]:
        """Distances, in pixels, between the first and the last pose, of points that both show."""
        first, last = self.poses[0], self.poses[-1]
        both = first.is_visible & last.is_visible
        return np.asarray(np.linalg.norm(last.positions[both] - first.positions[both], axis=1))

    def packed(self, width: int, height: int) -> dict[str, object]:
        """Write the arrays as base64 for a page's script; positions as uint16 from the picture's corner."""
        scale = TOP / max(width, height)
        return {
            "scale": scale,
            "classes": packed(self.classes),
            "poses": [
                {
                    "positions": packed(_packable(pose.positions, scale)),
                    "kinds": packed(pose.kinds),
                    "levels": packed(pose.levels),
                }
                for pose in self.poses
            ],
        }


def frame_points(views: Sequence[View], frame: int, together: npt.NDArray[np.bool_]) -> FramePoints:
    """Project the points of a frame.

    Args:
        views: Poses, and the same points and label images as their cameras see them.
        frame: Number of the frame, from 0.
        together: Classes of points (rows) and of pixels that go together, as `goes_together` tells.
    """
    observations = views[-1].observations
    cloud = observations.clouds[frame]
    seen = [view.seen_in_frame(frame) for view in views]
    # Farthest first at the last pose, after what only another pose shows.
    order = seen[-1].indices
    for each in seen[:-1]:
        order = np.concatenate([each.indices[~np.isin(each.indices, order)], order])
    found = []
    for each in seen:
        positions = np.zeros((cloud.num_points, 2))
        kinds = np.full(cloud.num_points, NOT_SEEN, np.uint8)
        levels = np.zeros(cloud.num_points, np.uint8)
        positions[each.indices] = each.positions
        kinds[each.indices] = np.where(each.is_hidden, HIDDEN, kinds_of(observations, frame, each, together))
        levels[each.indices] = depth_levels(each.ranges_m)
        found.append(PosePoints(positions[order], kinds[order], levels[order]))
    return FramePoints(order, cloud.classes[order], tuple(found))


def _packable(positions: npt.NDArray[np.float64], scale: float) -> npt.NDArray[np.uint16]:
    return np.clip(np.rint((positions + 0.5) * scale), 0, TOP).astype("<u2")


def packed(array: npt.NDArray[np.generic]) -> str:
    """Write an array as base64."""
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
