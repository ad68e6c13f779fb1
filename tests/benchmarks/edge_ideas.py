"""Compare what edges of sweeps and of pictures may be, on real drives and a synthetic one, by where their tops lie.

    python tests/benchmarks/edge_ideas.py ../shared/data -o docs/pictures/edge_ideas.png

The table tells for each idea how far the top near the published pose lies from it, by how many standard errors the
highest other top is behind, and how many of some single ascents come back. The picture shows the mutual information
along six axes through the published pose, over its range.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import click
import cv2
import numpy as np
from profiles import AXES, Profile, draw_profiles, poses_along
from real_data import real_drives

from semcal_cli import _core
from semcal_cli.assessment.rivals import sigmas_behind
from semcal_cli.config import PolishConfig
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.cues.edges import EDGES, STARTS, observe_edges
from semcal_cli.drive.cues.intensity import grey_values
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.observations import NO_CLASS, LabelledCloud, LabelledImage, Observations
from semcal_cli.experiments.page_tables import run_script
from semcal_cli.experiments.summary import markdown_table
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import Pose, compare_poses
from semcal_cli.geometry.twists import displaced
from semcal_cli.refinement.polish import newton
from semcal_cli.refinement.pyramid import ExactEstimator, refine_pose
from semcal_cli.refinement.several_starts import pyramid_of
from semcal_cli.synthetic.synthesis import synthesize

START_DEG, START_M = 2.0, 0.2
SAME_DEG, SAME_CM = 0.5, 15.0
"""Errors within which an ascent has come back to the top."""
QUARTER_TURN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turns elevations near the horizon straight ahead into azimuths."""


def with_points(
    seen: Observations, classes_of: Callable[[int, LabelledCloud], np.ndarray], names: list[str]
) -> Observations:
    """The same pictures with other classes of points."""
    clouds = [each.with_classes(classes_of(index, each)) for index, each in enumerate(seen.clouds)]
    return replace(seen.with_clouds(clouds), point_class_names=names)


def with_pictures(
    drive: Drive, seen: Observations, levels_of: Callable[[np.ndarray], np.ndarray]
) -> Observations:
    """The same points with other classes of pixels, from the grey values."""
    levels = [levels_of(grey_values(drive, frame)).astype(np.uint8) for frame in drive.frames]
    images = [LabelledImage(each, _core.ClassShares.certain(each.ravel())) for each in levels]
    return replace(
        seen.with_images(images), image_class_names=[str(level) for level in range(EDGES.num_levels)]
    )


def range_and_intensity(drive: Drive) -> Observations:
    """Steps in range and in intensity along the scan: the cue."""
    return observe_edges(drive)


def range_alone(drive: Drive) -> Observations:
    """Steps in range along the scan."""
    return observe_edges(drive, config=replace(EDGES, intensity_shares=()))


def intensity_alone(drive: Drive) -> Observations:
    """Steps in intensity along the scan."""
    return observe_edges(drive, config=replace(EDGES, range_steps_m=()))


def any_gradient(drive: Drive) -> Observations:
    """The cue beside gradients in any direction."""
    return with_pictures(drive, range_and_intensity(drive), lambda grey: _levels(_gradient(grey, (0, 1))))


def between_rings(drive: Drive) -> Observations:
    """Steps in range from ring to ring, beside gradients from top to bottom."""
    upright = with_pictures(drive, range_alone(drive), lambda grey: _levels(_gradient(grey, (1,))))

    def classes_of(index: int, cloud: LabelledCloud) -> np.ndarray:
        turned = np.ascontiguousarray(cloud.points @ QUARTER_TURN.T.astype(np.float32))
        (steps,) = _core.edge_steps([turned], [None], EDGES.same_surface_m)
        ranges = np.linalg.norm(cloud.points, axis=1)
        # Rings lie far apart, so that the ground steps from one to the next as well.
        found = np.digitize(
            np.where(np.isfinite(steps.range_m), steps.range_m, 0.0) - 0.03 * ranges, EDGES.range_steps_m
        )
        return np.where(np.isnan(steps.range_m), NO_CLASS, found).astype(np.uint8)

    return with_points(upright, classes_of, ["none", "1", "2", "3"])


def distance_to_edge(drive: Drive) -> Observations:
    """The cue beside distances to the next edge of the picture (Levinson and Thrun, 2013) instead of gradients."""

    def levels_of(grey: np.ndarray) -> np.ndarray:
        gradient = _gradient(grey, (0,))
        is_peak = (gradient >= np.roll(gradient, 1, 1)) & (gradient >= np.roll(gradient, -1, 1))
        is_edge = is_peak & (gradient > np.quantile(gradient, 0.88))
        distance = cv2.distanceTransform((~is_edge).astype(np.uint8), cv2.DIST_L2, 5)
        return np.digitize(distance, [0.7, 1.2, 1.8, 2.5, 4.0, 7.0, 12.0])

    return with_pictures(drive, range_and_intensity(drive), levels_of)


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

    return with_points(range_alone(drive), classes_of, ["flat", "20", "40", "60"])


IDEAS: dict[str, Callable[[Drive], Observations]] = {
    "steps in range and intensity (the cue)": range_and_intensity,
    "steps in range": range_alone,
    "steps in intensity": intensity_alone,
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


class Figures(NamedTuple):
    """What an idea reaches on a drive."""

    rotation_deg: float
    center_cm: float
    behind: float
    """Standard errors by which the highest other top is behind."""
    returned: int


def measure(seen: Observations, T: Pose, num_starts: int) -> Figures:
    """Find the top near the published pose, and ascend from poses around it."""
    pyramid, coarse = pyramid_of(STARTS), STARTS.coarse
    assert coarse is not None
    top = newton(seen, T, PolishConfig()).T_camera_lidar
    starts = [displaced(T, START_DEG, START_M, np.random.default_rng(seed)) for seed in range(num_starts)]
    ends = [
        refine_pose(seen, start, ExactEstimator(seen, coarse, 0), pyramid).T_camera_lidar for start in starts
    ]
    away = [compare_poses(end, top) for end in ends]
    is_back = [each.rotation_deg < SAME_DEG and each.camera_center_cm < SAME_CM for each in away]
    others = [end for end, back in zip(ends, is_back, strict=True) if not back]
    error = compare_poses(top, T)
    behind = min(sigmas_behind(seen, top, others), default=np.inf)
    return Figures(error.rotation_deg, error.camera_center_cm, behind, sum(is_back))


def profile(seen: Observations, T: Pose, axis: int, steps: int) -> Profile:
    """Offsets along an axis, in its unit, and the mutual information there."""
    offsets, poses = poses_along(T, axis, steps)
    agreements = [_core.agreement(seen.core, pose) for pose in poses]
    return offsets, np.array([each.mutual_information - each.bias for each in agreements])


def drives(data: Path, folder: Path, only: str, num_frames: int) -> Iterator[tuple[str, Drive, Pose]]:
    """The real drives, and a synthetic one."""
    names = ("KITTI object", "KITTI raw", "KITTI jam")
    for found in real_drives(data, folder):
        if found.name.startswith(names) and "DiCENet" not in found.name and only in found.name:
            drive = read_drive(found.path)
            yield (
                found.name,
                drive.model_copy(update={"frames": drive.frames[:num_frames]}),
                read_transform(found.path),
            )
    if only in "synthetic":
        synthesize(SynthConfig(num_frames=min(num_frames, 12), seed=95000), folder / "synthetic")
        yield "synthetic, 12 pairs", read_drive(folder / "synthetic"), read_transform(folder / "synthetic")


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
@click.option("--only", default="", help="Only drives whose names contain this.")
@click.option("--max-frames", default=70, help="Frames of each drive.")
@click.option("--starts", default=12, show_default=True, help="Single ascents of each idea.")
@click.option("--steps", default=8, show_default=True, help="Poses on either side of the published one.")
def main(data: Path, output: Path, only: str, max_frames: int, starts: int, steps: int) -> None:
    """Print the table, and draw the profiles."""
    rows, curves = [], {}
    with TemporaryDirectory() as folder:
        for name, drive, T in drives(data.resolve(), Path(folder), only, max_frames):
            curves[name] = {}
            for idea, observe in IDEAS.items():
                seen = observe(drive)
                found = measure(seen, T, starts)
                top = f"{found.rotation_deg:.2f} deg, {found.center_cm:.1f} cm"
                rows.append((name, idea, top, f"{found.behind:.1f}", f"{found.returned} of {starts}"))
                curves[name][idea] = [profile(seen, T, axis, steps) for axis in range(len(AXES))]
    print(markdown_table("| drive | edges | top | other tops behind, sigmas | ascents that return |", rows))
    draw_profiles(curves, output, head=1.2, linewidth=1.2)
    print(f"written to {output}")


if __name__ == "__main__":
    run_script(main)
