"""Intrinsics and the offset of the clock, estimated together with the pose."""

import math
from dataclasses import asdict, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conftest import with_twists

from semcal_cli.checks.families import check_stages
from semcal_cli.config import AdjustmentConfig, CalibrationConfig, PolishConfig, RefinementConfig
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.camera import Camera, IntrinsicsSigma, intrinsic_names, intrinsic_value, with_intrinsics
from semcal_cli.errors import InputError
from semcal_cli.estimation.adjust.joint import JointEstimate, fit_jointly
from semcal_cli.estimation.adjust.joint_fit import MIN_EVIDENCE, Problem, Variables
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.estimation.uncertainty.covariance import with_others
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.observations.motion import delayed
from semcal_cli.observations.observations import Observations
from semcal_cli.pipeline import assess, calibration, refine_and_polish, start_at
from semcal_cli.pipeline.stages import Stages
from semcal_cli.result.uncertainty import Uncertainty
from semcal_cli.synthetic.synthesis import LENSES, make_camera, synthesize

K_NAMES = ("fx", "fy", "cx", "cy")
MOVING = SynthConfig(
    num_frames=8, seed=93101, width=640, height=360, channels=32, columns=600, motion="mixed"
)
# Three times what eight frames of 640 x 360 were measured to end at.
MAX_FOCAL_SHARE = 0.006
MAX_CENTER_PX = 3.0
MAX_CLOCK_S = 0.003


@pytest.fixture(scope="module")
def observed(synthetic_eight: LoadedDrive) -> Observations:
    return synthetic_eight.observations


@pytest.fixture(scope="module")
def synthetic_eight(tmp_path_factory: pytest.TempPathFactory) -> LoadedDrive:
    folder = tmp_path_factory.mktemp("still") / "drive"
    synthesize(replace(MOVING, motion="none"), folder)
    return load(folder)


@pytest.fixture(scope="module")
def truth(synthetic_eight: LoadedDrive) -> Pose:
    return np.array(synthetic_eight.drive.T_camera_lidar)


@pytest.fixture(scope="module")
def moving(tmp_path_factory: pytest.TempPathFactory) -> LoadedDrive:
    folder = tmp_path_factory.mktemp("moving") / "drive"
    synthesize(MOVING, folder)
    return load(folder)


@pytest.fixture(scope="module")
def late(moving: LoadedDrive) -> JointEstimate:
    """What is found where images are 20 ms late, of the clock alone."""
    seen, truth = delayed(moving.observations, -0.02), np.array(moving.drive.T_camera_lidar)
    return fit_jointly(seen, truth, AdjustmentConfig(with_delay=True), PolishConfig())


def spoiled(camera: Camera, share: float, pixels: float) -> Camera:
    values = {name: intrinsic_value(camera, name) for name in K_NAMES}
    changed = {name: x * (1.0 + share) if name[0] == "f" else x + pixels for name, x in values.items()}
    return with_intrinsics(camera, changed)


def estimate(observations: Observations, T: Pose, names: tuple[str, ...] = K_NAMES) -> JointEstimate:
    return fit_jointly(observations, T, AdjustmentConfig(names), PolishConfig())


@pytest.mark.parametrize(("share", "pixels"), [(0.03, -8.0), (-0.03, 8.0)])
def test_wrong_intrinsics_are_found_from_both_sides(
    observed: Observations, truth: Pose, share: float, pixels: float
) -> None:
    wrong = replace(observed, camera=spoiled(observed.camera, share, pixels))
    found = estimate(wrong, truth)
    assert found.is_kept
    assert found.camera is not None
    for name, each in found.camera.intrinsics.items():
        true = intrinsic_value(observed.camera, name)
        assert each.given == intrinsic_value(wrong.camera, name)
        most = MAX_FOCAL_SHARE * true if name[0] == "f" else MAX_CENTER_PX
        assert abs(each.found - true) < most, name
    assert found.observations.camera == found.camera.found


@pytest.mark.parametrize(
    ("given", "found", "is_told"), [(1.0, 1.02, True), (1.0, 1.005, False), (1.03, 1.02, False)]
)
def test_an_estimate_that_contradicts_square_pixels_is_told(
    observed: Observations, truth: Pose, given: float, found: float, is_told: bool
) -> None:
    """A lens keeps its aspect; where the drive states another one, nothing is known of it."""

    def squeezed(camera: Camera, aspect: float) -> Camera:
        return with_intrinsics(camera, {"fx": aspect * intrinsic_value(camera, "fy")})

    wrong = replace(observed, camera=squeezed(spoiled(observed.camera, 0.03, 8.0), given))
    joint = estimate(wrong, truth)
    assert joint.camera is not None
    assert check_stages(None, None, None, joint) == ()
    camera = joint.camera.model_copy(update={"found": squeezed(joint.camera.found, found)})
    findings = check_stages(None, None, None, replace(joint, camera=camera))
    assert [finding.topic for finding in findings] == ["refined-aspect"] * is_told


def test_right_intrinsics_and_their_pose_stay(observed: Observations, truth: Pose) -> None:
    found = estimate(observed, truth)
    assert not found.is_kept
    assert np.array_equal(found.T_camera_lidar, truth)
    assert found.observations is observed
    assert found.uncertainty is None
    assert found.notes[-1] == (
        "the intrinsics of the drive are kept, because the estimate differs from them only by chance"
    )


def test_a_camera_that_is_known_exactly_stays(observed: Observations, truth: Pose) -> None:
    wrong = replace(observed, camera=spoiled(observed.camera, 0.03, 8.0))
    exact = AdjustmentConfig(K_NAMES, focal_sigma=1e-9, center_sigma_px=1e-9)
    found = fit_jointly(wrong, truth, exact, PolishConfig())
    assert not found.is_kept
    assert np.array_equal(found.T_camera_lidar, truth)


def test_coarse_blocks_that_lead_away_are_not_followed(
    moving: LoadedDrive, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth, climb = np.array(moving.drive.T_camera_lidar), Problem._climb

    def astray(problem: Problem, T: Pose, variables: Variables, *rest: Any) -> Any:
        if rest[-1] != MIN_EVIDENCE:
            return climb(problem, T, variables, *rest)
        away = displace(T, 20.0, 0.1, np.random.default_rng(0))
        return SimpleNamespace(T_camera_lidar=away, changes=(), offset_s=0.0, moved_px=0.0)

    monkeypatch.setattr(Problem, "_climb", astray)
    found = Problem(
        moving.observations, Variables((), True), AdjustmentConfig(with_delay=True), PolishConfig()
    ).fit_determined(truth)
    assert found.variables.with_delay
    assert abs(found.changes[0]) < MAX_CLOCK_S
    assert compare_poses(found.T_camera_lidar, truth).rotation_deg < 0.1


@pytest.mark.parametrize("late_s", [0.02, -0.05])
def test_late_images_are_found(moving: LoadedDrive, late: JointEstimate, late_s: float) -> None:
    found = late
    if late_s < 0.0:
        seen, truth = delayed(moving.observations, -late_s), np.array(moving.drive.T_camera_lidar)
        found = fit_jointly(seen, truth, AdjustmentConfig(with_delay=True), PolishConfig())
    assert found.is_kept
    assert found.clock is not None
    assert abs(found.clock.time_offset_s - late_s) < MAX_CLOCK_S
    assert ("later" if late_s > 0.0 else "earlier") in found.clock.meaning


@pytest.mark.parametrize("names", [(), ("fx", "fy")])
def test_a_clock_tells_how_it_goes_with_the_pose(
    moving: LoadedDrive, late: JointEstimate, names: tuple[str, ...]
) -> None:
    """Also where nothing but the clock is estimated; its row is the last one, in seconds."""
    found = late
    if names:
        seen, truth = delayed(moving.observations, -0.02), np.array(moving.drive.T_camera_lidar)
        found = fit_jointly(seen, truth, AdjustmentConfig(names, with_delay=True), PolishConfig())
    assert found.clock is not None
    assert found.uncertainty is not None
    covariance = np.array(found.clock.joint_covariance)
    assert covariance.shape == (7, 7)
    assert np.sqrt(covariance[6, 6]) == pytest.approx(found.clock.sigma_s)
    assert covariance[:6, :6] == pytest.approx(np.array(found.uncertainty.covariance))
    if found.camera is not None:
        of_all = np.array(found.camera.joint_covariance)
        assert len(of_all) == 6 + len(names) + 1
        places = [*range(6), len(of_all) - 1]
        assert np.array_equal(covariance, of_all[np.ix_(places, places)])


def test_an_offset_adds_to_that_of_the_drive(moving: LoadedDrive, late: JointEstimate) -> None:
    seen, truth = delayed(moving.observations, -0.02), np.array(moving.drive.T_camera_lidar)
    added = fit_jointly(seen, truth, AdjustmentConfig(with_delay=True), PolishConfig(), 0.3).clock
    assert late.clock is not None
    assert added is not None
    assert added.time_offset_s == pytest.approx(late.clock.time_offset_s + 0.3)
    assert (late.clock.given_s, added.given_s) == (0.0, 0.3)


def assessed(data: LoadedDrive, T: Pose, jointly: AdjustmentConfig) -> Stages:
    config = RefinementConfig(jointly=jointly)
    return assess(data, refine_and_polish(data, start_at(data, InitialPose(T, "start")), config), config)


def half_widths(stages: Stages) -> np.ndarray:
    assert stages.uncertainty is not None
    return np.array(stages.uncertainty.half_widths)


def test_the_interval_holds_what_stays_open_of_the_intrinsics(
    synthetic_eight: LoadedDrive, truth: Pose
) -> None:
    """One frame does not tell K: with K taken for right, the interval is too narrow."""
    camera = spoiled(synthetic_eight.observations.camera, 0.0, 8.0)
    changes = {"camera": camera, "frames": synthetic_eight.drive.frames[4:5]}
    observations = replace(synthetic_eight.observations.of_frames([4]), camera=camera)
    data = LoadedDrive(synthetic_eight.drive.model_copy(update=changes), observations)
    sure, open_ = (assessed(data, truth, AdjustmentConfig(names)) for names in ((), K_NAMES))
    assert not open_.is_joint
    assert np.array_equal(open_.T_camera_lidar, sure.T_camera_lidar)
    off = np.abs(compare_poses(sure.T_camera_lidar, truth).rotation_xyz_deg)
    assert (off[:2] > 2.0 * half_widths(sure)[3:5]).all()
    assert (off < half_widths(open_)[3:]).all()


def test_what_was_found_and_not_kept_is_in_the_interval(synthetic_eight: LoadedDrive, truth: Pose) -> None:
    """The pose may be off by what stays uncertain and by what was found of it; by nothing where K is known exactly."""
    names = ("cx", "cy")
    known, free = (
        fit_jointly(
            synthetic_eight.observations, truth, AdjustmentConfig(names, center_sigma_px=px), PolishConfig()
        )
        for px in (1e-9, 20.0)
    )
    assert not known.is_kept
    assert not free.is_kept
    assert known.left_open is not None
    assert free.left_open is not None
    assert np.sqrt(np.diag(known.left_open)).max() < 1e-9
    assert free.camera is not None
    cy = free.camera.intrinsics["cy"]
    assert cy.sigma is not None
    assert abs(cy.found - cy.given) > 0.5 * cy.sigma
    # An image that lies lower by some pixels looks like a pitch by as many.
    pitch_rad = math.hypot(cy.sigma, cy.found - cy.given) / intrinsic_value(
        synthetic_eight.observations.camera, "fy"
    )
    assert math.sqrt(free.left_open[3, 3]) == pytest.approx(pitch_rad, rel=0.15)


def test_a_drive_states_how_well_its_camera_is_known(observed: Observations) -> None:
    stated = IntrinsicsSigma(fx=0.5, cx=0.4)
    camera = observed.camera.model_copy(update={"intrinsics_sigma": stated})
    variables = Variables(K_NAMES, with_delay=False)
    fy = intrinsic_value(camera, "fy")
    assert variables.sigmas(camera, AdjustmentConfig()) == pytest.approx([0.5, 0.02 * fy, 0.4, 10.0])
    asked = AdjustmentConfig(focal_sigma=0.01, center_sigma_px=3.0)
    assert variables.sigmas(camera, asked) == pytest.approx([0.01 * fy, 0.01 * fy, 3.0, 3.0])


def test_at_one_speed_the_place_along_the_motion_is_open(moving: LoadedDrive) -> None:
    steady = [(12.0, 0.0, 0.0, 0.0, 0.0, 0.0)] * moving.observations.num_frames
    data = replace(moving, observations=with_twists(moving.observations, steady))
    stages = assessed(data, np.array(moving.drive.T_camera_lidar), AdjustmentConfig(with_delay=True))
    # A tenth of a second, which is what is known of the clock, at 12 m/s.
    assert half_widths(stages)[:3].max() == pytest.approx(1.96 * 1.2, rel=0.05)
    (finding,) = (each for each in stages.findings if each.topic == "wide-interval")
    advice = (
        "drive at different speeds, with turns, or calibrate without --estimate-delay if the clocks agree"
    )
    assert finding.advice == advice
    # What the clock may be off is recorded, though the pose is that of the drive's.
    assert stages.settings["jointly"] == asdict(AdjustmentConfig(with_delay=True))
    assert stages.joint is not None
    assert stages.joint.clock is not None
    assert not stages.joint.is_kept
    assert not stages.joint.clock.is_determined
    assert stages.joint.clock.meaning == "not determined: drive at different speeds, with turns"
    found = replace(stages.joint, clock=stages.joint.clock.model_copy(update={"is_determined": True}))
    assert found.advice == advice


@pytest.mark.parametrize(
    ("jointly", "complaint"),
    [
        (
            AdjustmentConfig(("fx", "k9")),
            r"--refine-intrinsics: found 'k9', expected names of plumb_bob: fx, fy",
        ),
        (
            AdjustmentConfig(with_delay=True),
            r"motion: found no direction of motion, expected poses or a twist for --estimate-delay",
        ),
    ],
)
def test_what_the_drive_does_not_allow_for_is_refused_before_the_search(
    synthetic_eight: LoadedDrive,
    truth: Pose,
    monkeypatch: pytest.MonkeyPatch,
    jointly: AdjustmentConfig,
    complaint: str,
) -> None:
    monkeypatch.setattr(calibration, "initialize", lambda *_: pytest.fail("searched"))
    config = RefinementConfig(jointly=jointly)
    with pytest.raises(InputError, match=complaint):
        calibration.calibrate(synthetic_eight, CalibrationConfig(refinement=config))
    with pytest.raises(InputError, match=complaint):
        refine_and_polish(synthetic_eight, start_at(synthetic_eight, InitialPose(truth, "truth")), config)


@pytest.mark.parametrize("lens", LENSES)
def test_every_number_of_a_lens_has_a_name(lens: str) -> None:
    camera = make_camera(replace(MOVING, lens=lens))  # type: ignore[arg-type]
    for name in intrinsic_names(camera.model):
        value = intrinsic_value(camera, name)
        by = 0.01 * value if name[0] == "f" else 1e-3
        changed = with_intrinsics(camera, {name: value + by})
        others = [other for other in intrinsic_names(camera.model) if other != name]
        assert intrinsic_value(changed, name) == value + by
        assert all(intrinsic_value(changed, other) == intrinsic_value(camera, other) for other in others)


def test_a_parked_rig_tells_intrinsics_and_no_clock(observed: Observations, truth: Pose) -> None:
    parked = with_twists(observed, [(0.0,) * 6] * observed.num_frames)
    wrong = replace(parked, camera=spoiled(observed.camera, 0.03, 0.0))
    found = fit_jointly(wrong, truth, AdjustmentConfig(("fx", "fy"), with_delay=True), PolishConfig())
    assert found.is_kept
    assert found.camera is not None
    assert found.clock is not None
    assert all(each.is_determined for each in found.camera.intrinsics.values())
    assert not found.clock.is_determined


def test_stated_errors_of_what_was_not_estimated_stay_in_the_interval() -> None:
    alone = Uncertainty.from_covariance(np.eye(4), 1e-6 * np.eye(6), np.full(6, 10.0))
    both = with_others(alone, np.eye(4), 3e-6 * np.eye(6))
    assert both.sigma_camera_center_m == pytest.approx([2e-3] * 3)
    assert both.degrees_of_freedom == pytest.approx([160.0] * 6)
    assert with_others(alone, np.eye(4), np.zeros((6, 6))) is alone


def test_stated_errors_of_replaced_intrinsics_go() -> None:
    stated = {"intrinsics_sigma": IntrinsicsSigma(fx=1.0, fy=2.0, cx=3.0, cy=4.0)}
    camera = make_camera(MOVING).model_copy(update=stated)
    changed = with_intrinsics(camera, {"fx": 300.0, "k1": 0.01})
    assert changed.intrinsics_sigma == IntrinsicsSigma(fx=0.0, fy=2.0, cx=3.0, cy=4.0)
