"""`semcal merge`: drives of one rig become one drive."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from commands import invoke

from semcal_cli.drive.document import read_drive

CAMERA = {"model": "plumb_bob", "width": 64, "height": 32, "K": [[50.0, 0, 31.5], [0, 50.0, 15.5], [0, 0, 1]]}


def write_drive(folder: Path, first_s: float, **changes: object) -> Path:
    """Write a drive of two frames, with poses around them."""
    folder.mkdir()
    stamps = [first_s, first_s + 1.0]
    frames = [{"points": f"{i}.bin", "points_stamp": t, "image_stamp": t} for i, t in enumerate(stamps)]
    document = {
        "semcal_drive": 1,
        "camera": CAMERA,
        "frames": frames,
        "motion": {"poses": "lidar.txt", "point_times": "deskewed"},
        "synchronization": "stamps",
        **changes,
    }
    (folder / "drive.yaml").write_text(yaml.safe_dump(document))
    for index in range(2):
        np.ones((5, 4), np.float32).tofile(folder / f"{index}.bin")
    lines = [f"{first_s + step} {step} 0 0 0 0 0 1" for step in (-0.5, 0.5, 1.5)]
    (folder / "lidar.txt").write_text("# poses\n" + "\n".join(lines))
    return folder


def test_frames_and_poses_are_joined(tmp_path: Path) -> None:
    late, early = write_drive(tmp_path / "late", 100.0), write_drive(tmp_path / "early", 10.0)
    result = invoke("merge", late, early, "-o", tmp_path / "both")
    assert result.exit_code == 0, result.output
    assert result.stderr == f"wrote {tmp_path / 'both' / 'drive.yaml'}: 4 frames of 2 drives\n"
    drive = read_drive(tmp_path / "both")
    names = ["../late/0.bin", "../late/1.bin", "../early/0.bin", "../early/1.bin"]
    assert [frame.points for frame in drive.frames] == names
    assert drive.motion is not None
    assert drive.motion.poses == "poses/drive.txt"
    poses = np.loadtxt(tmp_path / "both" / "poses" / "drive.txt")
    np.testing.assert_allclose(poses[:, 0], [9.5, 10.5, 11.5, 99.5, 100.5, 101.5])
    assert (drive.synchronization, drive.motion.point_times) == ("stamps", "deskewed")
    assert "time_offset_sigma_s" not in drive.model_fields_set


def test_what_differs_is_said(tmp_path: Path) -> None:
    T = np.eye(4).tolist()
    first = write_drive(tmp_path / "first", 10.0, T_camera_lidar=T)
    second = write_drive(tmp_path / "second", 20.0, synchronization="hardware")
    result = invoke("merge", first, second, "-o", tmp_path / "both")
    for key in ("synchronization", "T_camera_lidar"):
        assert f"note: {key} is not the same in all drives, and is left out" in result.stderr
    drive = read_drive(tmp_path / "both")
    assert (drive.synchronization, drive.T_camera_lidar) == ("unknown", None)


@pytest.mark.parametrize(
    ("changes", "first_s", "message"),
    [
        ({"camera": CAMERA | {"width": 65}}, 20.0, "camera: found another width, expected the same camera"),
        (
            {"camera": CAMERA | {"mask": "m.png"}},
            20.0,
            "camera.mask: found '{second}/m.png', expected nothing as in {first}",
        ),
        (
            {"classes": {"points": {"road": [1]}}},
            20.0,
            "classes: found a mapping, expected nothing as in {first}",
        ),
        (
            {"motion": {"speed_m_s": 1.0}},
            20.0,
            "motion.poses: found nothing, expected 'a file' as in {first}",
        ),
        ({"time_unit": "ms"}, 20.0, "time_unit: found 'ms', expected nothing as in {first}"),
        (
            {"point_columns": ["x", "y", "z", "time"]},
            20.0,
            "point_columns: found ['x', 'y', 'z', 'time'], expected nothing as in {first}",
        ),
        (
            {"motion": {"poses": "lidar.txt", "point_times": "absolute"}},
            10.5,
            "found poses from 10.000 s on, before the last of",
        ),
    ],
)
def test_drives_that_do_not_fit(tmp_path: Path, changes: dict, first_s: float, message: str) -> None:
    both = {"motion": changes["motion"]} if first_s < 20.0 else {}
    first = write_drive(tmp_path / "first", 10.0, **both)
    second = write_drive(tmp_path / "second", first_s, **changes)
    result = invoke("merge", first, second, "-o", tmp_path / "both")
    assert message.format(first=first / "drive.yaml", second=second) in str(result.exception)
    assert not (tmp_path / "both" / "drive.yaml").exists()


def test_drives_whose_clocks_begin_anew_follow_one_another(tmp_path: Path) -> None:
    """Their frames are 10 s apart, and so are their poses, which reach half a second beyond them."""
    first, second = write_drive(tmp_path / "first", 0.0), write_drive(tmp_path / "second", 0.2)
    result = invoke("merge", first, second, "-o", tmp_path / "both")
    assert result.exit_code == 0, result.output
    assert "note: the clocks of the drives begin anew: each is placed 10 s after" in result.stderr
    drive = read_drive(tmp_path / "both")
    for key in ("points_stamp", "image_stamp"):
        assert [getattr(frame, key) for frame in drive.frames] == [0.0, 1.0, 11.0, 12.0]
    poses = np.loadtxt(tmp_path / "both" / "poses" / "drive.txt")
    np.testing.assert_allclose(poses[:, 0], [-0.5, 0.5, 1.5, 10.5, 11.5, 12.5])
    np.testing.assert_array_equal(poses[:3, 1:], poses[3:, 1:])


def test_the_key_and_the_values_that_differ_are_named(tmp_path: Path) -> None:
    lidar = {"channels": 64, "columns": 2048, "fov_up_deg": 3.0, "fov_down_deg": -25.0}
    spin = {"rate_hz": 10.0, "clockwise": True, "seam_deg": 180.0}
    first = write_drive(tmp_path / "first", 10.0, lidar=lidar | {"spin": spin})
    second = write_drive(tmp_path / "second", 20.0, lidar=lidar | {"spin": spin | {"rate_hz": 20.0}})
    result = invoke("merge", first, second, "-o", tmp_path / "both")
    problem = f"lidar.spin.rate_hz: found 20.0, expected 10.0 as in {first / 'drive.yaml'}"
    assert str(result.exception) == f"{second / 'drive.yaml'}: {problem}"


def test_a_frame_counts_once(tmp_path: Path) -> None:
    """Under another name of its drive, too; the same sweep with another image is another frame."""
    first = write_drive(tmp_path / "first", 10.0)
    (tmp_path / "link").symlink_to(first)
    for again in (first, tmp_path / "link"):
        result = invoke("merge", first, again, "-o", tmp_path / "both")
        found = (
            f"frames[0.bin].points: found a frame that {first / 'drive.yaml'} has, too, expected other frames"
        )
        assert found in str(result.exception)
    document = yaml.safe_load((first / "drive.yaml").read_text())
    for index, frame in enumerate(document["frames"]):
        frame["image"] = f"{index}.png"
    (first / "other.yaml").write_text(yaml.safe_dump(document))
    assert invoke("merge", first, first / "other.yaml", "-o", tmp_path / "both").exit_code == 0


def test_drives_on_one_clock_do_not_overlap(tmp_path: Path) -> None:
    """Stamps since 1970 are on one clock: two drives of one moment are not of one rig."""
    first, second = (
        write_drive(tmp_path / name, 1.5e9 + at) for name, at in (("first", 0.0), ("second", 0.5))
    )
    result = invoke("merge", first, second, "-o", tmp_path / "both")
    assert "expected drives of different times" in str(result.exception)


def test_the_poses_of_another_drive_do_not_cover_a_frame(tmp_path: Path) -> None:
    """Between the drives, the joined poses lead from one world to the other."""
    first, second = write_drive(tmp_path / "first", 10.0), write_drive(tmp_path / "second", 20.0)
    document = yaml.safe_load((first / "drive.yaml").read_text())
    document["frames"][1] |= {"points_stamp": 12.0, "image_stamp": 12.0}
    (first / "drive.yaml").write_text(yaml.safe_dump(document))
    result = invoke("merge", first, second, "-o", tmp_path / "both")
    assert str(result.exception).startswith(f"{first / 'lidar.txt'}: ")
    assert str(result.exception).endswith("expected poses before and after 1.bin")
    assert not (tmp_path / "both").exists()


def test_a_drive_is_not_replaced_by_the_merged_one(tmp_path: Path) -> None:
    first = write_drive(tmp_path / "first", 10.0)
    result = invoke("merge", first, "-o", first)
    assert "found one of the drives to merge; choose another -o" in str(result.exception)
    (first / "poses").mkdir()
    (first / "lidar.txt").rename(first / "poses" / "all.txt")
    content = (first / "drive.yaml").read_text()
    (first / "drive.yaml").write_text(content.replace("lidar.txt", "poses/all.txt"))
    result = invoke("merge", first, "-o", first / "all.yaml", "--force")
    assert f"all.txt: found the poses of {first / 'drive.yaml'}; choose another -o" in str(result.exception)


def test_only_a_drive_of_the_same_data_is_replaced(tmp_path: Path) -> None:
    first, other = write_drive(tmp_path / "first", 10.0), write_drive(tmp_path / "other", 10.0)
    before = (other / "drive.yaml").read_text()
    result = invoke("merge", first, "-o", other)
    assert "found a drive of other data; choose another -o, or --force" in str(result.exception)
    assert (other / "drive.yaml").read_text() == before
    assert not (other / "poses").exists()
    for again in ((), (), ("--force",)):
        out = other if again else tmp_path / "both"
        assert invoke("merge", first, "-o", out, *again).exit_code == 0
