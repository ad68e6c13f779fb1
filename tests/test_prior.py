import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import make_pose, poses, triples
from hypothesis import given, settings
from scipy.linalg import expm

from semcal_cli.checks.families import check_stages
from semcal_cli.config import PolishConfig, SensitivityConfig
from semcal_cli.estimation.adjust.priors import Prior, _solve, clamp, fuse_with_priors
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.estimation.uncertainty.covariance import estimate_uncertainty
from semcal_cli.estimation.uncertainty.sensitivity import Measurement, Scatter, measure, sensitivity
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import camera_center, rotation_difference
from semcal_cli.observations.observations import NO_CLASS, LabelledImage, Observations
from semcal_cli.result.uncertainty import Uncertainty

FREE = (np.inf,) * 6


@pytest.fixture(scope="module")
def polished(street_observations: Observations, street_truth: Pose) -> Pose:
    return newton(street_observations, street_truth, PolishConfig()).T_camera_lidar


@pytest.fixture(scope="module")
def alone(street_observations: Observations, polished: Pose) -> Uncertainty:
    found = estimate_uncertainty(street_observations, polished)
    assert found is not None
    return found


def nudged(T: Pose, center_m: tuple[float, ...], rotation_rad: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Pose:
    """The camera moved along its axes, and turned about them."""
    moved = make_pose(rotation_rad, (0.0, 0.0, 0.0)) @ T
    moved[:3, 3] = -moved[:3, :3] @ (camera_center(T) + T[:3, :3].T @ np.array(center_m))
    return moved


def twisted(T: Pose, twist: np.ndarray) -> Pose:
    x, y, z = twist[3:]
    generator = np.zeros((4, 4))
    generator[:3, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    generator[:3, 3] = twist[:3]
    moved: Pose = expm(generator) @ T
    return moved


@settings(max_examples=30)
@given(poses, triples(0.9), triples(2.0))
def test_the_residual_changes_with_a_twist_as_its_jacobian_says(
    T: Pose, rotation: tuple[float, ...], center: tuple[float, ...]
) -> None:
    prior = Prior("known", nudged(T, center, rotation), FREE)
    step = 1e-6
    numeric = [
        (prior.residual(twisted(T, step * axis)) - prior.residual(twisted(T, -step * axis))) / (2.0 * step)
        for axis in np.eye(6)
    ]
    np.testing.assert_allclose(np.transpose(numeric), prior.jacobian(T), atol=1e-5)


def test_a_pose_is_clamped_near_to_what_is_known() -> None:
    T = make_pose((0.3, -1.2, 0.5), (0.4, -0.2, 0.1))
    prior = Prior("known", nudged(T, (0.5, 0.02, -0.3), (0.2, 0.0, 0.1)), (0.1, 0.1, np.inf, 0.0, 0.1, 0.05))
    residual = prior.residual(prior.clamp(T))
    np.testing.assert_allclose(
        residual, np.clip(prior.residual(T), *(np.array([[-3], [3]]) * prior.sigmas)), atol=1e-12
    )
    assert clamp(T, [Prior("nothing", make_pose((0, 0, 1), (1, 1, 1)), FREE)]) is T


def test_axes_that_are_fixed_stay_and_the_others_follow_the_labels(
    street_observations: Observations, polished: Pose, alone: Uncertainty
) -> None:
    T_given = nudged(polished, (0.02, 0.0, 0.01), (0.0, 0.0, 0.001))
    prior = Prior("--fix tx,rz", T_given, (0.0, np.inf, np.inf, np.inf, np.inf, 0.0))
    fused = fuse_with_priors(street_observations, polished, [prior])
    assert fused.uncertainty is not None
    residual = prior.residual(fused.T_camera_lidar)
    np.testing.assert_allclose(residual[[0, 5]], 0.0, atol=1e-7)
    sigmas = np.sqrt(np.diag(fused.uncertainty.covariance))
    np.testing.assert_allclose(sigmas[[0, 5]], 0.0, atol=1e-5)  # along axes turned by a milliradian
    assert fused.is_settled
    assert (sigmas[1:5] > 0.0).all()
    # Yaw goes along with the place to the side, as it does in the labels' covariance.
    c = np.array(alone.covariance)
    expected = polished.copy()
    fixed = np.ix_([0, 5], [0, 5])
    offset = np.array([-0.02, 0.001])
    twist = c[:, [0, 5]] @ np.linalg.solve(c[fixed], offset)
    expected = twisted(expected, twist)
    turned = np.degrees(rotation_difference(fused.T_camera_lidar, polished))
    np.testing.assert_allclose(turned, np.degrees(rotation_difference(expected, polished)), atol=0.02)


def test_what_is_hardly_known_leaves_newtons_step_and_its_covariance(
    street_observations: Observations, polished: Pose, alone: Uncertainty
) -> None:
    vague = Prior("vague", nudged(polished, (0.5, 0.5, 0.5)), (100.0,) * 3 + (10.0,) * 3)
    fused = fuse_with_priors(street_observations, polished, [vague])
    around = sensitivity(street_observations, polished, SensitivityConfig())
    assert around is not None
    assert fused.uncertainty is not None
    expected = twisted(polished, np.linalg.solve(around.curvature, around.scores.sum(axis=0)))
    np.testing.assert_allclose(fused.T_camera_lidar, expected, atol=1e-6)
    np.testing.assert_allclose(fused.uncertainty.covariance, alone.covariance, rtol=1e-3, atol=1e-12)
    np.testing.assert_allclose(fused.uncertainty.degrees_of_freedom, alone.degrees_of_freedom, rtol=1e-3)
    np.testing.assert_allclose(fused.label_gain, np.eye(6), atol=1e-3)
    assert (fused.is_alone, check_stages(None, None, fused)) == (True, ())


def test_two_equally_good_witnesses_meet_in_the_middle(
    street_observations: Observations, polished: Pose, alone: Uncertainty
) -> None:
    sigma = float(np.sqrt(alone.covariance[2][2]))
    known = (np.inf, np.inf, sigma, np.inf, np.inf, np.inf)
    prior = Prior("tape", nudged(polished, (0.0, 0.0, 2.0 * sigma)), known)
    here = Prior("here", polished, known)
    between = fuse_with_priors(street_observations, polished, [prior])
    at_rest = fuse_with_priors(street_observations, polished, [here])
    assert between.uncertainty is not None
    # Half of the way, from the pose that labels alone give: that is a small step from the polished pose.
    moved = here.residual(between.T_camera_lidar)[2] - here.residual(at_rest.T_camera_lidar)[2]
    assert moved == pytest.approx(sigma, rel=1e-3)
    assert np.sqrt(between.uncertainty.covariance[2][2]) == pytest.approx(sigma / np.sqrt(2.0), rel=1e-3)


def test_what_contradicts_the_labels_or_itself_is_said(
    street_observations: Observations, polished: Pose
) -> None:
    prior = Prior("--fix ty", nudged(polished, (0.0, 0.2, 0.0)), (np.inf, 0.0, *FREE[:4]))
    fused = fuse_with_priors(street_observations, polished, [prior])
    (finding,) = check_stages(None, None, fused)
    assert re.fullmatch(
        r"--fix ty is 20\.\d cm from the pose that the data alone give, chi-square \d+ with 1 degree of freedom "
        r"\(limit \d+\): give a start that is right along these axes, or leave --fix out",
        finding.sentence,
    )
    tape = Prior("tape", nudged(polished, (0.01, 0.0, 0.0)), (0.001, *FREE[:5]))
    exact = Prior("--fix tx", polished, (0.0, *FREE[:5]))
    fused = fuse_with_priors(street_observations, polished, [tape, exact])
    assert check_stages(None, None, fused)[0].sentence.startswith("tape is 1.0 cm from ")
    assert check_stages(None, None, fused)[0].advice == "measure it again, or give a larger SIGMA"


def test_labels_in_one_corner_leave_the_pose_to_what_is_known(
    street_observations: Observations, polished: Pose
) -> None:
    frame = street_observations.of_frames([0])
    image = frame.images[0].classes
    corner = np.full_like(image, NO_CLASS)
    corner[200:230, 300:330] = image[200:230, 300:330]
    seen = frame.with_images([LabelledImage(corner)])
    known = Prior("known", nudged(polished, (0.01, 0.0, 0.0)), (0.01,) * 3 + (0.001,) * 3)
    fused = fuse_with_priors(seen, polished, [known])
    assert fused.uncertainty is not None
    assert not fused.is_alone
    assert (np.sqrt(np.diag(fused.uncertainty.covariance)) <= np.array(known.sigmas) * (1.0 + 1e-6)).all()
    assert (np.abs(known.residual(fused.T_camera_lidar)) <= 3.0 * np.array(known.sigmas)).all()
    half = Prior("half", known.T_camera_lidar, (0.01, *FREE[:5]))
    assert fuse_with_priors(seen, polished, [half]).uncertainty is None


def test_labels_that_tell_nothing_leave_all_to_what_is_known(
    street_observations: Observations, polished: Pose
) -> None:
    plain = street_observations.with_images(
        image.with_classes(np.zeros_like(image.classes)) for image in street_observations.images
    )
    fused = fuse_with_priors(
        plain, polished, [Prior("known", polished, (0.1, 0.1, 0.1, np.inf, np.inf, np.inf))]
    )
    assert fused.uncertainty is None
    assert not fused.is_settled


@pytest.mark.parametrize("num_parts", [6, 7, 8])
def test_parts_too_few_for_a_covariance_determine_nothing(
    street_observations: Observations, polished: Pose, num_parts: int
) -> None:
    around = sensitivity(street_observations, polished, SensitivityConfig())
    assert around is not None
    kept = around.squares < num_parts
    of_parts = {name: getattr(around, name)[kept] for name in ("scores", "squares", "classes")}
    few = replace(around, **of_parts, num_squares=num_parts)
    assert few.is_determined == (num_parts == 8) == bool(measure(few).information.any())


@pytest.mark.parametrize(("off_m", "is_allowed"), [(0.7, True), (0.9, False)])
def test_a_rough_pose_is_allowed_as_far_as_both_may_be_off(off_m: float, is_allowed: bool) -> None:
    T = make_pose((0.3, -1.2, 0.5), (0.4, -0.2, 0.1))
    known = Prior("known", nudged(T, (off_m, 0.0, 0.0)), (0.1, *FREE[:5]))
    assert known.allows(T, 0.5, 0.1) == is_allowed


def test_what_is_known_decides_where_labels_do_not_bend() -> None:
    rng = np.random.default_rng(0)
    reads = np.eye(6)[:5]  # nothing about the last axis
    nothing = np.zeros((5, 5))
    squares = rng.standard_normal((50, 5))
    scatter = Scatter(squares, squares.T @ squares, np.zeros((1, 5)), nothing)
    labels = Measurement(reads, scatter, np.full(5, 0.1), np.diag([0.01] * 5))
    step, _, is_determined = _solve(labels, np.zeros((0, 6)), np.zeros(0), np.zeros(0), np.eye(6))
    assert not is_determined
    np.testing.assert_allclose(step, [0.1] * 5 + [0.0])
    known = np.eye(6)[5:], np.array([0.3])
    for sigma in (0.05, 0.0):
        step, covariance, is_determined = _solve(labels, *known, np.array([sigma]), np.eye(6))
        assert is_determined
        np.testing.assert_allclose(step, [0.1] * 5 + [-0.3])
        np.testing.assert_allclose(np.diag(covariance), [0.01] * 5 + [sigma**2], atol=1e-12)
