"""`semcal export nerfstudio` and `export colmap`, by the published conventions, and by COLMAP's own reader."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from commands import invoke
from conftest import edited, make_pose

from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.files.documents import document_text, read_document
from semcal_cli.formats import read_transform
from semcal_cli.formats.colmap import RigCamera, rig_config
from semcal_cli.formats.format import FormatOptions
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse, pose_from_quaternion, quaternion_xyzw

HALF_PX = 0.5
"""What is added to the pixels of semcal, where the centre of the first is (0, 0)."""
POSE_TOLERANCE = 2e-6
"""Metres: poses on the way are interpolated with 32 bits."""
T_FRONT, T_LEFT = make_pose((0.1, 1.2, -0.3), (0.2, -0.1, 0.4)), make_pose((-0.4, 2.1, 0.2), (0.5, 0.3, -0.2))
K = [[500.0, 0.0, 320.0], [0.0, 510.0, 240.0], [0.0, 0.0, 1.0]]


def camera_of(model: str, distortion: list[float]) -> Camera:
    return Camera.model_validate(
        {"model": model, "width": 640, "height": 480, "K": K, "distortion": distortion}
    )


@pytest.fixture
def moving(street: Path, tmp_path: Path) -> tuple[Path, list[Pose]]:
    """The drive on a turning way, with the pose of the LiDAR at each image."""
    folder = tmp_path / "moving"
    shutil.copytree(street, folder)
    poses, lines = [], []
    with edited(folder) as document:
        for number in range(-1, len(document["frames"]) + 1):
            T = make_pose((0.01 * number, 0.02, 0.2 * number), (5.0 + 2.0 * number, 1.0, 0.1 * number**2))
            numbers = [float(number), *T[:3, 3], *quaternion_xyzw(T)]
            lines.append(" ".join(map(repr, map(float, numbers))))
            poses.append(T)
        for number, frame in enumerate(document["frames"]):
            frame["image_stamp"] = frame["points_stamp"] = float(number)
        document["motion"] = {"poses": "poses.txt"}
    (folder / "poses.txt").write_text("\n".join(lines) + "\n")
    return folder, poses[1:-1]


def export(*arguments: object) -> Result:
    return invoke("export", *arguments)


def test_nerfstudio_projects_a_point_as_semcal_does(
    moving: tuple[Path, list[Pose]], street_truth: Pose, tmp_path: Path
) -> None:
    """A ray of nerfstudio through (u, v) of a pixel's centre has ((u - cx) / fl_x, -(v - cy) / fl_y, -1)."""
    folder, poses = moving
    (tmp_path / "out").mkdir()
    done = export("nerfstudio", folder, folder, "-o", tmp_path / "out/transforms.json")
    assert done.exit_code == 0, done.exception
    written = json.loads((tmp_path / "out/transforms.json").read_text())
    drive = read_drive(folder)
    assert (written["camera_model"], written["w"], written["h"]) == ("OPENCV", 640, 360)
    assert len(written["frames"]) == len(poses)
    for frame, stated, T_fixed_lidar in zip(drive.frames, written["frames"], poses, strict=True):
        assert (tmp_path / "out" / stated["file_path"]).resolve() == drive.resolve(
            frame.image or ""
        ).resolve()
        T_world_opengl = np.array(stated["transform_matrix"])
        T_camera_world = street_truth @ inverse(T_fixed_lidar) @ poses[0]
        point_camera = np.array([0.7, -0.4, 6.0, 1.0])
        point_opengl = inverse(T_world_opengl) @ inverse(T_camera_world) @ point_camera
        np.testing.assert_allclose(point_opengl, point_camera * [1.0, -1.0, -1.0, 1.0], atol=POSE_TOLERANCE)
        x, y, z, _ = point_opengl
        ((u, v),) = core_camera(drive.camera).project(point_camera[None, :3])
        assert written["cx"] + written["fl_x"] * x / -z == pytest.approx(u + HALF_PX, abs=1e-3)
        assert written["cy"] - written["fl_y"] * y / -z == pytest.approx(v + HALF_PX, abs=1e-3)


def test_images_below_a_linked_folder_are_found(moving: tuple[Path, list[Pose]], tmp_path: Path) -> None:
    folder, _ = moving
    (tmp_path / "far/away").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "far/away")
    assert export("nerfstudio", folder, folder, "-o", tmp_path / "link/transforms.json").exit_code == 0
    first = json.loads((tmp_path / "link/transforms.json").read_text())["frames"][0]["file_path"]
    assert (tmp_path / "link" / first).is_file()


@pytest.mark.parametrize("program", ["nerfstudio", "colmap"])
@pytest.mark.parametrize("name", ["image.png", "-"])
def test_only_a_json_file_is_written(
    program: str, name: str, street: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("image.png").write_bytes(b"kept")
    done = export(program, street, street, "-o", name)
    assert str(done.exception) == f"{name}: found suffix {Path(name).suffix!r}, expected .json"
    assert Path("image.png").read_bytes() == b"kept"


@pytest.mark.parametrize("program", ["nerfstudio", "mcap"])
def test_a_transform_that_is_not_trusted_is_named(
    program: str, rig: Path, rig_results: tuple[Result, Path], tmp_path: Path
) -> None:
    if program == "mcap":
        pytest.importorskip("rosbags")
    doubted = tmp_path / "camera_0.yaml"
    shutil.copy(rig_results[1] / "camera_0.yaml", doubted)
    document = read_document(doubted)
    document |= {"status": "not_trusted", "reasons": ["a reason"], "topics": ["few-scenes"]}
    doubted.write_text(document_text(document, "yaml"))
    out = tmp_path / ("out.mcap" if program == "mcap" else "transforms.json")
    done = export(program, rig.parent / "camera_0", doubted, "-o", out, "--max-frames", 1)
    assert done.exit_code == 0, done.exception
    assert f"{doubted}: the transform is not trusted; see its reasons" in done.stderr.splitlines()


def test_what_nerfstudio_cannot_hold(moving: tuple[Path, list[Pose]], street: Path, tmp_path: Path) -> None:
    folder, _ = moving
    out = tmp_path / "transforms.json"
    still = export("nerfstudio", street, street, "-o", out)
    assert "motion.poses: found nothing, expected the poses of the LiDAR for several frames" in str(
        still.exception
    )
    assert export("nerfstudio", street, street, "-o", out, "--max-frames", 1).exit_code == 0
    (folder / "poses.txt").write_text(
        (folder / "poses.txt").read_text().splitlines()[0] + "\n0.5 0 0 0 0 0 0 1\n"
    )
    short = export("nerfstudio", folder, folder, "-o", out)
    assert "poses.txt: found no pose, expected some before and after" in str(short.exception)
    with edited(folder) as document:
        document["camera"] |= {"model": "fov", "distortion": [0.5]}
    lens = export("nerfstudio", folder, folder, "-o", out)
    assert str(lens.exception).endswith(
        "found the lens fov, expected one of: plumb_bob, fisheye; undistort the images first"
    )


def test_the_rig_has_the_frame_of_its_reference(tmp_path: Path) -> None:
    pinhole = camera_of("plumb_bob", [])
    cameras = {"front": RigCamera(T_FRONT, pinhole), "left": RigCamera(T_LEFT, pinhole)}
    (rig,) = json.loads(rig_config(cameras, "left"))
    left, front = rig["cameras"]
    assert (left["image_prefix"], left["ref_sensor"], "ref_sensor" in front) == ("left/", True, False)
    w, *xyz = front["cam_from_rig_rotation"]
    T_front_left = pose_from_quaternion([*xyz, w], front["cam_from_rig_translation"])
    np.testing.assert_allclose(T_front_left @ T_LEFT, T_FRONT, atol=1e-8)
    file = tmp_path / "rig_config.json"
    file.write_text(json.dumps([rig]))
    for name, T in (("front/", T_FRONT), ("left/", T_LEFT)):
        np.testing.assert_allclose(read_transform(file, None, FormatOptions(camera=name)), T, atol=1e-8)


LENSES: dict[str, tuple[str, list[float]]] = {
    "PINHOLE": ("plumb_bob", []),
    "OPENCV": ("plumb_bob", [-0.2, 0.05, 1e-3, -2e-3]),
    "FULL_OPENCV": ("plumb_bob", [-0.2, 0.05, 1e-3, -2e-3, 0.01]),
    "FULL_OPENCV of eight": ("rational_polynomial", [0.3, -0.1, 1e-3, -2e-3, 0.02, 0.6, -0.05, 0.01]),
    "OPENCV_FISHEYE": ("fisheye", []),
    "OPENCV_FISHEYE of four": ("fisheye", [0.01, -0.02, 3e-3, -1e-3]),
    "FOV": ("fov", [0.8]),
}


@pytest.mark.parametrize("name", LENSES)
def test_colmap_projects_as_semcal_does(name: str, tmp_path: Path, rng: np.random.Generator) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    camera = camera_of(*LENSES[name])
    file = tmp_path / "rig_config.json"
    file.write_bytes(rig_config({"a": RigCamera(T_FRONT, camera), "b": RigCamera(T_LEFT, camera)}, "a"))
    ((first, second),) = [config.cameras for config in pycolmap.read_rig_config(file)]
    assert (first.image_prefix, first.ref_sensor, second.ref_sensor) == ("a/", True, False)
    assert second.camera.model.name == name.partition(" ")[0]
    np.testing.assert_allclose(second.cam_from_rig.matrix(), (T_LEFT @ inverse(T_FRONT))[:3], atol=1e-8)
    points = np.column_stack([rng.uniform(-0.4, 0.4, (20, 2)), np.ones(20)])
    pixels = core_camera(camera).project(points)
    np.testing.assert_allclose(second.camera.img_from_cam(points), pixels + HALF_PX, atol=1e-6)


def test_the_command_writes_the_rig(rig: Path, rig_results: tuple[Result, Path], tmp_path: Path) -> None:
    _, results = rig_results
    out = tmp_path / "rig_config.json"
    done = export("colmap", rig, results, "-o", out, "--reference", "camera_1")
    assert done.exit_code == 0, done.exception
    assert "2 cameras, in the frame of camera_1" in done.stderr
    names = [camera["image_prefix"] for camera in json.loads(out.read_text())[0]["cameras"]]
    assert names == ["camera_1/", "camera_0/"]
    wrong = export("colmap", rig, results, "-o", out, "--reference", "camera_2")
    assert "--reference: found 'camera_2', expected" in str(wrong.exception)
    alone = export("colmap", rig.parent / "camera_0", results, "-o", out)
    assert "found a drive, expected a rig.yaml" in str(alone.exception)


def test_a_rig_without_a_transform_is_refused(
    rig: Path, rig_results: tuple[Result, Path], tmp_path: Path
) -> None:
    results = shutil.copytree(rig_results[1], tmp_path / "results")
    file = results / "rig_calibration.yaml"
    document = read_document(file)
    for camera in document["cameras"]:
        document["cameras"][camera] = {"status": "failed", "reasons": ["no image"]}
    file.write_text(document_text(document, "yaml"))
    done = export("colmap", rig, results, "-o", tmp_path / "rig_config.json")
    assert str(done.exception) == (
        f"{results}: found no camera with a transform; camera_0: left out, no image"
    )


def test_a_pose_in_the_frame_of_a_camera_is_not_that_in_the_lidar(tmp_path: Path) -> None:
    cameras = {name: RigCamera(T, camera_of("plumb_bob", [])) for name, T in (("a", T_FRONT), ("b", T_LEFT))}
    (rig,) = json.loads(rig_config(cameras, "a"))
    for camera in rig["cameras"]:
        del camera["T_camera_lidar"]
    file = tmp_path / "rig_config.json"
    file.write_text(json.dumps([rig]))
    with pytest.raises(
        InputError, match=r"cameras\[1\]: found a rig whose frame is a camera, not the LiDAR; "
    ):
        read_transform(file)


def test_a_lens_without_a_name_is_left_out() -> None:
    notes: list[str] = []
    thin = camera_of("thin_prism", [0.1] * 12)
    (rig,) = json.loads(rig_config({"front": RigCamera(T_FRONT, thin)}, "front", notes.append))
    assert "camera_model_name" not in rig["cameras"][0]
    (note,) = notes
    assert note.startswith("front: found the lens thin_prism, expected one of: plumb_bob,")
