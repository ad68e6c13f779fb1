"""What an E57 file may hold, and which ones are refused; `test_point_clouds.py` compares it with the other formats."""

import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from e57_scans import Node, content_of, edit_xml, paged, write_e57, write_scans
from test_point_clouds import little_cloud, read

from semcal_cli.config.file_limits import MAX_E57_ELEMENTS
from semcal_cli.errors import InputError

libe57 = pytest.importorskip("pye57.libe57")

STEP_M = 1 / 128
POINTS = np.array([[1.0, 2.0, -0.5], [-4.0, 5.0, 6.0], [0.0, 0.0, 3.0]])
TIMES = np.array([0.0, 0.25, 0.5])


def of_float(image: Any) -> Any:
    return libe57.FloatNode(image)


def of_steps(image: Any) -> Any:
    return libe57.ScaledIntegerNode(image, 0, -(2**15), 2**15, STEP_M, 0.0)


def of_states(image: Any) -> Any:
    return libe57.IntegerNode(image, 0, 0, 2)


def cartesian(node: Node) -> dict[str, tuple[Node, np.ndarray]]:
    return {f"cartesian{axis}": (node, POINTS[:, i].copy()) for i, axis in enumerate("XYZ")}


def spherical() -> dict[str, tuple[Node, np.ndarray]]:
    x, y, z = POINTS.T
    columns = (np.linalg.norm(POINTS, axis=1), np.arctan2(y, x), np.arctan2(z, np.hypot(x, y)))
    return {
        f"spherical{name}": (of_float, column)
        for name, column in zip(("Range", "Azimuth", "Elevation"), columns, strict=True)
    }


@pytest.mark.parametrize("fields", [cartesian(of_steps), spherical(), {**spherical(), **cartesian(of_steps)}])
def test_coordinates_of_either_system_with_times(
    fields: dict[str, tuple[Node, np.ndarray]], tmp_path: Path
) -> None:
    fields |= {"timeStamp": (of_float, TIMES), "returnIndex": (of_states, np.zeros(3, np.int8))}
    cloud = read(write_scans(tmp_path / "a.e57", fields))
    np.testing.assert_allclose(cloud.points, POINTS, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(cloud.time, TIMES)
    assert (cloud.intensity, cloud.ring, cloud.labels) == (None, None, None)


def test_directions_without_a_distance_are_no_returns(tmp_path: Path) -> None:
    states = np.array([0, 1, 2], np.int8)
    fields = {**spherical(), "sphericalInvalidState": (of_states, states)}
    cloud = read(write_scans(tmp_path / "a.e57", fields))
    np.testing.assert_allclose(cloud.points, POINTS[:1], rtol=0, atol=1e-6)
    assert cloud.num_no_returns == 2


@pytest.mark.parametrize("fields", [cartesian(of_float), spherical()])
def test_an_infinite_coordinate_is_no_return(
    fields: dict[str, tuple[Node, np.ndarray]], tmp_path: Path
) -> None:
    for node, column in [*fields.values()][-1:]:
        assert node is of_float
        column[2] = np.inf
    cloud = read(write_scans(tmp_path / "a.e57", fields))
    np.testing.assert_allclose(cloud.points, POINTS[:2], rtol=0, atol=1e-6)
    assert cloud.num_no_returns == 1


@pytest.mark.parametrize("kept", ["time", "intensity"])
def test_values_that_the_file_calls_invalid_are_missing(kept: str, tmp_path: Path) -> None:
    all_invalid, one_invalid = np.ones(3, np.int8), np.array([0, 1, 0], np.int8)
    flags = {"time": "isTimeStampInvalid", "intensity": "isIntensityInvalid"}
    fields = {**cartesian(of_steps), "timeStamp": (of_float, TIMES), "intensity": (of_float, TIMES)}
    fields |= {
        flag: (of_states, one_invalid if name == kept else all_invalid) for name, flag in flags.items()
    }
    cloud = read(write_scans(tmp_path / "a.e57", fields))
    np.testing.assert_allclose(cloud.points, POINTS, rtol=0, atol=1e-6)
    (left_out,) = flags.keys() - {kept}
    assert getattr(cloud, left_out) is None
    np.testing.assert_array_equal(getattr(cloud, kept), [0.0, np.nan, 0.5])


def test_a_name_in_other_characters(tmp_path: Path) -> None:
    write_e57(little_cloud(), tmp_path / "a").rename(path := tmp_path / os.fsdecode(b"\xff.e57"))
    assert len(read(path).points) == 38


@pytest.mark.parametrize("num_scans", [0, 2])
def test_files_of_other_than_one_scan_are_refused(num_scans: int, tmp_path: Path) -> None:
    """Scans of several places are no sweep that one camera sees from one place."""
    path = write_scans(tmp_path / "a.e57", *[cartesian(of_float)] * num_scans)
    advice = ": write each scan to a file of its own, in the frame of its scanner" if num_scans else ""
    with pytest.raises(
        InputError, match=f"^{re.escape(str(path))}: found {num_scans} scans, needed one{advice}$"
    ):
        read(path)


DAMAGED = "is not a readable E57 file: it is damaged, or in a form that pye57 does not read"
NEST = b"<a type='Structure'>"
HOSTILE = {
    "entities": (
        b"<e57Root",
        b"<!DOCTYPE a [<!ENTITY b SYSTEM 'pipe'>]><e57Root",
        "found <!DOCTYPE, expected",
    ),
    "schema": (
        b"<e57Root",
        b"<e57Root xmlns:xsi='http://www.w3.org/2001/XMLSchema-instance' xsi:schemaLocation='b pipe'",
        "found an external schema of its XML, expected none",
    ),
    "encoding": (b"UTF-8", b"UTF-7", "found XML in 'UTF-7', expected UTF-8"),
    "depth": (
        b"<images2D",
        NEST * 101 + b"</a>" * 101 + b"<images2D",
        "found XML of more elements, needed at most",
    ),
    "elements": (
        b"<images2D",
        b"<a/>" * MAX_E57_ELEMENTS + b"<images2D",
        "found XML of more elements, needed at",
    ),
    "count": (b'recordCount="40"', b'recordCount="9999999"', "promises 9,999,999 points, holds 40"),
    "nothing": (b'recordCount="40"', b'recordCount="0"', "holds no points"),
    "fields": (
        b"cartesianX",
        b"cartesianW",
        "found points without coordinates, expected the fields cartesianX,",
    ),
    "no XML": (b"</e57Root>", b"", "line "),
    "type": (b'"CompressedVector"', b'"Vectors"', DAMAGED),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_xml_is_refused_before_libe57_follows_it(name: str, tmp_path: Path) -> None:
    path = write_e57(little_cloud(), tmp_path / "a")
    before, after, complaint = HOSTILE[name]
    os.mkfifo(tmp_path / "pipe")  # whoever opens it waits for ever
    after = after.replace(b"pipe", bytes(tmp_path / "pipe"))
    edit_xml(path, lambda xml: xml.replace(before, after))
    with pytest.raises(InputError) as error:
        read(path)
    assert str(error.value).startswith(f"{path}: {complaint}")
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("place", "value", "complaint"),
    [
        (0, b"ASTM-E56", "is not a readable E57 file: it has no E57 header"),
        (16, b"\xff", "promises 6,399 bytes, has 6,144: it is damaged, or not all of it is here"),
        (24, b"\xff" * 4, "promises XML of "),
        (40, b"\0\2", "promises XML of "),
    ],
)
def test_a_header_that_is_wrong_is_refused(place: int, value: bytes, complaint: str, tmp_path: Path) -> None:
    path = write_e57(little_cloud(), tmp_path / "a")
    content = bytearray(content_of(path.read_bytes()))
    content[place : place + len(value)] = value
    path.write_bytes(paged(content))
    with pytest.raises(InputError) as error:
        read(path)
    assert str(error.value).startswith(f"{path}: {complaint}")


def test_a_page_whose_checksum_is_wrong_is_refused(tmp_path: Path) -> None:
    path = write_e57(little_cloud(), tmp_path / "a")
    damaged = bytearray(path.read_bytes())
    damaged[200] ^= 1
    path.write_bytes(damaged)
    with pytest.raises(InputError) as error:
        read(path)
    assert str(error.value) == f"{path}: {DAMAGED}"
    assert "ErrorBadChecksum" in str(error.value.__cause__)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (b'fileOffset="', b'fileOffset="9'),
        (b'minimum="', b'minimum="x'),
        (b'colorRed type="Integer"', b'colorRed type="Intager"'),
    ],
)
def test_no_library_s_own_words_about_a_damaged_file(before: bytes, after: bytes, tmp_path: Path) -> None:
    path = write_e57(little_cloud(), tmp_path / "a")
    edit_xml(path, lambda xml: xml.replace(before, after))
    with pytest.raises(InputError) as error:
        read(path)
    assert str(error.value) == f"{path}: {DAMAGED}"
