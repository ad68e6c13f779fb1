"""The motion of the LiDAR in a recording: poses, transforms and spins, and those that do not fit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bag_imports import (
    CHAIN,
    FAR,
    MAST,
    RECORDS,
    STAMP_S,
    T_MOUNT,
    Maker,
    cloud,
    fixed,
    imported,
    moved,
    moving,
    odometry,
    refused,
    remarks,
    run_cli,
    small,
)
from bags import NS, START_NS, BagWriter, Messages

from semcal_cli.drive.document import read_drive
from semcal_cli.importing.bags.messages import Message, Topic
from semcal_cli.importing.bags.recorded_motion import MotionSource, Trajectory
from semcal_cli.observations.reading import load_points, read_clouds

SOURCES: dict[str, tuple[dict[str, Maker], dict[str, Any]]] = {
    "odometry": ({"odom": odometry("base")}, {}),
    "tf": ({"tf": moving("world", "base")}, {}),
    "pose": ({"pose": lambda bag, index, stamp: bag.pose(moved(stamp), stamp)},
             {"motion": "/pose", "motion_frame": "base"}),
}  # fmt: skip


@pytest.mark.parametrize("source", SOURCES)
def test_poses_become_the_motion_of_the_lidar(source: str, tmp_path: Path) -> None:
    messages, settings = SOURCES[source]
    path = small(tmp_path, count=8, tf_static=CHAIN, **messages)
    document = imported(path, tmp_path / "drive", **settings)
    assert document["motion"]["point_times"] == "relative"
    rows = np.loadtxt(tmp_path / "drive" / document["motion"]["poses"])
    stamps = START_NS + np.arange(8) * NS // 10
    np.testing.assert_allclose(rows[:, 0], stamps / NS, atol=1e-6)
    expected = [(moved(int(stamp)) @ MAST @ T_MOUNT)[:3, 3] for stamp in stamps]
    np.testing.assert_allclose(rows[:, 1:4], expected, atol=1e-9)
    # The first and the last frame have no poses before or after their points.
    assert 5 <= len(document["frames"]) <= 7
    assert load_points(read_drive(tmp_path / "drive")).num_frames == len(document["frames"])
    run_cli("inspect", tmp_path / "drive", code=None)


def test_poses_in_any_order() -> None:
    bag = Messages("sqlite3")
    message = bag.odometry(moved(START_NS), START_NS, "base")
    raw, topic = bag.raw(message), Topic("/odom", message.__msgtype__)
    trajectory = Trajectory(MotionSource(topic, "base", "odom"), np.eye(4))
    assert trajectory.position(START_NS) is None
    tenths = []
    for tenth in (2, 0, 1, 1):
        # With the time of receipt, one message can be a pose of any time.
        trajectory.take(Message(topic, START_NS + tenth * NS // 10, raw), received=True)
        tenths.append(tenth)
        assert trajectory.covers(START_NS + NS // 20) == (tenths != [2])
        times = [float(line.split()[0]) - STAMP_S for line in trajectory.tum().splitlines()]
        assert times == pytest.approx([each / 10 for each in sorted(set(tenths))], abs=1e-6)


def test_motion_needs_times_of_points_and_can_be_refused(tmp_path: Path) -> None:
    still = RECORDS.copy()
    still["time"] = 0.0
    path = small(tmp_path, tf_static=CHAIN, points=cloud(still), odom=odometry("base"))
    assert "no motion is written" in remarks(path, tmp_path / "drive")
    assert "motion" not in imported(path, tmp_path / "none", motion="none")
    given = {"motion": "none", "odometry": True}
    assert "not estimated: points have no times" in remarks(path, tmp_path / "sweeps", **given)


@pytest.mark.parametrize("fields", [["x", "y", "z"], ["x", "y", "z", "time"]])
def test_a_spin_gives_the_times_that_points_lack(fields: list[str], tmp_path: Path) -> None:
    """Where there is no field, or one that tells nothing."""
    angles = np.linspace(-3.0, 3.0, 20)
    records = RECORDS[fields].copy()
    records["x"], records["y"] = 9.0 * np.cos(angles), 9.0 * np.sin(angles)
    if "time" in fields:
        records["time"] = 5.0
    path = small(tmp_path, tf_static=CHAIN, points=cloud(records), odom=odometry("base"))
    run_cli("import", "bag", path, "--spin", "10:ccw:180:start", "-o", tmp_path / "drive")
    document = yaml.safe_load((tmp_path / "drive/drive.yaml").read_text())
    spin = {"rate_hz": 10.0, "clockwise": False, "seam_deg": 180.0, "stamp": "start"}
    assert document["lidar"] == {"spin": spin}
    run_cli("import", "bag", path, "--origin", "1.4", "0", "-0.5", "-o", tmp_path / "moved")
    moved = yaml.safe_load((tmp_path / "moved/drive.yaml").read_text())
    assert moved["lidar"] == {"origin_m": [1.4, 0.0, -0.5]}
    assert document["motion"]["point_times"] == "relative"
    frames = load_points(read_drive(tmp_path / "drive")).frame_observations
    # At 10 m/s, the points of a sweep of 0.1 s are moved by up to a metre.
    measured = np.stack([records[axis] for axis in "xyz"], axis=1)
    assert all(np.linalg.norm(frame.cloud.points - measured, axis=1).max() > 0.5 for frame in frames)
    for wrong, problem in {
        "10:cw": "found '10:cw', expected HZ:cw|ccw:SEAM_DEG[:start|middle|end], such as",
        "10:left:0": "found '10:left:0', expected HZ:cw|ccw:SEAM_DEG",
        "10:cw:0:end:1": "found '10:cw:0:end:1', expected HZ:cw|ccw:SEAM_DEG",
        "0:cw:0": "HZ: found 0.0, needed at least 1.0",
        "10:cw:0:late": "stamp: found 'late', expected 'start', 'middle' or 'end'",
    }.items():
        result = run_cli("import", "bag", path, "--spin", wrong, "-o", tmp_path / "drive", code=2)
        assert problem in result.stderr


TURNS: dict[str, tuple[dict[str, Maker], dict[str, Any], str]] = {
    "no such topic": ({"odom": odometry("lidar")}, {"motion": "/x"},
                      "--motion: found no topic '/x' of poses, expected one of: /odom"),
    "a frame that stands": ({"tf": fixed({("map", "lidar"): T_MOUNT})}, {"motion": "/tf"},
                            "--motion /tf: found the moving frames none"),
    "a pose of nothing": ({"pose": SOURCES["pose"][0]["pose"]}, {"motion": "/pose"}, "add --motion-frame FRAME"),
    "another body": ({"odom": odometry("gps")}, {"motion": "/odom"}, "--motion /odom: found poses of 'gps'"),
}  # fmt: skip


@pytest.mark.parametrize("turn", TURNS)
def test_motion_that_does_not_fit_gets_one_line(turn: str, tmp_path: Path) -> None:
    changes, settings, expected = TURNS[turn]
    assert expected in refused(small(tmp_path, **changes), tmp_path / "drive", **settings)


def test_poses_of_other_bodies_do_not_count(tmp_path: Path) -> None:
    """Nor do those that are none."""

    def two_bodies(bag: BagWriter, index: int, stamp: int) -> Any:
        bag.write("/odom", bag.odometry(FAR, stamp + 1, "gps"), stamp)
        lost = moved(stamp)
        lost[0, 3] = np.nan if index == 3 else lost[0, 3]
        return bag.odometry(lost, stamp, "lidar")

    path = small(tmp_path, count=9, odom=two_bodies)
    document = imported(path, tmp_path / "drive", motion="/odom", motion_frame="lidar")
    rows = np.loadtxt(tmp_path / "drive" / document["motion"]["poses"])
    assert rows[:, 1].max() < 100.0
    assert len(rows) == 8


def test_own_points_are_stated_where_the_recording_has_them(tmp_path: Path) -> None:
    path = small(tmp_path, tf_static=CHAIN)
    run_cli("import", "bag", path, "--own-points", "X=2:5", "-o", tmp_path / "drive")
    drive = read_drive(tmp_path / "drive")
    assert drive.lidar is not None
    assert drive.lidar.own_values == ("X", (2.0, 5.0))
    (cloud, *_) = read_clouds(drive)
    np.testing.assert_array_equal(cloud.points[:, 0], [2, 3, 4, 5])
    for wrong, problem in {
        "lidar=1": "--own-points: found the fields x, y, z, time, expected 'lidar' among them",
        "x=900": "--own-points: found 'x' from 0 to 19, expected points from 900 to 900",
    }.items():
        result = run_cli("import", "bag", path, "--own-points", wrong, "-o", tmp_path / "none", code=1)
        assert problem in str(result.exception)
