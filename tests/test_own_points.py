"""Clouds that hold the points of several LiDARs, of which a drive names one by a field of its files."""

import re
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import numpy.typing as npt
import pytest
import yaml
from commands import invoke
from conftest import Cli
from test_folder import own_data
from test_point_clouds import ALL, WRITERS, columns, little_cloud

from semcal_cli.config.point_files import PointForm
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.errors import InputError
from semcal_cli.files.point_clouds import SweepCache, read_point_clouds

LOW_RINGS = "ring", (0.0, 31.0)
VALUES = ("points", "intensity", "ring", "labels", "time")


@pytest.mark.parametrize("name", [name for name, (_, fields) in WRITERS.items() if fields == ALL])
def test_other_points_are_left_out_with_all_that_belongs_to_them(name: str, tmp_path: Path) -> None:
    write, _ = WRITERS[name]
    path = write(little_cloud(), tmp_path / "merged")
    (all_points,) = read_point_clouds([(path, None)])
    (own,) = read_point_clouds([(path, None)], form=PointForm(own_points=LOW_RINGS))
    assert all_points.ring is not None
    is_own = all_points.ring < 32
    assert 0 < is_own.sum() < len(is_own)
    for value in VALUES:
        np.testing.assert_array_equal(getattr(own, value), getattr(all_points, value)[is_own])
    assert own.num_no_returns == all_points.num_no_returns == 2
    np.testing.assert_array_equal(np.flatnonzero(own.is_kept), np.flatnonzero(all_points.is_kept)[is_own])


@pytest.mark.parametrize("suffix", [".label", ".npz"])
def test_labels_in_files_have_an_entry_for_each_point_of_all_lidars(suffix: str, tmp_path: Path) -> None:
    cloud = little_cloud()
    path, labels = WRITERS["PCD binary"][0](cloud, tmp_path / "merged"), tmp_path / f"labels{suffix}"
    ids = np.arange(len(cloud)) % 7
    if suffix == ".label":
        ids.astype("<u4").tofile(labels)
    else:
        np.savez(labels, np.eye(7, dtype=np.float32)[ids])
    (own,) = read_point_clouds([(path, labels)], form=PointForm(own_points=LOW_RINGS))
    read = own.labels if own.label_shares is None else own.label_shares.classes
    np.testing.assert_array_equal(read, ids[own.is_kept])


def las(path: Path) -> Path:
    cloud = laspy.create(point_format=6, file_version="1.4")
    cloud.x, cloud.y, cloud.z = np.arange(1.0, 7.0), np.zeros(6), np.zeros(6)
    cloud.point_source_id = np.repeat([1, 2, 3], 2)
    cloud.write(path)
    return path


def table(path: Path) -> Path:
    rows = "".join(f"{x},0,0,{1 + x // 2}\n" for x in range(1, 7))
    path.write_text("x,y,z,scalar_Source\n" + rows)
    return path


def archive(path: Path) -> Path:
    points = np.zeros((6, 3))
    points[:, 0] = np.arange(1, 7)
    np.savez(path, points=points, source=np.array([1, 1, 2, 2, 3, 3], np.uint8))
    return path


@pytest.mark.parametrize(
    ("path", "field"),
    [
        (lambda folder: las(folder / "a.las"), "Point_Source_ID"),
        (lambda folder: las(folder / "a.laz"), "point_source_id"),
        (lambda folder: archive(folder / "a.npz"), "source"),
    ],
    ids=["las", "laz", "npz"],
)
def test_fields_that_nothing_else_reads(path: Callable[[Path], Path], field: str, tmp_path: Path) -> None:
    (cloud,) = read_point_clouds([(path(tmp_path), None)], form=PointForm(own_points=(field, (2.0, 3.0))))
    np.testing.assert_array_equal(cloud.points[:, 0], [3, 4, 5, 6])


def test_columns_of_tables_and_of_bin_files_that_are_named(tmp_path: Path) -> None:
    form = PointForm(own_points=("source", (2.0, 2.0)))
    (cloud,) = read_point_clouds([(table(tmp_path / "a.csv"), None)], form=form)
    np.testing.assert_array_equal(cloud.points[:, 0], [2, 3])
    rows = columns(little_cloud(), "x", "y", "z", "intensity", "ring")
    rows.tofile(tmp_path / "a.bin")
    form = PointForm(("x", "y", "z", "intensity", "lidar"), own_points=("lidar", (0.0, 31.0)))
    (cloud,) = read_point_clouds([(tmp_path / "a.bin", None)], form=form)
    is_own = rows[:, :3].any(axis=1) & (rows[:, 4] < 32)
    np.testing.assert_array_equal(cloud.points, rows[is_own, :3])


def records(path: Path, values: npt.ArrayLike, dtype: str = "f4") -> Path:
    """Write points at x = 1, 2, 3 and so on, and a field q."""
    column = np.asarray(values, dtype)
    points = np.zeros(len(column), [*((axis, "f4") for axis in "xyz"), ("q", dtype)])
    points["x"], points["q"] = np.arange(1, len(column) + 1), column
    np.save(path, points)
    return path


def test_numbers_that_a_user_writes_are_those_of_a_file_of_float32(tmp_path: Path) -> None:
    path = records(tmp_path / "a.npy", [0.1, 0.2, 0.3, np.nan, np.inf])
    for ends, places in (((0.1, 0.1), [1]), ((0.2, 0.3), [2, 3]), ((0.0, 1e300), [1, 2, 3, 5])):
        (cloud,) = read_point_clouds([(path, None)], form=PointForm(own_points=("q", ends)))
        assert cloud.points[:, 0].tolist() == places


@pytest.mark.parametrize("dtype", ["?", "f2", "U4", "M8[s]", "c8"])
def test_a_field_of_another_type_is_named(dtype: str, tmp_path: Path) -> None:
    path = records(tmp_path / "a.npy", [0, 1, 2], dtype)
    with pytest.raises(InputError, match=r"a\.npy: field 'q' holds type .*, needs integers, float32"):
        read_point_clouds([(path, None)], form=PointForm(own_points=("q", (1.0, 1.0))))


@pytest.mark.parametrize(
    ("values", "dtype", "found"),
    [
        (
            [0.1, 0.7, 0.3],
            "f4",
            "found 'q' from 0.1 to 0.7, expected points from 3 to 4, as lidar.own_points",
        ),
        ([0.1, np.nan, np.inf], "f8", "found 'q' from 0.1 to 0.1, expected points from 3 to 4, as"),
        ([np.nan, np.inf, -np.inf], "f4", "found no number in 'q', expected points from 3 to 4, as"),
    ],
)
def test_values_of_a_refused_file_are_those_of_its_points(
    values: list[float], dtype: str, found: str, tmp_path: Path
) -> None:
    path = records(tmp_path / "a.npy", values, dtype)
    points = np.load(path)
    no_return = np.zeros(1, points.dtype)
    no_return["q"] = 99
    np.save(path, np.concatenate([points, no_return]))
    with pytest.raises(InputError, match=re.escape(f"{path}: {found}")):
        read_point_clouds([(path, None)], form=PointForm(own_points=("q", (3.0, 4.0))))


@pytest.mark.parametrize(
    ("others", "found"),
    [
        ({"source": np.zeros(6)}, "the arrays points source, and the fields x y z intensity in points,"),
        ({}, "the fields x y z intensity,"),
    ],
)
def test_an_archive_without_the_field_is_refused_with_its_arrays_and_fields(
    others: dict[str, npt.NDArray[np.float64]], found: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, points=np.ones((6, 4), np.float32), **others)
    with pytest.raises(InputError) as caught:
        read_point_clouds([(path, None)], form=PointForm(own_points=("lidar", (0.0, 1.0))))
    assert str(caught.value) == f"{path}: found {found} expected 'lidar' among them, {KEY}"


def test_a_dimension_of_three_numbers_tells_nothing(tmp_path: Path) -> None:
    cloud = laspy.create(point_format=6, file_version="1.4")
    cloud.add_extra_dim(laspy.ExtraBytesParams("vec", "3f4"))
    cloud.x, cloud.y, cloud.z = np.arange(1.0, 7.0), np.zeros(6), np.zeros(6)
    cloud.write(tmp_path / "a.las")
    with pytest.raises(InputError, match=r"a\.las: field 'vec' is not a single number$"):
        read_point_clouds([(tmp_path / "a.las", None)], form=PointForm(own_points=("Vec", (0.0, 1.0))))


@pytest.mark.parametrize("name", ["t", "time", "label", "ring"])
@pytest.mark.parametrize("point_format", [0, 6])
def test_a_dimension_that_tells_points_apart_has_no_other_meaning(
    name: str, point_format: int, tmp_path: Path
) -> None:
    cloud = laspy.create(point_format=point_format, file_version="1.4")
    cloud.add_extra_dim(laspy.ExtraBytesParams(name, np.uint8))
    cloud.x, cloud.y, cloud.z = np.arange(1.0, 7.0), np.zeros(6), np.zeros(6)
    cloud[name], cloud.classification = np.arange(6), np.full(6, 9)
    if point_format == 6:
        cloud.gps_time = np.arange(6) + 0.5
    cloud.write(tmp_path / "a.las")
    (own,) = read_point_clouds([(tmp_path / "a.las", None)], form=PointForm(own_points=(name, (0.0, 2.0))))
    assert (own.ring, own.labels.tolist()) == (None, [9, 9, 9])
    assert (None if own.time is None else own.time.tolist()) == (
        [0.5, 1.5, 2.5] if point_format == 6 else None
    )


def test_coordinates_tell_points_apart(tmp_path: Path) -> None:
    (own,) = read_point_clouds(
        [(las(tmp_path / "a.las"), None)], form=PointForm(own_points=("x", (0.0, 3.0)))
    )
    np.testing.assert_array_equal(own.points[:, 0], [1, 2, 3])


def test_too_little_memory_is_no_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise MemoryError

    path = las(tmp_path / "a.las")
    monkeypatch.setattr(laspy.LasReader, "chunk_iterator", fail)
    with pytest.raises(MemoryError):
        read_point_clouds([(path, None)])


def test_two_lidars_of_one_file_are_kept_apart(tmp_path: Path) -> None:
    path, sweeps = WRITERS["NPY records"][0](little_cloud(), tmp_path / "merged"), SweepCache()
    forms = [PointForm(own_points=("ring", ends)) for ends in ((0.0, 31.0), (32.0, 63.0))]
    first, second = (sweeps.read([(path, None)], form=form)[0] for form in forms)
    assert len(first.points) + len(second.points) == 38


KEY = "which lidar.own_points states (--own-points at import)"


@pytest.mark.parametrize(
    ("name", "own", "complaint"),
    [
        (
            "PLY binary",
            ("sensor", (0, 1)),
            f"found the fields x y z intensity ring label time, expected 'sensor' among them, {KEY}",
        ),
        (
            "KITTI .bin",
            ("ring", (0, 1)),
            f"found the fields x y z intensity, expected 'ring' among them, {KEY}: point_columns "
            "(--point-columns) names the columns of a .bin",
        ),
        (
            "NPY N x 4",
            ("ring", (0, 1)),
            f"found the fields x y z intensity, expected 'ring' among them, {KEY}",
        ),
        ("LAS 1.2", ("ring", (0, 1)), "return_number"),
        ("LAS 1.2", ("ring", (0, 1)), f"point_source_id gps_time, expected 'ring' among them, {KEY}"),
        (
            "PCD ascii",
            ("ring", (90, 99.5)),
            "found 'ring' from 0 to 62, expected points from 90 to 99.5, as lidar.own_points states "
            "(--own-points at import)",
        ),
    ],
)
def test_files_that_do_not_tell_are_refused(
    name: str, own: tuple[str, tuple[float, float]], complaint: str, tmp_path: Path
) -> None:
    path = WRITERS[name][0](little_cloud(), tmp_path / "merged")
    with pytest.raises(InputError, match=re.escape(path.name) + ".*" + re.escape(complaint)):
        read_point_clouds([(path, None)], form=PointForm(own_points=own))


@pytest.mark.parametrize(
    ("own_points", "complaint"),
    [
        ({"field": "ring"}, "own_points.range: found nothing, expected"),
        (
            {"field": "ring", "range": [3, 1]},
            "own_points.range: found [3.0, 1.0], expected the smallest and the",
        ),
        (
            {"field": "", "range": [0, 1]},
            "own_points.field: found '', expected the name of a field of the files",
        ),
        (
            {"field": "_", "range": [0, 1]},
            "own_points.field: found '_', a column that is not used, expected the name of a field of the files",
        ),
        (
            {"field": "ring", "range": [0, 2**53 + 2]},
            "expected values up to 9,007,199,254,740,992: larger integers are rounded",
        ),
        ({"field": "a" * 101, "range": [0, 1]}, "needed at most 100 characters"),
        ({"ring": [0, 1]}, "own_points: unknown key 'ring'"),
    ],
)
def test_statements_that_make_no_sense(own_points: object, complaint: str, drive: Path) -> None:
    document = yaml.safe_load((drive / "drive.yaml").read_text()) | {"lidar": {"own_points": own_points}}
    (drive / "drive.yaml").write_text(yaml.safe_dump(document))
    with pytest.raises(InputError, match=re.escape(complaint)):
        read_drive(drive)


def test_arrays_have_no_fields(drive: Path) -> None:
    own = {"own_points": {"field": "ring", "range": [0, 1]}}
    with pytest.raises(
        InputError, match=r"^arrays: lidar.own_points: found 'ring', expected none: arrays have"
    ):
        Drive.from_arrays(points=[np.ones((3, 3))], camera=read_drive(drive).camera, lidar=own)


def merged(drive: Path) -> Path:
    """A drive whose clouds hold the points of another LiDAR, too, which are wrong, with labels of the wrong class."""
    document = yaml.safe_load((drive / "drive.yaml").read_text())
    for frame in document["frames"]:
        path, labels = drive / frame["points"], drive / frame["point_labels"]
        rows = np.fromfile(path, "<f4").reshape(-1, 4)
        wrong = rows[:, [2, 1, 0, 3]] + np.float32(0.5)
        numbers = np.repeat([1.0, 2.0], len(rows))[:, None]
        np.hstack([np.vstack([rows, wrong]), numbers]).astype("<f4").tofile(path)
        np.tile(np.fromfile(labels, "<u4"), 2).tofile(labels)
    document |= {
        "point_columns": ["x", "y", "z", "intensity", "lidar"],
        "lidar": {"own_points": {"field": "lidar", "range": [1, 1]}},
    }
    (drive / "drive.yaml").write_text(yaml.safe_dump(document))
    return drive


def test_a_camera_is_calibrated_against_one_lidar_of_several(
    street: Path, drive: Path, tmp_path: Path
) -> None:
    def result(path: Path) -> object:
        output = tmp_path / "result.yaml"
        run = invoke("initialize", path, "-o", output)
        assert run.exit_code in (0, 3), run.output
        return yaml.safe_load(output.read_text())["T_camera_lidar"]

    document = yaml.safe_load((drive / "drive.yaml").read_text())
    (drive / "drive.yaml").write_text(yaml.safe_dump({k: v for k, v in document.items() if k != "lidar"}))
    expected = result(drive)
    assert result(merged(drive)) == expected
    shown = invoke("inspect", drive, "--json")
    alone = invoke("inspect", street, "--json")
    assert [frame["num_points"] for frame in yaml.safe_load(shown.stdout)["frames"]] == [
        frame["num_points"] for frame in yaml.safe_load(alone.stdout)["frames"]
    ]
    assert "own points  lidar 1\n" in invoke("inspect", drive).stdout


def test_only_the_lidars_own_points_are_labelled(drive: Path, tmp_path: Path) -> None:
    alone = [np.fromfile(path, "<f4").reshape(-1, 4) for path in sorted((drive / "points").iterdir())]
    run = invoke("label", merged(drive), "--points", "segments", "-o", tmp_path / "out")
    assert run.exit_code == 0, run.output
    new = read_drive(tmp_path / "out")
    for frame, rows in zip(new.frames, alone, strict=True):
        own, others = np.split(np.fromfile(new.resolve(str(frame.point_labels)), "<u4"), [len(rows)])
        assert own.any()
        assert len(others) == len(rows)
        assert not others.any()
    record = yaml.safe_load((tmp_path / "out/point_labels/semcal_label.json").read_text())
    assert record["own_points"] == {"field": "lidar", "range": [1.0, 1.0]}


def test_an_import_keeps_what_is_stated(tmp_path: Path, cli: Cli) -> None:
    arguments = ["import", "folder", *own_data(tmp_path / "own"), "-o", tmp_path / "drive", "--force"]
    code, *_ = cli(*arguments, "--own-points", "intensity=-1e9:1e9", "--origin", 1.38, 0, 1.63)
    assert code == 0
    assert yaml.safe_load((tmp_path / "drive/drive.yaml").read_text())["lidar"] == {
        "origin_m": [1.38, 0.0, 1.63],
        "own_points": {"field": "intensity", "range": [-1e9, 1e9]},
    }
    code, _, said = cli(*arguments, "--own-points", "ring=2")
    assert (code, said.count("\n")) == (1, 1)
    assert "clouds/000002.bin: found the fields x y z intensity, expected 'ring' among them" in said
    code, _, said = cli(*arguments, "--own-points", "=3")
    assert code == 2
    assert "own_points.field: found '', expected the name of a field of the files" in said
    for value in ("ring", "ring=32:"):
        code, _, said = cli(*arguments, "--own-points", value)
        assert code == 2
        assert f"found '{value}', expected FIELD=FIRST[:LAST], such as ring=0:31." in said
