"""Ties between the sensors of rigs of several LiDARs: their adjustment, and what loops say of them."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import make_pose
from rigs import exp, twist, with_pose
from test_rig_constraints import SIGMA_DEG, SIGMA_M, constraint

from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse
from semcal_cli.many.rig.adjustment import adjust
from semcal_cli.many.rig.rig_pair import from_first_lidar
from semcal_cli.many.rig.ties import Tie
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.uncertainty import Uncertainty

SENSORS = ("front", "left", "rear")
"""Two cameras, and a further LiDAR."""
SIGMA = np.repeat([SIGMA_M, np.radians(SIGMA_DEG)], 3)


def poses(rng: np.random.Generator) -> dict[str, Pose]:
    """Where the sensors are from the first LiDAR: T_sensor_lidar."""
    return {name: make_pose(rng.uniform(-2.0, 2.0, 3), rng.uniform(-1.0, 1.0, 3)) for name in SENSORS}


class Measured:
    """Calibrations and ties of a rig, with normal errors or exact."""

    def __init__(
        self, sure: CalibrationDocument, truth: dict[str, Pose], rng: np.random.Generator, by: float
    ):
        def measured(T: Pose) -> CalibrationDocument:
            return with_pose(sure, exp(by * SIGMA * rng.standard_normal(6)) @ T, np.diag(SIGMA**2))

        self.cameras = {name: measured(truth[name]) for name in SENSORS[:2]}
        registered = measured(inverse(truth["rear"])).pose
        covariance, many = np.diag(SIGMA**2), np.full(6, 1e4)
        known = Uncertainty.from_covariance(registered, covariance, many)
        self.ties = [
            Tie("registration", "lidar", "rear", registered, covariance, known),
            *(
                Tie.of_calibration(name, "rear", measured(truth[name] @ inverse(truth["rear"])))
                for name in SENSORS[:2]
            ),
        ]


def wrong(tie: Tie, angle_deg: float, rng: np.random.Generator) -> Tie:
    axis = rng.standard_normal(3)
    turn = exp(np.concatenate([np.zeros(3), np.radians(angle_deg) * axis / np.linalg.norm(axis)]))
    return replace(tie, pose=turn @ tie.pose)


def test_errors_after_the_adjustment_are_as_it_says(sure: CalibrationDocument) -> None:
    """Calibrations and registrations err as they state; so do the adjusted sensors, all three together."""
    rng = np.random.default_rng(3)
    truth, squares = poses(rng), []
    for _ in range(100):
        measured = Measured(sure, truth, rng, by=1.0)
        adjustment, found = adjust(measured.cameras, [], measured.ties)
        assert adjustment.cameras == (*SENSORS[:2], "rear")
        error = np.concatenate([twist(found[name].pose @ inverse(truth[name])) for name in SENSORS])
        squares.append(error @ np.linalg.solve(np.array(adjustment.covariance), error))
        assert not adjustment.contradictions
    # Chi-square with 18 degrees of freedom: its mean, and four standard errors of that.
    assert np.mean(squares) == pytest.approx(18.0, abs=4.0 * 6.0 / np.sqrt(100))


def test_the_covariance_between_lidars_is_that_of_their_scatter(sure: CalibrationDocument) -> None:
    rng = np.random.default_rng(5)
    truth, errors_m = poses(rng), []
    for _ in range(200):
        measured = Measured(sure, truth, rng, by=1.0)
        _, found = adjust(measured.cameras, [], measured.ties[1:])
        pair = from_first_lidar("rear", found["rear"], None)
        errors_m.append(twist(pair.T_a_b @ truth["rear"]))
    assert (pair.a, pair.b) == ("lidar", "rear")
    stated = np.array(pair.uncertainty.covariance)
    assert np.var(errors_m, axis=0) == pytest.approx(np.diag(stated), rel=4.0 * np.sqrt(2.0 / 200))


OF_K = 10.0 * np.diag(SIGMA)[:, [0, 1, 4, 5]]
"""Twist (6, 4) of a camera by errors of its intrinsics, ten times as large as its other errors."""


def by_intrinsics(sure: CalibrationDocument, T: Pose, k: np.ndarray) -> CalibrationDocument:
    """A calibration of which errors (4,) of the intrinsics turn and move the pose."""
    moved = with_pose(sure, exp(OF_K @ k) @ T, np.diag(SIGMA**2) + OF_K @ OF_K.T)
    of_K = {"covariance_of_intrinsics": OF_K @ OF_K.T, "twist_by_intrinsics": OF_K}
    rows = {part: tuple(map(tuple, matrix.tolist())) for part, matrix in of_K.items()}
    return moved.model_copy(update={"uncertainty": moved.uncertainty.model_copy(update=rows)})


def with_wrong_k(
    sure: CalibrationDocument, truth: dict[str, Pose], rng: np.random.Generator
) -> tuple[dict[str, CalibrationDocument], list[Tie]]:
    """Calibrations of which both of each camera share its errors of K, and those with the further LiDAR as ties."""
    exact = Measured(sure, truth, rng, by=1.0)
    k = {name: rng.standard_normal(4) for name in SENSORS[:2]}
    cameras = {name: by_intrinsics(sure, camera.pose, k[name]) for name, camera in exact.cameras.items()}
    further = [
        Tie.of_calibration(tie.to, tie.source, by_intrinsics(sure, tie.pose, k[tie.to]))
        for tie in exact.ties[1:]
    ]
    return cameras, further


def test_errors_of_k_that_calibrations_share_are_estimated_once(sure: CalibrationDocument) -> None:
    """Both calibrations of each camera err by the same error of its intrinsics, far more than by chance."""
    rng = np.random.default_rng(11)
    truth, squares, loops = poses(rng), [], []
    for _ in range(100):
        cameras, ties = with_wrong_k(sure, truth, rng)
        adjustment, found = adjust(cameras, [], ties)
        assert not adjustment.contradictions
        own = [twist(found[name].pose @ inverse(truth[name])) for name in SENSORS]
        alone = [np.array(found[name].uncertainty.covariance) for name in SENSORS]
        squares.append(np.concatenate(own) @ np.linalg.solve(adjustment.covariance, np.concatenate(own)))
        squares[-1] += sum(e @ np.linalg.solve(C, e) for e, C in zip(own, alone, strict=True))
        loops += [loop.chi_square for loop in adjustment.loops]
    # Eighteen axes together, and once more one sensor after the other; twice the spread of chi-square at most.
    assert np.mean(squares) == pytest.approx(36.0, abs=4.0 * 12.0 / np.sqrt(100))
    # Six axes of a loop.
    assert np.mean(loops) == pytest.approx(6.0, abs=4.0 * np.sqrt(12.0 / 100))


def test_two_cameras_of_uncertain_k_place_a_lidar_better_than_one(sure: CalibrationDocument) -> None:
    cameras, ties = with_wrong_k(sure, poses(rng := np.random.default_rng(12)), rng)
    widths = [
        np.array(from_first_lidar("rear", adjust(cameras, [], used)[1]["rear"], None).uncertainty.half_widths)
        for used in (ties, ties[:1], ties[1:])
    ]
    assert (widths[0] < widths[1]).all()
    assert (widths[0] < widths[2]).all()


@pytest.mark.parametrize("seed", range(5))
def test_a_wrong_calibration_is_named_whatever_the_uncertainty_of_k(
    sure: CalibrationDocument, seed: int
) -> None:
    """A turn by a degree is within the errors of K, but not within those that two calibrations do not share."""
    rng = np.random.default_rng(seed)
    truth = poses(rng)
    cameras, ties = with_wrong_k(sure, truth, rng)
    known = constraint("lidar", "rear", inverse(truth["rear"]))
    adjustment, found = adjust(cameras, [known], [ties[0], wrong(ties[1], 1.0, rng)])
    (named,) = adjustment.contradictions
    assert (named.kind, named.to, named.source) == ("calibration", "left", "rear")
    _, expected = adjust(cameras, [known], ties[:1])
    for name in SENSORS:
        assert found[name].pose == pytest.approx(expected[name].pose, abs=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_ties_does_not_matter(sure: CalibrationDocument, seed: int) -> None:
    rng = np.random.default_rng(seed)
    cameras, ties = with_wrong_k(sure, poses(rng), rng)
    (one, found), (other, again) = (adjust(cameras, [], order) for order in (ties, ties[::-1]))
    # What the linearisation leaves.
    assert found["rear"].pose == pytest.approx(again["rear"].pose, abs=1e-5)
    assert one.loops[0].chi_square == pytest.approx(other.loops[0].chi_square, rel=1e-2)


def test_exact_measurements_close_every_loop(sure: CalibrationDocument) -> None:
    measured = Measured(sure, poses(rng := np.random.default_rng(4)), rng, by=0.0)
    adjustment, found = adjust(measured.cameras, [], measured.ties)
    assert [loop.sensors for loop in adjustment.loops] == [
        ("lidar", "rear", "front"),
        ("lidar", "rear", "left"),
    ]
    for loop in adjustment.loops:
        assert (loop.rotation_deg, loop.distance_m) == pytest.approx((0.0, 0.0), abs=1e-9)
        # Three errors of two millimetres along three axes, and the levers of rotations of about a metre.
        assert 3.0 * SIGMA_M < loop.expected_distance_m < 4.5 * SIGMA_M
        assert loop.expected_rotation_deg == pytest.approx(3.0 * SIGMA_DEG)
    assert found["front"].pose == pytest.approx(measured.cameras["front"].pose, abs=1e-9)


def test_moving_the_points_moves_the_lidar(sure: CalibrationDocument) -> None:
    """With the points of the second LiDAR moved by S, T_lidar_rear is moved by S^-1, and no camera moves."""
    rng, S = np.random.default_rng(6), make_pose((0.2, -0.4, 1.0), (0.5, 0.3, -0.2))
    measured = Measured(sure, poses(rng), rng, by=1.0)
    moved = [replace(tie, pose=tie.pose @ inverse(S)) for tie in measured.ties]
    (_, before), (_, after) = (adjust(measured.cameras, [], ties) for ties in (measured.ties, moved))
    # Round-off, and what the linearisation at other places leaves.
    assert inverse(after["rear"].pose) == pytest.approx(inverse(before["rear"].pose) @ inverse(S), abs=1e-7)
    assert after["left"].pose == pytest.approx(before["left"].pose, abs=1e-7)


@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("seed", range(5))
def test_a_wrong_measurement_is_named_and_draws_nothing(
    sure: CalibrationDocument, place: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    measured = Measured(sure, poses(rng), rng, by=1.0)
    ties = [wrong(tie, 2.0, rng) if index == place else tie for index, tie in enumerate(measured.ties)]
    adjustment, found = adjust(measured.cameras, [], ties)
    (named,) = adjustment.contradictions
    assert (named.kind, named.to, named.source) == (ties[place].kind, ties[place].to, ties[place].source)
    assert named.rotation_deg == pytest.approx(2.0, abs=0.3)
    _, expected = adjust(
        measured.cameras, [], [tie for tie in measured.ties if tie is not measured.ties[place]]
    )
    assert found["rear"].pose == pytest.approx(expected["rear"].pose, abs=1e-12)


def test_a_wrong_calibration_with_the_first_lidar_shows_in_that_with_the_further_one(
    sure: CalibrationDocument,
) -> None:
    """Nothing else ties the camera, so that its two calibrations differ from each other alone. Both are named."""
    rng = np.random.default_rng(7)
    measured = Measured(sure, poses(rng), rng, by=1.0)
    direct = Tie.of_calibration("front", "lidar", measured.cameras["front"])
    cameras = measured.cameras | {"front": with_pose(sure, wrong(direct, 2.0, rng).pose, direct.covariance)}
    (named,) = adjust(cameras, [], measured.ties)[0].contradictions
    assert (named.kind, named.to, named.source) == ("calibration", "front", "rear")
    assert "check the drives of front with rear and with the first LiDAR" in named.reason


def test_two_that_contradict_each_other_are_a_loop_that_does_not_close(sure: CalibrationDocument) -> None:
    """Nobody can say which of the two is wrong, so one is left out, and the loop is reported."""
    rng = np.random.default_rng(8)
    measured = Measured(sure, poses(rng), rng, by=1.0)
    front, left = measured.ties[1:]
    adjustment, _ = adjust(measured.cameras, [], [front, wrong(left, 2.0, rng)])
    assert len(adjustment.contradictions) == 1
    (loop,) = adjustment.loops
    assert loop.sensors == ("lidar", "front", "rear", "left")
    assert not loop.is_explained
    assert loop.sentence.endswith(", more than chance explains")


def test_constraints_tie_lidars_and_cameras_of_further_lidars(sure: CalibrationDocument) -> None:
    """Only the second LiDAR sees the camera `left`: its pose follows from that of the LiDAR."""
    truth = poses(rng := np.random.default_rng(9))
    measured = Measured(sure, truth, rng, by=0.0)
    known = constraint("lidar", "rear", inverse(truth["rear"]))
    cameras = {"front": measured.cameras["front"]}
    adjustment, found = adjust(cameras, [known], measured.ties[2:])
    assert adjustment.cameras == ("front", "rear", "left")
    assert found["left"].pose == pytest.approx(truth["left"], abs=1e-9)
    sigmas = [np.sqrt(np.diag(found[name].uncertainty.covariance)) for name in ("left", "front")]
    assert (sigmas[0] > sigmas[1]).all()
    # Nothing ties the camera to the first LiDAR any more.
    adjustment, found = adjust(cameras, [], measured.ties[2:])
    assert (list(found), adjustment.skipped) == (["front"], ())


def test_a_constraint_alone_places_a_lidar(sure: CalibrationDocument) -> None:
    """The calibration of its only camera failed."""
    truth = poses(rng := np.random.default_rng(10))
    known = constraint("lidar", "rear", inverse(truth["rear"]))
    cameras = Measured(sure, truth, rng, by=0.0).cameras
    adjustment, found = adjust(cameras, [known], lidars=["rear"])
    assert (adjustment.cameras, adjustment.skipped) == (SENSORS, ())
    assert adjustment.unconfirmed == ("rear",)
    assert found["rear"].pose == pytest.approx(truth["rear"], abs=1e-9)


def test_a_wrong_constraint_of_lidars_is_named_with_what_to_check(sure: CalibrationDocument) -> None:
    truth = poses(rng := np.random.default_rng(13))
    measured = Measured(sure, truth, rng, by=1.0)
    turned = exp(np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.radians(2.0)])) @ inverse(truth["rear"])
    adjustment, _ = adjust(measured.cameras, [constraint("lidar", "rear", turned)], measured.ties)
    (named,) = adjustment.contradictions
    assert named.reason.startswith("the constraint of lidar and rear is ")
    assert " from what the other measurements say, more than chance explains" in named.reason
    assert named.reason.endswith(
        "check its direction and figures, the calibrations that place lidar and rear, and the other constraints"
    )


def test_errors_of_k_that_are_the_whole_covariance_leave_it_positive(sure: CalibrationDocument) -> None:
    """Round-off may make the part by K the larger one."""
    exact = by_intrinsics(sure, np.eye(4), np.zeros(4))
    whole = 0.999 * OF_K @ OF_K.T + np.diag([0.0, 0.0, *SIGMA[2:4] ** 2, 0.0, 0.0])
    narrow = exact.uncertainty.model_copy(update={"covariance": tuple(map(tuple, whole.tolist()))})
    camera = exact.model_copy(update={"uncertainty": narrow})
    adjustment, _ = adjust({"front": camera}, [], [Tie.of_calibration("front", "rear", camera)])
    assert np.linalg.eigvalsh(adjustment.covariance).min() > 0.0
