"""Messages of ROS become sweeps and images: every layout and encoding, and messages that lie."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from bag_imports import (
    COLORS,
    STAMP_S,
    Maker,
    cloud,
    done,
    image,
    imported,
    info,
    nothing,
    refused,
    remarks,
    small,
)
from bags import START_NS, BagWriter, Messages, jpeg, png

from semcal_cli.config.nanoseconds import NS
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.importing.bags.image_messages import ENCODINGS, ImageFile, image_file
from semcal_cli.importing.bags.messages import Message, MessageError, Span, Topic
from semcal_cli.importing.bags.point_messages import read_sweep
from semcal_cli.importing.bags.recorded_frames import WrittenFrame, form_of_open_times
from semcal_cli.importing.recording import SourceFrame
from semcal_cli.observations.reading import read_clouds


def sweep_of(bag: Messages, message: Any, stamp_ns: int = START_NS, rate_hz: int = 0) -> Any:
    raw = bag.raw(message)
    span = Span(rate_hz + 1, 0, NS) if rate_hz else Span()
    topic = Topic("/points", message.__msgtype__, span, is_ros1=bag.is_ros1)
    return read_sweep(Message(topic, stamp_ns, raw), stamp_ns)


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
    bag = Messages(kind)
    found = sweep_of(bag, bag.cloud(records, START_NS))
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
def test_livox_custom_messages(kind: str, package: str) -> None:
    layout = [("offset_time", "u4"), ("x", "f4"), ("y", "f4"), ("z", "f4"), ("reflectivity", "u1"), ("tag", "u1"),
              ("line", "u1")]  # fmt: skip
    records = np.zeros(7, layout)
    for place, (name, _) in enumerate(layout):
        records[name] = np.arange(7) * (place + 1) + 1
    records["offset_time"] = np.arange(7) * 15_000_000
    for frame in ("lidar", "livox_frame", ""):  # the length of the frame's name moves all that follows
        bag = Messages(kind)
        sweep = sweep_of(bag, bag.livox(records, START_NS, package, frame))
        for name, _ in layout:
            np.testing.assert_array_equal(sweep.records[name][0], records[name])
        assert sweep.times.reference == "relative"


SECONDS = np.linspace(0.0, 0.09, 10)


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


@pytest.mark.parametrize(
    ("rate_hz", "seconds", "told"),
    [
        (10, 0.1, "'time', shares of a turn of 0.1 s, are written as 't'"),
        (1, 1.0, None),  # a slow scanner
        (2, None, "'time' span 1 s as seconds, and sweeps are 0.5 s apart: they are written unchanged"),
        (5, None, "'time' span 1 s as seconds, and sweeps are 0.2 s apart: they are written unchanged"),
        (7, None, "'time' span 1 s as seconds, and sweeps are 0.143 s apart: they are written unchanged"),
        (0, None, "'time' span 1 s as seconds: they are written unchanged, without motion"),
    ],
)
def test_times_from_0_to_1(rate_hz: int, seconds: float | None, told: str | None) -> None:
    records = np.ones(11, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("time", "<f4")])
    records["time"] = np.linspace(0.0, 1.0, 11)
    bag = Messages("sqlite3")
    sweep = sweep_of(bag, bag.cloud(records, START_NS), rate_hz=rate_hz)
    assert (told or "") in (sweep.times.remark or "")
    assert (sweep.times.remark is None) == (told is None)
    assert sweep.times.ends_s == pytest.approx((0.0, seconds or 0.0))
    form = form_of_open_times([WrittenFrame(SourceFrame("a", Path("a.pcd")), sweep.times)])
    assert form.time_unit == ("s" if seconds == 1.0 else None)


@pytest.mark.parametrize("rate_hz", [0, 0.3, 1])
def test_nanoseconds_of_a_slow_scanner_are_no_shares(rate_hz: float) -> None:
    records = np.ones(11, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("t", "<u4")])
    records["t"] = np.linspace(0.0, 1e9, 11)
    bag = Messages("sqlite3")
    times = sweep_of(bag, bag.cloud(records, START_NS), rate_hz=rate_hz).times
    assert (times.reference, times.remark) == ("relative", None)
    form = form_of_open_times([WrittenFrame(SourceFrame("a", Path("a.pcd")), times)])
    assert form.time_unit == "ns"


@pytest.mark.parametrize("unit", TIMES)
def test_times_of_points_in_every_unit(unit: str, tmp_path: Path) -> None:
    name, kind, values, expected, is_told = TIMES[unit]
    records = np.ones(10, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), (name, kind)])
    records[name] = values
    bag = Messages("sqlite3")
    sweep = sweep_of(bag, bag.cloud(records, START_NS))
    assert sweep.times.reference == expected
    assert (sweep.times.remark is not None) == is_told
    (tmp_path / "cloud.pcd").write_bytes(sweep.pcd())
    (cloud,) = read_clouds(one_cloud(tmp_path))
    if expected is not None:
        shift = STAMP_S if expected == "absolute" else 0.0
        np.testing.assert_allclose(cloud.time - shift, SECONDS, atol=1e-6)


GREY = COLORS[:, :, 0]


def mosaic(pattern: str) -> np.ndarray:
    """Pixels as a sensor with a Bayer pattern, named by its first two rows, sees `COLORS`."""
    stored = np.empty(GREY.shape, np.uint8)
    for place, color in enumerate(pattern):
        rows, columns = slice(place // 2, None, 2), slice(place % 2, None, 2)
        stored[rows, columns] = COLORS[rows, columns, "bgr".index(color)]
    return stored


def file_of(bag: Messages, message: Any, bayer: Any = None) -> ImageFile:
    topic = Topic("/image", message.__msgtype__, is_ros1=bag.is_ros1)
    return image_file(Message(topic, START_NS, bag.raw(message)), bayer)


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
def test_every_encoding_of_an_image(encoding: str) -> None:
    stored, expected = stored_pixels(encoding)
    orders = ["<", ">"] if stored.dtype.itemsize == 2 else ["<"]
    for order in orders:
        pixels = np.ascontiguousarray(stored).astype(stored.dtype.newbyteorder(order))
        padded = np.pad(pixels.view(np.uint8).reshape(len(pixels), -1), ((0, 0), (0, 6)))
        bag = Messages("sqlite3")
        changes = {"step": padded.shape[1], "data": padded.ravel()}
        message = bag.image(pixels, encoding, START_NS, **changes)
        raw = bag.raw(message)
        file = image_file(Message(Topic("/image", message.__msgtype__), START_NS, raw))
        found = cv2.imdecode(np.frombuffer(file.content, np.uint8), cv2.IMREAD_UNCHANGED)
        if encoding.startswith(("yuv", "uyvy", "yuyv")):
            np.testing.assert_allclose(found, expected, atol=1.01)
        elif encoding.startswith("bayer"):
            for row, column in ((3, 3), (3, 11), (11, 3), (11, 11)):
                np.testing.assert_array_equal(found[row, column], expected[row, column])
        else:
            np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(("encode", "suffix"), [(png, ".png"), (jpeg, ".jpg")])
def test_compressed_images_keep_their_bytes(encode: Any, suffix: str) -> None:
    content = encode(COLORS)
    bag = Messages("ros1")
    message = bag.compressed(content, "bgr8; jpeg compressed bgr8", START_NS)
    raw = bag.raw(message)
    file = image_file(Message(Topic("/image", message.__msgtype__, is_ros1=True), START_NS, raw))
    assert file == (content, suffix, (16, 16))


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_compressed_mosaics_become_colours(pattern: str, bits: int) -> None:
    stored = mosaic(pattern).astype(np.uint16) * 257 if bits == 16 else mosaic(pattern)
    bag = Messages("ros1")
    expected = file_of(bag, bag.image(stored, f"bayer_{pattern}{bits}", START_NS))
    compressed = bag.compressed(png(stored), f"bayer_{pattern}{bits}; png compressed ", START_NS)
    assert file_of(bag, compressed) == expected
    # --bayer takes precedence, and serves messages that state no pattern.
    wrong = "bayer_rggb8" if pattern != "rggb" else "bayer_bggr8"
    for message in (
        bag.compressed(png(stored), "png", START_NS),
        bag.compressed(png(stored), f"{wrong}; png compressed ", START_NS),
        bag.image(stored, f"mono{bits}", START_NS),
    ):
        assert file_of(bag, message, pattern) == expected


def test_mosaics_in_jpeg_become_colours_and_colours_keep_their_bytes() -> None:
    stored, colored = mosaic("grbg"), jpeg(COLORS)
    bag = Messages("ros1")
    for content in (jpeg(stored), jpeg(np.dstack([stored] * 3))):
        file = file_of(bag, bag.compressed(content, "bayer_grbg8; jpeg compressed ", START_NS))
        decoded = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE)
        found = cv2.imdecode(np.frombuffer(file.content, np.uint8), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(found, cv2.cvtColor(decoded, cv2.COLOR_BayerGRBG2BGR))
    message = bag.compressed(colored, "bayer_grbg8; jpeg compressed bgr8", START_NS)
    assert file_of(bag, message).content == colored
    for of_colors in (message, bag.image(COLORS, "bgr8", START_NS)):
        with pytest.raises(
            MessageError, match="found a colour image, expected a grey one: --bayer rggb states"
        ):
            file_of(bag, of_colors, "rggb")


def test_a_mosaic_that_no_message_states_is_noticed(tmp_path: Path) -> None:
    path = small(tmp_path, image=lambda bag, index, stamp: bag.image(mosaic("rggb"), "mono8", stamp))
    assert "/cam/image_raw looks like the mosaic of a Bayer camera" in remarks(path, tmp_path / "grey")
    assert "mosaic" not in remarks(path, tmp_path / "colours", bayer="rggb")


def test_points_without_a_range_have_no_times() -> None:
    records = np.ones(10, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("timestamp", "<f8")])
    records["timestamp"] = SECONDS + STAMP_S
    records["x"][4], records["timestamp"][4] = np.nan, 0.0
    bag = Messages("sqlite3")
    sweep = sweep_of(bag, bag.cloud(records, START_NS))
    assert sweep.times.reference == "absolute"
    assert sweep.times.ends_s == pytest.approx((0.0, 0.09), abs=1e-6)


def compressed(content: bytes) -> Maker:
    return lambda bag, index, stamp: bag.compressed(content, "jpeg", stamp)


def test_of_one_camera_s_encodings_the_raw_one_is_taken(tmp_path: Path) -> None:
    again = {"cam/image_raw/compressed": compressed(cv2.imencode(".jpg", COLORS)[1].tobytes())}
    path = small(tmp_path, **again)
    told = (
        "/cam/image_raw/compressed is not used: it holds the messages of /cam/image_raw in another encoding"
    )
    assert told in remarks(path, tmp_path / "raw")
    named = remarks(path, tmp_path / "named", image="/cam/image_raw/compressed")
    assert "is not used" not in named
    suffixes = [
        {Path(str(frame.image)).suffix for frame in read_drive(tmp_path / name).frames}
        for name in ("raw", "named")
    ]
    assert suffixes == [{".png"}, {".jpg"}]
    below = small(tmp_path / "below", **{"cam": image(), "points/front": cloud()})
    assert "found 2 topics of" in refused(below, tmp_path / "none")  # another camera, and another LiDAR
    two = small(tmp_path / "two", **again, **{"other/image_raw": image()})
    found = "found 1 topic of sweeps and 2 topics of images, expected one pair: --image /cam/image_raw,"
    assert f"{found} --image /other/image_raw" in refused(two, tmp_path / "none")


LIES: dict[str, tuple[dict[str, Maker], str]] = {
    "point_step": ({"points": cloud(point_step=14)}, "up to byte 16, beyond point_step 14"),
    "point_step huge": ({"points": cloud(point_step=1 << 30)}, "point_step 1,073,741,824"),
    "row_step": ({"points": cloud(row_step=3, height=2, width=10)}, "found row_step 3, needed 160"),
    "points": ({"points": cloud(data=np.zeros(5, np.uint8))}, "found 5 bytes of points, needed 320"),
    "many points": ({"points": cloud(width=4_000_000_000)}, "found 4,000,000,000 points"),
    "no points": ({"points": cloud(width=0)}, "found a cloud without points"),
    "no fields": ({"points": cloud(fields=[])}, "found the fields none, expected x, y and z"),
    "no pixels": ({"image": image(data=[])}, "found 0 bytes of pixels, needed 768"),
    "step": ({"image": image(step=7)}, "found step 7, needed 48"),
    "size": ({"image": image(width=0)}, "found an image of 0 x 16 pixels"),
    "huge": ({"image": image(width=1 << 31, height=1 << 31)}, "needed at most 100,000,000"),
    "encoding": ({"image": image("32FC1")}, "found encoding '32FC1', expected one of: mono8"),
    "other size": ({"image": image(width=8, step=24)}, "found an image of 8 x 16 pixels, needed 16 x 16"),
    "empty": ({"image": compressed(b"")}, "found 0 bytes of"),
    "other format": ({"image": compressed(b"RIFF1234WEBP")}, "found 12 bytes of"),
    "JPEG": ({"image": compressed(b"\xff\xd8\xff\xe0")}, "found 4 bytes of"),
    "PNG": ({"image": compressed(b"\x89PNG\r\n\x1a\n")}, "found 8 bytes of"),
    "K": ({"info": info(K=np.zeros(9))}, "/cam/camera_info: K: found zeros only, expected a calibrated camera"),
    "lens": ({"info": info(distortion_model="odd")},
             "/cam/camera_info: distortion_model: found 'odd', expected one of: plumb_bob"),
    "no camera": ({"info": nothing}, "found no topic of intrinsics (CameraInfo), only"),
    "no images": ({"image": nothing}, "found no topic of images (Image, CompressedImage, video), only"),
    "two sweeps": ({"rear": cloud()}, "found 2 topics of sweeps and 1 topic of images, expected one pair: "
                   "--points /points, --points /rear"),
}  # fmt: skip


@pytest.mark.parametrize("lie", LIES)
def test_a_recording_that_lies_gets_one_line(lie: str, tmp_path: Path) -> None:
    changes, expected = LIES[lie]
    assert expected in refused(small(tmp_path, **changes), tmp_path / "drive")


def test_one_bad_message_is_left_out_and_counted(tmp_path: Path) -> None:
    def points(bag: BagWriter, index: int, stamp: int) -> Any:
        return cloud(**({"point_step": 3} if index == 2 else {}))(bag, index, stamp)

    found = done(small(tmp_path, points=points), tmp_path / "drive")
    assert found.written.num_frames == 5
    assert found.left_out.total() == 1


def test_what_is_asked_for_counts(tmp_path: Path) -> None:
    path = small(tmp_path, info=nothing, rear=cloud())
    file = tmp_path / "info.yaml"
    file.write_text(
        "{image_width: 16, image_height: 16, distortion_model: plumb_bob, distortion_coefficients: [],"
        " camera_matrix: [9, 0, 8, 0, 9, 8, 0, 0, 1]}"
    )
    document = imported(path, tmp_path / "drive", intrinsics=file, points="/rear")
    assert document["camera"]["width"] == 16
    assert len(document["frames"]) == 6
    assert "found no topic '/front' of sweeps" in refused(path, tmp_path / "x", points="/front")


def test_messages_too_short_for_a_header() -> None:
    for raw in (b"", b"\0", b"\0\1\0\0\0\0"):
        message = Message(Topic("/x", "sensor_msgs/msg/PointCloud2"), 1, raw)
        for read in (
            lambda message: message.header_ns,
            lambda message: message.frame_id,
            lambda message: message.content,
            lambda m: read_sweep(m, 1),
        ):
            with pytest.raises(MessageError):
                read(message)
