"""Many calibrations of one rig: their mean, who disagrees, and when the rig changed."""

import numpy as np
import pytest
from conftest import make_pose
from scipy.spatial.transform import Rotation

from semcal_cli.fleet.changes import ALPHA, change_points, drift
from semcal_cli.fleet.consensus import extra_variance, local_coordinates, moved, robust_mean
from semcal_cli.poses import Pose, camera_center

TRUTH = make_pose((1.2, -0.3, 0.8), (0.4, -0.2, 0.7))
SIGMAS = np.array([0.004, 0.003, 0.006, *np.radians([0.02, 0.03, 0.01])])


def fleet(
    rng: np.random.Generator, count: int, extra: float = 0.0
) -> tuple[list[Pose], np.ndarray, np.ndarray]:
    """Calibrations that scatter as they say, and by `extra` times as much again; covariances; coordinates."""
    scales = rng.uniform(0.5, 2.0, count)
    off = rng.standard_normal((count, 6)) * SIGMAS * scales[:, None]
    off += extra * rng.standard_normal((count, 6)) * SIGMAS
    covariances = np.array([np.diag((SIGMAS * scale) ** 2) for scale in scales])
    return [moved(TRUTH, each) for each in off], covariances, off


def test_coordinates_are_those_of_the_calibration_s_uncertainty() -> None:
    """Along the camera's axes: rho is minus the motion of its centre, phi the turn that is put before the rotation."""
    T = TRUTH.copy()
    turn = Rotation.from_rotvec([0.0, 0.01, 0.0]).as_matrix()
    T[:3, :3] = turn @ TRUTH[:3, :3]
    center = camera_center(TRUTH) + TRUTH[:3, :3].T @ [0.0, 0.0, 0.05]
    T[:3, 3] = -T[:3, :3] @ center
    (found,) = local_coordinates([T], TRUTH)
    assert found == pytest.approx([0.0, 0.0, -0.05, 0.0, 0.01, 0.0], abs=1e-12)
    assert moved(TRUTH, found) == pytest.approx(T, abs=1e-12)


def test_coordinates_are_a_twist_to_first_order() -> None:
    """exp(xi) T by its generator, for a small xi."""
    xi = np.array([2e-5, -1e-5, 3e-5, 1e-5, 2e-5, -3e-5])
    x, y, z = xi[3:]
    generator = np.zeros((4, 4))
    generator[:3, :3], generator[:3, 3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]], xi[:3]
    (found,) = local_coordinates([(np.eye(4) + generator) @ TRUTH], TRUTH)
    assert found == pytest.approx(xi, abs=1e-8)


def test_the_mean_is_as_sure_as_it_says_and_outliers_do_not_move_it() -> None:
    squared = []
    for seed in range(60):
        poses, covariances, _ = fleet(np.random.default_rng(seed), 12)
        for number, far in enumerate((0.5, -0.3, 2.0)):
            poses[number] = make_pose((0.1, 0.2, far), (1.0, 2.0, 3.0)) @ TRUTH
        mean = robust_mean(poses, covariances)
        (off,) = local_coordinates([mean.T_camera_lidar], TRUTH)
        squared.append(float(off @ np.linalg.inv(mean.covariance) @ off))
        assert mean.weights[:3].max() < 0.01 < mean.weights[3:].min()
    # Six degrees of freedom: a mean of 6, within what 60 draws allow and what Student's weights cost.
    assert 4.0 < np.mean(squared) < 10.0


def test_the_mean_does_not_depend_on_the_order() -> None:
    poses, covariances, _ = fleet(np.random.default_rng(3), 9)
    order = np.random.default_rng(4).permutation(9)
    one = robust_mean(poses, covariances)
    other = robust_mean([poses[i] for i in order], covariances[order])
    assert one.T_camera_lidar == pytest.approx(other.T_camera_lidar, abs=1e-9)


def test_scatter_beyond_what_is_stated_is_found_even_where_the_rig_changed() -> None:
    for extra in (0.0, 3.0):
        _, covariances, series = fleet(np.random.default_rng(1), 400, extra)
        series[200:] += 30.0 * SIGMAS
        found = np.sqrt(extra_variance(series, covariances))
        assert found == pytest.approx(extra * SIGMAS, rel=0.25, abs=0.6 * SIGMAS.max())
        assert (found[3:] <= (extra + 0.8) * SIGMAS[3:]).all()


def test_a_change_is_found_where_it_happened() -> None:
    _, covariances, series = fleet(np.random.default_rng(2), 60)
    series[20:, 4] += np.radians(0.2)
    series[45:, 0] += 0.03
    assert change_points(series, covariances) == pytest.approx([20, 45], abs=1)


def test_noise_is_no_change() -> None:
    """At most as often as is stated, which 200 series can tell."""
    found = [len(change_points(*fleet(np.random.default_rng(seed), 30)[2:0:-1])) > 0 for seed in range(200)]
    assert np.mean(found) <= 3.0 * ALPHA + 0.01


def test_one_that_lies_alone_is_no_change() -> None:
    _, covariances, series = fleet(np.random.default_rng(5), 30)
    series[12] += 100.0 * SIGMAS
    assert change_points(series, covariances) == []


def test_a_drift_is_measured() -> None:
    times = np.linspace(0.0, 100.0, 40)
    rate = np.array([1e-4, 0.0, 0.0, 0.0, 2e-5, 0.0])
    off, alarms = [], 0
    for seed in range(40):
        _, covariances, series = fleet(np.random.default_rng(seed), 40)
        alarms += drift(times, series, covariances).is_significant
        found = drift(times, series + times[:, None] * rate, covariances)
        assert found.is_significant
        off.append((found.per_unit - rate) / np.sqrt(np.diag(found.covariance)))
    assert 0.8 < np.std(off) < 1.25
    assert alarms <= 3  # at a level of 1 %
