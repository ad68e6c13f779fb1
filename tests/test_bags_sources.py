"""Recordings of other makers: Foxglove's schemas, ROS 1 in MCAP, video, and packets of LiDARs."""

from __future__ import annotations

import bz2
import re
import struct
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import pytest
import zstandard
from bag_imports import CAMERA, T_MOUNT, cloud, done, fill, image, info, nothing, refused, run_cli, small
from bags import NS, ROS1_MCAP, BagWriter, header, write_drive
from foxglove_recordings import FoxgloveWriter, VideoWriter, encoded
from mcap.writer import Writer as McapWriter

from semcal_cli.drive.camera import Camera
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.errors import describe_extra
from semcal_cli.files.image_files import read_image
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.importing.bags.mcap_file import McapFile
from semcal_cli.importing.bags.unpacking import unpack
from semcal_cli.observations.reading import read_clouds

CLOUD = "sensor_msgs/msg/PointCloud2"
VIDEO_GREY = 3.5
"""Largest mean difference of the brightness of a video's frame from its image, of 255: it is rounded down by 2."""
WRITERS: dict[str, Any] = {
    "protobuf": lambda folder: FoxgloveWriter(folder, "protobuf"),
    "json": lambda folder: FoxgloveWriter(folder, "json"),
    "ROS 1 in MCAP": lambda folder: BagWriter(folder, ROS1_MCAP),
}
VIDEOS: dict[str, Any] = {
    "protobuf, H.264": lambda folder: VideoWriter(FoxgloveWriter(folder, "protobuf"), "h264"),
    "ROS 2, H.265": lambda folder: VideoWriter(BagWriter(folder, "sqlite3"), "h265"),
    "json, AV1": lambda folder: VideoWriter(FoxgloveWriter(folder, "json"), "av1"),
}


def recorded(drive: Drive, writer: Any, out: Path) -> Drive:
    """Record a drive, and import it again."""
    done(write_drive(drive, writer, T_MOUNT), out)
    return read_drive(out)


@pytest.mark.parametrize("name", [*WRITERS, *VIDEOS])
def test_a_recording_is_the_drive_that_it_was_made_of(name: str, synthetic: Drive, tmp_path: Path) -> None:
    found = recorded(synthetic, (WRITERS | VIDEOS)[name](tmp_path), tmp_path / "drive")
    np.testing.assert_array_equal(found.camera.K, synthetic.camera.K)
    np.testing.assert_allclose(found.T_camera_lidar, T_MOUNT, atol=1e-9)
    assert len(found.frames) == len(synthetic.frames)
    for cloud_found, cloud_before in zip(read_clouds(found), read_clouds(synthetic), strict=True):
        np.testing.assert_array_equal(cloud_found.points, cloud_before.points)
    for frame, before in zip(found.frames, synthetic.frames, strict=True):
        grey, expected = (
            read_image(drive.resolve(each.image or "")).mean(axis=2)
            for drive, each in ((found, frame), (synthetic, before))
        )
        # Brightness keeps its resolution in a video; another frame differs by 20 and more.
        assert np.abs(grey - expected).mean() <= (VIDEO_GREY if name in VIDEOS else 0.0)


@pytest.mark.slow
def test_a_video_gives_the_pose_of_its_images(tmp_path: Path) -> None:
    size = ["--frames", "12", "--width", "640", "--height", "360", "--seed", "93010"]
    run_cli("synth", tmp_path / "true", *size)
    drive, poses = read_drive(tmp_path / "true"), []
    assert drive.T_camera_lidar is not None
    writers = BagWriter(tmp_path, "sqlite3"), VideoWriter(FoxgloveWriter(tmp_path, "protobuf"), "h264")
    for index, writer in enumerate(writers):
        out = tmp_path / str(index)
        done(write_drive(drive, writer, np.array(drive.T_camera_lidar)), out)
        run_cli("calibrate", out, "--cue", "edges", "--init", out, "-o", out / "found.yaml", code=None)
        poses.append(read_transform(out / "found.yaml"))
    assert compare_poses(*poses).rotation_deg < 0.02


def test_frames_of_a_video_are_decoded_from_the_key_frame_before_them(tmp_path: Path) -> None:
    """Every 25th image is a key frame, and frames lie three seconds apart."""

    def images(bag: Any, index: int, stamp: int) -> Any:
        return bag.image(np.full((16, 16, 3), 2 * index + 20, np.uint8), "bgr8", stamp)

    writer = VideoWriter(BagWriter(tmp_path, "mcap"), "h264", key_every=25)
    fill(writer, 100, image=images)
    done(writer.path, tmp_path / "drive", every_s=3.0)
    drive = read_drive(tmp_path / "drive")
    found = [read_image(drive.resolve(frame.image or "")).mean() for frame in drive.frames]
    np.testing.assert_allclose(found, [20, 80, 140, 200], atol=4.0)


@pytest.mark.parametrize(
    ("images", "told"),
    [
        (lambda bag, index, stamp: bag.packet(b"\0\0\1\1", "h264", stamp), "without a key frame"),
        (lambda bag, index, stamp: bag.packet(b"\0\0\1\5", "h264", stamp), "damaged video frame"),
        (lambda bag, index, stamp: bag.packet(b"", "vp8", stamp), "'vp8', expected H.264, H.265 or AV1"),
    ],
)
def test_a_video_that_cannot_be_decoded_is_named(images: Any, told: str, tmp_path: Path) -> None:
    path = small(tmp_path, image=nothing, **{"cam/video": images})
    assert told in refused(path, tmp_path / "drive")


def test_a_video_of_few_bytes_is_not_decoded_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames that repeat the one before take a few bytes each."""
    monkeypatch.setattr("semcal_cli.importing.bags.video.MIN_VIDEO_PIXELS", 16 * 256 * 256)

    def images(bag: Any, index: int, stamp: int) -> Any:
        return bag.image(np.zeros((256, 256, 3), np.uint8), "bgr8", stamp)

    camera = Camera(model="plumb_bob", width=256, height=256, K=((9.0, 0, 8.0), (0, 9.0, 8.0), (0, 0, 1.0)))
    writer = VideoWriter(BagWriter(tmp_path, "mcap"), "h264", key_every=100)
    fill(writer, 100, image=images, info=lambda bag, index, stamp: bag.camera_info(camera, stamp))
    monkeypatch.setattr("semcal_cli.importing.bags.video.MAX_PIXELS_A_BYTE", 100)
    message = refused(writer.path, tmp_path / "drive")
    told = "/cam/[a-z_]+: found a video of [0-9,]+ pixels in [0-9,]+ bytes, needed at most 100 a byte$"
    assert re.search(told, message)


def velodyne(bag: Any, index: int, stamp: int) -> Any:
    """A revolution of a VLP-16 that sees a wall 10 m away in all directions, by its manual (63-9243, chapter 9)."""
    packets = []
    for packet in range(75):
        blocks = b"".join(
            struct.pack("<HH", 0xEEFF, round(100 * (4.8 * packet + 0.4 * block)) % 36000)
            + struct.pack("<HB", 5000, 50) * 32
            for block in range(12)
        )
        data = blocks + struct.pack("<IBB", round(1e6 * 0.1 * packet / 75), 0x37, 0x22)
        times = stamp - round((74 - packet) * 1.33e6)
        packets.append(
            {"stamp": {"sec": times // NS, "nanosec": times % NS}, "data": np.frombuffer(data, np.uint8)}
        )
    return bag.make("velodyne_msgs/msg/VelodyneScan", header=header(stamp, "lidar"), packets=packets)


@pytest.mark.parametrize("kind", ["ros1", "sqlite3"])
def test_packets_of_a_velodyne_become_sweeps(kind: str, tmp_path: Path) -> None:
    done(small(tmp_path, kind, points=nothing, velodyne_packets=velodyne), tmp_path / "drive")
    cloud = read_clouds(read_drive(tmp_path / "drive"))[0]
    points = cloud.points.astype(float)
    assert cloud.time is not None
    # The stamp of the sweep is that of its last packet, whose points follow within two milliseconds.
    np.testing.assert_allclose([cloud.time.min(), cloud.time.max()], [-0.0987, 0.0013], atol=2e-4)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 10.0, atol=0.01)
    elevations = np.degrees(np.arcsin(points[:, 2] / 10.0))
    assert sorted(set(elevations.round().astype(int))) == list(range(-15, 16, 2))


@pytest.mark.parametrize(
    ("storage", "advice"),
    [
        ("mcap", "`ros2 launch ouster_ros replay.launch.xml bag_file:=BAG` while `ros2 bag record -a` runs"),
        (
            "ros1",
            "`roslaunch ouster_ros replay.launch bag_file:=BAG metadata:=JSON` while `rosbag record -a` runs",
        ),
    ],
)
def test_packets_of_an_ouster_are_to_be_replayed(storage: str, advice: str, tmp_path: Path) -> None:
    packet = {"buf": np.zeros(8, np.uint8)}
    path = small(
        tmp_path,
        storage,
        points=nothing,
        lidar_packets=lambda bag, index, stamp: bag.make("ouster_ros/msg/PacketMsg", **packet),
    )
    assert advice in refused(path, tmp_path / "drive")


@pytest.mark.parametrize(
    ("record", "missing", "extra"),
    [
        (lambda folder: fill(FoxgloveWriter(folder, "protobuf")), "mcap_protobuf", "bag"),
        (lambda folder: fill(VideoWriter(BagWriter(folder, "mcap"), "h264")), "av", "bag"),
        (lambda folder: small(folder, points=nothing, packets=velodyne), "velodyne_decoder", "velodyne"),
    ],
)
def test_a_library_that_is_missing_is_named_with_its_extra(
    record: Any, missing: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = record(tmp_path)
    monkeypatch.setattr(
        "semcal_cli.errors.find_spec", lambda name: None if name == missing else find_spec(name)
    )
    assert refused(path, tmp_path / "drive").endswith(f"found no {missing}; install {describe_extra(extra)}")


def in_json(**changes: Any) -> Any:
    """Change fields of the message that another maker makes."""
    return lambda maker: lambda bag, *of: (lambda name, fields: (name, fields | changes))(*maker(bag, *of))


X = {"name": "x", "offset": 0, "type": 7}
HOSTILE_JSON: dict[str, tuple[str, Any, str]] = {
    "negative offset": ("points", {"fields": [X | {"offset": -4}]}, "found offset -4, expected a whole number"),
    "negative size": ("image", {"width": -2, "height": -2, "step": -1}, "found height -2, expected a whole"),
    "wide step": ("image", {"step": 10**30}, "found step 1000000000"),
    "number for bytes": ("image", {"data": 10**9}, "found data 1000000000, expected bytes"),
    "stamp": ("points", {"timestamp": {"sec": 10**320, "nsec": 0}}, "found a stamp of 100000"),
    "surrogate": ("points", {"fields": [X | {"name": "\ud800"}]}, "found the fields ?, expected x, y and z"),
    "no text": ("points", {"frame_id": None}, "found frame_id nothing, expected a string"),
    "many fields": ("points", {"fields": [X] * 200}, "found 200 fields, needed at most 128"),
    "P": ("info", {"P": [1.0, 2.0]}, "/cam/camera_info: found 2 numbers in P, needed 12"),
    "many values": ("info", {"D": [0] * (1 << 20)}, "of JSON with 1,0"),
}  # fmt: skip


@pytest.mark.parametrize("case", HOSTILE_JSON)
def test_json_that_lies_gets_one_line(case: str, tmp_path: Path) -> None:
    topic, changes, expected = HOSTILE_JSON[case]
    maker = {"points": cloud(), "image": image(), "info": info()}[topic]
    path = fill(FoxgloveWriter(tmp_path, "json"), 3, **{topic: in_json(**changes)(maker)})
    assert expected in refused(path, tmp_path / "drive")


def test_the_frame_is_that_of_the_first_message_that_is_whole(tmp_path: Path) -> None:
    def points(bag: Any, index: int, stamp: int) -> Any:
        return in_json(**({} if index else {"fields": 5}))(cloud())(bag, index, stamp)

    found = done(fill(FoxgloveWriter(tmp_path, "json"), 6, points=points), tmp_path / "drive")
    assert found.written.num_frames == 5
    assert [why for why in found.left_out if ", expected a foxglove.PointCloud" in why]


def test_a_schema_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        for topic, name in (("points", "PointCloud"), ("image", "RawImage"), ("info", "CameraCalibration")):
            schema = writer.register_schema(f"foxglove.{name}", "protobuf", b"\xff")
            writer.add_message(writer.register_channel(topic, "protobuf", schema), NS, b"", NS)
        writer.finish()
    assert "found a schema foxglove.CameraCalibration that cannot be read" in refused(
        path, tmp_path / "drive"
    )


def record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


CHANNEL, MESSAGE = record(4, bytes(16)), record(5, bytes(22))
FAULTS = {
    "a message that is too short": record(5, b"abc"),
    "a schema that is too short": record(3, b"a"),
    "a record beyond the chunk": struct.pack("<BQ", 5, 99),
    "too many records": record(200, b"") * (1 << 20),
    "too many channels": CHANNEL * (2 << 16),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_chunk_is_read_as_a_whole_or_left_out(fault: str, tmp_path: Path) -> None:
    def chunk(data: bytes) -> bytes:
        return record(6, struct.pack("<QQQIIQ", 0, 0, len(data), 0, 0, len(data)) + data)

    whole = CHANNEL + MESSAGE
    path = tmp_path / "bag.mcap"
    path.write_bytes(
        b"\x89MCAP0\r\n" + record(1, bytes(8)) + chunk(whole) + chunk(whole + FAULTS[fault]) + chunk(whole)
    )
    with ExitStack() as stack:
        file = McapFile(path, stack)
        assert file.damage == "its index, 1 damaged chunks"
        assert len(list(file.messages(file.topics, 0, 1))) == 2


def test_frames_of_av1_that_are_cut_off_do_not_stop_an_import(tmp_path: Path) -> None:
    images = [np.full((64, 64, 3), 5 * index + 20, np.uint8) for index in range(20)]
    cut = [each[: -3 if index % 3 == 0 else None] for index, each in enumerate(encoded(images, "av1", 5))]
    camera = CAMERA.model_copy(update={"width": 64, "height": 64})
    makers: dict[str, Any] = {
        "info": lambda bag, index, stamp: bag.camera_info(camera, stamp),
        "cam/video": lambda bag, index, stamp: bag.packet(cut[index], "av1", stamp),
    }
    found = done(small(tmp_path, count=20, image=nothing, **makers), tmp_path / "drive")
    assert sum(n for why, n in found.left_out.items() if "video" in why) == 20 - found.written.num_frames > 0


def patched(path: Path, stated: int) -> Path:
    """Let each chunk of an MCAP state another size of what it unpacks to."""
    content = bytearray(path.read_bytes())
    for found in re.finditer(rb"\x04\x00\x00\x00zstd", bytes(content)):
        content[found.start() - 12 : found.start() - 4] = struct.pack("<Q", stated)
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    ("stated", "told"),
    [(1 << 40, "states 1,099,511,627,776 bytes, needed at most"), (10, "more than 10 bytes")],
)
def test_a_chunk_is_unpacked_up_to_what_it_states(stated: int, told: str, tmp_path: Path) -> None:
    whole = fill(BagWriter(tmp_path, "mcap library", "ZSTD"), 30)
    lying = patched(whole, stated)
    assert "/points" in run_cli("import", "bag", lying, "--list").output
    assert told in refused(lying, tmp_path / "drive")


def test_topics_of_a_bag_are_listed_without_unpacking_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = fill(BagWriter(tmp_path, "ros1", "BZ2"), 30)
    unpacked: list[Any] = []
    monkeypatch.setattr("semcal_cli.importing.bags.ros1_file.unpack", lambda *of: unpacked.append(of))
    rows = run_cli("import", "bag", path, "--list").output.splitlines()
    assert [" ".join(row.split()[2:6]) for row in rows if row.startswith("/points")] == [
        "30 10.0 0.000 2.900"
    ]


@pytest.mark.parametrize("compression", ["zstd", "lz4", "bz2"])
def test_what_unpacks_to_more_than_the_limit_is_refused(compression: str) -> None:
    compress = {"zstd": zstandard.compress, "lz4": lz4.frame.compress, "bz2": bz2.compress}[compression]
    packed = compress(bytes(1 << 20))
    assert unpack(compression, packed, 1 << 20) == bytes(1 << 20)
    with pytest.raises(ValueError, match=r"more than 1,048,575 bytes"):
        unpack(compression, packed, (1 << 20) - 1)
    with pytest.raises(ValueError, match="cut off"):
        unpack(compression, packed[:-1], 1 << 20)


def test_a_message_that_unpacks_to_gigabytes_is_left_out(tmp_path: Path) -> None:
    bomb = zstandard.compress(bytes(1 << 30))
    writer = BagWriter(tmp_path, "sqlite3")
    fill(writer, 3, points=lambda bag, index, stamp: bag.write_raw("/points", CLOUD, bomb, stamp + NS // 100))
    assert "unpack to more than 268,435,456 bytes" in refused(writer.path, tmp_path / "drive")
