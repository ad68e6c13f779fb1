"""Point clouds whose files do not say what their columns are: .bin files, and tables of numbers."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from test_point_clouds import read

from semcal_cli.config.point_files import PointColumn, PointForm, PointType
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.files.point_clouds import read_point_clouds

POSE_OF_PTX = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n5 5 5 1\n"


def a_sweep(num_columns: int) -> np.ndarray:
    """Points of a street in no order, with further columns from 0 to 1."""
    generator = np.random.default_rng(0)
    return np.column_stack(
        [
            generator.normal(0.0, 20.0, 2000),
            generator.normal(0.0, 6.0, 2000),
            generator.uniform(-2.0, 1.0, 2000),
            generator.uniform(0.0, 1.0, (2000, num_columns - 3)),
        ]
    )


@pytest.mark.parametrize(
    ("name", "num_columns", "kind", "needed"),
    [
        ("a.bin", 3, "f4", "point_columns: [x, y, z] in drive.yaml (--point-columns x,y,z at import)"),
        ("a.bin", 5, "f4", "point_columns: [x, y, z, _, _] in"),
        ("a.bin", 6, "f4", "point_columns: [x, y, z, _, _, _] in"),
        ("a.bin", 8, "f4", "point_columns: [x, y, z, _, _, _, _, _] in"),
        ("a.bin", 3, "f8", "point_columns: [x, y, z], point_type: f8 in"),
        ("a.bin", 4, "f8", "point_columns: [x, y, z, _], point_type: f8 in"),
        ("a.pcd.bin", 4, "f4", "point_columns: [x, y, z, _] in"),
    ],
)
def test_other_columns_are_refused_until_they_are_stated(
    name: str, num_columns: int, kind: PointType, needed: str, tmp_path: Path
) -> None:
    path, rows = tmp_path / name, a_sweep(num_columns).astype(f"<{kind}")
    rows.tofile(path)
    with pytest.raises(InputError, match=re.escape(needed)):
        read(path)
    columns: list[PointColumn] = ["x", "y", "z", *["_"] * (num_columns - 3)]
    if num_columns > 3:
        columns[-1] = "intensity"
    (cloud,) = read_point_clouds([(path, None)], form=PointForm(tuple(columns), kind))
    np.testing.assert_array_equal(cloud.points, rows[:, :3].astype(np.float32))
    if num_columns > 3:
        np.testing.assert_array_equal(cloud.intensity, rows[:, -1].astype(np.float32))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.csv", "x,y,z,intensity,ring,t\n1,2,3,9,5,0.25\n0,0,0,0,0,0\n4,5,6,8,6,0.5\n"),
        ("a.csv", "1;2;3;9\n0;0;0;0\n4;5;6;8\n"),
        ("a.pts", "3\n1 2 3 9 7 7 7\n0 0 0 0 0 0 0\n4 5 6 8 7 7 7\n"),
        ("a.ptx", f"1\n3\n{POSE_OF_PTX}1 2 3 9\n0 0 0 0.5\n4 5 6 8\n"),
    ],
)
def test_tables_of_numbers(name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    cloud = read(tmp_path / name)
    np.testing.assert_array_equal(cloud.points, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(cloud.intensity, [9, 8])
    assert cloud.num_no_returns == 1
    assert (cloud.ring is None, cloud.time is None) == (("ring" not in text,) * 2)
    (tmp_path / name).write_text(text + "7 7 seven\n")
    with pytest.raises(InputError, match=rf"{re.escape(name)}: (point 3: found|holds 4 lines)"):
        read(tmp_path / name)


@pytest.mark.parametrize(
    ("points", "keys", "complaint"),
    [
        ("a.bin", {"point_columns": ["x", "y", "_"]}, "point_columns: found no z, expected x, y and z"),
        (
            "a.bin",
            {"point_columns": ["x", "y", "z", "x"]},
            "point_columns: found x twice, expected each column once",
        ),
        (
            "a.bin",
            {"point_columns": ["x", "y", "z", "r"]},
            r"point_columns\[3\]: found 'r', expected 'x', 'y'",
        ),
        (
            "a.bin",
            {"point_type": "f8"},
            "found point_type f8 without point_columns, expected both, or neither",
        ),
        (
            "a.pcd",
            {"point_columns": ["x", "y", "z"]},
            "found point_columns and no .bin file of points, expected none",
        ),
        (
            "a.bin",
            {"time_unit": "min"},
            "time_unit: found 'min', expected s, ms, us, ns, or its length in seconds",
        ),
        (
            "a.bin",
            {"time_unit": -0.1},
            "time_unit: found -0.1, expected s, ms, us, ns, or its length in seconds",
        ),
    ],
)
def test_statements_that_make_no_sense(
    points: str, keys: dict[str, object], complaint: str, tmp_path: Path
) -> None:
    camera = {"model": "plumb_bob", "width": 64, "height": 48, "K": [[40, 0, 31], [0, 40, 23], [0, 0, 1]]}
    document = {"semcal_drive": 1, "camera": camera, "frames": [{"points": points}], **keys}
    (tmp_path / "drive.yaml").write_text(yaml.safe_dump(document))
    with pytest.raises(InputError, match=complaint):
        read_drive(tmp_path)
