"""`semcal import folder`: own files, paired by time or by name."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from camera_infos import LENS, ROS
from dataset_imports import complaint, run_import
from dataset_trees import own_data, write, write_cloud, write_ids

from semcal_cli.datasets.pairing import by_time, pairs, stamps_s
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError


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
        ("20240131_120000", None),
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


@pytest.mark.parametrize("mark", ["_", "-", "."])
def test_nanoseconds_without_zeros_in_front(mark: str) -> None:
    """ROS's seconds and nanoseconds: 98000000 is 0.098 s, and 149000 beside it 0.000149 s."""
    names = [f"1581624663{mark}{ns}.png" for ns in (198000000, 98000000, 149000, 0)]
    found = stamps_s(files(*names))
    expected = [1581624663.198, 1581624663.098, 1581624663.000149, 1581624663.0]
    assert list(found.values()) == pytest.approx(expected, abs=1e-6)


def test_a_pair_whose_one_side_has_nanoseconds_without_zeros() -> None:
    """As text 0.98 s is nearest to 0.98 s, as nanoseconds 0.098 s is nearest to 0.1 s."""
    clouds = files("1581624663_98000000.bin", "1581624663_980000000.bin")
    pictures = files("1581624663_100000000.png", "1581624663_980000000.png")
    assert pairs(clouds, pictures, max_gap_s=0.05) == dict(zip(clouds, pictures, strict=True))


def test_decimal_fractions_may_have_any_length() -> None:
    names = ("1581624663.98.bin", "1581624663.1490002.bin", "1581624664.bin")
    assert list(stamps_s(files(*names)).values()) == pytest.approx(
        [1581624663.98, 1581624663.1490002, 1581624664.0], abs=1e-6
    )
    # a zero in front shows that the others have lost zeros at the end
    dropped = files("1581624663.012345678.bin", "1581624663.14900000.bin")
    assert list(stamps_s(dropped).values()) == pytest.approx([1581624663.012345678, 1581624663.149], abs=1e-6)


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
        "zeros in front"
    )


def test_numbers_of_ten_digits_are_no_stamps(tmp_path: Path) -> None:
    """KITTI's names."""
    for number in (5, 6):
        write_cloud(tmp_path / f"clouds/{number:010d}.bin")
        write_ids(tmp_path / f"labels/{number:010d}.png")
    write(tmp_path / "camera.yaml", ROS)
    patterns = ("--points", tmp_path / "clouds/*", "--image-labels", tmp_path / "labels/*")
    run_import("folder", *patterns, "--camera-info", tmp_path / "camera.yaml", "-o", tmp_path / "drive")
    frames = read_drive(tmp_path / "drive").frames
    assert [(frame.points_stamp, frame.image_stamp) for frame in frames] == [(None, None), (None, None)]


def test_pairs_by_time_are_each_others_nearest() -> None:
    """Of two clouds near one picture the nearer takes it; what is too far stays alone; the order does not matter."""
    clouds = files("1000000000.00.bin", "1000000000.10.bin", "1000000000.14.bin", "1000000000.50.bin")
    pictures = files("1000000000.60.png", "1000000000.13.png", "1000000000.02.png")
    expected = {clouds[0]: pictures[2], clouds[2]: pictures[1]}
    assert pairs(clouds, pictures, max_gap_s=0.05) == expected
    assert pairs(clouds, pictures, max_gap_s=0.11) == expected | {clouds[3]: pictures[0]}


def test_pairs_by_name_whatever_the_suffix() -> None:
    clouds, pictures = files("a/000001.pcd.bin", "a/000002.pcd.bin"), files("b/000002.png", "b/000003.png")
    assert pairs(clouds, pictures, max_gap_s=0.05) == {clouds[1]: pictures[0]}
    with pytest.raises(InputError, match=r"^b/1.png: found the name of a/1.png, needed names that tell"):
        pairs(files("a/1.bin"), files("a/1.png", "b/1.png"), max_gap_s=0.05)


def own_data_without(root: Path, *names: str) -> list[object]:
    arguments = own_data(root)
    for name in names:
        (root / name).unlink()
    return arguments


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
    assert "note: --image-labels: 2 pairs by name; unpaired: 1 clouds, 1 files\n" in stderr


def test_clouds_that_have_one_label_set_each(tmp_path: Path) -> None:
    arguments = own_data_without(tmp_path / "own", "clouds/000002.label", "clouds/000003.label")
    assert complaint("folder", *arguments, "-o", tmp_path / "drive") == (
        "--points: found 3 clouds, 1 with a file of --point-labels, 2 with one of --image-labels, "
        "none with both, needed at least one"
    )
    arguments[arguments.index("--image-labels")] = "--images"
    assert "1 with a file of --point-labels, 2 with one of --images," in complaint(
        "folder", *arguments, "-o", tmp_path / "drive"
    )


def test_a_pattern_that_finds_nothing(tmp_path: Path) -> None:
    arguments = own_data(tmp_path / "own")
    arguments[1] = tmp_path / "own/*.pcd"
    assert complaint("folder", *arguments, "-o", tmp_path / "drive") == (
        f"--points: {tmp_path}/own/*.pcd: found no such files, needed at least one; quote the pattern"
    )


def test_nothing_that_can_be_paired(tmp_path: Path) -> None:
    arguments = own_data_without(tmp_path / "own", "labels/000002.png", "labels/000003.png")
    assert complaint("folder", *arguments, "-o", tmp_path / "drive") == (
        "--image-labels: found no partner, by name, for any of 3 clouds (as 000001.bin) "
        "among 1 files (as 000004.png)"
    )
