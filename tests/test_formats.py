import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from conftest import DRIVE, documents
from hypothesis import given
from hypothesis import strategies as st

from semcal_cli.calibration import read_calibration
from semcal_cli.drive import read_drive
from semcal_cli.errors import InputError
from semcal_cli.formats import read_transform
from semcal_cli.poses import check_rigid, inverse

RELLIS3D_KEY = "os1_cloud_node-pylon_camera_node"
PRINTED = 1e-9  # decimals of the reference in the drive.yaml of the real frame

# A camera 1 m down the LiDAR's -x axis that looks along it: x right = y, y down = -z, z forward = -x.
T_CAMERA_LIDAR = np.array([[0, 1, 0, 0], [0, 0, -1, 0], [-1, 0, 0, -1], [0, 0, 0, 1.0]])
RELLIS3D = {RELLIS3D_KEY: {"q": {"w": -0.5, "x": 0.5, "y": 0.5, "z": -0.5}, "t": {"x": -1, "y": 0, "z": 0}}}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.yaml"


def test_rellis3d_is_inverted(path: Path) -> None:
    path.write_text(yaml.dump(RELLIS3D))
    np.testing.assert_allclose(read_transform(path), T_CAMERA_LIDAR, atol=1e-15)


def test_rellis3d_agrees_with_its_drive(rellis3d: Path) -> None:
    T_camera_lidar = read_transform(rellis3d / "transforms.yaml")
    np.testing.assert_allclose(T_camera_lidar, read_transform(rellis3d), atol=PRINTED)
    np.testing.assert_allclose(inverse(T_camera_lidar)[:3, 3], [-0.13165462, 0.03870398, -0.17253834])


def test_rellis3d_between_lidars_is_not_taken_for_a_camera(rellis3d: Path) -> None:
    with pytest.raises(InputError, match="found top-level keys 'vel2os1', needed one of: "):
        read_transform(rellis3d / "vel2os1.yaml")


def test_quaternion_is_normalised(path: Path) -> None:
    q = {key: 1.0004 * value for key, value in RELLIS3D[RELLIS3D_KEY]["q"].items()}
    path.write_text(yaml.dump({RELLIS3D_KEY: RELLIS3D[RELLIS3D_KEY] | {"q": q}}))
    np.testing.assert_allclose(read_transform(path), T_CAMERA_LIDAR, atol=1e-15)


@pytest.mark.parametrize(
    ("transform", "complaint"),
    [
        (
            {"q": {"w": 1, "x": 1, "y": 0, "z": 0}, "t": {"x": 0, "y": 0, "z": 0}},
            ": found a quaternion of norm 1.41421, needed norm 1 within 0.001",
        ),
        ({"q": {"w": 1, "x": 1, "y": 0}}, ".q.z: found nothing, needed a value"),
        ({"q": [1, 0, 0, 0]}, ".q: found a list of 4, needed a mapping"),
        (None, ": found nothing, needed a mapping"),
    ],
)
def test_wrong_rellis3d(path: Path, transform: object, complaint: str) -> None:
    path.write_text(yaml.dump({RELLIS3D_KEY: transform}))
    with pytest.raises(InputError) as error:
        read_transform(path)
    assert str(error.value) == f"{path}: ['{RELLIS3D_KEY}']{complaint}"


def test_drive_without_reference(path: Path, document: dict[str, Any]) -> None:
    path.write_text(yaml.dump(document))
    with pytest.raises(InputError) as error:
        read_transform(path)
    complaint = "T_camera_lidar: found nothing, needed the drive's reference transform"
    assert str(error.value) == f"{path}: {complaint}"


def test_unknown_content(path: Path) -> None:
    path.write_text("cam0: {}\ncam1: {}\n")
    with pytest.raises(InputError) as error:
        read_transform(path)
    assert str(error.value) == (
        f"{path}: found top-level keys 'cam0', 'cam1', needed one of: "
        f"a semcal calibration (semcal_calibration); a drive (semcal_drive); RELLIS-3D ({RELLIS3D_KEY})"
    )


garbage = documents.map(yaml.dump).map(str.encode) | documents.map(json.dumps).map(str.encode) | st.binary()


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
@pytest.mark.parametrize("read", [read_drive, read_calibration, read_transform])
@given(content=garbage)
def test_garbage_is_one_line_of_input_error(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, read: Callable[[Path], object], content: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / f"garbage{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError) as error:
        read(path)
    assert len(str(error.value).splitlines()) == 1


@st.composite
def near_misses(draw: st.DrawFn) -> object:
    """A right document with one value, at any depth, replaced by anything."""
    drive = yaml.safe_load(DRIVE) | {"T_camera_lidar": T_CAMERA_LIDAR.tolist()}
    document = node = draw(st.sampled_from([drive, copy.deepcopy(RELLIS3D)]))
    while True:
        key = draw(st.sampled_from(list(node) if isinstance(node, dict) else range(len(node))))
        if not isinstance(node[key], dict | list) or draw(st.booleans()):
            node[key] = draw(documents)
            return document
        node = node[key]


@given(document=near_misses())
def test_near_miss_is_one_line_of_input_error(
    tmp_path_factory: pytest.TempPathFactory, document: object
) -> None:
    path = tmp_path_factory.getbasetemp() / "near_miss.yaml"
    path.write_text(yaml.dump(document), encoding="utf-8")
    try:
        check_rigid(read_transform(path))
    except InputError as error:
        assert len(str(error).splitlines()) == 1  # noqa: PT017
