"""Compare what edges of sweeps and of images may be, on real drives and a synthetic one, by where their tops lie.

    python tests/benchmarks/edge_ideas.py ../shared/data -o docs/pictures/edge_ideas.png

The table tells for each idea how far the top near the published pose lies from it, by how many standard errors the
highest other top is behind, and how many of some single ascents come back. The image shows the mutual information
along six axes through the published pose, over its range.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from benchmark import script, street, table
from profiles import draw_profiles, profiles
from real_data import real_drives

from semcal_cli import core
from semcal_cli.config import PolishConfig
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.estimation.refine.pyramid import ExactEstimator, refine_pose
from semcal_cli.estimation.refine.several_starts import pyramid_of
from semcal_cli.estimation.uncertainty.information import sigmas_behind
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.cues.edges import EDGES, STARTS, observe_edges
from semcal_cli.observations.cues.intensity import grey_values
from semcal_cli.observations.frame_selection import with_frames
from semcal_cli.observations.observations import NO_CLASS, LabelledCloud, LabelledImage, Observations

START_DEG, START_M = 2.0, 0.2
SAME_DEG, SAME_CM = 0.5, 15.0
"""Errors within which an ascent has come back to the top."""
RANGE_ALONE, INTENSITY_ALONE = replace(EDGES, intensity_shares=()), replace(EDGES, range_steps_m=())
QUARTER_TURN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turns elevations near the horizon straight ahead into azimuths."""


def with_points(
    seen: Observations, classes_of: Callable[[int, LabelledCloud], np.ndarray], names: list[str]
) -> Observations:
    """The same images with other classes of points."""
    clouds = [each.with_classes(classes_of(index, each)) for index, each in enumerate(seen.clouds)]
    return replace(seen.with_clouds(clouds), point_class_names=names)


def with_images(
    drive: Drive, seen: Observations, levels_of: Callable[[np.ndarray], np.ndarray]
) -> Observations:
    """The same points with other classes of pixels, from the grey values."""
    levels = [levels_of(grey_values(drive, frame)).astype(np.uint8) for frame in drive.frames]
    images = [LabelledImage(each, core.ClassShares.certain(each.ravel())) for each in levels]
    return replace(
        seen.with_images(images), image_class_names=[str(level) for level in range(EDGES.num_levels)]
    )


def any_gradient(drive: Drive) -> Observations:
    """The cue beside gradients in any direction."""
    return with_images(drive, observe_edges(drive), lambda grey: _levels(_gradient(grey, (0, 1))))


def between_rings(drive: Drive) -> Observations:
    """Steps in range from ring to ring, beside gradients from top to bottom."""
    upright = with_images(
        drive, observe_edges(drive, config=RANGE_ALONE), lambda grey: _levels(_gradient(grey, (1,)))
    )

    def classes_of(index: int, cloud: LabelledCloud) -> np.ndarray:
        turned = np.ascontiguousarray(cloud.points @ QUARTER_TURN.T.astype(np.float32))
        (steps,) = core.edge_steps([(turned, None, None)], EDGES.same_surface_m)
        ranges = np.linalg.norm(cloud.points, axis=1)
        # Rings lie far apart, so that the ground steps from one to the next as well.
        found = np.digitize(
            np.where(np.isfinite(steps.range_m), steps.range_m, 0.0) - 0.03 * ranges, EDGES.range_steps_m
        )
        return np.where(np.isnan(steps.range_m), NO_CLASS, found).astype(np.uint8)

    return with_points(upright, classes_of, ["none", "1", "2", "3"])


def distance_to_edge(drive: Drive) -> Observations:
    """The cue beside distances to the next edge of the image (Levinson and Thrun, 2013) instead of gradients."""

    def levels_of(grey: np.ndarray) -> np.ndarray:
        gradient = _gradient(grey, (0,))
        is_peak = (gradient >= np.roll(gradient, 1, 1)) & (gradient >= np.roll(gradient, -1, 1))
        is_edge = is_peak & (gradient > np.quantile(gradient, 0.88))
        distance = cv2.distanceTransform((~is_edge).astype(np.uint8), cv2.DIST_L2, 5)
        return np.digitize(distance, [0.7, 1.2, 1.8, 2.5, 4.0, 7.0, 12.0])

    return with_images(drive, observe_edges(drive), levels_of)


def creases(drive: Drive) -> Observations:
    """Angles between planes that meet along the scan (after Yuan et al., 2021), without steps in range."""

    def classes_of(index: int, cloud: LabelledCloud) -> np.ndarray:
        points = cloud.points.astype(np.float64)
        order = np.lexsort((np.arctan2(points[:, 1], points[:, 0]), np.round(_elevation(points), 3)))
        before, here, after = (points[np.roll(order, shift)] for shift in (3, 0, -3))
        ranges = [np.linalg.norm(each, axis=1) for each in (before, here, after)]
        is_surface = np.ptp(ranges, axis=0) < EDGES.same_surface_m
        left, right = before - here, after - here
        lengths = np.linalg.norm(left, axis=1) * np.linalg.norm(right, axis=1)
        cosine = -np.einsum("ij,ij->i", left, right) / np.maximum(lengths, 1e-9)
        classes = np.full(len(points), NO_CLASS, np.uint8)
        angles = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        classes[order] = np.where(is_surface, np.digitize(angles, [20.0, 40.0, 60.0]), NO_CLASS)
        return classes

    return with_points(observe_edges(drive, config=RANGE_ALONE), classes_of, ["flat", "20", "40", "60"])


IDEAS: dict[str, Callable[[Drive], Observations]] = {
    "steps in range and intensity (the cue)": lambda drive: observe_edges(drive),
    "steps in range": lambda drive: observe_edges(drive, config=RANGE_ALONE),
    "steps in intensity": lambda drive: observe_edges(drive, config=INTENSITY_ALONE),
    "the cue, gradients in any direction": any_gradient,
    "the cue, distance to the next edge": distance_to_edge,
    "steps between rings, gradients downwards": between_rings,
    "planes that meet": creases,
}


def _gradient(grey: np.ndarray, axes: tuple[int, ...]) -> np.ndarray:
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), 1.0)
    parts = [cv2.Sobel(smooth, cv2.CV_32F, 1 - axis, axis, ksize=3) for axis in axes]
    strength = np.sqrt(sum(part**2 for part in parts))
    beside = strength / (cv2.GaussianBlur(strength, (0, 0), 75.0) + 2.0)
    return np.asarray(cv2.GaussianBlur(beside, (0, 0), 1.0))


def _levels(strength: np.ndarray) -> np.ndarray:
    shares = np.linspace(0.0, 1.0, EDGES.num_levels + 1)[1:-1]
    return np.asarray(np.digitize(strength, np.quantile(strength, shares)))


def _elevation(points: np.ndarray) -> np.ndarray:
    return np.asarray(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))


def measure(seen: Observations, T: Pose, num_starts: int) -> tuple[str, str, str]:
    """Find the top near the published pose, and ascend from poses around it: cells of the table."""
    pyramid, coarse = pyramid_of(STARTS), STARTS.coarse
    assert coarse is not None
    top = newton(seen, T, PolishConfig()).T_camera_lidar
    starts = [displace(T, START_DEG, START_M, np.random.default_rng(seed)) for seed in range(num_starts)]
    ends = [
        refine_pose(seen, start, ExactEstimator(seen, coarse, 0), pyramid).T_camera_lidar for start in starts
    ]
    away = [compare_poses(end, top) for end in ends]
    is_back = [each.rotation_deg < SAME_DEG and each.camera_center_cm < SAME_CM for each in away]
    others = [end for end, back in zip(ends, is_back, strict=True) if not back]
    error = compare_poses(top, T)
    behind = min(sigmas_behind(seen, top, others), default=np.inf)
    off = f"{error.rotation_deg:.2f} deg, {error.camera_center_cm:.1f} cm"
    return off, f"{behind:.1f}", f"{sum(is_back)} of {num_starts}"


def drives(data: Path, folder: Path, only: str, num_frames: int) -> Iterator[tuple[str, Drive, Pose]]:
    """The real drives, and a synthetic one."""
    for found in real_drives(data, folder):
        is_kitti = found.name.startswith("KITTI") and "DiCENet" not in found.name
        if is_kitti and only in found.name:
            drive = read_drive(found.path)
            some = with_frames(drive, range(min(num_frames, len(drive.frames))))
            yield found.name, some, read_transform(found.path)
    if only in "synthetic":
        yield "synthetic, 12 pairs", *street(folder / "synthetic", 95_000, min(num_frames, 12), 1280)


def main(
    data: Path, *, output: Path, only: str = "", max_frames: int = 70, starts: int = 12, steps: int = 8
) -> Iterator[str]:
    """Print the table, and draw the profiles, `steps` poses to either side."""
    curves: dict[str, dict[str, list[tuple[np.ndarray, np.ndarray]]]] = {}

    def rows(folder: Path) -> Iterator[tuple[str, ...]]:
        for name, drive, T in drives(data.resolve(), folder, only, max_frames):
            for idea, observe in IDEAS.items():
                seen = observe(drive)
                yield name, idea, *measure(seen, T, starts)
                curves.setdefault(name, {})[idea] = profiles(partial(information, seen), T, steps)

    with TemporaryDirectory() as folder:
        header = "drive | edges | top | other tops behind, sigmas | ascents that return"
        yield from table(header, rows(Path(folder)))
    draw_profiles(curves, output, head=1.2, linewidth=1.2)
    yield f"written to {output}"


def information(seen: Observations, T: Pose) -> float:
    """Mutual information at a pose, less its bias."""
    agreement = core.agreement(seen.core, T)
    return agreement.mutual_information - agreement.bias


if __name__ == "__main__":
    script(main)
