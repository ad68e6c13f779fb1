"""Intrinsics of sweeps that a speed skews: the speed is found together with cx, because each looks like the other."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_skew import FAST_M_S, skew_at, skewed as skewed, spin_at

from semcal_cli.config import AdjustmentConfig, PolishConfig, RefinementConfig
from semcal_cli.drive.camera import intrinsic_value, with_intrinsics
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.lidar import Lidar
from semcal_cli.estimation.adjust import deskewed as speeds
from semcal_cli.estimation.adjust.deskewed import deskew
from semcal_cli.estimation.adjust.joint import fit_jointly
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.loading import load
from semcal_cli.observations.observations import Observations
from semcal_cli.pipeline import refine_and_polish
from semcal_cli.pipeline.assessment import _AssessedPose
from semcal_cli.pipeline.pose_stages import deskew_sweeps, start_at
from semcal_cli.pipeline.stages import Stages


def test_a_speed_does_not_hide_a_wrong_principal_point(
    skewed: Observations, street: Path, street_truth: Pose
) -> None:
    """K is tested at a speed that it does not change."""
    camera = skewed.camera
    (fx, _, cx), *rows = camera.K
    off = camera.model_copy(update={"K": ((fx, 0.0, cx + 6.0), *rows)})
    skew = skew_at(street_truth)
    wrong = replace(skewed, camera=off)
    by_polish, with_center = (
        speeds._find_maximum(fits)
        for ascent in (speeds.POLISH, speeds._polish_with(skew.center))
        if (fits := speeds._fit_speeds(wrong, skew, street_truth, ascent)) is not None
    )
    assert by_polish is not None
    assert with_center is not None
    assert abs(by_polish.along_view_m_s - FAST_M_S) > 4.0
    assert abs(with_center.along_view_m_s - FAST_M_S) < 3.0
    data = replace(load(read_drive(street)), observations=wrong)
    lidar = Lidar.model_validate({"spin": spin_at(street_truth)})
    data = replace(data, drive=data.drive.model_copy(update={"lidar": lidar}))
    stages = Stages.from_refined(
        data, start_at(data, InitialPose(street_truth, "truth")), None, is_compensated=True
    )
    seen, stages = deskew_sweeps(data, stages)
    assert stages.is_deskewed
    pose = _AssessedPose(seen, stages, PolishConfig(), None)
    tested = pose.tested_intrinsics()
    assert tested is not None
    assert dict(zip(tested.given, tested.changes, strict=True))["cx"] == pytest.approx(-6.0, abs=1.5)


def estimated(drive: Path, seen: Observations, T: Pose, spin: dict[str, Any] | None, *names: str) -> Stages:
    """Estimate intrinsics with the pose of a LiDAR that turns."""
    data = load(read_drive(drive))
    lidar = None if spin is None else Lidar.model_validate({"spin": spin})
    data = replace(data, observations=seen, drive=data.drive.model_copy(update={"lidar": lidar}))
    config = RefinementConfig(jointly=AdjustmentConfig(intrinsics=names))
    return refine_and_polish(data, start_at(data, InitialPose(T, "truth")), config)


@pytest.mark.parametrize("pixels", [14.0, -14.0])
def test_intrinsics_are_estimated_by_sweeps_that_a_speed_deskews(
    skewed: Observations, street: Path, street_truth: Pose, pixels: float
) -> None:
    """The speed is found together with cx, whose interval includes its error, once."""
    right = intrinsic_value(skewed.camera, "cx")
    wrong = replace(skewed, camera=with_intrinsics(skewed.camera, {"cx": right + pixels}))
    recorded, deskewed = (
        estimated(street, wrong, street_truth, spin, "fx", "cx") for spin in (None, spin_at(street_truth))
    )
    assert recorded.deskewed is None
    assert deskewed.deskewed is not None
    speed, errors = deskewed.deskewed.speed, deskewed.deskewed.errors
    assert speed is not None
    assert abs(speed.along_view_m_s - FAST_M_S) < 3.0 * speed.sigma_m_s
    joint = deskewed.joint
    assert joint is not None
    assert joint.is_kept
    assert joint.camera is not None
    cx = joint.camera.intrinsics["cx"]
    assert cx.sigma is not None
    assert abs(cx.found - right) < min(3.0, 2.0 * cx.sigma)
    assert recorded.joint is not None
    assert recorded.joint.camera is not None
    assert abs(recorded.joint.camera.intrinsics["cx"].found - right) > 12.0
    off_m = [
        compare_poses(stages.T_camera_lidar, street_truth).camera_center_m for stages in (recorded, deskewed)
    ]
    assert off_m[1] < 0.5 * off_m[0]
    assert deskewed.polished is not None
    T, config = deskewed.polished.T_camera_lidar, AdjustmentConfig(intrinsics=("fx", "cx"))
    without = fit_jointly(deskewed.deskewed.observations, T, config, PolishConfig())
    assert joint.uncertainty is not None
    assert without.uncertainty is not None
    assert without.camera is not None
    alone = without.camera.intrinsics["cx"].sigma
    assert alone is not None
    assert errors is not None
    assert cx.sigma**2 - alone**2 == pytest.approx(errors.covariance[6, 6])
    wider = np.subtract(joint.uncertainty.covariance, without.uncertainty.covariance)
    np.testing.assert_allclose(wider, errors.of_pose, atol=1e-12)
    data = replace(load(read_drive(street)), observations=joint.observations)
    assert _AssessedPose(data, deskewed, PolishConfig(), None).budget.speed is None


def test_cx_is_free_only_where_it_is_asked_for(
    skewed: Observations, street: Path, street_truth: Pose
) -> None:
    """With a wrong fx, the plain speed deskews, its error counts once, and K is tested with the fx that is found."""
    camera = skewed.camera
    wrong = replace(skewed, camera=with_intrinsics(camera, {"fx": 1.02 * intrinsic_value(camera, "fx")}))
    stages = estimated(street, wrong, street_truth, spin_at(street_truth), "fx")
    joint, deskewed, polished = stages.joint, stages.deskewed, stages.polished
    assert joint is not None
    assert deskewed is not None
    assert polished is not None
    assert joint.is_kept
    assert joint.uncertainty is not None
    assert deskewed.covariance is not None
    assert deskewed.errors is not None
    assert "cx" not in deskewed.note
    assert not deskewed.errors.covariance[6].any()
    config = AdjustmentConfig(intrinsics=("fx",))
    without = fit_jointly(deskewed.observations, polished.T_camera_lidar, config, PolishConfig()).uncertainty
    assert without is not None
    wider = np.subtract(joint.uncertainty.covariance, without.covariance)
    np.testing.assert_allclose(wider, deskewed.covariance, atol=1e-12)
    pose = _AssessedPose(
        replace(load(read_drive(street)), observations=joint.observations), stages, PolishConfig(), None
    )
    assert pose.budget.speed is None
    tested = pose.tested_intrinsics()
    assert tested is not None
    assert tested.given["fx"] == intrinsic_value(joint.observations.camera, "fx")
    assert max(tested.deviations) < 4.0


def test_a_speed_with_cx_that_may_be_none_deskews_nothing(
    street_observations: Observations, street_truth: Pose
) -> None:
    deskewed = deskew(street_observations, skew_at(street_truth), street_truth, with_center=True)
    assert deskewed.observations is street_observations
    assert deskewed.T_camera_lidar is street_truth
    assert "no speed" in deskewed.note
    assert deskewed.speed is not None
    assert deskewed.errors is not None
    assert deskewed.errors.covariance[6, 6] > 0.0


def test_an_error_of_the_speed_counts_once_where_intrinsics_stay(
    skewed: Observations, street_truth: Pose
) -> None:
    """What a speed does to the pose includes what it does by cx."""
    deskewed = deskew(skewed, skew_at(street_truth), street_truth, with_center=True)
    T = newton(deskewed.observations, street_truth, PolishConfig()).T_camera_lidar
    config = AdjustmentConfig(intrinsics=("cx",))
    without, joint = (
        fit_jointly(deskewed.observations, T, config, PolishConfig(), speed_errors=errors)
        for errors in (None, deskewed.errors)
    )
    assert not joint.is_kept
    assert joint.left_open is not None
    assert without.left_open is not None
    np.testing.assert_allclose(joint.left_open, without.left_open, atol=1e-12)
