"""The import of a recording: cameras, frames, motion, the choice of pairs, and what is written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bag_imports import (
    BODY,
    CAMERA,
    CHAIN,
    COLORS,
    FAR,
    MAST,
    RECORDS,
    STAMP_S,
    T_MOUNT,
    Maker,
    cloud,
    done,
    fixed,
    image,
    imported,
    info,
    moved,
    moving,
    nothing,
    odometry,
    refused,
    remarks,
    small,
)
from bags import KINDS, NS, START_NS, BagWriter

from semcal_cli.drive.document import read_drive
from semcal_cli.files.image_files import read_image
from semcal_cli.formats.frame_names import T_BODY_OPTICAL
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import pose_from_mounting, pose_from_quaternion
from semcal_cli.importing.bags.bag_import import import_bag
from semcal_cli.importing.bags.topics import BagRequest
from semcal_cli.importing.bags.transforms import FrameTree, reference
from semcal_cli.observations.reading import load_points


@pytest.mark.parametrize(("count", "changed"), [(6, 4), (600, 333)])
@pytest.mark.parametrize("kind", KINDS)
def test_a_camera_that_changes_is_an_error_that_says_when(
    kind: str, count: int, changed: int, tmp_path: Path
) -> None:
    """Beside each image, or stated twice, the second time where no frame lies near."""

    def change(bag: BagWriter, index: int, stamp: int) -> Any:
        K = [9.5 if index == changed else 9.0, 0, 8, 0, 9, 8, 0, 0, 1]
        return bag.camera_info(CAMERA, stamp, K=K) if count < 10 or index in (0, changed) else None

    message = refused(small(tmp_path, kind, count, info=change), tmp_path / "drive")
    when = f"found other intrinsics {changed / 10:.3f} s after the start: K 9.5, 0, 8"
    assert f"/cam/camera_info: {when}" in message


def test_rectified_images_use_P(tmp_path: Path) -> None:
    R = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    P = np.array([[7.0, 0, 6, 0], [0, 7.5, 5, 0], [0, 0, 1, 0]])
    path = small(
        tmp_path,
        info=info(P=P.ravel(), R=R.ravel(), D=np.full(5, 0.1)),
        image=nothing,
        **{"cam/image_rect": image(), "tf_static": fixed({("optical", "lidar"): T_MOUNT})},
    )
    assert "rectified" in remarks(path, tmp_path / "drive")
    document = yaml.safe_load((tmp_path / "drive/drive.yaml").read_text())
    assert document["camera"]["K"] == P[:, :3].tolist()
    assert not any(document["camera"].get("distortion", []))
    np.testing.assert_allclose(np.array(document["T_camera_lidar"])[:3], R @ T_MOUNT[:3], atol=1e-12)


@pytest.mark.parametrize("kind", ["ros1", "mcap library"])
def test_a_chain_of_fixed_frames_is_the_reference(kind: str, tmp_path: Path) -> None:
    document = imported(small(tmp_path, kind, tf_static=CHAIN), tmp_path / "drive")
    expected = np.linalg.inv(BODY @ T_MOUNT) @ MAST @ T_MOUNT
    np.testing.assert_allclose(document["T_camera_lidar"], expected, atol=1e-9)


@pytest.mark.parametrize("kind", ["ros1", "sqlite3"])
def test_binned_and_cropped_images_have_a_k_of_their_own(kind: str, tmp_path: Path) -> None:
    K = np.array([[50.0, 0, 31.5], [0, 50.0, 23.5], [0, 0, 1]])
    roi = {"x_offset": 16, "y_offset": 8, "width": 32, "height": 32}
    stated = {"width": 64, "height": 48, "K": K.ravel(), "binning_x": 2, "binning_y": 2, "roi": roi}
    path = small(tmp_path, kind, info=info(**stated))
    drive = done(path, tmp_path / "drive").written
    camera = read_drive(drive.path).camera
    assert camera.size == (16, 16)
    np.testing.assert_allclose(camera.K, [[25.0, 0, 7.5], [0, 25.0, 7.5], [0, 0, 1]])
    assert any(
        "for 64 x 48 pixels, is converted to the 16 x 16 of its binning" in line for line in drive.remarks
    )


def test_a_k_of_resized_images_is_converted_only_on_request(tmp_path: Path) -> None:
    K = np.array([[50.0, 0, 31.5], [0, 60.0, 31.5], [0, 0, 1]])
    path = small(tmp_path, info=info(width=64, height=64, K=K.ravel()))
    problem = refused(path, tmp_path / "drive")
    assert (
        "found an image of 16 x 16 pixels, needed 64 x 64, as its intrinsics state; if the images were"
        in problem
    )
    camera = read_drive(done(path, tmp_path / "drive", is_resized=True).written.path).camera
    np.testing.assert_allclose(camera.K, [[12.5, 0, 7.5], [0, 15.0, 7.5], [0, 0, 1]])
    other = small(tmp_path / "other", info=info(width=64, height=48, K=K.ravel()))
    assert "--resized" not in refused(other, tmp_path / "none")
    problem = refused(other, tmp_path / "none", is_resized=True)
    assert problem == "--resized: found images of 16 x 16 pixels, expected the aspect of 64 x 48, as K has"


@pytest.mark.parametrize(("quaternion", "direction"), [([0, 0, 0, 1], "up"), ([1, 0, 0, 0], "down")])
def test_a_body_frame_is_noticed_by_its_name_and_its_axes(quaternion: list[float], direction: str) -> None:
    T_lidar_body = pose_from_quaternion(quaternion, [0.5, 0.0, -0.2])

    def found(name: str, T_lidar_camera: Pose, axes: Any = None) -> tuple[Pose | None, str]:
        tree = FrameTree()
        tree.add(("lidar", name), T_lidar_camera)
        T_camera_lidar, remarks = reference(tree, "lidar", name, None, axes)
        return T_camera_lidar, "\n".join(remarks)

    T_camera_lidar, remark = found("camera_link", T_lidar_body)
    assert "'camera_link' is probably a body frame (x forward, y left, z up)" in remark
    assert (
        f"the camera looks {direction} along the LiDAR's z axis. --frame body converts the reference"
        in remark
    )
    np.testing.assert_allclose(T_camera_lidar, np.linalg.inv(T_lidar_body))
    T_camera_lidar, remark = found("camera_link", T_lidar_body, "body")
    np.testing.assert_allclose(T_camera_lidar, np.linalg.inv(T_lidar_body @ T_BODY_OPTICAL), atol=1e-12)
    assert "probably" not in remark
    for name, T, axes in (
        ("camera_optical", T_lidar_body, None),  # looks up, as it says
        ("camera_link", T_lidar_body @ T_BODY_OPTICAL, None),  # looks forward
        ("camera_link", T_lidar_body, "optical"),
    ):
        assert "probably" not in found(name, T, axes)[1]


def two_parents(bag: BagWriter, index: int, stamp: int) -> Any:
    return bag.transforms({("odom", "lidar"): moved(stamp), ("map", "lidar"): FAR @ moved(stamp)}, stamp)


CONTRADICTION = fixed(
    {("base", "lidar"): T_MOUNT, ("base", "optical"): np.eye(4), ("optical", "lidar"): np.eye(4)}
)
TOLD: dict[str, tuple[dict[str, Maker], str]] = {
    "a loose body": ({"odom": odometry("base")}, "no fixed transform connects the frames of /odom to 'lidar'"),
    "two parents": ({"tf": two_parents}, "/tf of lidar in odom, /tf of lidar in map: choose one"),
    "contradicting frames": ({"tf_static": CONTRADICTION}, "no reference: fixed transforms contradict one another"),
    "one frame of both": ({"points": cloud(frame="same"), "image": image(frame="same")},
                          "no reference: sweeps and images both have the frame 'same'"),
    "no frames": ({}, "no reference from 'lidar' to 'optical': there are no fixed transforms"),
}  # fmt: skip


@pytest.mark.parametrize("case", TOLD)
def test_what_is_missing_is_told(case: str, tmp_path: Path) -> None:
    changes, expected = TOLD[case]
    assert expected in remarks(small(tmp_path, count=8, **changes), tmp_path / "drive")
    drive = read_drive(tmp_path / "drive")
    assert drive.T_camera_lidar is None
    assert drive.motion is None


def test_frames_are_spread_and_the_rest_is_counted(tmp_path: Path) -> None:
    path = small(tmp_path, count=60)
    found = done(path, tmp_path / "drive", max_frames=5)
    assert found.written.num_frames == 5
    assert found.left_out.total() == 55
    every = imported(path, tmp_path / "every", every_s=1.0)
    stamps = [frame["points_stamp"] - STAMP_S for frame in every["frames"]]
    np.testing.assert_allclose(stamps, [0, 1, 2, 3, 4, 5], atol=1e-6)


def test_an_image_goes_to_the_sweep_that_is_nearest(tmp_path: Path) -> None:
    """A LiDAR twice as fast as the camera, whose images are 40 ms after one sweep and 10 ms before the next."""
    with BagWriter(tmp_path, "sqlite3") as bag:
        for index in range(100):
            stamp = START_NS + index * NS // 20
            bag.write("/points", bag.cloud(RECORDS, stamp), stamp + NS // 100)
            if index % 2 == 0:
                bag.write("/cam/camera_info", bag.camera_info(CAMERA, stamp), stamp)
                bag.write("/cam/image_raw", bag.image(COLORS, "bgr8", stamp + NS // 25), stamp + NS // 20)
    for settings in ({"max_frames": 50}, {"max_frames": 5}, {"every_s": 0.5}):
        document = imported(bag.path, tmp_path / "drive", **settings)
        gaps = [frame["image_stamp"] - frame["points_stamp"] for frame in document["frames"]]
        np.testing.assert_allclose(gaps, -0.01, atol=1e-6)
        assert len(gaps) >= 5


def long_recording(folder: Path, seconds: int) -> Path:
    """A recording of a rig that stands, but for ten seconds in the middle, with late sweeps and late odometry."""
    with BagWriter(folder, "sqlite3") as bag:
        for index in range(10 * seconds):
            stamp = START_NS + index * NS // 10
            travelled = float(np.clip(index / 10 - seconds / 2, 0.0, 10.0))
            bag.write("/cam/camera_info", bag.camera_info(CAMERA, stamp), stamp)
            bag.write("/cam/image_raw", bag.image(np.roll(COLORS, index, 0), "bgr8", stamp), stamp + NS // 50)
            bag.write("/points", bag.cloud(RECORDS, stamp), stamp + round(0.12 * NS))
            T = pose_from_mounting([0, 0, 0], [travelled, 0, 0])
            bag.write("/odom", bag.odometry(T, stamp, "lidar"), stamp + NS // 4)
    return bag.path


def test_as_many_frames_as_wanted_with_their_poses(tmp_path: Path) -> None:
    """Where the rig stands, images decide; late poses are read for every frame."""
    document = imported(long_recording(tmp_path, 120), tmp_path / "drive", max_frames=20)
    assert 19 <= len(document["frames"]) <= 20
    assert "motion" in document
    assert load_points(read_drive(tmp_path / "drive")).num_frames == len(document["frames"])
    stamps = np.array([frame["points_stamp"] - STAMP_S for frame in document["frames"]])
    assert ((stamps > 59.0) & (stamps < 71.0)).sum() >= 3  # every third second is looked at


def test_frames_that_stay_are_fixed(tmp_path: Path) -> None:
    """ROS 1 publishes fixed frames on /tf, too."""

    def tf(bag: BagWriter, index: int, stamp: int) -> Any:
        return bag.transforms({("base", "lidar"): T_MOUNT, ("base", "optical"): np.eye(4)}, stamp)

    document = imported(small(tmp_path, "ros1", tf=tf, odom=odometry("base")), tmp_path / "drive")
    np.testing.assert_allclose(document["T_camera_lidar"], T_MOUNT, atol=1e-9)
    assert document["motion"]["poses"] == "poses/drive.txt"


def test_a_topic_of_transforms_is_the_one_that_is_named(tmp_path: Path) -> None:
    path = small(
        tmp_path, count=8, **{"a/tf": moving("world", "lidar"), "b/tf": fixed({("map", "lidar"): FAR})}
    )
    assert imported(path, tmp_path / "drive", motion="/a/tf")["motion"]["poses"] == "poses/drive.txt"
    assert "found the moving frames none" in refused(path, tmp_path / "b", motion="/b/tf")


def test_what_is_left_out_adds_up(tmp_path: Path) -> None:
    """Of each sweep it is told what became of it; very short steps take every sweep."""

    def images(bag: BagWriter, index: int, stamp: int) -> Any:
        return bag.image(COLORS, "odd" if index % 4 == 1 else "bgr8", stamp)

    path = small(tmp_path, count=60, image=images)
    for settings in (
        {"max_frames": 5},
        {"every_s": 1e-9},
        {"every_s": 1e-9, "max_frames": 3},
        {"every_s": 1.0, "max_frames": 2},
    ):
        found = done(path, tmp_path / "drive", **settings)
        assert found.written.num_frames + found.left_out.total() == found.num_sweeps == 60
        assert found.written.num_frames <= settings.get("max_frames", 60)


def test_two_cameras_of_one_recording_share_a_folder(tmp_path: Path) -> None:
    """Whatever their topics are called."""
    names = ["/a/b", "/a_b", "/a.b", "/摄像头/左", "/摄像头/右", "/" + "x" * 300, "/" + "x" * 299 + "y"]

    def images(bag: BagWriter, index: int, stamp: int) -> Any:
        for shade, name in enumerate(names):
            bag.write(name, bag.image(np.full((16, 16), shade, np.uint8), "mono8", stamp), stamp + NS // 50)

    path = small(tmp_path, image=images)
    for shade, name in enumerate(names):
        import_bag(BagRequest([path], image=name), tmp_path / f"drive/{shade}.yaml")
    for shade in range(len(names)):
        drive = read_drive(tmp_path / f"drive/{shade}.yaml")
        assert read_image(drive.resolve(drive.frames[0].image or ""))[0, 0, 0] == shade


def test_sweeps_of_another_frame_are_left_out(tmp_path: Path) -> None:
    """Two LiDARs on one topic."""

    def points(bag: BagWriter, index: int, stamp: int) -> Any:
        return bag.cloud(RECORDS, stamp, "rear" if index % 2 else "front")

    found = done(small(tmp_path, points=points), tmp_path / "drive")
    assert found.written.num_frames == 3
    assert found.left_out["sweeps: found frame 'rear', expected 'front'"] == 3


def test_frames_are_spread_along_the_way(tmp_path: Path) -> None:
    """Half of the time the rig stands; frames are at equal distances, not at equal times."""

    def pose(stamp: int) -> Pose:
        return pose_from_mounting([0, 0, 0], [max((stamp - START_NS) / NS * 10 - 30, 0.0), 0, 0])

    path = small(tmp_path, count=60, odom=odometry("lidar", pose))
    document = imported(path, tmp_path / "drive", max_frames=10)
    stamps = np.array([frame["points_stamp"] - STAMP_S for frame in document["frames"]])
    assert (stamps > 2.95).sum() >= 8
