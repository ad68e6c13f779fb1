"""Names of the frames: those of a recording are kept, and files for a robot get them."""

import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bag_imports import T_MOUNT, Maker, cloud, image, imported, info, small
from commands import invoke
from conftest import make_pose

from semcal_cli.drive.document import read_drive
from semcal_cli.drive.frame_ids import FrameIds
from semcal_cli.errors import InputError
from semcal_cli.files.validation import validate
from semcal_cli.formats import read_transform, set_in_file
from semcal_cli.formats.format import FormatOptions
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import pose_from_quaternion
from semcal_cli.importing.bags.transforms import FrameTree, optical_frame
from semcal_cli.result.calibration_document import read_calibration

DOCUMENTS = Path(__file__).parent / "documents"
NAMES = FrameIds(lidar="os_sensor", camera="front_optical")
T_ANY = make_pose((0.1, -0.2, 0.3), (0.4, 0.5, -0.6))
OF_FRAMES = ("ros2-static-transform", "ros2-launch", "tf2", "urdf")


def frames(edges: dict[tuple[str, str], Pose]) -> Maker:
    return lambda bag, index, stamp: bag.transforms(edges) if index == 0 else None


def recorded(folder: Path, lidar: str = "/os_sensor", camera: str = "front_optical", **makers: Any) -> Any:
    """Import a small recording with these frames, and return what the drive says of them."""
    makers = {"points": cloud(frame=lidar), "image": image(frame=camera)} | makers
    return imported(small(folder, **makers), folder / "drive").get("frame_ids")


def with_names(folder: Path, names: FrameIds = NAMES) -> Path:
    """Write a calibration whose drive had these names."""
    document = yaml.safe_load((DOCUMENTS / "semcal_calibration-1/calibration.yaml").read_text())
    document["input"]["frame_ids"] = names.model_dump()
    (folder / "calibration.yaml").write_text(yaml.safe_dump(document))
    return folder / "calibration.yaml"


def words(text: str) -> set[str]:
    return {*re.findall(r"\w+", text)}


def test_an_import_keeps_the_names_of_a_recording(tmp_path: Path) -> None:
    static = frames({("os_sensor", "front_optical"): T_MOUNT})
    assert recorded(tmp_path / "a", tf_static=static) == NAMES.model_dump()
    assert recorded(tmp_path / "b", "", "front_optical") == {"camera": "front_optical"}
    assert recorded(tmp_path / "c", "map", "map") == {"lidar": "map"}
    assert recorded(tmp_path / "d", "l\ns", "x" * 201) is None


@pytest.mark.parametrize(
    ("changes", "kept"),
    [
        ({}, "front"),
        ({"R": np.diag([-1.0, -1.0, 1.0]).ravel()}, None),
        ({"P": [9.0, 0, 8, -3.0, 0, 9, 8, 0, 0, 0, 1, 0]}, None),
    ],
    ids=["as it is", "turned", "of a pair"],
)
def test_rectified_images_of_other_axes_have_no_frame(changes: Any, kept: str | None, tmp_path: Path) -> None:
    rectified = {"image": lambda *_: None, "cam/image_rect": image(frame="front"), "info": info(**changes)}
    assert recorded(tmp_path, "os", **rectified) == {"lidar": "os"} | ({"camera": kept} if kept else {})


@pytest.mark.parametrize(
    ("axes", "name", "kept"),
    [
        (None, "camera_link", False),
        ("body", "camera_link", False),
        ("optical", "camera_link", True),
        (None, "camera_optical", True),
    ],
)
def test_a_body_frame_is_not_taken_for_an_optical_one(axes: Any, name: str, kept: bool) -> None:
    tree = FrameTree()
    tree.add(("lidar", name), pose_from_quaternion([0, 0, 0, 1], [0.5, 0.0, -0.2]))
    assert optical_frame(tree, "lidar", name, None, axes) == (name if kept else None)


@pytest.mark.parametrize("format", OF_FRAMES)
def test_files_for_a_robot_have_the_names_there_and_back(format: str, tmp_path: Path) -> None:
    calibration = with_names(tmp_path)
    done = invoke("convert", calibration, "--to", format, "-o", tmp_path / "T")
    assert done.exit_code == 0, done.output
    text = (tmp_path / "T").read_text()
    assert {"os_sensor", "front_optical"} <= words(text)
    np.testing.assert_allclose(read_transform(tmp_path / "T"), read_transform(calibration), atol=1e-8)
    own = invoke(
        "convert", calibration, "--to", format, "--to-lidar", "velodyne", "--to-camera", "cam_optical"
    )
    assert {"velodyne", "cam_optical"} <= words(own.stdout)
    assert not {"os_sensor", "front_optical"} & words(own.stdout)


def test_a_body_frame_does_not_get_the_name_of_the_optical_one(tmp_path: Path) -> None:
    body = invoke("convert", with_names(tmp_path), "--to", "tf2", "--to-frame", "body").stdout
    assert {"os_sensor", "camera_link"} <= words(body)
    assert "front_optical" not in body


def test_a_drive_and_what_is_made_of_it_keep_the_names(street: Path, tmp_path: Path) -> None:
    drive = shutil.copytree(street, tmp_path / "drive") / "drive.yaml"
    document = yaml.safe_load(drive.read_text())
    drive.write_text(yaml.safe_dump(document | {"frame_ids": {"lidar": "os_sensor"}}))
    assert "os_sensor" in invoke("convert", drive, "--to", "urdf").stdout
    invoke("merge", drive, "-o", tmp_path / "merged")
    assert read_drive(tmp_path / "merged").frame_ids == FrameIds(lidar="os_sensor")
    start = ("--init", drive, "-q")
    invoke("calibrate", drive, *start, "--to", "tf2", "-o", tmp_path / "T.yaml")
    assert "os_sensor" in (tmp_path / "T.yaml").read_text()
    invoke("refine", drive, *start, "-o", tmp_path / "c.yaml")
    assert read_calibration(tmp_path / "c.yaml").input.frame_ids == FrameIds(lidar="os_sensor")


ROBOT = """<robot>
  <joint name="a" type="fixed"><parent link="base"/><child link="os_sensor"/><origin xyz="0 0 1"/></joint>
  <joint name="b" type="fixed"><parent link="base"/><child link="front"/><origin xyz="1 0 0" rpy="0 0 0"/></joint>
  <joint name="c" type="fixed"><parent link="base"/><child link="rear_camera"/><origin xyz="1 0 0"/></joint>
</robot>
"""


def test_a_robot_is_edited_between_the_frames_of_the_recording(tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_text(ROBOT)
    calibration = with_names(tmp_path, FrameIds(lidar="os_sensor", camera="front"))
    set_in_file(calibration, tmp_path / "robot.urdf", tmp_path / "new.urdf", key="b")
    options = FormatOptions(camera="front", frame="optical", lidar="os_sensor")
    expected = read_transform(calibration)
    np.testing.assert_allclose(read_transform(tmp_path / "new.urdf", None, options), expected, atol=1e-7)
    other = replace(options, camera="rear_camera")
    set_in_file(calibration, tmp_path / "robot.urdf", tmp_path / "c.urdf", key="c", write_options=other)
    np.testing.assert_allclose(read_transform(tmp_path / "c.urdf", None, other), expected, atol=1e-7)


def test_the_publisher_between_the_frames_of_the_recording_is_set(tmp_path: Path) -> None:
    line = "ros2 run tf2_ros static_transform_publisher 0 0 0 0 0 0 {}\n"
    pairs = "os_sensor front_optical", "os_sensor rear_camera_optical"
    (tmp_path / "tf.sh").write_text("".join(map(line.format, pairs)))
    set_in_file(with_names(tmp_path), tmp_path / "tf.sh", tmp_path / "new.sh")
    new = (tmp_path / "new.sh").read_text().splitlines(keepends=True)
    assert [text == line.format(pair) for text, pair in zip(new, pairs, strict=True)] == [False, True]


@pytest.mark.parametrize(
    ("frame_ids", "complaint"),
    [
        ({"lidar": "os", "camera": "os"}, "found 'os' for both, expected two names"),
        ({"lidar": ""}, "lidar: found '', expected a name of at most 200 printable characters"),
        ({"camera": "a\nb"}, "camera: found 'a\\nb', expected a name of"),
        (
            {"camera": " a"},
            "camera: found ' a', expected a name of at most 200 printable characters, without spaces",
        ),
        ({"lidar": "$(eval 1)"}, "drive.yaml: lidar: found '$(eval 1)', expected a name of"),
        ({"camera": "--x"}, "camera: found '--x', expected a name of"),
        ({"lidar": "x" * 201}, "expected a name of"),
    ],
)
def test_names_that_are_none_are_refused(frame_ids: Any, complaint: str) -> None:
    with pytest.raises(InputError) as refused:
        validate(FrameIds, frame_ids, Path("drive.yaml"))
    assert complaint in str(refused.value)


def test_a_name_that_a_launch_file_computes_is_not_written(tmp_path: Path) -> None:
    makers = {"points": cloud(frame="$(env HOME)"), "image": image(frame="-x")}
    done = invoke("import", "bag", small(tmp_path / "bag", **makers), "-o", tmp_path / "drive")
    assert done.exit_code == 0, done.output
    assert "frame_ids" not in yaml.safe_load((tmp_path / "drive" / "drive.yaml").read_text())
    said = " ".join(done.output.split())
    assert "the frame of the lidar is left out of frame_ids: found '$(env HOME)', expected a name" in said
    assert "the frame of the camera is left out of frame_ids: found '-x'" in said
    for name in ("$(var x)", "-x"):
        refused = invoke("convert", with_names(tmp_path), "--to", "ros2-launch", f"--to-camera={name}")
        assert str(refused.exception).startswith(
            f"--to-camera, --to-lidar, --base-frame: found {name!r}, expected a name"
        )


def test_a_name_of_the_user_is_not_paired_with_a_recorded_one_of_another_publisher(tmp_path: Path) -> None:
    node = '<node pkg="tf2_ros" exec="static_transform_publisher" args="0 0 0 0 0 0 {}"/>\n'
    pairs = "lidar2 cam_x_optical", "os_sensor cam_y_optical"
    launch = tmp_path / "two.launch.xml"
    launch.write_text(f"<launch>\n{''.join(map(node.format, pairs))}</launch>\n")
    options = FormatOptions(camera="cam_x_optical")
    set_in_file(with_names(tmp_path), launch, tmp_path / "new.launch.xml", write_options=options)
    lines = (tmp_path / "new.launch.xml").read_text().splitlines(keepends=True)[1:3]
    assert [line == node.format(pair) for line, pair in zip(lines, pairs, strict=True)] == [False, True]
