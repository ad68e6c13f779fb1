from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from semcal_cli.drive.document import output_drive_file, read_drive
from semcal_cli.errors import InputError

Edit = Callable[[dict[str, Any]], object]

SHEARED = [[1, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
MIRRORED = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]
ROUNDED = [[0.6, 0.8, 0, 1], [-0.8, 0.6, 0, 2], [0, 0, 1.0004, 3], [0, 0, 0, 1]]


def edit(*keys: str | int, to: object) -> Edit:
    def apply(document: Any) -> None:
        for key in keys[:-1]:
            document = document.setdefault(key, {}) if isinstance(document, dict) else document[key]
        document[keys[-1]] = to

    return apply


def lens(model: str, *distortion: float, **parameters: object) -> Edit:
    def apply(document: dict[str, Any]) -> None:
        document["camera"] |= {"model": model, "distortion": list(distortion), "parameters": parameters}

    return apply


def write(folder: Path, content: str | bytes) -> Path:
    path = folder / "drive.yaml"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def test_a_drive_is_written_to_a_folder_or_to_a_file() -> None:
    for output, expected in (
        ("out", "out/drive.yaml"),
        ("out/left.yaml", "out/left.yaml"),
        ("left.yml", "left.yml"),
        ("out.2024", "out.2024/drive.yaml"),
    ):
        assert output_drive_file(Path(output)) == Path(expected)


def test_reads_folder_or_file(tmp_path: Path, document: dict[str, Any]) -> None:
    path = write(tmp_path, yaml.dump(document))
    drive = read_drive(tmp_path)
    assert drive == read_drive(path)
    assert (drive.path, drive.root) == (path, tmp_path)
    assert drive.camera.K[0] == (640.0, 0.0, 639.5)
    assert drive.camera.distortion == ()
    assert drive.lidar is None

    assert drive.resolve("../other/a.bin") == tmp_path / "../other/a.bin"
    assert drive.resolve("/data/a.bin") == Path("/data/a.bin")
    assert drive.resolve("~/$HOME.bin") == tmp_path / "~/$HOME.bin"


def test_accepts_every_key(tmp_path: Path, document: dict[str, Any]) -> None:
    document["camera"] |= {"distortion": [0.1, 0, 0, 0], "parameters": {}}
    document["lidar"] = {"channels": 64, "columns": 1024, "fov_up_deg": 10, "fov_down_deg": -30.5}
    document["frames"][0] |= {
        "point_labels": "a.label",
        "image_labels": "a.png",
        "image": "b.png",
        "points_stamp": 12,
        "image_stamp": 12.31,
        "point_features": "a.npy",
        "image_features": "b.npy",
    }
    document["ignore"] = {"points": [0], "image": [255]}
    document["classes"] = {"points": {"road": [40, 44], "no": [10]}, "image": {"road": [40]}}
    document["palette"] = {"road": [128, 64, 128]}
    document["motion"] = {"twist": {"linear_m_s": [9, 0.5, 0], "angular_rad_s": [0, 0, 0.1]}}
    document["T_camera_lidar"] = np.eye(4).tolist()
    write(tmp_path, yaml.dump(document))
    drive = read_drive(tmp_path)
    assert drive.classes
    assert drive.classes.points == {"road": (40, 44), "no": (10,)}
    assert drive.frames[0].points_stamp == 12.0


def test_reference_becomes_an_exact_rotation(tmp_path: Path, document: dict[str, Any]) -> None:
    document["T_camera_lidar"] = ROUNDED
    write(tmp_path, yaml.dump(document))
    T = np.array(read_drive(tmp_path).T_camera_lidar)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(T, ROUNDED, atol=5e-4)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (edit("semcal_drive", to=2), "semcal_drive: found 2, which a newer semcal wrote, needed 1"),
        (edit("semcal_drive", to=0), "semcal_drive: found 0, needed 1"),
        (edit("semcal_drive", to="1"), "semcal_drive: found '1', needed 1"),
        (lambda document: document.pop("semcal_drive"), "semcal_drive: found nothing, needed 1"),
        (edit("frame", to=[]), "unknown key 'frame'; the nearest known key is 'frames'"),
        (edit("camera", "widht", to=1), "camera: unknown key 'widht'; the nearest known key is 'width'"),
        (
            edit("camera", "model", to="mei"),
            "camera.model: found 'mei', expected 'plumb_bob', 'rational_polynomial', 'thin_prism', 'fisheye', "
            "'omnidirectional', 'equirectangular', 'fov' or 'double_sphere'",
        ),
        (
            edit("camera", "intrinsics_sigma", "cy", to=-0.5),
            "camera.intrinsics_sigma.cy: found -0.5, needed at least 0.0",
        ),
        (lens("omnidirectional"), "camera.parameters: found none, expected 'xi' for omnidirectional"),
        (
            lens("double_sphere", xi=-1.0, alpha=0.5),
            "camera.parameters: found xi -1.0, needed more than -1 and less than 1",
        ),
        (
            lens("double_sphere", xi=0.0, alpha=1.5),
            "camera.parameters: found alpha 1.5, needed at least 0 and at most 1",
        ),
        (lens("fov", 3.5), "camera.distortion: found [0] 3.5, needed more than 0 and less than 3.14159"),
        (lens("fisheye", 0.1, 0.2), "camera.distortion: found 2 coefficients, needed 0 or 4 for fisheye"),
        (
            lens("thin_prism", *[0.0] * 13, 1.6),
            "camera.distortion: found [13] 1.6, needed more than -1.5708 and less than 1.5708",
        ),
        (edit("camera", "width", to=True), "camera.width: found true, expected a whole number"),
        (edit("camera", "height", to=0), "camera.height: found 0, needed more than 0"),
        (edit("camera", "K", to=[[1, 0, 0]]), "camera.K: found a list of 1, needed at least 3"),
        (edit("camera", "K", 1, to=[0, 1, 0, 0]), "camera.K[1]: found a list of 4, needed at most 3"),
        (edit("camera", "K", 1, 1, to=float("nan")), "camera.K[1][1]: found nan, expected a finite number"),
        (
            edit("camera", "K", 0, 1, to=639.5),
            "camera.K: found skew 639.5, needed at most 6.4 to either side, 1% of fx",
        ),
        (edit("camera", "K", 1, 0, to=0.5), "camera.K: found [1][0] 0.5, needed 0"),
        (edit("camera", "K", 2, 2, to=2), "camera.K: found last row [0.0, 0.0, 2.0], needed [0, 0, 1]"),
        (
            edit("camera", "K", 0, 0, to=-1),
            "camera.K: found focal lengths -1.0 and 640.0, expected both above 0",
        ),
        (
            edit("lidar", to={"channels": 64, "columns": 800, "fov_up_deg": -3, "fov_down_deg": 3}),
            "lidar.fov_down_deg: found 3.0, needed less than fov_up_deg, -3.0",
        ),
        (edit("frames", to={}), "frames: found a mapping, expected a list"),
        (
            edit("frames", 0, "points_stamp", to=1_532_402_927_612_460_000),
            "frames[0].points_stamp: found 1532402927612460000, needed at most 10000000000.0",
        ),
        (edit("palette", to={}), "palette: found a mapping of 0, needed at least 1"),
        (edit("frames", 0, to={}), "frames[0].points: found nothing, expected a value"),
        (edit("frames", 0, to="a.bin"), "frames[0]: found 'a.bin', expected a mapping"),
        (edit("frames", 0, "points", to="a\0b"), "frames[0].points: found 'a\\x00b', expected a file name"),
        (
            edit("classes", to={"image": {"road": [1, 2], "car": [2]}}),
            "classes.image: found id 2 under 'road' and 'car', expected it under one name",
        ),
        (
            edit("classes", to={"image": {"a\nroad": ["x" * 99]}}),
            f"classes.image['a\\nroad'][0]: found '{'x' * 56}..., expected a whole number",
        ),
        (
            edit("palette", to={"road": [1, 2, 3], "car": [1, 2, 3]}),
            "palette: found color [1, 2, 3] under 'road' and 'car', expected it under one name",
        ),
        (
            edit("T_camera_lidar", to=np.diag([1, 1, 1, 2]).tolist()),
            "T_camera_lidar: found last row [0.0, 0.0, 0.0, 2.0], needed [0, 0, 0, 1]",
        ),
        (
            edit("T_camera_lidar", to=MIRRORED),
            "T_camera_lidar: found determinant -1 and R R^T off the identity by 0, "
            "expected a rotation: determinant 1 and R R^T within 0.001 of the identity",
        ),
        (
            edit("T_camera_lidar", to=SHEARED),
            "T_camera_lidar: found determinant 1 and R R^T off the identity by 0.5, "
            "expected a rotation: determinant 1 and R R^T within 0.001 of the identity",
        ),
    ],
)
def test_wrong_value(tmp_path: Path, document: dict[str, Any], change: Edit, complaint: str) -> None:
    change(document)
    path = write(tmp_path, yaml.dump(document, sort_keys=False))
    with pytest.raises(InputError) as error:
        read_drive(tmp_path)
    assert str(error.value) == f"{path}: {complaint}"


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("", "found nothing, expected a mapping"),
        ("- 1\n- 2\n", "found a list of 2, expected a mapping"),
        (
            "a: 1\nb: [1, 2\n",
            "line 3: while parsing a flow sequence, did not find expected ',' or ']'",
        ),
        ("a: 1\nb:\n  c: 1\n  c: 2\n", "line 4: key 'c' is given twice"),
        ("a: 1\nb: &x [1]\n", "line 2: anchors, aliases and tags are not supported"),
        ("a: !!python/object:os.system {}\n", "line 1: anchors, aliases and tags are not supported"),
        ("a: 1\n---\nb: 1\n", "line 2: expected a single document in the stream, but found another document"),
        (b"a: \xff\n", "byte 3 is not UTF-8 text"),
        (b"a: \x07\n", "character 3 is a control character"),
        ("a: " + "[" * 20000, "nested too deeply"),
    ],
)
def test_malformed_file(tmp_path: Path, content: str | bytes, complaint: str) -> None:
    path = write(tmp_path, content)
    with pytest.raises(InputError) as error:
        read_drive(path)
    assert str(error.value) == f"{path}: {complaint}"


@pytest.mark.parametrize("missing", ["nowhere", "nowhere/drive.yaml"])
def test_missing_file(tmp_path: Path, missing: str) -> None:
    with pytest.raises(InputError) as error:
        read_drive(tmp_path / missing)
    assert str(error.value) == f"{tmp_path / missing}: no such file or folder"
