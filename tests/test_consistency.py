import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from conftest import with_twists
from laboratory.raw_drive import RawDrive

from semcal_cli import core
from semcal_cli.checks.families import check_consistency
from semcal_cli.checks.mirrored_clouds import check_mirrored_edges
from semcal_cli.checks.precedence import diagnosed
from semcal_cli.checks.registry import CHECKS
from semcal_cli.checks.shifted_pairing import check_shifted_pairing
from semcal_cli.checks.wrong_intrinsics import check_intrinsics
from semcal_cli.config import ExactConfig, PolishConfig, PyramidConfig
from semcal_cli.estimation.adjust.intrinsics_estimate import estimate_intrinsics
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.estimation.refine.pyramid import refine_exactly
from semcal_cli.estimation.uncertainty.intrinsics import around_intrinsics
from semcal_cli.findings.check import findings_among
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.cues.edges import STARTS, observe_edges
from semcal_cli.observations.observations import NO_CLASS, Observations


def sentences(observations: Observations, T_camera_lidar: Pose) -> list[str]:
    return [
        finding.sentence
        for finding in findings_among(check_consistency(observations, T_camera_lidar, estimated_s=0.0))
    ]


def refined(observations: Observations, T_camera_lidar: Pose) -> Pose:
    found = refine_exactly(observations, T_camera_lidar, ExactConfig(), PyramidConfig(coarsest_block_deg=3.0))
    assert found is not None
    return found.T_camera_lidar


def all_pixels_of(seen: Observations, label: int) -> Observations:
    return seen.with_images(image.with_classes(np.full_like(image.classes, label)) for image in seen.images)


def shuffled(seen: Observations) -> Observations:
    rng = np.random.default_rng(0)
    return seen.with_clouds(cloud.with_classes(rng.permutation(cloud.classes)) for cloud in seen.clouds)


def mostly_one_class(seen: Observations) -> Observations:
    rng = np.random.default_rng(0)
    return seen.with_clouds(
        cloud.with_classes(np.where(rng.random(cloud.num_points) < 0.02, cloud.classes, 0).astype(np.uint8))
        for cloud in seen.clouds
    )


def at_one_speed(seen: Observations, speed_m_s: float) -> Observations:
    return with_twists(seen, [[speed_m_s, 0.0, 0.0, 0.0, 0.0, 0.0]] * seen.num_frames)


@pytest.mark.parametrize(
    "good",
    [
        lambda seen: seen,
        lambda seen: seen.of_frames([1]),
        lambda seen: seen.of_frames([2, 2, 2]),  # images of one scene fit all of its sweeps
        lambda seen: at_one_speed(seen, 12.0),  # at which a delay looks like another place
        lambda seen: at_one_speed(seen, 0.0),
    ],
)
def test_nothing_is_found_against_a_good_drive(
    street_observations: Observations, street_truth: Pose, good: Callable[[Observations], Observations]
) -> None:
    assert sentences(good(street_observations), street_truth) == []


@pytest.mark.parametrize(
    ("bad", "expected"),
    [
        (
            lambda seen: seen.with_images(seen.images[1:] + seen.images[:1]),
            r"images of other frames fit these sweeps \d{3}% as well as their own \(limit 55%\): compare ",
        ),
        (shuffled, r"turned by \d+ degrees, the camera still fits \d{3}% as well|.*better than"),
        (mostly_one_class, r"nearly all points in the image have the same class, equivalent to 1\."),
        (lambda seen: all_pixels_of(seen, 0), "nearly all pixels have the same class"),
        (
            lambda seen: all_pixels_of(seen, NO_CLASS),
            "none of the pixels are labelled: label them, or check which ids the drive ignores$",
        ),
    ],
)
def test_labels_that_tell_no_pose_are_named(
    street_observations: Observations,
    street_truth: Pose,
    bad: Callable[[Observations], Observations],
    expected: str,
) -> None:
    found = sentences(bad(street_observations), street_truth)
    assert any(re.match(expected, line) for line in found), found


@pytest.mark.parametrize("scale", [0.9, 1.1])
def test_wrong_intrinsics_are_named(
    street_observations: Observations, street_truth: Pose, scale: float
) -> None:
    seen = replace(street_observations, camera=street_observations.camera.zoomed(scale))
    T = refined(seen, street_truth)
    (focal,) = sentences(seen, T)
    right = "shorter" if scale > 1.0 else "longer"
    assert re.match(
        rf"the focal length looks wrong, since points and images agree \d+\.\d% better with fx and fy 7% {right}: ",
        focal,
    )
    estimate = estimate_intrinsics(seen, T, around_intrinsics(seen, T))
    (intrinsics,) = findings_among(check_intrinsics(estimate, seen.camera).measured)
    assert re.match(r"the frames contradict the intrinsics: f[xy] should be ", intrinsics.sentence)


@pytest.mark.parametrize(
    ("delay_s", "side"), [(-0.1, "earlier"), (-0.01, "earlier"), (0.0, ""), (0.1, "later")]
)
def test_wrong_clocks_are_told_from_the_motion(
    street_observations: Observations, street_truth: Pose, delay_s: float, side: str
) -> None:
    """A car that speeds up and turns sees things where it was when the sweep was stamped."""
    speeds = np.linspace(6.0, 16.0, street_observations.num_frames)
    rates = np.linspace(-0.1, 0.2, street_observations.num_frames)
    twists = [[speed, 0.0, 0.0, 0.0, 0.0, rate] for speed, rate in zip(speeds, rates, strict=True)]
    clouds = [
        cloud.with_points(
            core.Trajectory.constant(twist, 0.0).compensate(
                cloud.points, np.full(cloud.num_points, delay_s), 0.0
            )
        )
        for cloud, twist in zip(street_observations.clouds, twists, strict=True)
    ]
    seen = with_twists(street_observations.with_clouds(clouds), twists)
    ended = newton(seen, refined(seen, street_truth), PolishConfig()).T_camera_lidar
    found = [line for line in sentences(seen, ended) if line.startswith("the clocks look wrong, ")]
    said = f" ms {side} than image_stamp says: calibrate with --estimate-delay"
    assert [said in line for line in found] == [True] * bool(side)


def test_images_a_frame_off_are_told(long_street: RawDrive) -> None:
    T = read_transform(long_street.drive.path)
    seen = replace(observe_edges(long_street.drive), starts=STARTS)
    (paired,) = check_shifted_pairing(seen, T)
    assert paired.value is not None
    assert paired.value < 0.0
    off = seen.of_frames(range(seen.num_frames - 1)).with_images(seen.images[1:])
    (finding,) = findings_among(check_shifted_pairing(off, T))
    assert finding.found.startswith("images 1 frame earlier fit these sweeps ")
    # Whatever else speaks against such a pose follows from it.
    others = [CHECKS[topic].finding("found") for topic in ("moved-camera", "intrinsics", "other-pose")]
    assert diagnosed([*others, finding], weak=(), start="a", near_only=("edges",))[0] == finding


def test_mirrored_clouds_are_told_by_edges(long_street: RawDrive, rng: np.random.Generator) -> None:
    T = read_transform(long_street.drive.path)
    seen = replace(observe_edges(long_street.drive), starts=STARTS)
    (upright,) = check_mirrored_edges(seen, T, T)
    assert upright.value is not None
    assert upright.value < 0.0
    flip = np.array([1.0, -1.0, 1.0], np.float32)
    mirrored = seen.with_clouds(cloud.with_points(cloud.points * flip) for cloud in seen.clouds)
    (finding,) = findings_among(
        check_mirrored_edges(mirrored, displace(T, 1.0, 0.1, rng), displace(T, 0.5, 0.05, rng))
    )
    assert finding.found.startswith("clouds or images seem mirrored, since near the start, points with y ")
