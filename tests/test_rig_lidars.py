"""Rigs of several LiDARs: what ties them together, what loops say of it, and the commands."""

import json
import re
import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from click.testing import Result
from commands import invoke
from conftest import NAMES, SMALL, make_pose
from test_rig import exp, twist, with_pose
from test_rig_constraints import SIGMA_DEG, SIGMA_M, constraint
from test_schemas import check

from semcal_cli import core, errors
from semcal_cli.cli.jobs import failure_sentence
from semcal_cli.drive.document import Drive
from semcal_cli.drive.stated_motion import Motion
from semcal_cli.errors import InputError
from semcal_cli.files.documents import read_document
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses, inverse
from semcal_cli.many.rig.adjustment import adjust
from semcal_cli.many.rig.further_lidar import (
    MAX_HALF_WIDTH_DEG,
    UNCONFIRMED,
    LidarTies,
    assess_lidar,
    first_cameras,
    measure_lidars,
)
from semcal_cli.many.rig.rig_calibration import combine
from semcal_cli.many.rig.rig_document import Rig, read_rig
from semcal_cli.many.rig.rig_page import rig_verdict
from semcal_cli.many.rig.rig_pair import from_first_lidar
from semcal_cli.many.rig.sweep_registration import (
    MIN_PAIRS,
    OF_UNKNOWN_MOMENTS,
    NotRegistered,
    Registration,
    SweepPair,
    SweepPairs,
    read_sweep_pairs,
    register_sweeps,
    robust_mean_of_vectors,
    stiffness,
)
from semcal_cli.many.rig.ties import Tie, relying_on, unconfirmed
from semcal_cli.result.calibration_document import CalibrationDocument, read_calibration
from semcal_cli.result.uncertainty import Uncertainty
from semcal_cli.synthetic.synthesis import synthesize_rig

LIDAR = "lidar_1"
SENSORS = ("front", "left", "rear")
"""Two cameras, and a further LiDAR."""
IDENTITY = np.eye(4).tolist()
SIGMA = np.repeat([SIGMA_M, np.radians(SIGMA_DEG)], 3)


CONFIG = replace(SMALL, num_frames=MIN_PAIRS)


@pytest.fixture(scope="module")
def lidars(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rig of two cameras and two LiDARs, whose sweeps are to be registered; tests do not write to it."""
    path = tmp_path_factory.mktemp("lidars") / "rig/rig.yaml"
    synthesize_rig(CONFIG, 2, path.parent, num_lidars=2)
    document = yaml.safe_load(path.read_text())
    document["lidars"][LIDAR]["register"] = True
    path.write_text(path.read_text().splitlines()[0] + "\n" + yaml.safe_dump(document, sort_keys=False))
    return path


@pytest.fixture(scope="module")
def results(lidars: Path) -> tuple[Result, Path]:
    out = lidars.parents[1] / "results"
    return invoke("calibrate", lidars, "-o", out, "--report", out.with_suffix(".html")), out


@pytest.fixture(scope="module")
def sure(results: tuple[Result, Path]) -> CalibrationDocument:
    """A calibration, whatever it says, as if by many parts of the images."""
    calibration = read_calibration(results[1] / f"{NAMES[0]}.yaml")
    many = calibration.uncertainty.model_copy(update={"degrees_of_freedom": (1e4,) * 6})
    sound = {"status": "trusted", "reasons": (), "topics": (), "uncertainty": many}
    return calibration.model_copy(update=sound)


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


def stated(*ends: str) -> list[Tie]:
    """Ties without errors, each between the sensors that a letter and a digit name: `c0-l1`."""
    covariance = np.diag(SIGMA**2)
    return [
        Tie("constraint", *each.replace("l0", "lidar").split("-"), np.eye(4), covariance) for each in ends
    ]


@pytest.mark.parametrize(
    ("ends", "expected"),
    [
        ("c0-l0", {"c0"}),
        ("c0-l0 c0-l1", {"c0", "l1"}),
        ("c0-l0 c1-l0 c0-l1 c1-l1", set()),
        ("c0-l0 c0-l1 c1-l1 c2-l1 c1-l2 c2-l2", {"c0", "l1", "c1", "c2", "l2"}),
        ("c0-l0 c1-l0 c0-l1 c1-l1 c1-l2", {"l2"}),
        ("c0-l0 l0-l1 l0-l1", {"c0"}),
        ("c0-l0 c1-l1", {"c0"}),
    ],
)
def test_a_sensor_behind_a_single_tie_is_confirmed_by_nothing(ends: str, expected: set[str]) -> None:
    assert unconfirmed(stated(*ends.split())) == expected


@pytest.mark.parametrize(
    ("ends", "expected"),
    [
        # The first tie of each is wrong. A loop, and what hangs on it.
        ("c1-l1 c0-l0 c1-l0 c0-l1", {"c0", "c1", "l1"}),
        ("c1-l1 c0-l0 c1-l0 c0-l1 c2-l1 c2-l2", {"c0", "c1", "l1", "c2", "l2"}),
        # Two loops that have the first LiDAR in common.
        ("c1-l1 c0-l0 c1-l0 c0-l1 c2-l0 c3-l0 c2-l2 c3-l2", {"c0", "c1", "l1"}),
        # A loop beyond a bridge, which is not doubted.
        ("c2-l2 c0-l0 c0-l1 c1-l1 c2-l1 c1-l2", {"c1", "c2", "l2"}),
        # Two ties of the same sensors are a loop.
        ("l0-l1 l0-l1 c0-l0 c1-l1", {"l1", "c1"}),
    ],
)
def test_doubt_follows_the_chain(ends: str, expected: set[str]) -> None:
    ties = stated(*ends.split())
    assert relying_on(ties[:1], ties) == expected
    assert relying_on([], ties) == set()


def chain_of_lidars() -> Rig:
    """The camera c2 alone ties the LiDAR l2 to l1, which two cameras tie to the first one."""
    on = {"l1": ("c0", "c1", "c2"), "l2": ("c2",)}
    return Rig.model_validate(
        {
            "semcal_rig": 1,
            "cameras": {"c0": "c0", "c1": "c1"},
            "lidars": {
                name: {"cameras": {camera: f"{camera}_on_{name}" for camera in cameras}}
                for name, cameras in on.items()
            },
            "T_lidar_lidar": {"lidar": dict.fromkeys(on, IDENTITY)},
        }
    )


@pytest.mark.parametrize("angle_deg", [0.0, 2.0])
def test_a_lidar_that_hangs_on_a_contradicted_one_is_not_trusted(
    sure: CalibrationDocument, angle_deg: float
) -> None:
    """Neither are the pairs of cameras on the loop, nor the camera that only the further LiDARs see."""
    rig, rng = chain_of_lidars(), np.random.default_rng(3)
    measured = with_pose(sure, np.eye(4), np.diag(SIGMA**2))
    cameras = dict.fromkeys(rig.views, measured)
    further = [view for view in rig.views.values() if view.lidar != "lidar"]
    ties = [Tie.of_calibration(view.camera, view.lidar, measured) for view in further]
    ties[0] = wrong(ties[0], angle_deg, rng)
    adjustment, sensors = adjust(first_cameras(rig, cameras), [], ties)
    known = LidarTies(tuple(ties), {}, {})
    lidars = tuple(assess_lidar(name, rig, {}, cameras, adjustment, sensors, known) for name in rig.lidars)
    drives = dict.fromkeys(rig.views, SimpleNamespace(T_camera_lidar=None))
    whole = combine(rig, drives, cameras, {}, 1, adjustment, lidars)
    is_wrong = angle_deg > 0.0
    assert [lidar.status for lidar in lidars] == ["not_trusted" if is_wrong else "trusted"] * 2
    assert lidars[1].reasons == lidars[0].reasons == tuple(each.reason for each in adjustment.contradictions)
    # With one of its ties left out, the first of them has a single one, too.
    assert [lidar.notes for lidar in lidars] == [(UNCONFIRMED,) * is_wrong, (UNCONFIRMED,)]
    own = [pair for lidar in lidars for pair in lidar.own_cameras]
    assert [(pair.a, pair.is_doubted) for pair in own] == [("c2", is_wrong)] * 2
    assert [pair.is_doubted for pair in whole.pairs] == [is_wrong]


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        (
            {"lidars": {"rear": {"cameras": {"back": "camera_0_on_lidar_1"}}}, "T_lidar_lidar": {}},
            "lidars.rear: found nothing that ties it to the first LiDAR, expected a camera that sees both, "
            "`constraints`, or `register: true` and T_lidar_lidar",
        ),
        (
            {"lidars": {"lidar": {"cameras": {"camera_0": "camera_0_on_lidar_1"}}}},
            "lidars: found 'lidar' for two things, expected a name for each camera, LiDAR and result",
        ),
        (
            {"cameras": {"lidar": "camera_0", "camera_1": "camera_1"}},
            "lidars: found 'lidar' for two things, expected a name for each camera, LiDAR and result",
        ),
        (
            {"lidars": {"Camera_0": {"cameras": {"camera_0": "camera_0_on_lidar_1"}}}},
            "lidars: found 'camera_0' and 'Camera_0', expected names that differ in more than case",
        ),
        (
            {"cameras": {"camera_0": "camera_0", "camera_0_on_lidar_1": "camera_1"}},
            "lidars: found 'camera_0_on_lidar_1' for two things, expected a name for each camera, LiDAR and result",
        ),
        (
            {"lidars": {"a/b": {"cameras": {"camera_0": "camera_0_on_lidar_1"}}}},
            "lidars: found 'a/b', expected a LiDAR name of letters, digits, _, - and .",
        ),
        (
            {"lidars": {"lidar_1": {"cameras": {}}}},
            "lidars.lidar_1.cameras: found a mapping of 0, needed at least 1",
        ),
        (
            {"lidars": {"lidar_1": {"cameras": {"camera_0": "camera_1"}}}},
            "for 'camera_1' and 'camera_0_on_lidar_1', expected a drive for each",
        ),
        (
            {"T_lidar_lidar": {"lidar": {"rear": IDENTITY}}},
            "T_lidar_lidar: found LiDAR 'rear', expected one of: lidar, lidar_1",
        ),
        (
            {
                "constraints": [
                    {"from": "rear", "to": "lidar", "T_to_from": IDENTITY, "sigma_m": 1.0, "sigma_deg": 1.0}
                ]
            },
            "constraints[0]: found camera or LiDAR 'rear', expected one of: camera_0, camera_1, lidar, lidar_1",
        ),
        (
            {
                "cameras": {"lidar": "camera_0", "camera_1": "camera_1"},
                "lidars": {},
                "T_lidar_lidar": {},
                "constraints": [
                    {
                        "from": "lidar",
                        "to": "camera_1",
                        "T_to_from": IDENTITY,
                        "sigma_m": 1.0,
                        "sigma_deg": 1.0,
                    }
                ],
            },
            "cameras: found 'lidar', expected another name beside `constraints`",
        ),
        (
            {"cameras": {"camera_0": "camera_0"}, "lidars": {}, "T_lidar_lidar": {}},
            "found a mapping of 1, needed at least 2",
        ),
    ],
)
def test_mistakes_are_named(lidars: Path, changes: dict, complaint: str) -> None:
    path = lidars.with_name("wrong.yaml")
    path.write_text(yaml.safe_dump(yaml.safe_load(lidars.read_text()) | changes))
    with pytest.raises(InputError) as caught:
        read_rig(path).read_drives()
    assert str(caught.value).startswith(f"{path}: ")
    assert complaint in str(caught.value)


def test_drives_of_one_camera_have_one_camera(lidars: Path, tmp_path: Path) -> None:
    path = Path(shutil.copytree(lidars.parent, tmp_path / "rig")) / "rig.yaml"
    drive = path.parent / "camera_1_on_lidar_1/drive.yaml"
    drive.write_text(drive.read_text().replace("width: 480", "width: 490"))
    with pytest.raises(InputError) as caught:
        read_rig(path).read_drives()
    assert str(caught.value) == (
        f"{path}: lidars: found different `camera` blocks in the drives of 'camera_1' and 'camera_1_on_lidar_1', "
        "expected the same camera"
    )


def test_drives_have_sweeps_and_images_of_their_own(lidars: Path, tmp_path: Path) -> None:
    """Drives in wrong places, and copies of drives, would be trusted: their loops close."""
    path = Path(shutil.copytree(lidars.parent, tmp_path / "rig")) / "rig.yaml"
    shutil.copytree(path.parent, path.parent / "copy")
    document = yaml.safe_load(path.read_text())
    for drive, complaint in (
        ("camera_1_on_lidar_1", ".camera_0: found images of 'camera_1', expected those of 'camera_0'"),
        ("copy/camera_1_on_lidar_1", ".camera_0: found images of 'camera_1', expected those of 'camera_0'"),
        (
            "copy/camera_0",
            ": found clouds of 'lidar' in the drive of 'camera_0', expected sweeps of another LiDAR",
        ),
    ):
        document["lidars"] = {LIDAR: {"cameras": {"camera_0": drive}}}
        path.write_text(yaml.safe_dump(document))
        with pytest.raises(InputError) as caught:
            read_rig(path).read_drives()
        assert str(caught.value) == f"{path}: lidars.{LIDAR}.cameras{complaint}"


def test_a_missing_extra_is_named(lidars: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(errors, "is_installed", lambda package: package != "small_gicp")
    result = invoke("calibrate", lidars, "-o", tmp_path / "out")
    assert str(result.exception).startswith(
        f"{lidars}: lidars.lidar_1.register: found no small_gicp; install the extra 'registration': pip install"
    )
    assert not (tmp_path / "out").exists()


def test_the_command_places_the_lidar(lidars: Path, results: tuple[Result, Path], tmp_path: Path) -> None:
    ending, out = results
    assert ending.exit_code in (0, 3), ending.output
    document = read_document(out / "rig_calibration.yaml")
    check(lidars)
    check(out / "rig_calibration.yaml")
    lidar = document["lidars"][LIDAR]
    assert (lidar["status"], lidar["registration"]["num_pairs"]) == ("trusted", CONFIG.num_frames)
    pair = lidar["pair"]
    assert (pair["a"], pair["b"], pair["reference"]["source"]) == ("lidar", LIDAR, "rig.yaml")
    assert pair["reference"]["is_explained"]
    assert pair["reference"]["rotation_deg"] < 0.05
    assert pair["reference"]["camera_center_cm"] < 1.0
    assert max(pair["uncertainty"]["half_width_95_rotation_deg"]) < 0.1 < MAX_HALF_WIDTH_DEG
    assert list(document["cameras"]) == list(lidar["cameras"]) == list(NAMES)
    loops = document["adjustment"]["loops"]
    assert [loop["sensors"] for loop in loops] == [["lidar", LIDAR, name] for name in NAMES]
    assert f"LiDAR {LIDAR}    trusted: ±" in ending.stderr.replace("+- ", "±")
    assert "T_lidar_lidar_1\n" in ending.stderr
    assert f"lidar - {LIDAR} - camera_0 closes within" in " ".join(ending.stderr.split())
    # What was written is read again.
    again = invoke("report", lidars, out, "-o", tmp_path / "again.html")
    assert again.exit_code == 0, again.output
    assert (tmp_path / "again.html").read_bytes() == out.with_suffix(".html").read_bytes()
    page = (tmp_path / "again.html").read_text()
    assert "p_lidar = T_lidar_lidar_1 p_lidar_1: from lidar_1 to lidar" in page
    assert page.count("chance explains it") == len(loops)


def test_a_wrong_calibration_is_named_and_neither_lidar_nor_rig_is_trusted(
    lidars: Path, results: tuple[Result, Path], rng: np.random.Generator
) -> None:
    """The registration, which starts between the two cameras, shows which of them is wrong."""
    rig, sound = read_rig(lidars), {"status": "trusted", "reasons": (), "topics": ()}
    drives, truth = rig.read_drives(), rig.reference("lidar", LIDAR)
    cameras = {
        name: read_calibration(results[1] / f"{name}.yaml").model_copy(update=sound) for name in rig.views
    }
    turned = cameras[f"camera_1_on_{LIDAR}"]
    turn = exp(np.array([0.0, 0.0, 0.0, 0.0, np.radians(2.0), 0.0]))
    cameras[f"camera_1_on_{LIDAR}"] = with_pose(turned, turn @ turned.pose, turned.covariance)
    measured = measure_lidars(rig, cameras, drives)
    adjustment, sensors = adjust(first_cameras(rig, cameras), (), measured.ties)
    lidar = assess_lidar(LIDAR, rig, drives, cameras, adjustment, sensors, measured)
    whole = combine(rig, drives, cameras, {}, 6, adjustment, (lidar,))
    (reason,) = whole.reasons
    assert re.match(r"the calibration of camera_1 with lidar_1 is (1\.9|2\.0|2\.1) degrees and ", reason)
    assert reason.endswith(
        "was left out: check the drives of camera_1 with lidar_1 and with the first LiDAR, and the others of its loops"
    )
    assert (whole.status, lidar.status, lidar.reasons) == ("not_trusted", "not_trusted", (reason,))
    assert lidar.pair.believed_uncertainty is None
    assert compare_poses(lidar.pair.T_a_b, truth).rotation_deg < 0.05
    assert [loop.is_explained for loop in adjustment.loops] == [True, False]
    assert rig_verdict(whole).title == "Measurements of the rig contradict each other"
    assert rig_verdict(whole).sentence == "Each camera is trusted alone."
    unknown = cameras["camera_0"].model_copy(update={"status": "not_assessed"})
    whole = combine(rig, drives, cameras | {"camera_0": unknown}, {}, 6, adjustment, (lidar,))
    assert rig_verdict(whole).sentence == "The accuracy of these is unknown: camera_0."


def test_cameras_of_the_further_lidar_alone_are_shown_and_exported(lidars: Path, tmp_path: Path) -> None:
    """Only the second LiDAR sees `camera_1`."""
    document = yaml.safe_load(lidars.read_text()) | {"cameras": {"camera_0": "camera_0"}}
    path, out, page = lidars.with_name("own.yaml"), tmp_path / "out", tmp_path / "page.html"
    path.write_text(yaml.safe_dump(document))
    ending = invoke("calibrate", path, "-o", out, "--report", page)
    assert ending.exit_code in (0, 3), ending.output
    assert "the other measurements of the rig moved the camera by" in " ".join(ending.stderr.split())
    (own,) = read_document(out / "rig_calibration.yaml")["lidars"][LIDAR]["own_cameras"]
    for transform in ("T_camera_1_lidar p_lidar:", "T_camera_1_lidar_1 p_lidar_1:"):
        assert transform in page.read_text()
    file = tmp_path / "rig_config.json"
    done = invoke("export", "colmap", path, out, "-o", file)
    assert done.exit_code == 0, done.output
    (config,) = json.loads(file.read_text())
    assert [entry["image_prefix"] for entry in config["cameras"]] == ["camera_0/", "camera_1/"]
    T = read_calibration(out / "camera_0.yaml").pose @ inverse(np.array(own["T_a_b"]))
    assert config["cameras"][1]["cam_from_rig_translation"] == pytest.approx(inverse(T)[:3, 3].tolist())


@pytest.mark.parametrize(("of_lidars", "kind"), [(True, "calibrations"), (False, "cameras")])
def test_what_failed_is_named(of_lidars: bool, kind: str) -> None:
    sentence = failure_sentence({"front_on_rear": "why"}, 4, of_lidars=of_lidars)
    assert sentence == f"1 of 4 {kind} failed; front_on_rear: why"


def test_rigs_that_would_be_too_large_are_not_synthesized(tmp_path: Path) -> None:
    result = invoke("synth", tmp_path / "rig", "--cameras", "99", "--lidars", "3")
    assert str(result.exception) == (
        "--lidars: found 3 and --cameras 99, expected at most 100 drives with further LiDARs"
    )
    assert not (tmp_path / "rig").exists()


def test_a_lidar_that_is_known_too_roughly_is_not_trusted(sure: CalibrationDocument) -> None:
    rig, ties = chain_of_lidars(), LidarTies((), {}, {})
    rough = with_pose(sure, np.eye(4), np.diag(np.repeat([0.01, np.radians(0.3)], 3) ** 2))
    cameras = {name: rough for name in rig.views if name in ("c0", "c0_on_l1")}
    further = Tie.of_calibration("c0", "l1", rough)
    adjustment, sensors = adjust(first_cameras(rig, cameras), [], [further])
    lidar = assess_lidar("l1", rig, {}, cameras, adjustment, sensors, ties)
    # Two errors of 0.3 degrees, and the quantile of a normal distribution.
    assert lidar.reasons == (
        "T_lidar_l1 is known only to +- 2.8 cm, +- 0.83 degrees (95 %), needed +- 10 cm, +- 0.5 degrees: use more "
        "frames, more cameras that see both LiDARs, or `register: true`",
    )
    assert (lidar.status, lidar.notes) == ("not_trusted", (UNCONFIRMED,))


def test_errors_of_k_that_are_the_whole_covariance_leave_it_positive(sure: CalibrationDocument) -> None:
    """Round-off may make the part by K the larger one."""
    exact = by_intrinsics(sure, np.eye(4), np.zeros(4))
    whole = 0.999 * OF_K @ OF_K.T + np.diag([0.0, 0.0, *SIGMA[2:4] ** 2, 0.0, 0.0])
    narrow = exact.uncertainty.model_copy(update={"covariance": tuple(map(tuple, whole.tolist()))})
    camera = exact.model_copy(update={"uncertainty": narrow})
    adjustment, _ = adjust({"front": camera}, [], [Tie.of_calibration("front", "rear", camera)])
    assert np.linalg.eigvalsh(adjustment.covariance).min() > 0.0


def test_overlays_and_inspection_take_each_camera_with_each_lidar(
    lidars: Path, results: tuple[Result, Path], tmp_path: Path
) -> None:
    ending = invoke("overlay", lidars, results[1], "-o", tmp_path / "o", "--by", "depth", "--max-frames", "1")
    assert ending.exit_code == 0, ending.output
    names = [*NAMES, *(f"{name}_on_{LIDAR}" for name in NAMES)]
    assert sorted(path.parent.name for path in (tmp_path / "o").rglob("*.png")) == sorted(names)
    lines = invoke("inspect", lidars).stdout.splitlines()
    assert [line for line in lines if line.startswith("[")] == [f"[{name}]" for name in names]


@pytest.fixture(scope="module")
def sweeps(lidars: Path) -> SweepPairs:
    drives = read_rig(lidars).read_drives()
    return read_sweep_pairs([drives["camera_1"]], [drives["camera_1_on_lidar_1"]])


def register(sweeps: SweepPairs, T_start: Pose) -> Registration:
    registration = register_sweeps(sweeps, T_start)
    assert isinstance(registration, Registration)
    return registration


def test_a_registration_is_as_near_the_truth_as_it_says(lidars: Path, sweeps: SweepPairs) -> None:
    truth = read_rig(lidars).reference("lidar", LIDAR)
    start = exp(np.array([0.05, -0.03, 0.04, 0.01, -0.008, 0.012])) @ truth
    registration = register(sweeps, start)
    assert (registration.num_pairs, registration.num_left_out) == (CONFIG.num_frames, 0)
    error = compare_poses(np.array(registration.T_lidar_further), truth)
    assert (np.abs(error.offsets) <= registration.tie(LIDAR).uncertainty.half_widths).all()
    # With the points moved, so is the answer; voxels divide the points another way, which costs a millimetre.
    S = make_pose((0.0, 0.0, 0.5), (0.4, 0.0, 0.1))
    moved = tuple(
        SweepPair(first, (further @ S[:3, :3].T + S[:3, 3]).astype(np.float32))
        for first, further in sweeps.pairs
    )
    found = np.array(register(SweepPairs(moved), start @ inverse(S)).T_lidar_further)
    away = compare_poses(found, np.array(registration.T_lidar_further) @ inverse(S))
    assert (away.rotation_deg, away.camera_center_m) == pytest.approx((0.0, 0.0), abs=0.01)


def test_what_cannot_be_registered_is_left_out(lidars: Path, sweeps: SweepPairs) -> None:
    """A pair has nothing in common, and another jumps."""
    truth = read_rig(lidars).reference("lidar", LIDAR)
    (first, further), *others = sweeps.pairs
    away = inverse(truth)[:3, :3] @ (0.0, 0.7, 0.0)
    jumped = SweepPair(first, (further + away).astype(np.float32))
    mixed = (*sweeps.pairs, SweepPair(first, 100.0 + further), jumped)
    registration = register(SweepPairs(mixed, Counter({"are of different moments": 3})), truth)
    assert (registration.num_pairs, registration.num_left_out) == (CONFIG.num_frames, 5)
    few = register_sweeps(SweepPairs((*others, *mixed[-2:])), truth)
    assert isinstance(few, NotRegistered)
    assert few.reason == (
        "4 of 6 pairs of sweeps could be, needed 5; 1 overlap by less than 30 %; "
        "1 end more than 0.5 m or 5 degrees from the start"
    )


def surroundings(kind: str, rng: np.random.Generator, num: int = 6_000) -> np.ndarray:
    """Points (N, 3) on the ground, walls and the ceiling of a scene along x, with noise of two centimetres."""
    along = [rng.uniform(-40.0, 40.0, num) for _ in range(5)]
    across, up = [rng.uniform(-5.0, 6.0, num) for _ in range(2)], rng.uniform(-1.8, 4.0, (3, num))
    ground = np.stack([along[0], across[0], np.full(num, -1.8)], axis=1)
    walls = [np.stack([along[1 + i], np.full(num, y), up[i]], axis=1) for i, y in enumerate((6.0, -5.0))]
    ceiling = np.stack([along[3], across[1], np.full(num, 4.0)], axis=1)
    end = np.stack([np.full(num // 5, 20.0), rng.uniform(-5, 6, num // 5), up[2][: num // 5]], axis=1)
    surfaces = {
        "ground and one wall": [ground, walls[0]],
        "tunnel": [ground, *walls, ceiling],
        "tunnel with an end": [ground, *walls, ceiling, end],
    }
    points = np.concatenate(surfaces[kind])
    return points + 0.02 * rng.standard_normal(points.shape)


@pytest.mark.parametrize("kind", ["ground and one wall", "tunnel"])
def test_a_scene_that_does_not_hold_the_pose_gives_no_registration(
    kind: str, rng: np.random.Generator
) -> None:
    """Every pair would stay 30 cm off along the walls, where it started."""
    pair = SweepPair(surroundings(kind, rng), surroundings(kind, rng))
    start = exp(np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0]))
    result = register_sweeps(SweepPairs((pair,) * MIN_PAIRS), start)
    assert isinstance(result, NotRegistered)
    assert result.reason == (
        "0 of 5 pairs of sweeps could be, needed 5; 5 do not hold the pose in all directions, as in a tunnel"
    )


def test_the_end_of_a_tunnel_holds_the_pose(rng: np.random.Generator) -> None:
    pairs = tuple(
        SweepPair(*(surroundings("tunnel with an end", rng) for _ in range(2))) for _ in range(MIN_PAIRS)
    )
    registration = register(SweepPairs(pairs), exp(np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.0])))
    error = compare_poses(np.array(registration.T_lidar_further), np.eye(4))
    assert error.camera_center_m < 0.02


def test_stiffness_is_that_of_the_best_turn_and_the_best_shift() -> None:
    """Points on a plane at a distance resist one shift and two turns; a lever arm adds nothing."""
    rng = np.random.default_rng(1)
    points = np.stack([*rng.uniform(-5.0, 5.0, (2, 400)), np.full(400, 3.0)], axis=1)
    slopes = np.hstack([np.cross(points, (0.0, 0.0, 1.0)), np.tile((0.0, 0.0, 1.0), (400, 1))])
    values = stiffness(slopes.T @ slopes / 400, 1.0)
    assert values[[0, 1, 3]] == pytest.approx(0.0, abs=1e-9)
    assert values[2] == pytest.approx(1.0, abs=0.05)
    # The variance of a uniform distribution of 10 m.
    assert values[4:] == pytest.approx(100.0 / 12.0, rel=0.2)


@pytest.mark.parametrize(
    ("changes", "stamps", "cause"),
    [
        ({}, (None, None), None),
        ({"synchronization": "stamps"}, (None, None), OF_UNKNOWN_MOMENTS),
        ({"synchronization": "stamps"}, (1.0, None), OF_UNKNOWN_MOMENTS),
        ({"synchronization": "stamps"}, (1.0, 1.0009), None),
        ({"synchronization": "stamps", "motion": Motion(speed_m_s=0.0)}, (None, None), None),
        ({"synchronization": "stamps", "motion": Motion(speed_m_s=1.0)}, (None, None), OF_UNKNOWN_MOMENTS),
        ({}, (1.0, 1.05), "are of different moments by their points_stamp"),
        ({"motion": Motion(speed_m_s=0.0)}, (1.0, 1.05), None),
    ],
)
def test_only_sweeps_of_one_moment_are_pairs(
    lidars: Path, changes: dict, stamps: tuple[float | None, float | None], cause: str | None
) -> None:
    """They are by their stamps, by a signal that triggers all, or since the rig stood still."""
    drives = read_rig(lidars).read_drives()

    def changed(name: str, stamp: float | None) -> Drive:
        frame = drives[name].frames[0].model_copy(update={"points_stamp": stamp})
        return drives[name].model_copy(update={**changes, "frames": (frame,)})

    found = read_sweep_pairs(
        *([changed(*each)] for each in zip(("camera_1", "camera_1_on_lidar_1"), stamps, strict=True))
    )
    assert (len(found.pairs), found.left_out) == ((0, {cause: 1}) if cause else (1, {}))


def test_the_robust_mean_ignores_what_is_far_off(rng: np.random.Generator) -> None:
    values = rng.standard_normal((40, 6))
    values[:4] += 50.0
    mean, _ = robust_mean_of_vectors(values)
    assert np.abs(mean - values[4:].mean(axis=0)).max() < 0.2


@pytest.mark.parametrize("num", [MIN_PAIRS, 8, 30])
def test_intervals_of_the_robust_mean_hold_it(num: int) -> None:
    rng, quantile = np.random.default_rng(num), core.student_quantile(0.975, num - 2)
    held, squares, stated = [], [], []
    for _ in range(400):
        mean, errors_of_mean = robust_mean_of_vectors(rng.standard_normal((num, 6)))
        held.append(np.abs(mean) <= quantile * errors_of_mean)
        squares.append(mean**2)
        stated.append(errors_of_mean**2)
    # Six axes of 400 means: three standard errors are 1.3 %; weights cost small numbers a per cent or two.
    assert 0.925 < np.mean(held) < 0.97
    assert np.sqrt(np.mean(stated) / np.mean(squares)) == pytest.approx(1.0, abs=0.15)
