"""The import of a recording: cameras, frames, motion, the choice of pairs, and what is written."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from bag_imports import COLORS, STAMP_S, T_MOUNT, Small, imported, refused, run_cli
from bags import KINDS, NS, START_NS, BagWriter, write_drive_as_bag
from networks import color_network

from semcal_cli.bags import motion
from semcal_cli.bags.candidates import longest_ascending
from semcal_cli.bags.importing import import_bag
from semcal_cli.bags.messages import Message, Span, Topic
from semcal_cli.bags.motion import MotionSource, Trajectory
from semcal_cli.bags.pictures import read_picture
from semcal_cli.bags.topics import Request
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.reading import load_points
from semcal_cli.errors import InputError
from semcal_cli.files.images import read_image
from semcal_cli.geometry.poses import Pose, pose_from_mounting, rotation_error_deg


@pytest.mark.parametrize("kind", KINDS)
def test_a_camera_that_changes_is_an_error_that_says_when(kind: str, tmp_path: Path) -> None:
    small = Small(tmp_path, kind)
    other = [9.5, 0, 8, 0, 9, 8, 0, 0, 1]

    def info(bag: BagWriter, index: int, stamp: int) -> Any:
        return bag.camera_info(small.camera, stamp, **({"K": np.array(other, float)} if index == 4 else {}))

    message = refused(small.write(info=info), tmp_path / "drive")
    assert "/cam/camera_info: found another camera 0.400 s after the start: K 9.5, 0, 8" in message


def test_rectified_pictures_use_P(tmp_path: Path) -> None:
    small = Small(tmp_path)
    R = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    P = np.array([[7.0, 0, 6, 0], [0, 7.5, 5, 0], [0, 0, 1, 0]])

    def info(bag: BagWriter, index: int, stamp: int) -> Any:
        bag.write("/cam/image_rect", bag.image(COLORS, "bgr8", stamp), stamp)
        if index == 0:
            bag.write("/tf_static", bag.transforms({("optical", "lidar"): T_MOUNT}), stamp)
        return bag.camera_info(small.camera, stamp, P=P.ravel(), R=R.ravel(), D=np.full(5, 0.1))

    path = small.write(info=info, image=lambda *_: None)
    done = import_bag(Request([path]), tmp_path / "drive")
    document = yaml.safe_load((tmp_path / "drive/drive.yaml").read_text())
    assert document["camera"]["K"] == P[:, :3].tolist()
    assert not any(document["camera"].get("distortion", []))
    np.testing.assert_allclose(np.array(document["T_camera_lidar"])[:3], R @ T_MOUNT[:3], atol=1e-12)
    assert any("rectified" in remark for remark in done.written.remarks)


def chain(bag: BagWriter, index: int, stamp: int) -> Any:
    """Fixed frames: base -> mast -> lidar, base -> camera -> optical."""
    mast, camera = pose_from_mounting([5, 6, 7], [1, 2, 3]), pose_from_mounting([-3, 2, 9], [2, 0, 1])
    edges = {
        ("base", "mast"): mast,
        ("mast", "lidar"): T_MOUNT,
        ("base", "camera"): camera,
        ("camera", "optical"): T_MOUNT,
    }
    return bag.transforms(edges) if index == 0 else None


def reference_of_chain() -> Pose:
    mast, camera = pose_from_mounting([5, 6, 7], [1, 2, 3]), pose_from_mounting([-3, 2, 9], [2, 0, 1])
    return np.linalg.inv(camera @ T_MOUNT) @ mast @ T_MOUNT


@pytest.mark.parametrize("kind", ["ros1", "mcap library"])
def test_a_chain_of_fixed_frames_is_the_reference(kind: str, tmp_path: Path) -> None:
    document = imported(Small(tmp_path, kind).write(tf_static=chain), tmp_path / "drive")
    np.testing.assert_allclose(document["T_camera_lidar"], reference_of_chain(), atol=1e-9)


def moved(stamp: int) -> Pose:
    """Pose of the base in the world: 10 m/s, and a turn."""
    seconds = (stamp - START_NS) / NS
    return pose_from_mounting([0, 0, 20 * seconds], [10 * seconds, 0, 0])


def motion_source(kind: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Messages of a source of motion, and the settings that it needs."""
    messages = {
        "odometry": {"odom": lambda bag, index, stamp: bag.odometry(moved(stamp), stamp, "base")},
        "tf": {"tf": lambda bag, index, stamp: bag.transforms({("world", "base"): moved(stamp)}, stamp)},
        "pose": {"pose": lambda bag, index, stamp: bag.pose(moved(stamp), stamp)},
    }
    settings = {"pose": {"motion": "/pose", "motion_frame": "base"}}
    return messages[kind], settings.get(kind, {})


@pytest.mark.parametrize("source", ["odometry", "tf", "pose"])
def test_poses_become_the_motion_of_the_lidar(source: str, tmp_path: Path) -> None:
    messages, settings = motion_source(source)
    path = Small(tmp_path, count=8).write(tf_static=chain, **messages)
    document = imported(path, tmp_path / "drive", **settings)
    assert document["motion"]["point_times"] == "relative"
    rows = np.loadtxt(tmp_path / "drive" / document["motion"]["poses"])
    stamps = START_NS + np.arange(8) * NS // 10
    np.testing.assert_allclose(rows[:, 0], stamps / NS, atol=1e-6)
    T_base_lidar = pose_from_mounting([5, 6, 7], [1, 2, 3]) @ T_MOUNT
    expected = [(moved(int(stamp)) @ T_base_lidar)[:3, 3] for stamp in stamps]
    np.testing.assert_allclose(rows[:, 1:4], expected, atol=1e-9)
    # The first and the last frame have no poses before or after their points.
    assert 5 <= len(document["frames"]) <= 7
    assert load_points(read_drive(tmp_path / "drive")).num_frames == len(document["frames"])
    assert np.isfinite(np.array(document["T_camera_lidar"])).all()
    run_cli("inspect", tmp_path / "drive", code=None)


def test_poses_in_any_order_are_sorted_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sortings = []
    monkeypatch.setattr(motion, "sorted", lambda stamps: sortings.append(1) or sorted(stamps), raising=False)
    with BagWriter(tmp_path, "sqlite3") as bag:
        message = bag.odometry(moved(START_NS), START_NS, "base")
        raw, kind = bag.raw(message), message.__msgtype__
        bag.write("/odom", message, START_NS)
    topic = Topic("/odom", kind, Span(1, START_NS, START_NS))
    trajectory = Trajectory(MotionSource(topic, "base", "odom"), np.eye(4))
    assert trajectory.position(START_NS) is None
    tenths = []
    for tenth in (2, 0, 1):
        # With the time of receipt, one message can be a pose of any time.
        trajectory.take(Message(topic, START_NS + tenth * NS // 10, raw, is_ros1=False), received=True)
        tenths.append(tenth)
        assert trajectory.covers(START_NS + NS // 20) == (tenths != [2])
        times = [float(line.split()[0]) - STAMP_S for line in trajectory.tum().splitlines()]
        assert times == pytest.approx([each / 10 for each in sorted(tenths)], abs=1e-6)
        assert len(sortings) == len(tenths)


def test_motion_needs_times_of_points_and_can_be_refused(tmp_path: Path) -> None:
    messages, _ = motion_source("odometry")
    small = Small(tmp_path)
    small.records["time"] = 0.0
    path = small.write(tf_static=chain, **messages)
    done = import_bag(Request([path]), tmp_path / "drive")
    assert any("no motion is written" in remark for remark in done.written.remarks)
    assert "motion" not in imported(path, tmp_path / "none", motion="none")
    assert "found no topic '/x' of poses, needed one of: /odom" in refused(path, tmp_path / "x", motion="/x")


def test_frames_are_spread_and_the_rest_is_counted(tmp_path: Path) -> None:
    path = Small(tmp_path, count=60).write()
    done = import_bag(Request([path], max_frames=5), tmp_path / "drive")
    assert done.written.num_frames == 5
    assert done.left_out.total() == 55
    every = imported(path, tmp_path / "every", every_s=1.0)
    stamps = [frame["points_stamp"] - STAMP_S for frame in every["frames"]]
    np.testing.assert_allclose(stamps, [0, 1, 2, 3, 4, 5], atol=1e-6)


def test_a_picture_goes_to_the_sweep_that_is_nearest(tmp_path: Path) -> None:
    """A LiDAR twice as fast as the camera, whose pictures are 40 ms after one sweep and 10 ms before the next."""
    with BagWriter(tmp_path, "sqlite3") as bag:
        small = Small(tmp_path / "unused")
        small.bag.write("/x", small.bag.camera_info(small.camera, START_NS), START_NS)
        small.bag.__exit__(None, None, None)
        for index in range(100):
            stamp = START_NS + index * NS // 20
            bag.write("/points", bag.cloud(small.records, stamp), stamp + NS // 100)
            if index % 2 == 0:
                bag.write("/cam/camera_info", bag.camera_info(small.camera, stamp), stamp)
                bag.write("/cam/image_raw", bag.image(COLORS, "bgr8", stamp + NS // 25), stamp + NS // 20)
    for settings in ({"max_frames": 50}, {"max_frames": 5}, {"every_s": 0.5}):
        document = imported(bag.path, tmp_path / "drive", **settings)
        gaps = [frame["image_stamp"] - frame["points_stamp"] for frame in document["frames"]]
        np.testing.assert_allclose(gaps, -0.01, atol=1e-6)
        assert len(gaps) >= 5


def long_recording(
    folder: Path, seconds: int, *, delay_s: float = 0.12, latency_s: float = 0.25, **more: Any
) -> Path:
    """A recording of a rig that stands, but for ten seconds in the middle, with late sweeps and late odometry."""
    small = Small(folder)
    with small.bag as bag:
        for index in range(10 * seconds):
            stamp = START_NS + index * NS // 10
            travelled = float(np.clip(index / 10 - seconds / 2, 0.0, 10.0))
            bag.write("/cam/camera_info", bag.camera_info(small.camera, stamp), stamp)
            bag.write("/cam/image_raw", bag.image(np.roll(COLORS, index, 0), "bgr8", stamp), stamp + NS // 50)
            bag.write("/points", bag.cloud(small.records, stamp), stamp + round(delay_s * NS))
            T = pose_from_mounting([0, 0, 0], [travelled, 0, 0])
            bag.write("/odom", bag.odometry(T, stamp, "lidar"), stamp + round(latency_s * NS))
    return bag.path


def test_as_many_frames_as_wanted_with_their_poses(tmp_path: Path) -> None:
    """Where the rig stands, pictures decide; late poses are read for every frame."""
    document = imported(long_recording(tmp_path, 120), tmp_path / "drive", max_frames=20)
    assert 19 <= len(document["frames"]) <= 20
    assert "motion" in document
    assert load_points(read_drive(tmp_path / "drive")).num_frames == len(document["frames"])
    stamps = np.array([frame["points_stamp"] - STAMP_S for frame in document["frames"]])
    assert ((stamps > 59.0) & (stamps < 71.0)).sum() >= 3  # every third second is looked at


def test_frames_that_stay_are_fixed_and_others_are_told(tmp_path: Path) -> None:
    """ROS 1 publishes fixed frames on /tf, too; odometry of a frame that nothing ties to the LiDAR is named."""

    def tf(bag: BagWriter, index: int, stamp: int) -> Any:
        return bag.transforms({("base", "lidar"): T_MOUNT, ("base", "optical"): np.eye(4)}, stamp)

    def odometry(bag: BagWriter, index: int, stamp: int) -> Any:
        return bag.odometry(moved(stamp), stamp, "base")

    document = imported(Small(tmp_path, "ros1").write(tf=tf, odom=odometry), tmp_path / "drive")
    np.testing.assert_allclose(document["T_camera_lidar"], T_MOUNT, atol=1e-9)
    assert document["motion"]["poses"] == "poses/drive.txt"
    path = Small(tmp_path / "loose", "ros1").write(odom=odometry)
    done = import_bag(Request([path]), tmp_path / "loose/drive")
    assert any(
        "/odom tell of frames that no fixed transform ties to 'lidar'" in each
        for each in done.written.remarks
    )


def test_a_topic_of_transforms_is_the_one_that_is_named(tmp_path: Path) -> None:
    def moving(bag: BagWriter, index: int, stamp: int) -> Any:
        return bag.transforms({("world", "lidar"): moved(stamp)}, stamp)

    def standing(bag: BagWriter, index: int, stamp: int) -> Any:
        return bag.transforms({("map", "lidar"): T_MOUNT}, stamp)

    path = Small(tmp_path, count=8).write(**{"a/tf": moving, "b/tf": standing})
    document = imported(path, tmp_path / "drive", motion="/a/tf")
    assert document["motion"]["poses"] == "poses/drive.txt"
    assert "found the moving frames none" in refused(path, tmp_path / "b", motion="/b/tf")


def test_one_frame_for_both_sensors_is_no_reference(tmp_path: Path) -> None:
    small = Small(tmp_path)
    path = small.write(
        points=lambda bag, index, stamp: bag.cloud(small.records, stamp, "sensor"),
        image=lambda bag, index, stamp: bag.image(COLORS, "bgr8", stamp, "sensor"),
    )
    assert "T_camera_lidar" not in imported(path, tmp_path / "drive")


def test_a_camera_that_is_stated_twice_and_changes(tmp_path: Path) -> None:
    """Between two messages that no frame lies near."""
    small = Small(tmp_path, count=600)
    K = np.array([12.0, 0, 8, 0, 9, 8, 0, 0, 1])

    def info(bag: BagWriter, index: int, stamp: int) -> Any:
        return (
            bag.camera_info(small.camera, stamp, **({"K": K} if index else {})) if index in (0, 333) else None
        )

    assert "found another camera 33.300 s after the start" in refused(
        small.write(info=info), tmp_path / "drive"
    )


def test_what_is_left_out_adds_up(tmp_path: Path) -> None:
    """Of each sweep it is told what became of it; very short steps take every sweep."""
    small = Small(tmp_path, count=60)
    path = small.write(
        image=lambda bag, index, stamp: bag.image(COLORS, "odd" if index % 4 == 1 else "bgr8", stamp)
    )
    for settings in (
        {"max_frames": 5},
        {"every_s": 1e-9},
        {"every_s": 1e-9, "max_frames": 3},
        {"every_s": 1.0, "max_frames": 2},
    ):
        done = import_bag(Request([path], **settings), tmp_path / "drive")
        assert done.written.num_frames + done.left_out.total() == done.num_sweeps == 60
        assert done.written.num_frames <= settings.get("max_frames", 60)


def test_an_import_replaces_nothing_that_it_reads(tmp_path: Path) -> None:
    path = Small(tmp_path).write()
    before = (path / "metadata.yaml").read_bytes()
    assert "found a file that this import reads" in str(error_of(path, path / "metadata.yaml"))
    assert (path / "metadata.yaml").read_bytes() == before
    file = tmp_path / "camera.yaml"
    file.write_text("mine")
    assert "found a file that this import reads" in str(error_of(path, file, intrinsics=file))
    assert file.read_text() == "mine"
    (tmp_path / "folder.yaml").mkdir()
    assert "is a folder" in str(error_of(path, tmp_path / "folder.yaml"))
    assert sorted(each.name for each in tmp_path.iterdir()) == ["bag", "camera.yaml", "folder.yaml"]
    with pytest.raises(InputError, match="found twice among the parts"):
        import_bag(Request([path, path]), tmp_path / "twice")


def error_of(path: Path, out: Path, **settings: Any) -> InputError:
    with pytest.raises(InputError) as error:
        import_bag(Request([path], **settings), out)
    return error.value


def test_two_cameras_of_one_recording_share_a_folder(tmp_path: Path) -> None:
    """Whatever their topics are called."""
    names = ["/a/b", "/a_b", "/a.b", "/摄像头/左", "/摄像头/右", "/" + "x" * 300, "/" + "x" * 299 + "y"]
    small = Small(tmp_path)

    def images(bag: BagWriter, index: int, stamp: int) -> Any:
        for shade, name in enumerate(names):
            bag.write(name, bag.image(np.full((16, 16), shade, np.uint8), "mono8", stamp), stamp + NS // 50)

    path = small.write(image=images)
    for shade, name in enumerate(names):
        import_bag(Request([path], image=name), tmp_path / f"drive/{shade}.yaml")
    for shade in range(len(names)):
        drive = read_drive(tmp_path / f"drive/{shade}.yaml")
        assert read_image(drive.resolve(drive.frames[0].image or ""))[0, 0, 0] == shade


def test_poses_of_other_frames_do_not_count(tmp_path: Path) -> None:
    """Two parents of one frame, odometry of two bodies, and poses that are none."""

    def two_parents(bag: BagWriter, index: int, stamp: int) -> Any:
        far = pose_from_mounting([0, 0, 0], [500.0 + index, 0, 0])
        return bag.transforms({("odom", "lidar"): moved(stamp), ("map", "lidar"): far}, stamp)

    done = import_bag(Request([Small(tmp_path / "a", count=8).write(tf=two_parents)]), tmp_path / "a/drive")
    assert any(
        "/tf of lidar in odom, /tf of lidar in map: choose one" in each for each in done.written.remarks
    )

    def two_bodies(bag: BagWriter, index: int, stamp: int) -> Any:
        bag.write(
            "/odom", bag.odometry(pose_from_mounting([0, 0, 0], [900.0, 0, 0]), stamp + 1, "gps"), stamp
        )
        lost = moved(stamp)
        lost[0, 3] = np.nan if index == 3 else lost[0, 3]
        return bag.odometry(lost, stamp, "lidar")

    path = Small(tmp_path / "b", count=9).write(odom=two_bodies)
    document = imported(path, tmp_path / "b/drive", motion="/odom", motion_frame="lidar")
    rows = np.loadtxt(tmp_path / "b/drive" / document["motion"]["poses"])
    assert rows[:, 1].max() < 100.0
    assert len(rows) == 8


def test_fixed_frames_that_contradict_one_another_are_no_reference(tmp_path: Path) -> None:
    def contradiction(bag: BagWriter, index: int, stamp: int) -> Any:
        edges = {("base", "lidar"): T_MOUNT, ("base", "optical"): np.eye(4), ("optical", "lidar"): np.eye(4)}
        return bag.transforms(edges) if index == 0 else None

    done = import_bag(Request([Small(tmp_path).write(tf_static=contradiction)]), tmp_path / "drive")
    assert any("fixed transforms contradict one another" in each for each in done.written.remarks)
    assert read_drive(tmp_path / "drive").T_camera_lidar is None


def test_a_stamp_that_is_far_off_and_a_clock_that_stands(tmp_path: Path) -> None:
    small = Small(tmp_path / "a")

    def off(stamp: int, index: int) -> int:
        return stamp + (400_000_000 * NS if index == 0 else 0)

    path = small.write(
        points=lambda bag, index, stamp: bag.cloud(small.records, off(stamp, index)),
        image=lambda bag, index, stamp: bag.image(COLORS, "bgr8", off(stamp, index)),
    )
    assert len(imported(path, tmp_path / "a/drive")["frames"]) == 5
    with BagWriter(tmp_path, "mcap library") as bag:
        for index in range(6):
            stamp = START_NS + index * NS // 10
            bag.write("/cam/camera_info", bag.camera_info(small.camera, stamp), START_NS)
            bag.write("/cam/image_raw", bag.image(np.roll(COLORS, index, 0), "bgr8", stamp), START_NS)
            bag.write("/points", bag.cloud(small.records, stamp), START_NS)
    assert len(imported(bag.path, tmp_path / "b/drive")["frames"]) == 6


def test_sweeps_of_another_frame_are_left_out(tmp_path: Path) -> None:
    """Two LiDARs on one topic."""
    small = Small(tmp_path)
    path = small.write(
        points=lambda bag, index, stamp: bag.cloud(small.records, stamp, "rear" if index % 2 else "front")
    )
    done = import_bag(Request([path]), tmp_path / "drive")
    assert done.written.num_frames == 3
    assert done.left_out["sweeps: found frame 'rear', needed 'front'"] == 3


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("--every", "1e300"), "not in the range"),
        (("--max-gap-s", "1e300"), "not in the range"),
        (("--camera-info", "/a", "--intrinsics", "b"), "exclude one another"),
        (("--motion", "none", "--motion-frame", "c"), "is of a topic of --motion"),
    ],
)
def test_options_that_cannot_be(options: tuple[str, ...], complaint: str, tmp_path: Path) -> None:
    assert complaint in run_cli("import", "bag", tmp_path, "-o", tmp_path / "drive", *options, code=2).stderr


def test_the_longest_ascending_part() -> None:
    assert longest_ascending([]) == []
    assert longest_ascending([9, 1, 2, 2, 3, 0, 4]) == [1, 3, 4, 6]
    assert longest_ascending([5, 4, 3]) == [2]


def test_frames_are_spread_along_the_way(tmp_path: Path) -> None:
    """Half of the time the rig stands; frames are at equal distances, not at equal times."""

    def odometry(bag: BagWriter, index: int, stamp: int) -> Any:
        T = pose_from_mounting([0, 0, 0], [max(index - 30, 0) * 1.0, 0, 0])
        return bag.odometry(T, stamp, "lidar")

    document = imported(Small(tmp_path, count=60).write(odom=odometry), tmp_path / "drive", max_frames=10)
    stamps = np.array([frame["points_stamp"] - STAMP_S for frame in document["frames"]])
    assert (stamps > 2.95).sum() >= 8


def test_times_of_receipt_and_clocks_that_differ(tmp_path: Path) -> None:
    def late(bag: BagWriter, index: int, stamp: int) -> Any:
        return bag.cloud(small.records, stamp - 5 * NS)

    small = Small(tmp_path)
    path = small.write(points=late)
    message = refused(path, tmp_path / "drive")
    assert "the clocks of /points and /cam/image_raw differ by 5.000 s; try --stamps receive" in message
    assert len(imported(path, tmp_path / "receive", by_receipt=True)["frames"]) == 6
    zero = Small(tmp_path / "zero")
    path = zero.write(points=lambda bag, index, stamp: bag.cloud(zero.records, 0))
    assert "sweeps: found a stamp of zero, needed a time; or give --stamps receive" in refused(
        path, tmp_path / "z"
    )


def test_stamps_that_run_backwards_are_left_out(tmp_path: Path) -> None:
    def back(stamp: int, index: int) -> int:
        return stamp - (2 * NS if index >= 4 else 0)

    small = Small(tmp_path)
    path = small.write(
        points=lambda bag, index, stamp: bag.cloud(small.records, back(stamp, index)),
        image=lambda bag, index, stamp: bag.image(COLORS, "bgr8", back(stamp, index)),
    )
    done = import_bag(Request([path]), tmp_path / "drive")
    assert done.written.num_frames == 4
    assert done.left_out == {"pairs: their stamps run backwards": 2}


def test_an_interrupted_import_leaves_nothing_half_written(
    synthetic: Drive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_drive_as_bag(synthetic, tmp_path, "ros1")
    written = []

    def stop(*arguments: Any) -> Any:
        written.append(arguments)
        if len(written) == 3:
            raise KeyboardInterrupt
        return read_picture(*arguments)

    monkeypatch.setattr("semcal_cli.bags.frames.read_picture", stop)
    with pytest.raises(KeyboardInterrupt):
        import_bag(Request([path]), tmp_path / "drive")
    assert not (tmp_path / "drive/drive.yaml").exists()
    monkeypatch.undo()
    imported(path, tmp_path / "drive")
    imported(path, tmp_path / "whole")
    names = [
        sorted(str(file.relative_to(out)) for file in out.rglob("*"))
        for out in (tmp_path / "drive", tmp_path / "whole")
    ]
    assert names[0] == names[1]


DOCUMENT = Path(__file__).parents[1] / "docs/recordings.md"


def tutorial() -> list[list[str]]:
    """The commands of the first block of the documentation."""
    block = re.search(r"```sh\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)
    assert block is not None
    return [shlex.split(line) for line in block[1].splitlines()]


PAINT = np.stack(np.meshgrid(*[[10, 90, 170, 250]] * 3), axis=-1).reshape(-1, 3).astype(np.uint8)
"""Red, green, blue of each id."""


def test_the_commands_of_the_tutorial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures whose colours are their classes, and a network that knows them."""
    size = ["--width", "480", "--height", "270", "--channels", "64", "--columns", "800"]
    run_cli("synth", tmp_path / "true", "--frames", "8", "--seed", "93002", *size)
    drive = read_drive(tmp_path / "true")
    for frame in drive.frames:
        ids = cv2.imread(str(drive.resolve(frame.image_labels or "")), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(drive.resolve(frame.image or "")), np.ascontiguousarray(PAINT[ids][:, :, ::-1]))
    recorded = write_drive_as_bag(drive, tmp_path, "mcap library")
    recorded.rename(tmp_path / "recording.mcap")
    color_network(tmp_path / "network.onnx", colors=PAINT)
    card = {"semcal_picture_model": 1, "scale": 1 / 255, "mean": [0, 0, 0], "std": [1, 1, 1]}
    (tmp_path / "network.yaml").write_text(yaml.safe_dump(card))
    monkeypatch.chdir(tmp_path)
    commands = tutorial()
    assert [command[1] for command in commands] == ["import", "label", "calibrate", "convert"]
    for program, *arguments in commands:
        assert program == "semcal"
        run_cli(*arguments, code=None if arguments[0] == "calibrate" else 0)
    T_camera_lidar = np.array(yaml.safe_load(Path("calibration.yaml").read_text())["T_camera_lidar"])
    assert rotation_error_deg(T_camera_lidar, np.array(drive.T_camera_lidar)) < 1.0
    assert "static_transform_publisher" in Path("static_transform.sh").read_text()


def test_a_drive_in_the_rerun_viewer(synthetic: Drive, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    run_cli("calibrate", synthetic.path, "-o", tmp_path / "calibration.yaml", code=None)
    run_cli("export", "rerun", synthetic.path, tmp_path / "calibration.yaml", "-o", tmp_path / "look.rrd")
    rerun = [sys.executable, "-m", "rerun", "rrd", "print", str(tmp_path / "look.rrd"), "-v"]
    printed = subprocess.run(rerun, capture_output=True, text=True, check=True).stdout
    names = [
        "reference",
        "hypothesis_0",
        "stage_initial",
        "stage_polished",
        "result/picture",
        "result/labels",
    ]
    for entity in ("lidar/points", *(f"lidar/cameras/{name}" for name in names)):
        assert f"/{entity}" in printed
    assert run_cli("export", "rerun", synthetic.path, "-o", tmp_path / "look.txt", code=1)
