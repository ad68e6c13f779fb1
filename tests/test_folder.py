"""`semcal import folder`: own files, paired by time or by name."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from camera_infos import LENS
from dataset_imports import complaint, run_import
from dataset_trees import POINTS, own_data, write

from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.importing.file_pairing import by_time, pairs, stamps_s
from semcal_cli.observations.reading import read_clouds


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("1581624663.149", 1581624663.149),
        ("frame000104-1581624663_149", 1581624663.149),
        ("1581624663-149000001", 1581624663.149),
        ("1581624663149000001", 1581624663.149),
        ("n015-2018-07-24-11-22-45+0800__LIDAR_TOP__1532402927647951", 1532402927.647951),
        ("cloud_1581624663149", 1581624663.149),
        ("12.31", 12.31),
        ("000104", None),
        ("left_000104_2", None),
        ("0000000005", None),
        ("0000000002_0000000385", None),
        ("0000000005_000", None),
        ("20240131_120000", None),  # whole seconds pair nothing
        ("20240131_120000_123", 1706702400.123),
        ("2024-01-31T12-00-00.123456", 1706702400.123456),
        ("lidar_2024-01-31-12-00-00_123456789", 1706702400.123456789),
        ("20240131120000123", 1706702400.123),
        ("2024_01_31_drive_0001_sync_0000000005", None),
        ("2024-13-31-12-00-00-123", None),
        ("2024-02-31-12-00-00-123", None),
        ("1581624663.5", 1581624663.5),
        ("1581624663_98000000", 1581624663.098),
        ("1581624663.149000072479248", 1581624663.149),
    ],
)
def test_times_in_names(name: str, expected: float | None) -> None:
    # a double holds Unix time to a quarter of a microsecond
    path = Path(f"{name}.png")
    found = stamps_s([path])
    assert found == ({} if expected is None else {path: pytest.approx(expected, abs=1e-6)})


def files(*names: str) -> list[Path]:
    return [Path(name) for name in names]


SECONDS = 1581624663


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        # ROS's seconds and nanoseconds without leading zeros: 98000000 is 0.098 s, and 149000 beside it 0.000149 s.
        *(
            (
                [f"{SECONDS}{mark}{ns}" for ns in (198000000, 98000000, 149000, 0)],
                [0.198, 0.098, 0.000149, 0.0],
            )
            for mark in "_-."
        ),
        # Decimal fractions may have any length, and a zero in front shows that the others have lost zeros at the end.
        ([f"{SECONDS}.98", f"{SECONDS}.1490002", f"{SECONDS + 1}"], [0.98, 0.1490002, 1.0]),
        ([f"{SECONDS}.012345678", f"{SECONDS}.14900000"], [0.012345678, 0.149]),
    ],
)
def test_fractions_are_told_by_all_names_together(names: list[str], expected: list[float]) -> None:
    found = stamps_s(files(*(f"{name}.bin" for name in names)))
    assert [stamp - SECONDS for stamp in found.values()] == pytest.approx(expected, abs=1e-6)


def test_a_pair_whose_one_side_has_nanoseconds_without_zeros() -> None:
    """As text 0.98 s is nearest to 0.98 s, as nanoseconds 0.098 s is nearest to 0.1 s."""
    clouds = files("1581624663_98000000.bin", "1581624663_980000000.bin")
    images = files("1581624663_100000000.png", "1581624663_980000000.png")
    assert pairs(clouds, images, max_gap_s=0.05) == dict(zip(clouds, images, strict=True))


@pytest.mark.parametrize(
    "names",
    [
        ("1581624663_149.bin", "1581624663_98.bin"),  # milliseconds without zeros?
        ("1581624663_149000000.bin", "1581624664_098000000.bin", "1581624665_98.bin"),
    ],
)
def test_digits_after_seconds_that_are_not_clear(names: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as error:
        by_time(files(*names))
    assert str(error.value) == (
        f"{names[-1]}: found 2 digits after the seconds, needed 3, 6 or 9 in every name, or nanoseconds without "
        "leading zeros"
    )


def test_pairs_by_time_are_each_others_nearest() -> None:
    """Of two clouds near one image the nearer takes it; what is too far stays alone; the order does not matter."""
    clouds = files("1000000000.00.bin", "1000000000.10.bin", "1000000000.14.bin", "1000000000.50.bin")
    images = files("1000000000.60.png", "1000000000.13.png", "1000000000.02.png")
    expected = {clouds[0]: images[2], clouds[2]: images[1]}
    assert pairs(clouds, images, max_gap_s=0.05) == expected
    assert pairs(clouds, images, max_gap_s=0.11) == expected | {clouds[3]: images[0]}


def test_pairs_by_name_whatever_the_suffix() -> None:
    clouds, images = files("a/000001.pcd.bin", "a/000002.pcd.bin"), files("b/000002.png", "b/000003.png")
    assert pairs(clouds, images, max_gap_s=0.05) == {clouds[1]: images[0]}
    with pytest.raises(InputError, match=r"^b/1.png: found the same name as a/1.png, expected a"):
        pairs(files("a/1.bin"), files("a/1.png", "b/1.png"), max_gap_s=0.05)


def test_pairs_by_number_where_no_names_are_the_same() -> None:
    clouds, images = (
        files("lidar_0012.pcd", "lidar_0013.pcd", "lidar_0014.pcd"),
        files("cam2_12.png", "cam2_14.png"),
    )
    assert pairs(clouds, images, 0.05) == {clouds[0]: images[0], clouds[2]: images[1]}
    last = files("000012_left_2.png", "000013_left_2.png")
    assert pairs(clouds, last, 0.05) == {clouds[0]: last[0], clouds[1]: last[1]}
    assert pairs(clouds, files("left_2_a1.png", "right_2_a1.png"), 0.05) == {}
    same = files("cam_12.png", "lidar_0013.png")
    assert pairs(clouds, same, 0.05) == {clouds[1]: same[1]}


def test_own_data(tmp_path: Path) -> None:
    arguments = own_data(tmp_path / "own")
    reference = tmp_path / "reference.yaml"
    T = [[0, -1, 0, 1], [0, 0, -1, 2], [1, 0, 0, 3], [0, 0, 0, 1]]
    own = {"semcal_drive": 1, "camera": {"model": "plumb_bob", **LENS}, "frames": [{"points": "a.bin"}]}
    write(reference, yaml.safe_dump(own | {"T_camera_lidar": T}))
    stderr = run_import("folder", *arguments, "--reference", reference, "-o", tmp_path / "drive.yaml")
    drive = read_drive(tmp_path / "drive.yaml")
    assert [frame.points for frame in drive.frames] == ["own/clouds/000002.bin", "own/clouds/000003.bin"]
    assert drive.frames[0].image_labels == "own/labels/000002.png"
    assert drive.frames[0].points_stamp is None
    np.testing.assert_array_equal(drive.T_camera_lidar, T)
    assert "note: --image-labels: 2 pairs by name; unpaired: 1 cloud, 1 file\n" in stderr


def test_how_the_lidar_turns_and_where_its_rays_start_are_stated(tmp_path: Path) -> None:
    arguments = [*own_data(tmp_path / "own"), "-o", tmp_path / "drive"]
    stated = ["--spin", "10:cw:180:end", "--origin", -1.38, 0, 1.63]
    run_import("folder", *arguments, *stated)
    drive = read_drive(tmp_path / "drive")
    assert drive.lidar is not None
    assert drive.lidar.origin_m == (-1.38, 0.0, 1.63)
    spin = {"rate_hz": 10.0, "clockwise": True, "seam_deg": 180.0, "stamp": "end"}
    document = yaml.safe_load((tmp_path / "drive/drive.yaml").read_text())
    assert document["lidar"] == {"origin_m": [-1.38, 0.0, 1.63], "spin": spin}
    told = drive.point_times(read_clouds(drive)[0])
    assert told is not None
    assert told[1]
    run_import("folder", *arguments, *stated[2:], "--force")
    assert yaml.safe_load((tmp_path / "drive/drive.yaml").read_text())["lidar"] == {
        "origin_m": [-1.38, 0.0, 1.63]
    }
    run_import("folder", *arguments, "--force")
    assert "lidar" not in yaml.safe_load((tmp_path / "drive/drive.yaml").read_text())


def test_sweeps_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    arguments, own = own_data(tmp_path / "own"), tmp_path / "own"
    for file in (*own.glob("clouds/*"), *own.glob("labels/*")):
        for number in (1, 10, 2, 11) if file.stem == "000002" else ():
            shutil.copy(file, file.with_stem(f"sweep_{number}"))
        file.unlink()
    run_import("folder", *arguments, "-o", tmp_path / "drive.yaml")
    names = [Path(frame.points).stem for frame in read_drive(tmp_path / "drive.yaml").frames]
    assert names == ["sweep_1", "sweep_2", "sweep_10", "sweep_11"]


def test_files_paired_by_number_are_named(tmp_path: Path) -> None:
    arguments = own_data(tmp_path / "own")
    for path in (tmp_path / "own" / "labels").iterdir():
        path.rename(path.with_name(f"cam_{path.name.lstrip('0')}"))
    stderr = run_import("folder", *arguments, "-o", tmp_path / "drive.yaml")
    assert [frame.image_labels for frame in read_drive(tmp_path / "drive.yaml").frames] == [
        "own/labels/cam_2.png",
        "own/labels/cam_3.png",
    ]
    assert "2 pairs by the numbers in their names, such as 000002.bin with cam_2.png" in " ".join(
        stderr.split()
    )


COUNTS = (
    "--points: found 3 clouds, 1 with a file of --point-labels, 2 with one of {}, none with both, "
    "needed at least one"
)


@pytest.mark.parametrize(
    ("changed", "value", "missing", "expected"),
    [
        (4, "--image-labels", "clouds/000002.label clouds/000003.label", COUNTS.format("--image-labels")),
        (4, "--images", "clouds/000002.label clouds/000003.label", COUNTS.format("--images")),
        (1, "*.pcd", "", "--points: *.pcd: found no matching file, needed at least one; quote the pattern"),
        (
            4,
            "--image-labels",
            "labels/000002.png labels/000003.png",
            "--image-labels: found no partner, by name, for any of 3 clouds (such as 000001.bin) among 1 file "
            "(such as 000004.png)",
        ),
    ],
)
def test_what_finds_no_files_or_no_pairs_is_named(
    tmp_path: Path, changed: int, value: str, missing: str, expected: str
) -> None:
    arguments = own_data(tmp_path / "own")
    arguments[changed] = value
    for name in missing.split():
        (tmp_path / "own" / name).unlink()
    assert complaint("folder", *arguments, "-o", tmp_path / "drive") == expected


def test_a_folder_in_the_place_of_a_pattern_is_named(tmp_path: Path) -> None:
    arguments, clouds = own_data(tmp_path / "own"), tmp_path / "own/clouds"
    arguments[1] = str(clouds)
    needed = f"expected a pattern of its files, such as '{clouds}/*.bin'"
    assert (
        complaint("folder", *arguments, "-o", tmp_path / "drive")
        == f"--points: {clouds}: is a folder, {needed}"
    )


def write_own_labels(path: Path, ids: str) -> None:
    """Write a PCD or a PLY in text, whose points have a further field."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [f"{x} {y} {z} {number}" for number, (x, y, z, *_) in enumerate(POINTS, start=1)]
    if path.suffix == ".pcd":
        head = (
            f"VERSION 0.7\nFIELDS x y z {ids}\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH {len(rows)}\n"
        )
        head += f"HEIGHT 1\nPOINTS {len(rows)}\nDATA ascii\n"
    else:
        names = "".join(f"property float {axis}\n" for axis in "xyz") + f"property uint {ids}\n"
        head = f"ply\nformat ascii 1.0\nelement vertex {len(rows)}\n{names}end_header\n"
    write(path, head + "\n".join(rows) + "\n")


def own_clouds(root: Path, suffix: str, ids: str) -> list[object]:
    """Arguments for clouds that may have labels of their own, without files of labels."""
    arguments = own_data(root)
    for number in (2, 3):
        write_own_labels(root / f"own/{number:06d}{suffix}", ids)
    return ["--points", root / f"own/*{suffix}", *arguments[4:]]


@pytest.mark.parametrize("suffix", [".pcd", ".ply"])
def test_clouds_with_a_field_of_labels_need_no_files_of_them(tmp_path: Path, suffix: str) -> None:
    stderr = run_import("folder", *own_clouds(tmp_path / "own", suffix, "label"), "-o", tmp_path / "drive")
    assert f"note: point labels: from the clouds themselves, such as 000002{suffix}\n" in stderr
    assert "no point labels" not in stderr
    drive = read_drive(tmp_path / "drive")
    assert [cloud.labels.tolist() for cloud in read_clouds(drive)] == [[1, 2, 3]] * 2
    stderr = run_import("folder", *own_clouds(tmp_path / "other", suffix, "echo"), "-o", tmp_path / "without")
    assert "no point labels: edges are compared instead; add your own with" in stderr
    assert stderr.splitlines()[-1] == f"next: semcal calibrate {tmp_path}/without -o calibration.yaml"


def test_the_cloud_that_is_looked_into_may_be_too_large(tmp_path: Path) -> None:
    arguments = own_clouds(tmp_path / "own", ".pcd", "label")
    found = complaint("folder", *arguments, "--max-points", 2, "-o", tmp_path / "drive")
    assert found == f"{tmp_path}/own/own/000002.pcd: found 3 points, needed at most 2: see --max-points"


@pytest.mark.parametrize(
    ("option", "name", "expected"),
    [
        (
            "--points",
            "a.xyz",
            "suffix '.xyz', expected .pcd.bin, .bin, .pcd, .ply, .npy, .npz, .csv, .pts, .ptx, .las, .laz or .e57",
        ),
        (
            "--points",
            "a.osf",
            "packets of a LiDAR, which `ouster-cli source FILE save sweeps.csv` turns into sweeps if it is an Ouster, "
            "expected .pcd.bin, .bin, .pcd, .ply, .npy, .npz, .csv, .pts, .ptx, .las, .laz or .e57",
        ),
        ("--point-labels", "a.txt", "suffix '.txt', expected .label, .bin, .npy or .npz"),
        ("--image-labels", "a.jpg", "suffix '.jpg', expected .png, .npy or .npz"),
        ("--images", "a.tiff", "suffix '.tiff', expected .png, .jpg, .jpeg or .bmp"),
    ],
)
def test_files_that_no_reader_knows(tmp_path: Path, option: str, name: str, expected: str) -> None:
    arguments = own_data(tmp_path / "own")
    # These intrinsics have no size, so that the images are looked for first.
    write(tmp_path / "own/camera.yaml", "camera: {camera_model: plumb_bob, intrinsics: [50, 50, 32, 16]}\n")
    file = tmp_path / "other" / name
    write(file, "anything")
    assert complaint("folder", *arguments, option, file, "-o", tmp_path / "drive") == (
        f"{option}: {file}: found {expected}"
    )
    assert not (tmp_path / "drive").exists()


def test_capital_suffixes_are_read(tmp_path: Path) -> None:
    arguments = own_data(tmp_path / "own")
    for path in (tmp_path / "own/labels").iterdir():
        path.rename(path.with_suffix(".PNG"))
    arguments[5] = tmp_path / "own/labels/*.PNG"
    run_import("folder", *arguments, "-o", tmp_path / "drive")
    assert len(read_drive(tmp_path / "drive").frames) == 2


@pytest.mark.parametrize(
    "content",
    [
        "road: [1]\ncar: [2, 3]\n",
        "classes: {road: [1], car: [2, 3]}\n",
        "ignore: [0]\nclasses:\n  road: {ids: [1]}\n  car: {ids: [2, 3], color: [0, 0, 142]}\n",
    ],
)
def test_names_of_classes_from_a_file(tmp_path: Path, content: str) -> None:
    own = tmp_path / "own.yaml"
    write(own, content)
    options = ("--image-classes", own, "--point-classes", own)
    run_import("folder", *own_data(tmp_path / "own"), *options, "-o", tmp_path / "drive")
    classes = read_drive(tmp_path / "drive").classes
    assert classes is not None
    assert classes.image == classes.points == {"road": (1,), "car": (2, 3)}


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("road: 7\n", "classes.road.ids: found 7, expected a list"),
        ("road: [seven]\n", "classes.road.ids[0]: found 'seven', expected a whole number"),
        ("road: [7, 70000]\n", "classes.road.ids[1]: found 70000, needed at most 65535"),
        ("road: [7]\ncar: [7]\n", "classes: found id 7 under 'road' and 'car', expected it under one name"),
        ("{}\n", "classes: found a mapping of 0, needed at least 1"),
        ("- road\n", "found a list of 1, expected a mapping"),
        (
            "ignore: [0]\nroad: [7]\n",
            "ignore: found next to the class names, expected the names under a key 'classes'; "
            "ids that no class lists are ignored anyway",
        ),
        (
            "".join(f"c{n}: []\n" for n in range(65_537)),
            "classes: found a mapping of 65537, needed at most 65536",
        ),
    ],
)
def test_names_of_classes_that_are_wrong(tmp_path: Path, content: str, expected: str) -> None:
    own = tmp_path / "own.yaml"
    write(own, content)
    arguments = (*own_data(tmp_path / "own"), "--image-classes", own, "-o", tmp_path / "drive")
    assert complaint("folder", *arguments) == f"{own}: {expected}"
