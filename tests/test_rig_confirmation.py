"""Sensors of rigs of several LiDARs that nothing confirms, or that rely on what is contradicted."""

from types import SimpleNamespace

import numpy as np
import pytest
from rigs import with_pose
from test_rig_ties import SIGMA, wrong

from semcal_cli.many.rig.adjustment import adjust
from semcal_cli.many.rig.further_lidar import (
    UNCONFIRMED,
    LidarTies,
    assess_lidar,
    first_cameras,
)
from semcal_cli.many.rig.rig_calibration import combine
from semcal_cli.many.rig.rig_document import Rig
from semcal_cli.many.rig.ties import Tie, relying_on, unconfirmed
from semcal_cli.result.calibration_document import CalibrationDocument

IDENTITY = np.eye(4).tolist()


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
