"""What moves points by hand, without its page: scores, points and images of a session."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import camera_center, compare_poses, mounting_rpy_deg, pose_from_mounting
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.reading import load_points, read_clouds
from semcal_cli.report.view.session import MovedPose, Session

ZERO = [0.0] * 6


def test_offsets_are_along_and_about_the_axes_of_the_camera(street_truth: Pose) -> None:
    """Camera 20 cm forward: the same way as its optical axis. Turned: in place, and by the given angle."""
    shifted = MovedPose(street_truth, np.array([0.0, 0.0, 0.2, 0.0, 0.0, 0.0])).T_camera_lidar
    np.testing.assert_allclose(
        camera_center(shifted) - camera_center(street_truth), 0.2 * street_truth[2, :3]
    )
    turned = MovedPose(street_truth, np.array([0.0, 0.0, 0.0, 1.0, -2.0, 0.5])).T_camera_lidar
    error = compare_poses(turned, street_truth)
    assert error.camera_center_cm == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(error.rotation_xyz_deg, (1.0, -2.0, 0.5), atol=1e-9)


def test_positive_turns_are_those_that_the_page_names() -> None:
    """Pitch looks down, yaw looks left, roll leans left: of a camera that looks along x, upright."""
    T = pose_from_mounting((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for axis, (roll, pitch, yaw) in ((3, (0, 1, 0)), (4, (0, 0, 1)), (5, (-1, 0, 0))):
        offsets = np.zeros(6)
        offsets[axis] = 1.0
        angles_deg = mounting_rpy_deg(MovedPose(T, offsets).T_camera_lidar)
        np.testing.assert_allclose(angles_deg, (roll, pitch, yaw), atol=1e-9)


def test_the_score_is_best_at_the_truth(session: Session, street_truth: Pose, T_off: Pose) -> None:
    at = [session.points({"base": T.tolist(), "offsets": ZERO, "frame": 0}) for T in (T_off, street_truth)]
    assert at[0]["information"] < at[1]["information"]
    assert at[0]["agreement_of_frame"] < at[1]["agreement_of_frame"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"base": None}, "found .* needed 4 x 4 and 6 numbers"),
        ({"base": [[1.0]]}, "found .* needed 4 x 4 and 6 numbers"),
        ({"base": [[2.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}, "view: base: "),
        ({"offsets": [1e300] * 6}, "offsets: found .* needed at most 10000"),
        ({"offsets": ["a"] * 6}, "needed 4 x 4 and 6 numbers"),
        ({"frame": 4}, "frame: found 4, expected one of 0 to 3"),
        ({"frame": -1}, "frame: found -1, expected one of 0 to 3"),
        ({"frame": True}, "frame: found True, expected one of 0 to 3"),
        ({"frame": [0]}, r"frame: found \[0\], expected one of 0 to 3"),
    ],
)
def test_wrong_questions(session: Session, T_off: Pose, change: dict[str, Any], message: str) -> None:
    asked = {"base": T_off.tolist(), "offsets": ZERO, "frame": 0} | change
    with pytest.raises(InputError, match=message):
        session.points(asked)


def test_a_drive_without_labels_is_shown_and_refines_nothing(street: Path, T_off: Pose) -> None:
    drive = read_drive(street)
    bare = Session(
        LoadedDrive(drive, load_points(drive)),
        read_clouds(drive),
        CalibrationConfig(),
        unlabelled="no labels here",
    )
    assert bare.page["choices"] == ["depth", "intensity"]
    asked = {"base": T_off.tolist(), "offsets": ZERO, "frame": 0}
    assert bare.points(asked)["num_visible"] > 1000
    with pytest.raises(InputError, match="no labels here"):
        bare.refine(asked)


def test_a_drive_by_edges_is_shown_by_edge(by_edge: Session, street_truth: Pose) -> None:
    assert by_edge.page["choices"] == ["edge", "depth", "intensity", "agreement"]
    assert by_edge.page["palette"]["edge"][0] is None
    assert "range step 3" in by_edge.page["legends"]["edge"]
    assert "no edge" not in by_edge.page["legends"]["edge"]
    at = [
        by_edge.points({"base": street_truth.tolist(), "offsets": [0.0] * 4 + [yaw, 0.0], "frame": 0})
        for yaw in (-1.0, 0.0, 1.0)
    ]
    assert at[1]["information"] > max(at[0]["information"], at[2]["information"])
    assert at[1]["agreement_of_frame"] is None


def test_the_image_of_edges_is_grey_and_that_of_the_frame_is_not(by_edge: Session) -> None:
    shown = [
        cv2.imdecode(np.frombuffer(by_edge.image(0, by_edge=image), np.uint8), cv2.IMREAD_COLOR).astype(int)
        for image in (False, True)
    ]
    color = [int(np.abs(image - image.mean(axis=2, keepdims=True)).max()) for image in shown]
    assert color[0] > 30
    assert color[1] <= 2
    assert shown[0].shape == shown[1].shape
    with pytest.raises(InputError, match="frame: found 4, expected one of 0 to 3"):
        by_edge.image(4, by_edge=True)
