"""The spin of a LiDAR: times by azimuth, in drives, odometry, imports and `inspect`."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import START_NS, Messages
from dataset_imports import Import
from dataset_trees import KITTI_360_DRIVE, KITTI_RAW_DRIVE, moved, numbers, write, write_cloud, write_ids

from semcal_cli.checks.inspection import inspect
from semcal_cli.checks.seam import check_seam, seam_of
from semcal_cli.drive.camera import Camera
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.lidar import Lidar
from semcal_cli.drive.stated_motion import Motion
from semcal_cli.errors import InputError
from semcal_cli.files.documents import document_text
from semcal_cli.importing.bags.messages import Message, Topic
from semcal_cli.importing.bags.point_messages import read_sweep
from semcal_cli.importing.drive_odometry import drive_motion
from semcal_cli.importing.kitti_motion import MOMENT_S, read_packet
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.motion import compensated, read_poses, read_trajectory
from semcal_cli.observations.reading import load_points, read_clouds

KITTI = {"rate_hz": 10.0, "clockwise": True, "seam_deg": 180.0}
TWIST = {"linear_m_s": [9.0, 0.5, -0.2], "angular_rad_s": [0.03, -0.02, 0.35]}
PATTERN = {"channels": 64, "columns": 1024, "fov_up_deg": 10.0, "fov_down_deg": -30.0}
CAMERA = Camera(model="plumb_bob", width=64, height=32, K=((50, 0, 31.5), (0, 50, 15.5), (0, 0, 1)))


def around(azimuths_deg: Any, range_m: float = 10.0) -> np.ndarray:
    """Points (N, 3) at azimuths in degrees."""
    angles = np.radians(azimuths_deg)
    return (range_m * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)).astype(np.float32)


def lidar(**changes: Any) -> Lidar:
    return Lidar.model_validate({"spin": KITTI | changes})


@pytest.mark.parametrize(
    ("changes", "times_ms"),
    [
        ({}, [0.0, -25.0, 25.0, 47.5]),
        ({"stamp": "start"}, [50.0, 25.0, 75.0, 97.5]),
        ({"stamp": "end"}, [-50.0, -75.0, -25.0, -2.5]),
        ({"clockwise": False}, [0.0, 25.0, -25.0, -47.5]),
        ({"rate_hz": 20.0, "seam_deg": -90.0}, [12.5, 0.0, -25.0, -13.75]),
    ],
)
def test_the_time_is_the_azimuth(changes: dict[str, Any], times_ms: list[float]) -> None:
    """Ahead, to the left, to the right, and 9 degrees beside the opposite of ahead."""
    spin = lidar(**changes).spin
    assert spin is not None
    times = spin.times(around([0.0, 90.0, -90.0, -171.0]))
    expected = np.array(times_ms)
    # A point on the seam may count as the first or as the last one.
    np.testing.assert_allclose((1e3 * times - expected + 1.0) % (1e3 / spin.rate_hz), 1.0, atol=1e-3)
    assert np.ptp(times) < 1.0 / spin.rate_hz


@pytest.mark.parametrize(
    ("block", "says"),
    [
        (
            {},
            "found nothing, expected channels, columns, fov_up_deg, fov_down_deg together, origin_m, own_points, or "
            "spin",
        ),
        (
            {"channels": 64, "spin": KITTI},
            "found channels, expected channels, columns, fov_up_deg, fov_down_deg together",
        ),
        ({"spin": {"rate_hz": 10.0, "seam_deg": 0.0}}, "spin.clockwise: found nothing, expected a value"),
        ({"spin": KITTI | {"rate_hz": 0.1}}, "spin.rate_hz: found 0.1, needed at least 1.0"),
        (
            {"spin": KITTI | {"stamp": "begin"}},
            "spin.stamp: found 'begin', expected 'start', 'middle' or 'end'",
        ),
    ],
)
def test_what_is_no_lidar_is_named(block: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError) as error:
        Drive.from_arrays(points=[around([0.0])], camera=CAMERA, lidar=block)
    assert str(error.value).removeprefix("arrays: lidar").lstrip(".: ") == says


def test_a_pattern_may_stand_beside_a_spin_or_alone() -> None:
    assert Lidar.model_validate(PATTERN).pattern == tuple(PATTERN.values())
    assert lidar().pattern is None
    assert Lidar.model_validate(PATTERN | {"spin": KITTI}).pattern is not None


def array_drive(points: np.ndarray, **others: Any) -> Drive:
    stamps = {"points_stamps": [100.25], "image_stamps": [100.26]}
    arrays: dict[str, Any] = {"points": [points], "camera": CAMERA, "motion": {"twist": TWIST}, **stamps}
    return Drive.from_arrays(**(arrays | others))


def test_a_sweep_without_times_is_deskewed_as_one_with_them() -> None:
    points = around(np.linspace(-179.0, 179.0, 500))
    times = -np.arctan2(points[:, 1], points[:, 0]).astype(np.float64) / (2.0 * np.pi) * 0.1
    timed, spun = array_drive(points, point_times=[times]), array_drive(points, lidar={"spin": KITTI})
    (one,), (other,) = (compensated(drive, read_clouds(drive)) for drive in (timed, spun))
    np.testing.assert_allclose(other.points, one.points, atol=1e-5)
    assert np.linalg.norm(one.points - points, axis=1).max() > 0.3
    assert not other.is_rigid
    # Times of the file count first.
    both = array_drive(points, point_times=[times], lidar={"spin": KITTI | {"clockwise": False}})
    np.testing.assert_array_equal(compensated(both, read_clouds(both))[0].points, one.points)
    deskewed = array_drive(points, lidar={"spin": KITTI}, motion={"twist": TWIST, "point_times": "deskewed"})
    assert compensated(deskewed, read_clouds(deskewed))[0].is_rigid


def test_times_that_are_all_alike_tell_nothing() -> None:
    """Neither to a calibration nor to `inspect`, with a spin or without."""
    azimuths = 90.0 - np.linspace(0.0, 359.9, 1800)
    points = around(azimuths)
    for others in ({}, {"lidar": {"spin": KITTI}}):
        alike, untimed = (
            array_drive(points, **others, **times) for times in ({"point_times": [0 * azimuths]}, {})
        )
        (one,), (other,) = (compensated(drive, read_clouds(drive)) for drive in (alike, untimed))
        np.testing.assert_array_equal(one.points, other.points)
        assert one.is_rigid == (not others)
        assert not any("point times" in line for line in inspect(alike).suspicions)
        assert len(check_seam(alike, read_clouds(alike))) == (not others)
    # The azimuths of a spin are about the place where the rays start.
    moved = array_drive(points + np.float32([1.0, 8.0, 0.0]), lidar={"origin_m": [1.0, 8.0, 0.0]})
    (finding,) = check_seam(moved, read_clouds(moved))
    assert "clockwise from 90 degrees" in finding.sentence


def test_a_spin_without_a_motion_is_noted() -> None:
    points = around(np.linspace(-179.0, 179.0, 500))
    note = "lidar.spin deskews no sweep, because the drive gives neither motion.poses nor motion.twist"
    for motion, notes in ((None, (note,)), ({"speed_m_s": 8.0}, (note,)), ({"speed_m_s": 0.0}, ())):
        drive = array_drive(points, lidar={"spin": KITTI}, motion=motion)
        assert LoadedDrive(drive, load_points(drive)).notes_on_spin == notes


def room(index: int) -> np.ndarray:
    """The walls (6000, 3) of a room, 0.8 m farther on in each sweep."""
    generator = np.random.default_rng(index)
    walls = generator.uniform(-15.0, 15.0, (6000, 3)) * [1.0, 1.0, 0.2]
    walls[np.arange(6000), generator.integers(0, 2, 6000)] = 15.0 * generator.choice([-1.0, 1.0], 6000)
    return (walls - [0.8 * index, 0.0, 0.0]).astype(np.float32)


def test_odometry_takes_the_times_of_the_spin(tmp_path: Path) -> None:
    pytest.importorskip("kiss_icp")
    document: dict[str, Any] = {"semcal_drive": 1, "camera": CAMERA.model_dump(mode="json"), "frames": []}
    for index in range(4):
        points = room(index)
        records = np.zeros(len(points), [("x", "f4"), ("y", "f4"), ("z", "f4"), ("time", "f8")])
        records["x"], records["y"], records["z"] = points.T
        records["time"] = -np.arctan2(*points.T[[1, 0]].astype(np.float64)) / (2.0 * np.pi) * 0.1
        np.save(tmp_path / f"timed{index}.npy", records)
        np.save(tmp_path / f"plain{index}.npy", points)
        document["frames"].append({"points": "", "points_stamp": 0.1 * index, "image_stamp": 0.1 * index})
    found = []
    for name, block in (("timed", {}), ("plain", {"lidar": {"spin": KITTI}})):
        for index, frame in enumerate(document["frames"]):
            frame["points"] = f"{name}{index}.npy"
        write(tmp_path / f"{name}.yaml", document_text(document | block, "yaml"))
        found.append(drive_motion(read_drive(tmp_path / f"{name}.yaml")).poses)
    assert found[0].keys() == found[1].keys()
    np.testing.assert_allclose([*found[0].values()], [*found[1].values()], atol=1e-6)
    deskewed = Motion.model_validate({"twist": TWIST, "point_times": "deskewed"})
    motion = drive_motion(read_drive(tmp_path / "plain.yaml").model_copy(update={"motion": deskewed}))
    assert motion.point_times == "deskewed"
    assert not np.allclose([*motion.poses.values()], [*found[1].values()], atol=1e-3)


def test_an_import_estimates_the_motion_of_a_data_set(tmp_path: Path) -> None:
    """From all sweeps, of which one frame is kept; the stated motion comes first, and is compared."""
    pytest.importorskip("kiss_icp")
    of = Import("kitti-raw", tmp_path)
    (of.root / KITTI_RAW_DRIVE / "velodyne_points/timestamps.txt").unlink()
    for index in range(6):
        sweep = np.c_[room(index), np.zeros(6000)].astype("<f4")
        (of.root / KITTI_RAW_DRIVE / f"velodyne_points/data/{index:010d}.bin").write_bytes(sweep.tobytes())
        write_ids(of.root / KITTI_RAW_DRIVE / f"image_02/data/{index:010d}.png")
    drive = of.run("--odometry", "--frames", "3:4")
    assert (len(drive.frames), drive.time_offset_s) == (1, MOMENT_S)
    assert drive.motion is not None
    assert "estimates the motion of the LiDAR from the sweeps; the drive uses it" in " ".join(
        of.stderr.split()
    )
    twist = read_trajectory(drive, str(drive.motion.poses)).twist_at(drive.frames[0].points_stamp or 0.0)
    assert twist[0] == pytest.approx(8.0, abs=1.0)
    for index in range(6):
        write(of.root / KITTI_RAW_DRIVE / f"oxts/data/{index:010d}.txt", packet(20.0))
    of.run("--odometry")
    assert "the motion of the data set disagrees with the motion estimated" in " ".join(of.stderr.split())


def packet(forward_m_s: float, *, pitch: float = 0.0, up_m_s: float = 0.0, yaw_rad_s: float = 0.0) -> str:
    values = np.zeros(30)
    values[4], values[8], values[10], values[19] = pitch, forward_m_s, up_m_s, yaw_rad_s
    return numbers(values) + "\n"


def test_a_packet_is_along_the_axes_of_its_unit(tmp_path: Path) -> None:
    """Downhill, at 0.1 rad, the unit moves along its own x axis. KITTI's pitch is positive downwards."""
    downhill = packet(10.0 * np.cos(0.1), pitch=0.1, up_m_s=-10.0 * np.sin(0.1), yaw_rad_s=0.2)
    write(tmp_path / "packet.txt", downhill)
    np.testing.assert_allclose(read_packet(tmp_path / "packet.txt"), [10, 0, 0, 0, 0, 0.2], atol=1e-6)


def with_packets(of: Import, drive: str = KITTI_RAW_DRIVE) -> None:
    for number in range(2):
        write(of.root / drive / f"oxts/data/{number:010d}.txt", packet(8.0, yaw_rad_s=0.1))


def test_kitti_raw_states_its_motion(tmp_path: Path) -> None:
    of = Import("kitti-raw", tmp_path)
    with_packets(of)
    write(of.root / "2011_09_26/calib_imu_to_velo.txt", "R: 1 0 0 0 1 0 0 0 1\nT: -0.8 0.3 -0.8\n")
    drive = of.run()
    assert drive.lidar is not None
    assert drive.lidar.spin is not None
    assert drive.lidar.spin.model_dump() == KITTI | {"stamp": "middle"}
    assert (drive.time_offset_s, drive.synchronization) == (MOMENT_S, "hardware")
    assert drive.motion is not None
    trajectory = read_trajectory(drive, str(drive.motion.poses))
    for frame in drive.frames:
        assert frame.image_stamp == frame.points_stamp
        # The LiDAR is 0.8 m ahead of the inertial unit, and 0.3 m to its right.
        twist = trajectory.twist_at(frame.points_stamp or 0.0)
        np.testing.assert_allclose(twist, [8.03, 0.08, 0, 0, 0, 0.1], atol=1e-4)
    assert "note: sweeps are deskewed by the spin of the LiDAR and the motion in oxts\n" in of.stderr
    write(of.root / KITTI_RAW_DRIVE / "oxts/data/0000000001.txt", "1 2 3\n")
    (of.out / "drive.yaml").unlink()
    says = of.complaint().removeprefix(f"{{root}}/{KITTI_RAW_DRIVE}/oxts/data/0000000001.txt: ")
    assert says == "found 3 values, needed at least 20"


def test_all_drives_of_a_day_are_one_drive(tmp_path: Path) -> None:
    of = Import("kitti-raw", tmp_path)
    other = KITTI_RAW_DRIVE.replace("0001", "0002")
    for drive in (KITTI_RAW_DRIVE, other):
        for number in range(2):
            write_cloud(of.root / drive / f"velodyne_points/data/{number:010d}.bin")
            write_ids(of.root / drive / f"image_02/data/{number:010d}.png")
        with_packets(of, drive)
        (of.root / drive / "velodyne_points/timestamps.txt").unlink(missing_ok=True)
    names = [Path(drive).name for drive in (KITTI_RAW_DRIVE, other)]
    found = of.complaint()
    assert found.startswith("{root}: found 3 sequences, choose one: `semcal import kitti-raw {root} ")
    assert all(f" --sequence {name}`" in found for name in (*names, "2011_09_26"))
    frames = of.run("--sequence", "2011_09_26").frames
    assert [frame.points_stamp for frame in frames] == pytest.approx([0.0, 0.1, 10.1, 10.2])
    assert f"found no calib_imu_to_velo.txt in {of.root}/2011_09_26" in " ".join(of.stderr.split())
    write_ids(tmp_path / "labels/0000000000.png")
    (of.out / "drive.yaml").unlink()
    says = of.complaint("--sequence", "2011_09_26", "--image-labels", tmp_path / "labels")
    assert says.endswith("0000000000.png: found several frames of this name, expected a label file for each")


def test_sequences_keep_their_poses_and_get_times_of_their_own(tmp_path: Path) -> None:
    of = Import("kitti-raw", tmp_path)
    other = KITTI_RAW_DRIVE.replace("0001", "0002")
    for drive, minute in ((KITTI_RAW_DRIVE, 2), (other, 1)):
        for number in range(2):
            write_cloud(of.root / drive / f"velodyne_points/data/{number:010d}.bin")
            write_ids(of.root / drive / f"image_02/data/{number:010d}.png")
        with_packets(of, drive)
        stamps = "".join(f"2011-09-26 13:0{minute}:25.{tenth}00000000\n" for tenth in (1, 2))
        write(of.root / drive / "velodyne_points/timestamps.txt", stamps)
    first, second = Path(KITTI_RAW_DRIVE).name, Path(other).name
    sequences = "--sequence", first, "--sequence", second
    drive = of.run(*sequences)
    assert drive.motion is not None
    stamps_s, _ = read_poses(drive.resolve(str(drive.motion.poses)))
    late, early = (drive.frames[index].points_stamp or 0.0 for index in (0, 2))
    assert late - early == pytest.approx(60.0)
    expected = [start + step for start in (early, late) for step in (-0.1, 0.0, 0.1, 0.2)]
    assert stamps_s == pytest.approx(expected, abs=1e-6)
    for folder in (KITTI_RAW_DRIVE, other):
        (of.root / folder / "velodyne_points/timestamps.txt").unlink()
    spaced = of.run(*sequences, "--force").frames
    assert [frame.points_stamp for frame in spaced] == pytest.approx([0.0, 0.1, 10.1, 10.2])
    shutil.rmtree(of.root / other / "oxts")
    says = of.complaint(*sequences, "--force")
    assert f"--sequence: found poses of {first}, and none of {second}, expected poses of all or none" in says


def test_kitti_360_states_the_motion_of_raw_sweeps(tmp_path: Path) -> None:
    """Frames that its poses do not cover are left out."""
    of = Import("kitti-360", tmp_path)
    for name in ("data_3d_semantics", "data_2d_semantics"):
        (of.root / name).rename(tmp_path / name)
    lines = []
    for number in range(248, 256):
        write_cloud(of.root / f"data_3d_raw/{KITTI_360_DRIVE}/velodyne_points/data/{number:010d}.bin")
        write_ids(of.root / f"data_2d_raw/{KITTI_360_DRIVE}/image_01/data_rect/{number:010d}.png")
        if number < 254:
            lines.append(f"{number} {numbers(moved(np.eye(4), 1000.0 + number, 2000.0, 100.0)[:3])}\n")
    write(of.root / f"data_poses/{KITTI_360_DRIVE}/poses.txt", "".join(lines))
    drive = of.run()
    assert [Path(frame.points).stem for frame in drive.frames] == [f"{n:010d}" for n in range(249, 253)]
    assert drive.motion is not None
    twist = read_trajectory(drive, str(drive.motion.poses)).twist_at(25.05)
    assert np.linalg.norm(twist[:3]) == pytest.approx(10.0)
    assert "note: left out 4 frames without poses around them\n" in of.stderr


def test_a_seam_is_seen_in_the_order_of_the_points() -> None:
    """Sixteen rings that are fired together, and the same ring by ring, as KITTI lists them."""
    azimuths = np.repeat(90.0 - np.linspace(0.0, 359.9, 1800), 16)
    seam = seam_of(around(azimuths))
    assert seam is not None
    assert seam[0]
    assert seam[1] == pytest.approx(90.0, abs=0.5)
    by_ring = azimuths.reshape(1800, 16).T.ravel()
    assert seam_of(around(by_ring)) is None
    assert seam_of(around(np.random.default_rng(1).permutation(azimuths))) is None
    says = "the points have no times, but are in the order of one turn, clockwise from 90 degrees: if "
    for others, count in (({}, 1), ({"lidar": {"spin": KITTI}}, 0), ({"motion": {"speed_m_s": 0.0}}, 0)):
        drive = array_drive(around(azimuths), **others)
        findings = check_seam(drive, read_clouds(drive))
        assert [finding.sentence.startswith(says) for finding in findings] == [True] * count


def test_sweeps_of_recordings_have_the_times_of_the_spin() -> None:
    bag = Messages("ros1")
    fields = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
    records = np.zeros(4, fields)
    records["x"], records["y"], records["z"] = around([0.0, 90.0, -90.0, -171.0]).T
    message = bag.cloud(records, START_NS)
    raw = Message(Topic("/points", message.__msgtype__, is_ros1=True), START_NS, bag.raw(message))
    assert read_sweep(raw, START_NS).seconds is None
    sweep = read_sweep(raw, START_NS, lidar())
    assert sweep.times.reference == "relative"
    np.testing.assert_allclose(sweep.times.ends_s, [-0.025, 0.0475], atol=1e-6)
    origin_m = (1.0, 2.0, 3.0)
    moved = Lidar.model_validate({"spin": KITTI, "origin_m": origin_m})
    for name, shift_m in zip("xyz", origin_m, strict=True):
        records[name] += shift_m
    of_vehicle = bag.cloud(records, START_NS)
    raw = Message(raw.topic, START_NS, bag.raw(of_vehicle))
    np.testing.assert_allclose(read_sweep(raw, START_NS, moved).times.ends_s, [-0.025, 0.0475], atol=1e-6)
    assert read_sweep(raw, START_NS, Lidar(origin_m=origin_m)).seconds is None
    timed = np.zeros(4, [*fields, ("t", "<f4")])
    for name in "xyz":
        timed[name] = records[name]
    timed["t"] = [0.0, 0.01, 0.02, 0.03]
    message = bag.cloud(timed, START_NS)
    raw = Message(Topic("/points", message.__msgtype__, is_ros1=True), START_NS, bag.raw(message))
    assert read_sweep(raw, START_NS, lidar()).times.ends_s == pytest.approx((0.0, 0.03))
