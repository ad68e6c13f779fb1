"""The motion of the LiDAR from its own sweeps: poses, what is left out, recordings, and drives."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import yaml
from bag_imports import done, recorded, run_cli
from bags import NS, BagWriter
from commands import unwrapped
from moving_street import NUM_SWEEPS, SWEEP_S, MovingStreet, stamp_s

from semcal_cli import errors
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.stated_motion import Motion
from semcal_cli.geometry.arrays import Pose
from semcal_cli.importing.drive_odometry import drive_motion
from semcal_cli.importing.stamps import tum_text
from semcal_cli.importing.sweep_odometry import DOUBTFUL_NS, SIGMA, Odometry
from semcal_cli.observations.reading import load_observations, read_clouds

POINTS = 15_000
"""Points of a sweep, of which a 16-beam LiDAR has twice as many."""
LEAST_ERROR_OF_WAY, LEAST_ERROR_DEG = 0.01, 0.3
"""A hundredth of the way; and 0.2 degrees of sweeps with 40,000 points, with fewer a little more."""
UNTWISTED_M = 0.05
"""Median distance of points untwisted by odometry from those by the truth: a sixth of what 10 m/s cost."""


@pytest.fixture(scope="module")
def street() -> MovingStreet:
    return MovingStreet(10.0, -0.2, seed=110, points=POINTS, width=160)


def estimated(street: MovingStreet, indices: Iterable[int] = range(NUM_SWEEPS)) -> Odometry:
    odometry = Odometry()
    for index in indices:
        sweep = street.sweep(index)
        odometry.add(sweep.points, sweep.times_s, round(stamp_s(index) * NS))
    return odometry


def inner(poses: dict[int, Pose]) -> dict[int, Pose]:
    """The poses of sweeps, without those before and after."""
    return dict(list(poses.items())[1:-1])


@pytest.mark.parametrize("speed_m_s", [5.0, 15.0])
def test_twisted_sweeps_tell_the_way_and_the_turn(speed_m_s: float) -> None:
    street = MovingStreet(speed_m_s, 0.2, seed=100, points=POINTS, width=16)
    odometry = estimated(street)
    error_m, error_deg = street.errors(inner(odometry.poses()))
    assert error_m <= LEAST_ERROR_OF_WAY * speed_m_s * SWEEP_S * NUM_SWEEPS
    assert error_deg <= LEAST_ERROR_DEG
    assert not odometry.doubtful_ns


def test_lost_sweeps_and_sweeps_that_come_twice_do_no_harm(street: MovingStreet) -> None:
    indices = [0, 1, 2, 3, 3, 4, 7, 8, 9, 11, 10, 12, 13]
    poses = inner(estimated(street, indices).poses())
    assert len(poses) == len(set(indices)) - 1  # the one that is late is left out as well
    assert street.errors(poses)[0] <= LEAST_ERROR_OF_WAY * 10.0 * 1.4


def test_the_same_sweeps_give_the_same_bytes(street: MovingStreet) -> None:
    first, second = (tum_text(estimated(street, range(8)).poses()) for _ in range(2))
    assert first == second


def test_a_motion_that_jumps_is_left_out() -> None:
    """After half the way the rig is in another street, as after a tunnel."""
    streets = [MovingStreet(10.0, 0.0, seed, points=POINTS, width=16) for seed in (1, 2)]
    odometry = Odometry()
    for index in range(NUM_SWEEPS):
        sweep = streets[index // (NUM_SWEEPS // 2)].sweep(index)
        odometry.add(sweep.points, sweep.times_s, round(stamp_s(index) * NS))
    jump_ns = round((stamp_s(NUM_SWEEPS // 2) + 0.5 * SWEEP_S) * NS)
    assert min(abs(each - jump_ns) for each in odometry.doubtful_ns) <= 2 * SWEEP_S * NS
    poses = odometry.poses()
    assert all(abs(stamp - jump) > DOUBTFUL_NS for stamp in poses for jump in odometry.doubtful_ns)
    assert min(poses) < jump_ns < max(poses)


def tunnel(seed: int, x_m: float = 0.0, depth_m: float = 0.0) -> npt.NDArray[np.float32]:
    """A sweep from a place between two smooth walls, with a pillar of a metre on them every ten."""
    rng = np.random.default_rng(seed)
    azimuth, elevation = rng.uniform(-np.pi, np.pi, POINTS), np.radians(rng.uniform(-25.0, 15.0, POINTS))
    rays = np.stack(
        [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)]
    )
    wall, front = 4.5 / np.abs(rays[1]), (4.5 - depth_m) / np.abs(rays[1])
    ranges = np.where((x_m + front * rays[0]) % 10.0 < 1.0, front, wall)
    for side_m in np.add.outer(10.0 * np.arange(-6, 7), [0.0, 1.0]).ravel() - x_m % 10.0:
        side = side_m / rays[0]
        is_hit = (side > front) & (side < ranges)
        ranges = np.where(is_hit, side, ranges)
    ranges = np.minimum(ranges, np.where(rays[2] > 0.0, 3.5, 1.8) / np.abs(rays[2]))
    return (rays * (ranges + rng.normal(0.0, 0.03, POINTS))).T.astype(np.float32)


def test_a_tunnel_tells_nothing_along_the_way() -> None:
    odometry = Odometry()
    for index in range(3):
        odometry.add(tunnel(index), None, (index + 1) * NS // 10)
    assert len(odometry.doubtful_ns) == 3
    assert not odometry.poses()


def test_a_plain_world_does_not_seem_to_stand() -> None:
    """Walls and ground fit a standstill as well; what overlaps tells that pillars go by at 25 m/s."""
    odometry = Odometry()
    for index in range(5):
        odometry.add(tunnel(index, 2.5 * index, depth_m=1.0), None, (index + 1) * NS // 10)
    poses = list(inner(odometry.poses()).values())
    assert len(poses) == 5
    assert np.linalg.norm(poses[-1][:3, 3] - poses[0][:3, 3]) == pytest.approx(10.0, rel=0.05)


def test_a_recording_without_poses_gets_them_from_its_sweeps(street: MovingStreet, tmp_path: Path) -> None:
    path = recorded(tmp_path, street)
    result = run_cli("import", "bag", path, "-o", tmp_path / "drive", "--odometry")
    assert "estimates the motion of the LiDAR from the sweeps; the drive uses it" in " ".join(
        result.stderr.split()
    )
    drive = read_drive(tmp_path / "drive")
    assert len(drive.frames) == 12
    assert drive.motion is not None
    assert drive.motion.sigma is not None
    assert drive.motion.sigma.linear_m_s == SIGMA["linear_m_s"]
    lines = (tmp_path / "drive" / str(drive.motion.poses)).read_text().splitlines()
    assert lines[0].startswith("# KISS-ICP ")
    run_cli("import", "bag", path, "-o", tmp_path / "again", "--odometry")
    assert (tmp_path / "again/poses/drive.txt").read_text().splitlines() == lines


@pytest.mark.parametrize("is_true", [True, False])
def test_a_recordings_own_odometry_is_preferred_and_compared(
    is_true: bool, street: MovingStreet, tmp_path: Path
) -> None:
    """It may say that the rig stands."""

    def pose(bag: BagWriter, index: int, stamp: int) -> Any:
        return bag.odometry(street.pose(stamp / NS) if is_true else np.eye(4), stamp, "lidar")

    path = recorded(tmp_path, street, odom=pose)
    found = {
        motion: "\n".join(done(path, tmp_path / str(motion), odometry=True, motion=motion).written.remarks)
        for motion in (None, "none")
    }
    assert "/odom states the motion of 'lidar'" in found[None]
    assert ("/odom agrees with the motion estimated from the sweeps" in found[None]) == is_true
    way = r"/odom disagrees with .* the sweeps: they differ by (9\.9|10) m/s and 1[12] degrees per second"
    assert bool(re.search(way, found[None])) == (not is_true)
    assert ("--motion none uses that of the sweeps" in found[None]) == (not is_true)
    assert "KISS-ICP" in found["none"]
    assert "/odom" not in found["none"]


def test_a_drive_of_consecutive_sweeps_is_untwisted_by_them(street: MovingStreet, tmp_path: Path) -> None:
    path = street.write(tmp_path / "drive", count=8)
    result = run_cli("odometry", path, "-o", tmp_path / "drive/estimated.txt")
    block = result.stderr.partition("motion: ")[2].strip()
    assert "agrees" not in result.stderr
    assert "point times" not in result.stderr
    assert block == (
        "{poses: estimated.txt, point_times: relative, sigma: {linear_m_s: 0.1, angular_rad_s: 0.01}}"
    )
    drive, true = read_drive(path), Motion(poses="true.txt")
    untwisted = {
        name: load_observations(drive.model_copy(update={"motion": motion}))
        for name, motion in {"by": Motion(**yaml.safe_load(block)), "true": true, "not": None}.items()
    }

    def off_m(name: str) -> float:
        pairs = zip(untwisted[name].clouds, untwisted["true"].clouds, strict=True)
        return float(np.median([np.linalg.norm(a.points - b.points, axis=1).mean() for a, b in pairs]))

    assert "no poses around" not in result.stderr
    path.write_text(path.read_text() + "motion: {poses: true.txt}\n")
    again = run_cli("odometry", path, "-o", tmp_path / "drive/again.txt").stderr
    assert "note: motion.poses of the drive agrees with the motion estimated from the sweeps" in " ".join(
        again.split()
    )
    assert off_m("by") <= UNTWISTED_M < 0.2 < off_m("not")


@pytest.mark.parametrize("is_stated", [True, False])
def test_sweeps_without_times_are_said_to_be_taken_as_deskewed(
    street: MovingStreet, tmp_path: Path, is_stated: bool
) -> None:
    path = street.write(tmp_path / "drive", count=8)
    for number, cloud in enumerate(read_clouds(read_drive(path))):
        np.save(tmp_path / f"drive/{number:06d}.npy", cloud.points)
    text = path.read_text().replace(".pcd", ".npy")
    path.write_text(text + "motion: {poses: true.txt, point_times: deskewed}\n" * is_stated)
    said = unwrapped(run_cli("odometry", path, "-o", tmp_path / "drive/estimated.txt").stderr, 6)
    assert ("note: 8 of 8 sweeps have no point times, and are taken as deskewed" in said) == (not is_stated)


def test_frames_beside_a_gap_have_poses_and_lone_ones_have_none(street: MovingStreet, tmp_path: Path) -> None:
    path = street.write(tmp_path / "drive", count=12)
    document = yaml.safe_load(path.read_text())
    document["frames"] = [*document["frames"][:4], *document["frames"][-2:]]
    lone = dict(document["frames"][0], points_stamp=90.0, image_stamp=90.05, points="lone.pcd")
    (tmp_path / "drive/lone.pcd").write_bytes((tmp_path / "drive/000000.pcd").read_bytes())
    path.write_text(yaml.safe_dump(document | {"frames": [lone, *document["frames"]]}))
    motion = drive_motion(read_drive(path))
    assert motion.uncovered == ["lone.pcd"]
    assert not motion.doubtful_ns
    assert len(motion.poses) == 4 + 2 + 2 * 2


@pytest.mark.parametrize(("every", "reason"), [(10, "1 s apart"), (40, "found 1 sweep")])
def test_sweeps_that_do_not_follow_one_another_are_refused(
    every: int, reason: str, street: MovingStreet, tmp_path: Path
) -> None:
    path = street.write(tmp_path / "drive", every=every)
    result = run_cli("odometry", path, "-o", tmp_path / "poses.txt", code=1)
    assert reason in str(result.exception)
    assert "expected consecutive ones" in str(result.exception)
    assert not (tmp_path / "poses.txt").exists()


@pytest.mark.parametrize("command", ["odometry d -o p.txt", "import bag d -o p --odometry"])
def test_without_the_extra_one_line_says_what_to_install(
    command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    is_installed = errors.is_installed
    monkeypatch.setattr(errors, "is_installed", lambda name: name != "kiss_icp" and is_installed(name))
    result = run_cli(*command.split(), code=1)
    asked = "semcal odometry" if command.startswith("odometry") else "--odometry"
    assert str(result.exception) == f"{asked}: found no kiss_icp; install {errors.describe_extra('odometry')}"
