from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2, f, t

from semcal_cli import core
from semcal_cli.checks.wide_interval import check_interval
from semcal_cli.config import PolishConfig, SensitivityConfig
from semcal_cli.errors import InputError
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.estimation.uncertainty.covariance import (
    estimate_uncertainty,
    grow_rare_classes,
    label_bleed,
)
from semcal_cli.estimation.uncertainty.sensitivity import MIN_CLASSES, Sensitivity, sensitivity
from semcal_cli.files.validation import validate
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.observations import NO_CLASS, Observations
from semcal_cli.readable import figure
from semcal_cli.result.uncertainty import Uncertainty

CONFIG = PolishConfig()


@pytest.fixture(scope="module")
def polished(street_observations: Observations, street_truth: Pose) -> Pose:
    return newton(street_observations, street_truth, CONFIG).T_camera_lidar


@pytest.fixture(scope="module")
def uncertainty(street_observations: Observations, polished: Pose) -> Uncertainty:
    found = estimate_uncertainty(street_observations, polished)
    assert found is not None
    return found


def errors(T: Pose, T_reference: Pose) -> np.ndarray:
    """(6,) metres of the camera's place, degrees of the rotation."""
    return compare_poses(T, T_reference).offsets


def sigmas(uncertainty: Uncertainty) -> np.ndarray:
    return np.concatenate([uncertainty.sigma_camera_center_m, uncertainty.sigma_rotation_deg])


def test_the_truth_is_about_as_far_away_as_is_said(
    uncertainty: Uncertainty, polished: Pose, street_truth: Pose
) -> None:
    z = errors(polished, street_truth) / sigmas(uncertainty)
    # Of six axes: neither farther than one drive in 1000 would be, nor suspiciously near.
    assert chi2.ppf(0.001, 6) < z @ z < 4.0 * chi2.ppf(0.999, 6)
    assert (np.array(uncertainty.half_widths) > 1.9 * sigmas(uncertainty)).all()


def test_poses_of_single_frames_scatter_as_is_said(
    street_observations: Observations, uncertainty: Uncertainty, polished: Pose
) -> None:
    scatter, stated = [], []
    for index in range(street_observations.num_frames):
        frame = street_observations.of_frames([index])
        T = newton(frame, polished, CONFIG).T_camera_lidar
        found = estimate_uncertainty(frame, T)
        assert found is not None
        scatter.append(errors(T, polished))
        stated.append(sigmas(found))
    ratio = np.sqrt(np.mean(np.square(scatter), axis=0)) / np.sqrt(np.mean(np.square(stated), axis=0))
    # What the points of a class share in one frame may be shared by all frames, so that stated errors are wide.
    assert 0.2 < np.sqrt(np.mean(ratio**2)) < 2.0
    assert 1.2 < np.median(stated / sigmas(uncertainty)) < 4.0  # two, were all frames alike


def test_the_translation_moves_with_a_rotation(uncertainty: Uncertainty, polished: Pose) -> None:
    rng = np.random.default_rng(0)
    twists = rng.multivariate_normal(np.zeros(6), uncertainty.covariance, 20_000)
    t0 = polished[:3, 3]
    translations = t0 + twists[:, :3] + np.cross(twists[:, 3:], t0)
    np.testing.assert_allclose(translations.std(axis=0), uncertainty.sigma_translation_m, rtol=0.03)


def around(curvature: Matrix, scores: Matrix, num_alike: int = 1) -> Sensitivity:
    """A sensitivity of squares that `num_alike` frames show, with points of one class, which shares nothing."""
    n, num_squares = len(curvature), len(scores) // num_alike
    squares = np.tile(np.arange(num_squares), num_alike)
    classes = np.zeros_like(squares)
    return Sensitivity(curvature, np.zeros((1, n, n)), scores, squares, classes, np.eye(n), num_squares)


def sandwich(found: Sensitivity) -> tuple[Matrix, Matrix]:
    scatter = found.scatter(found.influence)
    return scatter.covariance, scatter.degrees_of_freedom


def test_sandwich_of_independent_scores() -> None:
    rng = np.random.default_rng(1)
    curvature = np.diag([4.0, 1.0])
    scores = rng.standard_normal((5000, 2)) * [2.0, 0.5]
    covariance, dof = sandwich(around(curvature, scores))
    expected = np.diag([(2.0 / 4.0) ** 2, (0.5 / 1.0) ** 2]) * 5000
    np.testing.assert_allclose(np.diag(covariance), np.diag(expected), rtol=0.06)
    np.testing.assert_allclose(dof, 5000 / 3, rtol=0.1)  # of normal scores: E[x^2]^2 / E[x^4] is a third


@pytest.mark.parametrize("num_squares", [40, 4000])
def test_what_a_class_shares_does_not_fall_with_more_images(num_squares: int) -> None:
    """Borders of five classes are off by `shared` in all squares; each class is a fifth of the curvature."""
    shared, noise = np.array([0.5, -0.3, 0.1, 0.2, -0.5]), 0.05
    curvature = np.array([[5.0 * num_squares]])
    scores = np.tile(shared, num_squares) + noise * np.random.default_rng(3).standard_normal(5 * num_squares)
    squares, classes = np.repeat(np.arange(num_squares), 5), np.tile(np.arange(5), num_squares)
    parts = np.tile(curvature / 5.0, (5, 1, 1))
    found = Sensitivity(curvature, parts, scores[:, None], squares, classes, np.eye(1), num_squares)
    scatter = found.scatter(np.linalg.inv(curvature))
    # The variance of a mean of five errors, by their scatter.
    expected = shared.var(ddof=1) / 5.0 * (1.0 - 1.0 / num_squares)
    np.testing.assert_allclose(scatter.of_classes, expected, rtol=0.05)
    np.testing.assert_allclose(scatter.of_squares, 5.0 * noise**2 / num_squares / 25.0, rtol=0.5)
    assert scatter.degrees_of_freedom == pytest.approx(MIN_CLASSES, rel=0.1)


def test_scatter_follows_a_change_of_variables(street_observations: Observations, polished: Pose) -> None:
    found = sensitivity(street_observations, polished, SensitivityConfig())
    assert found is not None
    turn = np.random.default_rng(4).standard_normal((6, 6))
    turned = Sensitivity(
        turn.T @ found.curvature @ turn,
        turn.T @ found.class_curvatures @ turn,
        found.scores @ turn,
        *(found.squares, found.classes, turn.T @ found.motions @ turn, found.num_squares),
    )
    back = np.linalg.inv(turn)
    expected = back @ sandwich(found)[0] @ back.T
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        sandwich(turned)[0] / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-6
    )


def test_classes_share_the_curvature(street_observations: Observations, polished: Pose) -> None:
    found = core.sensitivity(street_observations.core, polished, SensitivityConfig())
    assert found is not None
    np.testing.assert_allclose(found.class_curvatures.sum(axis=0), found.curvature, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.frame_curvatures.sum(axis=0), found.curvature, rtol=1e-9, atol=1e-9)


def test_copies_of_a_frame_are_that_frame() -> None:
    """Twenty copies pull twenty times as strongly against a curvature twenty times as large."""
    scores = np.random.default_rng(2).standard_normal((50, 2))
    of_one, dof_of_one = sandwich(around(np.eye(2), scores))
    of_copies, dof = sandwich(around(20.0 * np.eye(2), np.tile(scores, (20, 1)), num_alike=20))
    np.testing.assert_allclose(of_copies, of_one, rtol=1e-9)
    np.testing.assert_allclose(dof, dof_of_one, rtol=1e-9)


def test_a_saddle_is_not_determined() -> None:
    scores = np.ones((9, 2))
    assert around(np.diag([1.0, 1e-3]), scores).is_determined
    assert not around(np.diag([1.0, -1e-3]), scores).is_determined


def test_directions_that_are_hardly_determined_are_named(uncertainty: Uncertainty, polished: Pose) -> None:
    assert uncertainty.weak_directions == ()
    covariance = np.array(uncertainty.covariance)
    covariance[2, 2], covariance[4, 4] = 0.05**2, np.radians(0.3) ** 2
    weak = Uncertainty.from_covariance(polished, covariance, np.full(6, 1e6)).weak_directions
    assert weak == (
        "along the optical axis (frames with nearby objects would help)",
        "in yaw (more frames would help)",
    )


def test_a_pose_that_is_not_determined_to_any_use_is_not_trusted(
    uncertainty: Uncertainty, polished: Pose
) -> None:
    assert check_interval(uncertainty) == ()
    covariance = np.array(uncertainty.covariance)
    covariance[1, 1], covariance[3, 3] = 2.0**2, np.radians(1.0) ** 2
    vague = Uncertainty.from_covariance(polished, covariance, np.full(6, 1e6))
    (found,) = check_interval(vague)
    assert found.sentence == (
        "the interval is too wide, +- 3.92 m up and down, +- 2.0 degrees in pitch (95 %; limits 0.25 m and "
        "1 degree): add frames with near and far objects, recorded while driving"
    )


@pytest.mark.parametrize("dof", [1.3, 4.0, 37.5, 1e5, 1e9])
def test_student_quantile_is_scipys(dof: float) -> None:
    assert core.student_quantile(0.975, dof) == pytest.approx(t.ppf(0.975, dof), rel=1e-6)


@pytest.mark.parametrize("alpha", [0.05, 1e-3, 2.5e-5, 1e-7])
@pytest.mark.parametrize("numerator", [1, 3, 6, 114, 5994])
def test_fisher_limit_is_exceeded_with_its_probability(alpha: float, numerator: int) -> None:
    denominators = [0.5, 1.0, 4.5, 37.5, 300.0, 1e4, 1e6]
    limits = [core.fisher_limit(alpha, numerator, dof) for dof in denominators]
    # The core subtracts logarithms of gamma functions, which are up to 1e7.
    assert f.sf(limits, numerator, denominators) == pytest.approx(alpha, rel=1e-8)


def test_the_rarer_class_bleeds() -> None:
    image = np.zeros((5, 6), np.uint8)
    image[2, 2], image[0, 5], image[4, 5] = 1, 2, NO_CLASS
    image[3, 3:5] = 2
    (grown,) = grow_rare_classes([image])
    expected = image.copy()
    expected[0, 4] = expected[1, 5] = 2
    expected[2, 3] = expected[2, 4] = expected[4, 3] = expected[4, 4] = expected[3, 2] = expected[3, 5] = 2
    expected[1, 2] = expected[3, 2] = expected[2, 1] = expected[2, 3] = 1  # rarest
    np.testing.assert_array_equal(grown, expected)


def test_bleeding_labels_move_the_pose(street_observations: Observations, polished: Pose) -> None:
    moved = label_bleed(street_observations, polished, CONFIG)
    assert moved is not None
    assert 1e-4 < np.linalg.norm(moved.camera_center_m) < 0.1
    assert 1e-3 < np.linalg.norm(moved.rotation_deg) < 0.5


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0998, "0.10"), (0.0994, "0.099"), (1.25, "1.2"), (99.6, "100"), (0.0, "0"), (-3.14159, "-3.1")],
)
def test_figures_have_two_digits(value: float, text: str) -> None:
    assert figure(value) == text


@pytest.mark.parametrize(
    ("part", "twist_m", "complaint"),
    [
        (None, 1e-3, "found a twist_by_intrinsics alone, expected a covariance_of_intrinsics beside it"),
        (
            1e-6,
            1.001e-3,
            "found a twist_by_intrinsics that exceeds the covariance_of_intrinsics, expected a part of",
        ),
        (1e-6, 1e-3, None),
    ],
)
def test_the_twist_by_intrinsics_is_that_of_their_covariance(
    part: float | None, twist_m: float, complaint: str | None
) -> None:
    uncertainty = Uncertainty.from_covariance(np.eye(4), 1e-4 * np.eye(6), np.full(6, 30.0))
    document = uncertainty.model_dump() | {
        "covariance_of_intrinsics": None if part is None else (part * np.eye(6)).tolist(),
        "twist_by_intrinsics": (twist_m * np.eye(6)[:, :4]).tolist(),
    }
    if complaint is None:
        validate(Uncertainty, document, Path("c.yaml"))
        return
    with pytest.raises(InputError) as refused:
        validate(Uncertainty, document, Path("c.yaml"))
    assert complaint in str(refused.value)
