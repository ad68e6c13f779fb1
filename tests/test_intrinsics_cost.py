import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from semcal_cli.checks.implausible_intrinsics import implausible_intrinsics, notes_on_intrinsics
from semcal_cli.checks.wrong_intrinsics import check_intrinsics
from semcal_cli.config import ExactConfig, PolishConfig, PyramidConfig
from semcal_cli.drive.camera import Camera, IntrinsicsSigma, intrinsic_value, with_intrinsics
from semcal_cli.drive.document import read_drive
from semcal_cli.estimation.adjust import intrinsics_estimate
from semcal_cli.estimation.adjust.intrinsics_estimate import estimate_intrinsics
from semcal_cli.estimation.adjust.priors import Prior, fuse_with_priors
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.estimation.refine.pyramid import refine_exactly
from semcal_cli.estimation.uncertainty.covariance import MANY, Matrix, estimate_uncertainty
from semcal_cli.estimation.uncertainty.intrinsics import (
    around_intrinsics,
    intrinsics_cost,
    shift_by,
    twist_by_intrinsics,
)
from semcal_cli.findings.check import findings_among
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.twists import apply_twist, displace
from semcal_cli.observations.cues.edges import STARTS, observe_edges
from semcal_cli.observations.observations import Observations

CONFIG = PolishConfig()
SIGMA = IntrinsicsSigma(fx=2.0, fy=2.0, cx=2.0, cy=2.0)


@pytest.fixture(scope="module")
def polished(street_observations: Observations, street_truth: Pose) -> Pose:
    return newton(street_observations, street_truth, CONFIG).T_camera_lidar


@pytest.fixture(scope="module")
def shift(street_observations: Observations, polished: Pose) -> Matrix:
    found = shift_by(around_intrinsics(street_observations, polished))
    assert found is not None
    return found[:, :4]


def changed(camera: Camera, by: np.ndarray) -> Camera:
    """Add (4,) pixels to fx, fy, cx and cy."""
    (fx, _, cx), (_, fy, cy), last_row = camera.K
    fx, fy, cx, cy = (np.array([fx, fy, cx, cy]) + by).tolist()
    return camera.model_copy(update={"K": ((fx, 0.0, cx), (0.0, fy, cy), last_row)})


@pytest.mark.parametrize("intrinsic", range(4))
def test_a_wrong_intrinsic_moves_the_pose_as_is_said(
    street_observations: Observations, polished: Pose, shift: Matrix, intrinsic: int
) -> None:
    by = (3.0 if intrinsic > 1 else 4.0) * np.eye(4)[intrinsic]
    seen = replace(street_observations, camera=changed(street_observations.camera, by))
    moved = newton(seen, apply_twist(polished, shift @ by), CONFIG).T_camera_lidar
    motions = around_intrinsics(street_observations, polished).motions[:6, :6]
    # First order: the rest of the way that a new calibration goes from the predicted pose.
    left = moved @ np.linalg.inv(apply_twist(polished, shift @ by))
    rest = np.array([*left[:3, 3], left[2, 1], left[0, 2], left[1, 0]])
    whole = shift @ by
    assert rest @ motions @ rest < 0.35**2 * (whole @ motions @ whole)
    assert whole @ motions @ whole > 0.5**2


def test_stated_errors_of_k_widen_the_interval(
    street_observations: Observations, polished: Pose, shift: Matrix
) -> None:
    camera = street_observations.camera.model_copy(update={"intrinsics_sigma": SIGMA})
    assert twist_by_intrinsics(shift, street_observations.camera) is None
    twist = twist_by_intrinsics(shift, camera)
    assert twist is not None
    of_intrinsics = twist @ twist.T
    np.testing.assert_allclose(of_intrinsics, 4.0 * shift @ shift.T)
    alone = estimate_uncertainty(street_observations, polished)
    wide = estimate_uncertainty(street_observations, polished, of_others=of_intrinsics)
    assert alone is not None
    assert wide is not None
    np.testing.assert_allclose(wide.covariance, np.array(alone.covariance) + of_intrinsics)
    # A part of the variance that is known exactly adds degrees of freedom.
    share = np.diag(alone.covariance) / np.diag(wide.covariance)
    most = np.minimum(np.array(alone.degrees_of_freedom) / share**2, MANY)
    np.testing.assert_allclose(wide.degrees_of_freedom, most, rtol=1e-9)
    # Known errors alone make the interval, of a normal distribution.
    huge = estimate_uncertainty(street_observations, polished, of_others=1e6 * of_intrinsics)
    assert huge is not None
    np.testing.assert_allclose(
        huge.half_width_95_camera_center_m, 1.96 * np.array(huge.sigma_camera_center_m), rtol=1e-3
    )


def test_more_frames_do_not_reduce_what_k_costs(
    street_observations: Observations, polished: Pose, shift: Matrix
) -> None:
    one = shift_by(around_intrinsics(street_observations.of_frames([1]), polished))
    assert one is not None
    camera = street_observations.camera
    costs = [intrinsics_cost(each, camera).together for each in (one, shift)]
    np.testing.assert_allclose(*costs, rtol=0.5)


def test_labels_with_stated_errors_of_k_weigh_less_than_a_prior(
    street_observations: Observations, polished: Pose
) -> None:
    prior = Prior("stated", polished, np.array([0.01, 0.01, 0.01, 0.002, 0.002, 0.002]))
    camera = street_observations.camera.model_copy(update={"intrinsics_sigma": SIGMA})
    sure = fuse_with_priors(street_observations, polished, [prior])
    unsure = fuse_with_priors(replace(street_observations, camera=camera), polished, [prior])
    assert sure.uncertainty is not None
    assert unsure.uncertainty is not None
    of_unsure, of_sure = (np.sqrt(np.diag(found.uncertainty.covariance)) for found in (unsure, sure))
    assert (of_unsure > of_sure).all()
    assert np.trace(unsure.label_gain) < np.trace(sure.label_gain)
    assert (of_unsure < prior.sigmas).all()


def test_a_good_camera_is_confirmed(street_observations: Observations, polished: Pose) -> None:
    around = around_intrinsics(street_observations, polished)
    estimate = estimate_intrinsics(street_observations, polished, around)
    assert findings_among(check_intrinsics(estimate, street_observations.camera).measured) == ()
    tested = check_intrinsics(estimate, street_observations.camera)
    assert tested.checked is not None
    assert tested.checked.is_confirmed
    assert tested.notes[0].startswith("these frames confirm cx to +- ")
    assert notes_on_intrinsics(street_observations.camera, None) == ()


@pytest.mark.parametrize(
    ("name", "off"), [("cx", 20.0), ("cx", -25.0), ("cy", 22.0), ("fx", 20.0), ("fy", -20.0), ("k1", 0.1)]
)
def test_a_wrong_intrinsic_is_named_with_its_value(
    street_observations: Observations, street_truth: Pose, name: str, off: float
) -> None:
    """Also cy, which a pitch imitates: the pose is 2 degrees off, and the polish has settled there."""
    camera = street_observations.camera
    given = intrinsic_value(camera, name)
    seen = replace(street_observations, camera=with_intrinsics(camera, {name: given + off}))
    refined = refine_exactly(seen, street_truth, ExactConfig(), PyramidConfig(coarsest_block_deg=3.0))
    assert refined is not None
    T = newton(seen, refined.T_camera_lidar, CONFIG).T_camera_lidar
    estimate = estimate_intrinsics(seen, T, around_intrinsics(seen, T))
    (finding,) = findings_among(check_intrinsics(estimate, seen.camera).measured)
    assert estimate is not None
    assert [*estimate.given][int(estimate.deviations.argmax())] == name
    assert finding.sentence.startswith(f"the frames contradict the intrinsics: {name} should be ")
    advised = finding.advice.rpartition(" ")[2].split(",")
    assert {*re.findall(r"(\w+) should be ", finding.found)} <= {*advised} <= {*estimate.given}
    index = [*estimate.given].index(name)
    assert estimate.changes[index] == pytest.approx(-off, abs=3.0 * estimate.sigmas[index])


def test_a_single_frame_does_not_confirm_k_by_edges(street: Path, street_truth: Pose) -> None:
    one = replace(observe_edges(read_drive(street)), starts=STARTS).of_frames([0])
    assert estimate_intrinsics(one, street_truth, around_intrinsics(one, street_truth)) is None
    assert check_intrinsics(None, one.camera).notes[0].startswith("K was not checked")


@pytest.mark.parametrize(("with_given_focal", "is_accused"), [(0.0, False), (4.0, True)])
def test_edges_accuse_k_only_with_the_given_focal_length_as_well(
    fine_street: Path,
    street_truth: Pose,
    monkeypatch: pytest.MonkeyPatch,
    with_given_focal: float,
    is_accused: bool,
) -> None:
    seen = replace(observe_edges(read_drive(fine_street)), starts=STARTS)
    T = displace(street_truth, 8.0, 0.0, np.random.default_rng(0))
    around = around_intrinsics(seen, T)
    sigma_px = 0.0

    def ascend(_: Observations, T_start: Pose, names: tuple[str, ...]) -> SimpleNamespace:
        off = 5.0 if "fy" in names else with_given_focal
        changes = [off * sigma_px if name == "cy" else 0.0 for name in names]
        return SimpleNamespace(changes=changes, T_camera_lidar=street_truth, moved_px=0.0)

    monkeypatch.setattr(intrinsics_estimate, "ascend_with", ascend)
    at_given = estimate_intrinsics(seen, T, around)
    assert at_given is not None
    index = [*at_given.given].index("cy")
    sigma_px = float(at_given.sigmas[index])
    estimate = estimate_intrinsics(seen, T, around)
    assert estimate is not None
    assert estimate.changes[index] == pytest.approx((5.0 if is_accused else 0.0) * sigma_px)
    assert bool(findings_among(check_intrinsics(estimate, seen.camera).measured)) == is_accused


@pytest.mark.parametrize(
    ("width", "height", "K", "named"),
    [
        (1242, 375, (721.5, 721.5, 609.6, 172.9), []),  # KITTI, cropped below and above
        (1600, 900, (1259.5, 1259.5, 807.3, 501.2), []),  # the farthest off of nuScenes' cameras
        (1920, 1200, (2813.6, 2808.3, 969.3, 624.0), []),  # RELLIS-3D
        (1920, 1080, (1000.0, 1000.0, 640.0, 360.0), ["cx", "cy"]),  # of 1280 x 720
        (1408, 376, (552.6, 552.6, 682.0, 238.8), ["cy"]),  # KITTI-360, cropped above
        (900, 1600, (1259.5, 1259.5, 398.8, 807.3), []),  # the one of nuScenes on its side
        (1280, 720, (1000.0, 900.0, 640.0, 360.0), ["fx"]),  # squeezed
    ],
)
def test_intrinsics_that_no_lens_has(
    width: int, height: int, K: tuple[float, float, float, float], named: list[str]
) -> None:
    fx, fy, cx, cy = K
    matrix = ((fx, 0.0, cx), (0.0, fy, cy), (0.0, 0.0, 1.0))
    camera = Camera(model="plumb_bob", width=width, height=height, K=matrix)
    assert [*implausible_intrinsics(camera)] == named
    cost = intrinsics_cost(np.full((6, 4), 0.001), camera)
    notes = notes_on_intrinsics(camera, cost)
    assert len(notes) == len(named)
    assert all(" moves the pose by " in note for note in notes)
    assert any("another size" in note for note in notes) == (len(named) == 2)
