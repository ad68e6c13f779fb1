"""A camera on its side sees the same edges, and is calibrated like an upright one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from laboratory.portrait import TURN, on_side, write_portrait_drive
from test_skew import AHEAD, FAST_M_S, SPIN, array_drive, skew_at, skewed as skewed

from semcal_cli.config import CalibrationConfig, RefinementConfig
from semcal_cli.drive.camera import intrinsic_value, with_intrinsics
from semcal_cli.drive.document import read_drive
from semcal_cli.estimation.adjust.deskewed import deskew
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.files.array_forms import ArrayCloud
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.cues.cue_table import load_cues
from semcal_cli.observations.cues.edges import edges_of_sweeps, observe_edges
from semcal_cli.observations.loading import load
from semcal_cli.observations.observations import NO_CLASS, LabelledImage, Observations
from semcal_cli.observations.skew import Skew
from semcal_cli.pipeline import calibrate, refine_and_polish, start_at

SAME = 0.999
"""Share of the levels of a turned image that are those of the upright one: blurs add up in another order."""

ALIKE_DEG, ALIKE_CM = 0.03, 0.05
"""By gradients from left to right, the camera on its side ends 0.07 degrees and 1.1 cm farther off."""
OPPOSITE_CORNER = 0.5
"""Speeds are alike to this, metres per second: blocks of pixels begin in another corner of the image."""


@pytest.fixture(scope="module")
def portrait(fine_street: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_portrait_drive(fine_street, tmp_path_factory.mktemp("portrait") / "drive")


def test_levels_are_those_along_the_scan_lines(fine_street: Path, portrait: Path, street_truth: Pose) -> None:
    upright, turned = (observe_edges(read_drive(path)) for path in (fine_street, portrait))
    assert upright.along_scans(street_truth) is upright
    along = turned.along_scans(TURN @ street_truth)
    assert along.along_scans(TURN @ street_truth) is along
    for image, before, expected in zip(along.images, turned.images, upright.images, strict=True):
        levels = np.rot90(expected.classes, -1)
        assert np.mean(image.classes == levels) > SAME
        assert np.mean(before.classes == levels) < 0.5
    again = along.along_scans(street_truth)
    for image, before in zip(again.images, turned.images, strict=True):
        np.testing.assert_array_equal(image.classes, before.classes)


def test_it_is_calibrated_like_an_upright_one(fine_street: Path, portrait: Path, street_truth: Pose) -> None:
    config, start = (
        CalibrationConfig(cues=("edges",)),
        displace(street_truth, 1.0, 0.1, np.random.default_rng(7)),
    )
    ends = []
    for path, turn in ((fine_street, np.eye(4)), (portrait, TURN)):
        found = calibrate(load(path, config), config, initial_pose=InitialPose(turn @ start, "start"))
        off = compare_poses(np.array(found.T_camera_lidar), turn @ street_truth)
        ends.append((off.rotation_deg, off.camera_center_cm))
    assert ends[1][0] == pytest.approx(ends[0][0], abs=ALIKE_DEG)
    assert ends[1][1] == pytest.approx(ends[0][1], abs=ALIKE_CM)


def test_gradients_beside_another_cue_keep_their_classes(portrait: Path, street_truth: Pose) -> None:
    drive, T = read_drive(portrait), TURN @ street_truth
    alone = load_cues(drive, ("edges",)).along_scans(T)
    both = load_cues(drive, ("labels", "edges")).along_scans(T)
    num_labels = len(both.image_class_names) - len(alone.image_class_names)
    for image, beside in zip(alone.images, both.of_cue(1).images, strict=True):
        known = image.classes != NO_CLASS
        np.testing.assert_array_equal(beside.classes[known], image.classes[known] + num_labels)


def test_later_stages_see_the_gradients_of_the_refinement(portrait: Path, street_truth: Pose) -> None:
    """Whoever refines from another mounting, as verify does after a search, need not know of scan lines."""
    data = load(portrait, CalibrationConfig(cues=("edges",)))
    start = start_at(data, InitialPose(TURN @ street_truth, "truth"))
    stages = refine_and_polish(data, start, RefinementConfig())
    assert stages.seen is not None
    assert {image.along for image in stages.seen.images} == {"columns"}
    assert {image.along for image in data.observations.images} == {"rows"}


def test_the_axis_of_several_sweeps_has_one_sign() -> None:
    """The axis of a LiDAR on its side is level, so that noise decides which end has a positive z coordinate."""
    azimuth = np.radians(np.arange(0.0, 360.0, 0.5))
    rings = [
        np.column_stack([np.cos(azimuth), np.sin(azimuth), np.full(720, 0.02 * ring)]) for ring in range(6)
    ]
    clouds = []
    for roll_deg in (89.9, 90.1):
        roll = np.radians(roll_deg)
        turn = np.array(
            [[1.0, 0.0, 0.0], [0.0, np.cos(roll), -np.sin(roll)], [0.0, np.sin(roll), np.cos(roll)]]
        )
        points = np.float32(10.0 * np.concatenate(rings) @ turn.T)
        clouds.append(ArrayCloud(points, np.full(len(points), True), None, None, None, None))
    # Two points tell no axis.
    few = ArrayCloud(clouds[0].points[:2], np.full(2, True), None, None, None, None)
    for sweeps in (clouds, [few, *clouds]):
        assert abs(edges_of_sweeps(sweeps).axis[1]) == pytest.approx(1.0, abs=1e-3)
    assert edges_of_sweeps([few]).axis.tolist() == [0.0, 0.0, 1.0]


def test_a_speed_looks_like_an_error_of_cy(skewed: Observations, street_truth: Pose) -> None:
    drive = array_drive(lidar={"spin": SPIN})
    upright, turned = (Skew.of(drive, turn @ AHEAD) for turn in (np.eye(4), TURN))
    assert upright is not None
    assert turned is not None
    assert (upright.center, turned.center) == ("cx", "cy")

    images = [LabelledImage(np.ascontiguousarray(np.rot90(image.classes, -1))) for image in skewed.images]
    camera = skewed.camera.model_copy(
        update=on_side({name: getattr(skewed.camera, name) for name in ("K", "width", "height")})
    )
    turned_street = replace(skewed.with_images(images), camera=camera)
    skew = skew_at(street_truth)
    speeds = []
    for seen, turn, center in ((skewed, np.eye(4), "cx"), (turned_street, TURN, "cy")):
        off = {center: intrinsic_value(seen.camera, center) + 6.0}
        wrong = replace(seen, camera=with_intrinsics(seen.camera, off))
        deskewed = deskew(wrong, skew._replace(center=center), turn @ street_truth, with_center=True)
        assert deskewed.errors is not None
        assert deskewed.errors.covariance[6, 6] > 0.0
        assert center in deskewed.note
        assert deskewed.speed is not None
        speeds.append(deskewed.speed.along_view_m_s)
    assert abs(speeds[0] - FAST_M_S) < 3.0
    assert speeds[1] == pytest.approx(speeds[0], abs=OPPOSITE_CORNER)
