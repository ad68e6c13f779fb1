"""`semcal export mcap`: read by the definitions in the file, as a viewer does, and imported again."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from bag_imports import run_cli
from conftest import edited
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.files.image_files import read_image
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.reading import read_clouds

SAME = 1e-6
"""Largest difference of a transform after its quaternion was written and read."""


def messages(path: Path) -> list[tuple[str, Any, int]]:
    """Read topic, message and time of all messages, by the definitions of types that the file itself holds."""
    store, found = get_typestore(Stores.EMPTY), []
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            if schema.name not in store.fielddefs:
                store.register(get_types_from_msg(schema.data.decode(), schema.name))
            found.append((channel.topic, store.deserialize_cdr(message.data, schema.name), message.log_time))
    return found


def seconds(header: Any) -> float:
    return float(header.stamp.sec + 1e-9 * header.stamp.nanosec)


@pytest.fixture
def given(street_truth: Pose, tmp_path: Path) -> tuple[Path, Pose]:
    """A file of a transform that is not the drive's own."""
    T = displace(street_truth, 1.0, 0.05, np.random.default_rng(1))
    path = tmp_path / "T.yaml"
    path.write_text(f"semcal_transform: 1\nT_camera_lidar: {T.tolist()}\n")
    return path, T


def test_a_viewer_projects_the_points_as_semcal_does(
    street: Path, given: tuple[Path, Pose], tmp_path: Path
) -> None:
    path, T = given
    run_cli("export", "mcap", street, path, "-o", tmp_path / "out.mcap")
    drive, by_topic = read_drive(street), dict[str, list[Any]]()
    for topic, message, _ in messages(tmp_path / "out.mcap"):
        by_topic.setdefault(topic, []).append(message)
    (tf,) = by_topic["/tf_static"]
    (edge,) = tf.transforms
    T_parent_child = np.eye(4)
    rotation, translation = edge.transform.rotation, edge.transform.translation
    T_parent_child[:3, :3] = Rotation.from_quat([rotation.x, rotation.y, rotation.z, rotation.w]).as_matrix()
    T_parent_child[:3, 3] = translation.x, translation.y, translation.z
    np.testing.assert_allclose(T_parent_child, inverse(T), atol=1e-12)
    topics = (by_topic[f"/camera/{name}"] for name in ("camera_info", "image_raw/compressed"))
    frames = zip(drive.frames, read_clouds(drive), by_topic["/points"], *topics, strict=True)
    for frame, cloud, points, info, image in frames:
        assert (points.header.frame_id, edge.header.frame_id) == ("lidar", "lidar")
        assert {image.header.frame_id, info.header.frame_id} == {edge.child_frame_id}
        assert image.header == info.header
        columns = [(field.name, {7: "<f4", 8: "<f8"}[field.datatype]) for field in points.fields]
        records = np.frombuffer(points.data.tobytes(), np.dtype(columns))
        assert points.row_step == len(points.data) == points.width * points.point_step
        np.testing.assert_array_equal(np.stack([records[axis] for axis in "xyz"], axis=1), cloud.points)
        np.testing.assert_array_equal(records["intensity"], cloud.intensity)
        np.testing.assert_array_equal(info.k.reshape(3, 3), drive.camera.K)
        np.testing.assert_array_equal(info.p.reshape(3, 4)[:, :3], drive.camera.K)
        assert (info.width, info.height) == drive.camera.size
        pixels = cv2.imdecode(image.data, cv2.IMREAD_COLOR)
        np.testing.assert_array_equal(pixels, read_image(drive.resolve(frame.image or "")))


def stamped(street: Path, folder: Path) -> Drive:
    """Copy a drive, and give its sweeps and images times, the last frame first, 20 ms apart; and a BMP."""
    shutil.copytree(street, folder)
    with edited(folder) as document:
        for index, frame in enumerate(document["frames"]):
            frame["points_stamp"] = 1.6e9 + 10.0 - index
            frame["image_stamp"] = frame["points_stamp"] + 0.02
        first = document["frames"][0]
        pixels = cv2.imread(str(folder / first["image"]))
        first["image"] = "first.bmp"
        cv2.imwrite(str(folder / "first.bmp"), pixels)
    return read_drive(folder)


def test_an_import_makes_the_same_drive(street: Path, given: tuple[Path, Pose], tmp_path: Path) -> None:
    """The transform, the camera, the points, the pixels and the times."""
    path, T = given
    drive = stamped(street, tmp_path / "drive")
    out, again = tmp_path / "out.mcap", tmp_path / "again"
    done = run_cli("export", "mcap", drive.path, path, "-o", out)
    assert done.stderr.split() == ["wrote", f"{out}:", str(len(drive.frames)), "frames"]
    times = [time for _, _, time in messages(out)]
    assert times == sorted(times)
    run_cli("import", "bag", out, "-o", again)
    imported = read_drive(again)
    np.testing.assert_allclose(np.array(imported.T_camera_lidar), T, atol=SAME)
    assert imported.camera.K == drive.camera.K
    frames = [*zip(drive.frames, read_clouds(drive), strict=True)][::-1]
    for (frame, cloud), other, other_cloud in zip(
        frames, imported.frames, read_clouds(imported), strict=True
    ):
        assert other.points_stamp == pytest.approx(frame.points_stamp, abs=1e-6)
        assert other.image_stamp == pytest.approx(frame.image_stamp, abs=1e-6)
        np.testing.assert_array_equal(other_cloud.points, cloud.points)
        images = (of.resolve(file.image or "") for of, file in ((drive, frame), (imported, other)))
        np.testing.assert_array_equal(*map(read_image, images))


def test_times_may_begin_at_zero(street: Path, given: tuple[Path, Pose], tmp_path: Path) -> None:
    shutil.copytree(street, tmp_path / "drive")
    with edited(tmp_path / "drive") as document:
        for index, frame in enumerate(document["frames"]):
            frame["points_stamp"] = frame["image_stamp"] = 0.1 * index
    drive, out, again = read_drive(tmp_path / "drive"), tmp_path / "out.mcap", tmp_path / "again"
    assert "note" not in run_cli("export", "mcap", drive.path, given[0], "-o", out).stderr
    run_cli("import", "bag", out, "-o", again)
    assert [frame.points_stamp for frame in read_drive(again).frames] == pytest.approx(
        [frame.points_stamp for frame in drive.frames], abs=1e-6
    )


def test_without_times_frames_are_a_second_apart(
    street: Path, given: tuple[Path, Pose], tmp_path: Path
) -> None:
    shutil.copytree(street, tmp_path / "drive")
    with edited(tmp_path / "drive") as document:
        for frame in document["frames"]:
            frame.pop("points_stamp", None)
    done = run_cli(
        "export", "mcap", tmp_path / "drive", given[0], "-o", tmp_path / "o.mcap", "--max-frames", "3"
    )
    assert "note: the drive states no times of all sweeps and images: frames are a second" in done.stderr
    points = [message for topic, message, _ in messages(tmp_path / "o.mcap") if topic == "/points"]
    assert [seconds(message.header) for message in points] == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("change", "name", "message"),
    [
        (
            lambda document: document["frames"][1].pop("image"),
            "o.mcap",
            "image: found nothing, expected an image",
        ),
        (
            lambda document: document["camera"].update(model="fov", distortion=[0.5]),
            "o.mcap",
            "semcal export mcap: found the lens fov, expected one of: plumb_bob",
        ),
        (lambda document: None, "o.bag", "found suffix '.bag', expected .mcap"),
    ],
)
def test_what_cannot_be_written_is_told(
    street: Path, given: tuple[Path, Pose], tmp_path: Path, change: Any, name: str, message: str
) -> None:
    shutil.copytree(street, tmp_path / "drive")
    with edited(tmp_path / "drive") as document:
        change(document)
    done = run_cli("export", "mcap", tmp_path / "drive", given[0], "-o", tmp_path / name, code=1)
    assert message in str(done.exception)
    assert not (tmp_path / name).exists()
