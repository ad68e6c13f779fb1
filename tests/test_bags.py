"""Recordings of ROS become drives: every storage, layout and encoding, and what is damaged or lies."""

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
from bags import KINDS, NS, START_NS, BagWriter, cut, jpeg, png, write_drive_as_bag
from click.testing import CliRunner, Result
from conftest import run
from mcap.writer import IndexType
from networks import color_network

from semcal_cli.bags.bag import Bag
from semcal_cli.bags.candidates import longest_ascending
from semcal_cli.bags.clouds import read_sweep
from semcal_cli.bags.importing import import_bag
from semcal_cli.bags.messages import Message, MessageError
from semcal_cli.bags.pictures import ENCODINGS, read_picture
from semcal_cli.bags.topics import Request
from semcal_cli.cli import semcal
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.reading import load_points, read_clouds
from semcal_cli.errors import InputError
from semcal_cli.files.images import read_image
from semcal_cli.geometry.poses import Pose, pose_from_mounting, rotation_error_deg

T_MOUNT = pose_from_mounting([1.0, -2.0, 3.0], [0.3, 0.1, -0.2])


@pytest.fixture(scope="module")
def synthetic(tmp_path_factory: pytest.TempPathFactory) -> Drive:
    """A small drive with labels and pictures."""
    folder = tmp_path_factory.mktemp("synthetic")
    size = ["--width", "320", "--height", "180", "--channels", "32", "--columns", "400"]
    run_cli("synth", folder, "--frames", "6", "--seed", "93001", *size)
    return read_drive(folder)


def run_cli(*arguments: object, code: int | None = 0) -> Result:
    """Run the command; None allows the exit codes of verdicts."""
    result = CliRunner().invoke(semcal, list(map(str, arguments)))
    assert result.exit_code in ((0, 3) if code is None else (code,)), result.output
    return result


def imported(path: Path, out: Path, **settings: Any) -> Any:
    """Import a recording, and return the content of the drive.yaml."""
    import_bag(Request([path], **settings), out)
    return yaml.safe_load((out / "drive.yaml").read_text())


@pytest.mark.parametrize("kind", KINDS)
def test_a_drive_comes_back_from_each_storage(kind: str, synthetic: Drive, tmp_path: Path) -> None:
    path = write_drive_as_bag(synthetic, tmp_path, kind, T_camera_lidar=T_MOUNT)
    imported(path, tmp_path / "drive")
    drive = read_drive(tmp_path / "drive")
    assert drive.camera == synthetic.camera
    np.testing.assert_allclose(drive.T_camera_lidar or 0, T_MOUNT, atol=1e-12)
    assert len(drive.frames) == len(synthetic.frames)
    for mine, theirs in zip(read_clouds(drive), read_clouds(synthetic), strict=True):
        np.testing.assert_array_equal(mine.points, theirs.points)
    for index, (mine, theirs) in enumerate(zip(drive.frames, synthetic.frames, strict=True)):
        assert mine.points_stamp == pytest.approx(START_NS / NS + index / 10, abs=1e-6)
        assert mine.image_stamp == pytest.approx(mine.points_stamp + 0.01, abs=1e-6)
        pictures = (
            read_image(read_drive.resolve(each.image))
            for read_drive, each in ((drive, mine), (synthetic, theirs))
        )
        np.testing.assert_array_equal(*pictures)


@pytest.mark.parametrize(
    ("kind", "compression"),
    [("ros1", "LZ4"), ("ros1", "BZ2"), ("mcap library", "LZ4"), ("mcap library", "ZSTD"), ("sqlite3", "MESSAGE"),
     ("mcap", "MESSAGE"), ("sqlite3", "FILE"), ("mcap", "FILE"), ("mcap", "STORAGE")],
)  # fmt: skip
def test_compressed_recordings(kind: str, compression: str, synthetic: Drive, tmp_path: Path) -> None:
    path = write_drive_as_bag(synthetic, tmp_path, kind, compression=compression)
    assert len(imported(path, tmp_path / "drive")["frames"]) == len(synthetic.frames)


def test_the_pose_is_that_of_the_drive_itself(synthetic: Drive, tmp_path: Path) -> None:
    """Import, take over the labels, calibrate: the same pose to 1e-9."""
    path = write_drive_as_bag(synthetic, tmp_path, "mcap library")
    document = imported(path, tmp_path / "drive")
    first = yaml.safe_load(synthetic.path.read_text())
    for mine, theirs in zip(document["frames"], first["frames"], strict=True):
        for side in ("image_labels", "point_labels"):
            mine[side] = str(synthetic.resolve(theirs[side]).absolute())
    document |= {key: first[key] for key in ("classes", "ignore", "lidar") if key in first}
    (tmp_path / "drive/drive.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
    found = []
    for drive in (tmp_path / "drive", synthetic.path):
        out = tmp_path / f"{len(found)}.yaml"
        run_cli("calibrate", drive, "-o", out, code=None)
        found.append(np.array(yaml.safe_load(out.read_text())["T_camera_lidar"]))
    np.testing.assert_allclose(*found, atol=1e-9)


def test_the_parts_of_a_recording_are_one(synthetic: Drive, tmp_path: Path) -> None:
    paths = []
    for name, chosen in (("a", slice(0, 3)), ("b", slice(3, 6))):
        (tmp_path / name).mkdir()
        part = synthetic.model_copy(update={"frames": synthetic.frames[chosen]})
        paths.append(write_drive_as_bag(part, tmp_path / name, "ros1"))
    # The stamps of both parts are the same: a second part that begins again is told by its stamps.
    done = import_bag(Request(paths), tmp_path / "drive")
    assert done.written.num_frames == 3
    assert sum(done.left_out.values()) == 3


# --- sweeps


def sweep_of(bag: BagWriter, message: Any, stamp_ns: int = START_NS) -> Any:
    raw = bag.raw(message)
    return read_sweep(Message("/points", message.__msgtype__, stamp_ns, raw, bag.is_ros1), stamp_ns)


LAYOUTS: dict[str, Any] = {
    "usual": [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("time", "<f4")],
    "double": [("intensity", "<u1"), ("z", "<f8"), ("y", "<f8"), ("x", "<f8"), ("reflectivity", "<u2")],
    "big endian": [("x", ">f4"), ("y", ">f4"), ("z", ">f4"), ("t", ">u4"), ("ring", ">i2"), ("n", ">i4")],
    "padded": {"names": ["x", "y", "z", "ring", "far"], "formats": ["<f4", "<f4", "<f4", "u1", "<i2"],
               "offsets": [0, 4, 8, 20, 30], "itemsize": 48},
    "several numbers": [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("normal", "<f4", (3,)), ("flag", "i1")],
}  # fmt: skip


@pytest.mark.parametrize("shape", [(50,), (5, 10)])
@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize("kind", ["ros1", "sqlite3"])
def test_every_field_of_a_sweep_is_kept(kind: str, name: str, shape: tuple[int, ...], tmp_path: Path) -> None:
    generator = np.random.default_rng(1)
    records = np.zeros(shape, np.dtype(LAYOUTS[name]))
    for field in records.dtype.names or ():
        values = generator.integers(0, 120, (*shape, *records.dtype[field].shape))
        records[field] = values + (0.25 if records.dtype[field].base.kind == "f" else 0)
    for field, scale in (
        ("time", 1e-3),
        ("t", 1_000_000),
    ):  # times of a sweep, in a unit that is read as it is
        if field in (records.dtype.names or ()):
            records[field] = records[field] * scale
    records["x"].flat[3] = np.nan
    records["x"].flat[4] = records["y"].flat[4] = records["z"].flat[4] = 0.0
    with BagWriter(tmp_path, kind) as bag:
        found = sweep_of(bag, bag.cloud(records, START_NS))
        bag.write("/x", bag.cloud(records, START_NS), START_NS)
    assert found.records.dtype.names == records.dtype.names
    for field in records.dtype.names or ():
        np.testing.assert_array_equal(found.records[field].ravel(), np.atleast_2d(records)[field].ravel())
    (tmp_path / "cloud.pcd").write_bytes(found.pcd())
    assert f"WIDTH {shape[-1]}".encode() in found.pcd()
    (cloud,) = read_clouds(one_cloud(tmp_path))
    kept = np.isfinite(records["x"].ravel())
    assert len(cloud.points) in (kept.sum(), kept.sum() - 1)


def one_cloud(folder: Path) -> Drive:
    camera = {"model": "plumb_bob", "width": 8, "height": 8, "K": [[8.0, 0, 4], [0, 8.0, 4], [0, 0, 1]]}
    document = {"semcal_drive": 1, "camera": camera, "frames": [{"points": "cloud.pcd"}]}
    (folder / "drive.yaml").write_text(yaml.safe_dump(document))
    return read_drive(folder)


@pytest.mark.parametrize("package", ["livox_ros_driver", "livox_ros_driver2"])
@pytest.mark.parametrize("kind", ["ros1", "sqlite3"])
def test_livox_custom_messages(kind: str, package: str, tmp_path: Path) -> None:
    layout = [("offset_time", "u4"), ("x", "f4"), ("y", "f4"), ("z", "f4"), ("reflectivity", "u1"), ("tag", "u1"),
              ("line", "u1")]  # fmt: skip
    records = np.zeros(7, layout)
    for place, (name, _) in enumerate(layout):
        records[name] = np.arange(7) * (place + 1) + 1
    records["offset_time"] = np.arange(7) * 15_000_000
    for frame in ("lidar", "livox_frame", ""):  # the length of the frame's name moves all that follows
        with BagWriter(tmp_path, kind) as bag:
            message = bag.livox(records, START_NS, package)
            message.header.frame_id = frame
            sweep = sweep_of(bag, message)
            bag.write("/x", message, START_NS)
        for name, _ in layout:
            np.testing.assert_array_equal(sweep.records[name][0], records[name])
        assert sweep.times.reference == "relative"
        tmp_path = tmp_path / "next"
        tmp_path.mkdir()


SECONDS = np.linspace(0.0, 0.09, 10)
STAMP_S = START_NS / NS
TIMES = {
    "seconds": ("time", "<f4", SECONDS, "relative", False),
    "nanoseconds": ("t", "<u4", SECONDS * 1e9, "relative", False),
    "absolute seconds": ("timestamp", "<f8", SECONDS + STAMP_S, "absolute", False),
    "microseconds": ("time_offset", "<u4", SECONDS * 1e6, "relative", True),
    "milliseconds": ("time", "<f4", SECONDS * 1e3, "relative", True),
    "absolute nanoseconds": ("timestamp", "<f8", SECONDS * 1e9 + START_NS, "relative", True),
    "unknown name": ("time_stamp", "<f8", SECONDS + STAMP_S, "relative", True),
    "another clock": ("timestamp", "<f8", SECONDS + 1234.0, None, True),
    "zeros": ("time", "<f4", SECONDS * 0.0, None, True),
}


@pytest.mark.parametrize("unit", TIMES)
def test_times_of_points_in_every_unit(unit: str, tmp_path: Path) -> None:
    name, kind, values, expected, is_told = TIMES[unit]
    records = np.ones(10, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), (name, kind)])
    records[name] = values
    with BagWriter(tmp_path, "sqlite3") as bag:
        sweep = sweep_of(bag, bag.cloud(records, START_NS))
        bag.write("/x", bag.cloud(records, START_NS), START_NS)
    assert sweep.times.reference == expected
    assert (sweep.times.remark is not None) == is_told
    (tmp_path / "cloud.pcd").write_bytes(sweep.pcd())
    (cloud,) = read_clouds(one_cloud(tmp_path))
    if expected is not None:
        shift = STAMP_S if expected == "absolute" else 0.0
        np.testing.assert_allclose(cloud.time - shift, SECONDS, atol=1e-6)


# --- pictures

COLORS = (
    np.array([[[200, 100, 50], [30, 60, 90]], [[10, 20, 250], [240, 230, 5]]], np.uint8)
    .repeat(8, 0)
    .repeat(8, 1)
)
"""Four patches of blue, green, red."""
GREY = COLORS[:, :, 0]


def mosaic(pattern: str) -> np.ndarray:
    """Pixels as a sensor with a Bayer pattern, named by its first two rows, sees `COLORS`."""
    stored = np.empty(GREY.shape, np.uint8)
    for place, color in enumerate(pattern):
        rows, columns = slice(place // 2, None, 2), slice(place % 2, None, 2)
        stored[rows, columns] = COLORS[rows, columns, "bgr".index(color)]
    return stored


def stored_pixels(encoding: str) -> tuple[np.ndarray, np.ndarray]:
    """Pixels in an encoding, and what they are to become."""
    alpha = np.dstack([COLORS, np.full(GREY.shape, 9, np.uint8)])
    plain = {
        "mono8": (GREY, GREY), "8UC1": (GREY, GREY), "bgr8": (COLORS, COLORS), "8UC3": (COLORS, COLORS),
        "rgb8": (COLORS[:, :, ::-1], COLORS), "bgra8": (alpha, COLORS), "8UC4": (alpha, COLORS),
        "rgba8": (alpha[:, :, [2, 1, 0, 3]], COLORS),
        "mono16": (GREY.astype(np.uint16) * 257, GREY.astype(np.uint16) * 257),
        "bgr16": (COLORS.astype(np.uint16) * 257, COLORS.astype(np.uint16) * 257),
        "rgb16": (COLORS[:, :, ::-1].astype(np.uint16) * 257, COLORS.astype(np.uint16) * 257),
    }  # fmt: skip
    if encoding in plain:
        return plain[encoding]
    if encoding.startswith("bayer"):
        stored = mosaic(encoding[6:10])
        return (
            (stored, COLORS)
            if encoding.endswith("8")
            else (stored.astype(np.uint16) * 257, COLORS.astype(np.uint16) * 257)
        )
    y, u, v = (
        np.kron(each, np.ones((8, 8), int))
        for each in ([[60, 90], [120, 200]], [[90, 150], [120, 60]], [[200, 100], [80, 140]])
    )
    chroma = np.where(np.arange(y.shape[1]) % 2 == 0, u, v)
    pair = (chroma, y) if encoding in ("yuv422", "uyvy") else (y, chroma)
    # ITU-R BT.601 with its limited range.
    luma = 1.164 * (y - 16)
    red, blue = luma + 1.596 * (v - 128), luma + 2.018 * (u - 128)
    green = luma - 0.813 * (v - 128) - 0.391 * (u - 128)
    return np.dstack(pair).astype(np.uint8), np.dstack([blue, green, red]).clip(0, 255)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_every_encoding_of_a_picture(encoding: str, tmp_path: Path) -> None:
    stored, expected = stored_pixels(encoding)
    orders = ["<", ">"] if stored.dtype.itemsize == 2 else ["<"]
    for order in orders:
        pixels = np.ascontiguousarray(stored).astype(stored.dtype.newbyteorder(order))
        padded = np.pad(pixels.view(np.uint8).reshape(len(pixels), -1), ((0, 0), (0, 6)))
        with BagWriter(tmp_path, "sqlite3") as bag:
            changes = {"step": padded.shape[1], "data": padded.ravel()}
            message = bag.image(pixels, encoding, START_NS, **changes)
            raw = bag.raw(message)
            bag.write("/x", message, START_NS)
        tmp_path = tmp_path / "next"
        tmp_path.mkdir()
        picture = read_picture(Message("/image", message.__msgtype__, START_NS, raw, is_ros1=False))
        found = cv2.imdecode(np.frombuffer(picture.content, np.uint8), cv2.IMREAD_UNCHANGED)
        if encoding.startswith(("yuv", "uyvy", "yuyv")):
            np.testing.assert_allclose(found, expected, atol=1.01)
        elif encoding.startswith("bayer"):
            for row, column in ((3, 3), (3, 11), (11, 3), (11, 11)):
                np.testing.assert_array_equal(found[row, column], expected[row, column])
        else:
            np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(("encode", "suffix"), [(png, ".png"), (jpeg, ".jpg")])
def test_compressed_pictures_keep_their_bytes(encode: Any, suffix: str, tmp_path: Path) -> None:
    content = encode(COLORS)
    with BagWriter(tmp_path, "ros1") as bag:
        message = bag.compressed(content, "bgr8; jpeg compressed bgr8", START_NS)
        raw = bag.raw(message)
        bag.write("/x", message, START_NS)
    picture = read_picture(Message("/image", message.__msgtype__, START_NS, raw, is_ros1=True))
    assert picture == (content, suffix, (16, 16))


# --- cameras, frames, motion, choice


class Small:
    """A small recording: `count` sweeps and pictures, a tenth of a second apart; functions change its messages."""

    def __init__(self, folder: Path, kind: str = "sqlite3", count: int = 6) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.bag = BagWriter(folder, kind)
        self.count = count
        camera = {
            "model": "plumb_bob",
            "width": 16,
            "height": 16,
            "K": ((9.0, 0.0, 8.0), (0.0, 9.0, 8.0), (0.0, 0.0, 1.0)),
        }
        self.camera = Drive.model_validate(
            {"semcal_drive": 1, "camera": camera, "frames": [{"points": "p.bin"}]}
        ).camera
        self.records = np.ones(20, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("time", "<f4")])
        self.records["x"] = np.arange(20)
        self.records["time"] = np.linspace(0.0, 0.09, 20)

    def write(self, **changes: Any) -> Path:
        """Write the recording; a change is a function of the writer, the index and the stamp that gives a message."""
        make = {
            "info": lambda bag, index, stamp: bag.camera_info(self.camera, stamp),
            "image": lambda bag, index, stamp: bag.image(np.roll(COLORS, index, 0), "bgr8", stamp),
            "points": lambda bag, index, stamp: bag.cloud(self.records, stamp),
        } | changes
        names = {"info": "/cam/camera_info", "image": "/cam/image_raw", "points": "/points"}
        with self.bag as bag:
            for index in range(self.count):
                stamp = START_NS + index * NS // 10
                for key, function in make.items():
                    message = function(bag, index, stamp)
                    if message is not None:
                        bag.write(names.get(key, f"/{key}"), message, stamp + NS // 100)
        return self.bag.path


def refused(path: Path, out: Path, **settings: Any) -> str:
    """Import what has to be refused, and return the message."""
    with pytest.raises(InputError) as error:
        import_bag(Request([path], **settings), out)
    assert not (out / "drive.yaml").exists()
    return str(error.value)


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


def test_an_index_without_those_of_messages(tmp_path: Path) -> None:
    with BagWriter(tmp_path, "mcap library", index_types=IndexType.ALL & ~IndexType.MESSAGE) as bag:
        small = Small(tmp_path / "unused")
        small.bag.write("/x", small.bag.camera_info(small.camera, START_NS), START_NS)
        small.bag.__exit__(None, None, None)
        small.bag = bag
        path = small.write()
    assert len(imported(path, tmp_path / "drive")["frames"]) == 6


def test_points_without_a_range_have_no_times(tmp_path: Path) -> None:
    records = np.ones(10, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("timestamp", "<f8")])
    records["timestamp"] = SECONDS + STAMP_S
    records["x"][4], records["timestamp"][4] = np.nan, 0.0
    with BagWriter(tmp_path, "sqlite3") as bag:
        sweep = sweep_of(bag, bag.cloud(records, START_NS))
        bag.write("/x", bag.cloud(records, START_NS), START_NS)
    assert sweep.times.reference == "absolute"
    assert sweep.times.ends_s == pytest.approx((0.0, 0.09), abs=1e-6)


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


def test_a_database_that_was_not_closed_says_so(tmp_path: Path) -> None:
    path = Small(tmp_path).write()
    file = next(path.glob("*.db3"))
    file.with_name(f"{file.name}-wal").write_bytes(bytes(5000))
    done = import_bag(Request([path]), tmp_path / "drive")
    assert any(
        "bag.db3-wal, 5,000 bytes: the recording was not closed" in each for each in done.written.remarks
    )


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


# --- what lies or is damaged


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


CLOUD_LIES: dict[str, Any] = {
    "point_step": ({"point_step": 14}, "up to byte 16, but point_step 14"),
    "point_step huge": ({"point_step": 1 << 30}, "point_step 1,073,741,824"),
    "row_step": ({"row_step": 3, "height": 2, "width": 10}, "found row_step 3, needed 160"),
    "data": ({"data": np.zeros(5, np.uint8)}, "found 5 bytes of points, needed 320"),
    "width": ({"width": 4_000_000_000}, "found 4,000,000,000 points"),
    "empty": ({"width": 0}, "found a cloud without points"),
    "fields": ({"fields": []}, "found the fields none, needed x, y and z"),
}
IMAGE_LIES: dict[str, Any] = {
    "no bytes": ({"data": np.zeros(0, np.uint8)}, "found 0 bytes of pixels, needed 768"),
    "step": ({"step": 7}, "found step 7, needed 48"),
    "size": ({"width": 0}, "found a picture of 0 x 16 pixels"),
    "huge": ({"width": 1 << 31, "height": 1 << 31}, "needed at most 100,000,000"),
    "encoding": ({"encoding": "32FC1"}, "found encoding '32FC1', needed one of: mono8"),
    "other size": ({"width": 8, "step": 24}, "found a picture of 8 x 16 pixels, needed 16 x 16"),
}


@pytest.mark.parametrize("lie", CLOUD_LIES)
def test_a_sweep_that_lies_gets_one_line(lie: str, tmp_path: Path) -> None:
    changes, expected = CLOUD_LIES[lie]
    small = Small(tmp_path)
    path = small.write(points=lambda bag, index, stamp: bag.cloud(small.records, stamp, **changes))
    assert expected in refused(path, tmp_path / "drive")


@pytest.mark.parametrize("lie", IMAGE_LIES)
def test_a_picture_that_lies_gets_one_line(lie: str, tmp_path: Path) -> None:
    changes, expected = IMAGE_LIES[lie]
    path = Small(tmp_path).write(
        image=lambda bag, index, stamp: bag.image(COLORS, stamp_ns=stamp, **{"encoding": "bgr8"} | changes)
    )
    assert expected in refused(path, tmp_path / "drive")


@pytest.mark.parametrize("content", [b"", b"RIFF1234WEBP", b"\xff\xd8\xff\xe0", b"\x89PNG\r\n\x1a\n"])
def test_a_compressed_picture_that_is_none_gets_one_line(content: bytes, tmp_path: Path) -> None:
    path = Small(tmp_path).write(image=lambda bag, index, stamp: bag.compressed(content, "jpeg", stamp))
    assert f"found {len(content)} bytes of" in refused(path, tmp_path / "drive")


def test_one_bad_message_is_left_out_and_counted(tmp_path: Path) -> None:
    small = Small(tmp_path)
    path = small.write(
        points=lambda bag, index, stamp: bag.cloud(
            small.records, stamp, **({"point_step": 3} if index == 2 else {})
        )
    )
    done = import_bag(Request([path]), tmp_path / "drive")
    assert done.written.num_frames == 5
    assert done.left_out.total() == 1


def test_cameras_that_are_none_and_topics_that_are_missing(tmp_path: Path) -> None:
    small = Small(tmp_path / "zeros")
    path = small.write(info=lambda bag, index, stamp: bag.camera_info(small.camera, stamp, K=np.zeros(9)))
    assert "/cam/camera_info: K: found zeros only, needed a calibrated camera" in refused(
        path, tmp_path / "a"
    )
    small = Small(tmp_path / "lens")
    path = small.write(
        info=lambda bag, index, stamp: bag.camera_info(small.camera, stamp, distortion_model="odd")
    )
    assert "/cam/camera_info: distortion_model: found 'odd', needed one of: plumb_bob" in refused(
        path, tmp_path / "b"
    )
    path = Small(tmp_path / "none").write(info=lambda *_: None)
    assert "found no topic of intrinsics (CameraInfo), needed one, or --intrinsics FILE" in refused(
        path, tmp_path / "c"
    )
    file = tmp_path / "info.yaml"
    file.write_text(
        "{image_width: 16, image_height: 16, distortion_model: plumb_bob, distortion_coefficients: [],"
        " camera_matrix: [9, 0, 8, 0, 9, 8, 0, 0, 1]}"
    )
    assert imported(path, tmp_path / "d", intrinsics=file)["camera"]["width"] == 16
    path = Small(tmp_path / "no_image").write(image=lambda *_: None)
    assert "found no topic of pictures (Image, CompressedImage), only" in refused(path, tmp_path / "e")
    small = Small(tmp_path / "two")
    path = small.write(rear=lambda bag, index, stamp: bag.cloud(small.records, stamp))
    message = refused(path, tmp_path / "f")
    assert message.startswith("--points: found 2 topics of sweeps")
    assert message.endswith("needed one of: /points, /rear")
    assert len(imported(path, tmp_path / "g", points="/rear")["frames"]) == 6
    assert "found no topic '/front' of sweeps" in refused(path, tmp_path / "h", points="/front")


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


def test_ten_thousand_topics_and_unknown_types(tmp_path: Path) -> None:
    small = Small(tmp_path, "mcap library")
    for index in range(10_000):
        small.bag.write_raw(f"/odd/{index:05d}", "odd_msgs/msg/Odd", b"\0\1\0\0\7", START_NS)
    path = small.write()
    assert len(imported(path, tmp_path / "drive")["frames"]) == 6
    done = run_cli("import", "bag", path, "--list")
    assert len(done.stdout.splitlines()) == 10_004


@pytest.mark.parametrize("kind", ["ros1", "mcap library", "sqlite3"])
def test_a_recording_that_is_cut_off_gives_what_is_whole(
    kind: str, synthetic: Drive, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = write_drive_as_bag(synthetic, tmp_path, kind, T_camera_lidar=T_MOUNT)
    file = next(path.glob("*.db3")) if path.is_dir() else path
    counts = []
    for tenth in range(10):
        part = cut(file, tenth / 10 + 0.05, tmp_path / f"{tenth}{file.suffix}")
        code, _, stderr = run(capfd, "import", "bag", part, "-o", tmp_path / f"drive{tenth}")
        if code == 0:
            counts.append(len(read_drive(tmp_path / f"drive{tenth}").frames))
            assert "damaged" in stderr
        else:
            counts.append(0)
            assert (code, len(stderr.splitlines())) == (1, 1)
            assert str(part) in stderr
    assert counts == sorted(counts)
    assert counts[0] == 0
    assert counts[-1] >= len(synthetic.frames) - 1


@pytest.mark.parametrize(
    ("kind", "compression"), [("ros1", "BZ2"), ("mcap library", "LZ4"), ("mcap library", "")]
)
def test_damage_in_the_middle_costs_what_lies_there(
    kind: str, compression: str, synthetic: Drive, tmp_path: Path
) -> None:
    """Bzip2 and MCAP have checksums; without one, nobody can tell."""
    path = write_drive_as_bag(synthetic, tmp_path, kind, compression=compression)
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 64] = bytes(64)
    path.write_bytes(content)
    done = import_bag(Request([path]), tmp_path / "drive")
    assert 1 <= done.written.num_frames < len(synthetic.frames)
    assert any("damaged data, left out" in remark for remark in done.written.remarks)


def test_a_recording_without_its_metadata(synthetic: Drive, tmp_path: Path) -> None:
    path = write_drive_as_bag(synthetic, tmp_path, "mcap")
    (path / "metadata.yaml").unlink()
    assert len(imported(path, tmp_path / "drive")["frames"]) == len(synthetic.frames)
    (path / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    assert len(imported(path, tmp_path / "again")["frames"]) == len(synthetic.frames)


@pytest.mark.parametrize(
    ("name", "content"),
    [("a.bag", b""), ("a.bag", b"#ROSBAG V2.0\n"), ("a.bag", b"#ROSBAG V1.2\n"), ("a.mcap", b"\x89MCAP0\r\n"),
     ("a.db3", b"SQLite format 3\0"), ("a.db3", b"SQLite format 3\0" + bytes(4096)), ("a.txt", b"hello"),
     ("a.mcap", b"\x89MCAP0\r\n\x01" + b"\xff" * 30)],
)  # fmt: skip
def test_a_file_that_is_no_recording_gets_one_line(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    assert str(tmp_path / name) in refused(tmp_path / name, tmp_path / "drive")
    assert "no such file" in refused(tmp_path / "missing.bag", tmp_path / "drive")


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


def test_bags_are_read_in_the_order_of_receipt(synthetic: Drive, tmp_path: Path) -> None:
    path = write_drive_as_bag(synthetic, tmp_path, "mcap")
    with Bag([path]) as bag:
        times = [message.received_ns for message in bag.messages(bag.topics)]
    assert times == sorted(times)
    assert len(times) == 3 * len(synthetic.frames)


def test_messages_too_short_for_a_header() -> None:
    for raw in (b"", b"\0", b"\0\1\0\0\0\0"):
        message = Message("/x", "sensor_msgs/msg/PointCloud2", 1, raw, is_ros1=False)
        for read in (
            lambda message: message.header_ns,
            lambda message: message.frame_id,
            lambda m: read_sweep(m, 1),
        ):
            with pytest.raises(MessageError):
                read(message)


# --- the tutorial

DOCUMENT = Path(__file__).parents[1] / "docs/recordings.md"


def tutorial() -> list[list[str]]:
    """The commands of the first block of the documentation."""
    block = re.search(r"```sh\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)
    assert block is not None
    return [shlex.split(line) for line in block[1].splitlines()]


PAINT = np.stack(np.meshgrid(*[[10, 90, 170, 250]] * 3), axis=-1).reshape(-1, 3).astype(np.uint8)
"""Red, green, blue of each id."""


def test_the_five_commands_of_the_tutorial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
    assert [command[1] for command in commands] == ["import", "label", "calibrate", "verify", "convert"]
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
