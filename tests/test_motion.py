"""Motion compensation: a drive that was skewed on purpose comes out straight."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import make_pose, run
from scipy.linalg import expm

from semcal_cli.checks.inspection import inspect
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import DRIVE_FILE, read_drive
from semcal_cli.errors import InputError
from semcal_cli.files.documents import document_text, read_document
from semcal_cli.files.output_files import write_text
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import quaternion_xyzw
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.reading import read_clouds, read_observations
from semcal_cli.result.calibration_document import read_calibration
from semcal_cli.synthetic.synthesis import synthesize

TWIST = {"linear_m_s": [9.0, 0.5, -0.2], "angular_rad_s": [0.03, -0.02, 0.35]}
SWEEP_S = 0.1
CLOSE_S = 0.002
"""Error of the clock that six small images tell."""
STAMPS = {"points_stamp": 1_600_000_000.25, "image_stamp": 1_600_000_000.31}


def pose_at(seconds: float) -> Pose:
    """The LiDAR's pose after so many seconds, in the frame that it begins in, by SciPy's matrix exponential."""
    x, y, z = TWIST["angular_rad_s"]
    generator = np.zeros((4, 4))
    generator[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    generator[:3, 3] = TWIST["linear_m_s"]
    return expm(generator * seconds)


def skew(points: np.ndarray, times: np.ndarray, moment: float) -> np.ndarray:
    """What a LiDAR that moves measures of points that stand still, given where these are at `moment`."""
    steps, which = np.unique(times, return_inverse=True)
    motions = np.array([np.linalg.inv(pose_at(time)) @ pose_at(moment) for time in steps])[which]
    return np.einsum("nij,nj->ni", motions[:, :3, :3], points) + motions[:, :3, 3]


@pytest.fixture(scope="module")
def skewed(street: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The street as recorded from a moving car, without `motion`."""
    folder = tmp_path_factory.mktemp("skewed")
    document = read_document(street / DRIVE_FILE)
    observations = read_observations(read_drive(street))
    for index, frame in enumerate(document["frames"]):
        points = observations.clouds[index].points.astype(np.float64)
        turn = (np.arctan2(points[:, 1], points[:, 0]) + np.pi) / (2 * np.pi)
        times = np.round(turn * 200) / 200 * SWEEP_S
        moved = skew(points, times, STAMPS["image_stamp"] - STAMPS["points_stamp"])
        labels = np.fromfile(street / frame["point_labels"], np.uint32) & 0xFFFF
        dtype = [("x", "f4"), ("y", "f4"), ("z", "f4"), ("time", "f8"), ("label", "u2")]
        records = np.zeros(len(points), dtype)
        records["x"], records["y"], records["z"] = moved.T
        kept = np.any(np.fromfile(street / frame["points"], np.float32).reshape(-1, 4)[:, :3], axis=1)
        records["time"], records["label"] = times, labels[kept]
        np.save(folder / f"{index}.npy", records)
        frame |= {"points": str(folder / f"{index}.npy"), **STAMPS}
        frame["image_labels"] = str(street / frame["image_labels"])
        frame.pop("point_labels")
        frame.pop("image", None)
    return document


def write_drive(folder: Path, document: dict[str, Any], motion: object) -> Path:
    write_text(document_text(document | {"motion": motion}, "yaml"), folder / DRIVE_FILE)
    return folder


def load(folder: Path, document: dict[str, Any], motion: object) -> Observations:
    return read_observations(read_drive(write_drive(folder, document, motion)))


def offsets_m(found: Observations, expected: Observations) -> np.ndarray:
    pairs = zip(found.clouds, expected.clouds, strict=True)
    return np.concatenate([np.linalg.norm(a.points - b.points, axis=1) for a, b in pairs])


def tum(start: float, stop: float, num: int) -> str:
    """Poses in some fixed frame, as text."""
    fixed = make_pose((0.3, -1.0, 0.2), (400.0, -70.0, 12.0))
    lines = ["# stamp x y z qx qy qz qw"]
    for seconds in np.linspace(start, stop, num):
        pose = fixed @ pose_at(seconds)
        values = [seconds + STAMPS["points_stamp"], *pose[:3, 3], *quaternion_xyzw(pose)]
        lines.append(" ".join(f"{value:.9f}" for value in values))
    return "\n".join(lines)


def test_a_moving_car_sees_what_a_standing_one_sees(
    tmp_path: Path, skewed: dict[str, Any], street: Path
) -> None:
    still = read_observations(read_drive(street))
    (tmp_path / "poses.txt").write_text(tum(-0.2, 0.4, 4))
    off_m = offsets_m(load(tmp_path, skewed, None), still)
    assert np.median(off_m) > 0.2
    for motion in ({"twist": TWIST}, {"poses": "poses.txt"}):
        assert offsets_m(load(tmp_path, skewed, motion), still).max() < 1e-4
    absolute = {"twist": TWIST, "point_times": "absolute"}
    with pytest.raises(InputError, match=r"expected them within 1 s; motion\.point_times is absolute"):
        load(tmp_path, skewed, absolute)


def test_a_speed_without_direction_tells_what_it_may_cost(
    tmp_path: Path, skewed: dict[str, Any], street: Path
) -> None:
    speed = float(np.linalg.norm(TWIST["linear_m_s"]))
    observations = load(tmp_path, skewed, {"speed_m_s": speed})
    assert observations.motion_error_px is not None
    # Against what the motion really does to the points that the camera sees: the same size, not the same number.
    straight = load(tmp_path, skewed, {"twist": TWIST | {"angular_rad_s": [0.0, 0.0, 0.0]}})
    rays = [
        [cloud.points / np.linalg.norm(cloud.points, axis=1, keepdims=True) for cloud in each.clouds]
        for each in (observations, straight)
    ]
    angles = np.concatenate([np.linalg.norm(a - b, axis=1) for a, b in zip(*rays, strict=True)])
    focal_px = observations.camera.K[0][0]
    assert 0.5 < observations.motion_error_px / (focal_px * np.median(angles)) < 2.0
    suspicions = inspect(read_drive(write_drive(tmp_path, skewed, {"speed_m_s": speed}))).suspicions
    assert any("motion during a sweep displaces half of the points by" in line for line in suspicions)
    assert load(tmp_path, skewed, {"speed_m_s": 0.0}).motion_error_px == 0.0
    # An image that is later than its stamp by more than the sweep takes is farther from every point.
    late = load(tmp_path, skewed | {"time_offset_s": 0.3}, {"speed_m_s": speed})
    assert late.motion_error_px is not None
    assert late.motion_error_px > 3.0 * observations.motion_error_px


@pytest.mark.parametrize(
    ("motion", "complaint"),
    [
        ({}, "motion: found none, expected one of twist, poses, speed_m_s"),
        ({"twist": TWIST, "speed_m_s": 3.0}, "motion: found twist and speed_m_s, expected one of"),
        (
            {"speed_m_s": 3.0, "sigma": {"linear_m_s": 0.1}},
            "motion: found sigma beside speed_m_s, expected poses or a twist, whose errors it states",
        ),
        ({"poses": "far.txt"}, "motion: found a motion that moves points of .* to infinity"),
        (
            {"poses": "late.txt"},
            r"late\.txt: the motion at 16\d+(\.\d+)? s is unknown, expected poses",
        ),
        ({"poses": "few.txt"}, r"few\.txt: found 1 poses, needed at least 2"),
        ({"poses": "twice.txt"}, r"twice\.txt: found time 1 after 1, expected times that ascend"),
        (
            {"poses": "words.txt"},
            r"words\.txt: line 1: found something other than numbers, expected seconds x y z",
        ),
        ({"poses": "short.txt"}, r"short\.txt: line 2: found 7 numbers, expected seconds x y z qx qy qz qw"),
        ({"poses": "long.txt"}, r"long\.txt: line 1: found a quaternion of norm 2, needed norm 1"),
    ],
)
def test_a_motion_that_cannot_be_is_refused(
    tmp_path: Path, skewed: dict[str, Any], motion: object, complaint: str
) -> None:
    line = "1 0 0 0 0 0 0 1\n"
    files = {
        "late": tum(0.2, 0.4, 4),
        "few": line,
        "twice": line * 2,
        "words": "a b c",
        "short": "# a comment\n1 0 0 0 0 0 1",
        "far": "1.5e9 -1e308 0 0 0 0 0 1\n1.7e9 1e308 0 0 0 0 0 1",
        "long": "1 0 0 0 0 0 0 2",
    }
    for name, text in files.items():
        (tmp_path / f"{name}.txt").write_text(text)
    with pytest.raises(InputError, match=complaint):
        load(tmp_path, skewed, motion)


def test_times_of_another_unit_or_clock_are_refused(tmp_path: Path, skewed: dict[str, Any]) -> None:
    records = np.load(skewed["frames"][0]["points"])
    microseconds = records.astype(
        [(name, "u4" if name == "time" else kind) for name, kind in records.dtype.descr]
    )
    microseconds["time"] = np.round(records["time"] * 1e6)
    np.save(tmp_path / "us.npy", microseconds)
    frames = [skewed["frames"][0] | {"points": str(tmp_path / "us.npy")}]
    with pytest.raises(
        InputError,
        match=r"us\.npy: found point times that span 0\.0001 s, 0\.1 s as us, expected time_unit: us in",
    ):
        load(tmp_path, skewed | {"frames": frames}, {"twist": TWIST})
    in_microseconds = load(tmp_path, skewed | {"frames": frames, "time_unit": "us"}, {"twist": TWIST})
    as_written = load(tmp_path, skewed | {"frames": skewed["frames"][:1]}, {"twist": TWIST})
    moved, expected = (seen.clouds[0].points for seen in (in_microseconds, as_written))
    np.testing.assert_allclose(moved, expected, atol=1e-3)
    with pytest.raises(InputError, match=r"us\.npy: .* expected time_unit: us in"):
        load(tmp_path, skewed | {"frames": frames}, {"speed_m_s": 9.0})
    assert load(tmp_path, skewed | {"frames": frames}, {"speed_m_s": 0.0}).motion_error_px == 0.0
    late = [skewed["frames"][0] | {"image_stamp": STAMPS["image_stamp"] + 1000.0}]
    with pytest.raises(
        InputError, match=r"image_stamp: found 1000\.06 s after points_stamp, needed at most 1 s"
    ):
        load(tmp_path, skewed | {"frames": late}, {"twist": TWIST})


@pytest.mark.parametrize("key", ["points_stamp", "image_stamp"])
def test_motion_needs_stamps(tmp_path: Path, skewed: dict[str, Any], key: str) -> None:
    frames = [{k: v for k, v in frame.items() if k != key} for frame in skewed["frames"]]
    with pytest.raises(
        InputError, match=rf"frames\[.*0\.npy\]\.{key}: found nothing, expected a time for the motion"
    ):
        load(tmp_path, skewed | {"frames": frames}, {"twist": TWIST})


def without_times(folder: Path, drive: Path, frames: Sequence[int]) -> Path:
    """A copy of a drive, some sweeps of which are compensated to points_stamp and lost their times."""
    folder.mkdir()
    document = read_document(drive / DRIVE_FILE)
    timed = read_drive(drive)
    at_sweeps = [frame.model_copy(update={"image_stamp": frame.points_stamp}) for frame in timed.frames]
    changes = {"frames": tuple(at_sweeps), "time_offset_s": 0.0}
    compensated = read_observations(timed.model_copy(update=changes)).clouds
    clouds = read_clouds(timed)
    for index, frame in enumerate(document["frames"]):
        for key in {"points", "point_labels", "image_labels", "image"} & frame.keys():
            frame[key] = str(drive / frame[key])
        if index in frames:
            labels = clouds[index].labels
            assert labels is not None
            records = np.zeros(len(labels), [("x", "f4"), ("y", "f4"), ("z", "f4"), ("label", "u2")])
            records["x"], records["y"], records["z"] = compensated[index].points.T
            records["label"] = labels
            np.save(folder / f"{index}.npy", records)
            frame["points"] = str(folder / f"{index}.npy")
            frame.pop("point_labels", None)
    document["motion"]["poses"] = str(drive / document["motion"]["poses"])
    write_text(document_text(document, "yaml"), folder / DRIVE_FILE)
    return folder


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive at mixed speeds, whose images are 20 ms later than their stamps say."""
    folder = tmp_path_factory.mktemp("late") / "drive"
    config = SynthConfig(num_frames=6, seed=11, width=640, height=360, motion="mixed", delay_ms=20.0)
    synthesize(config, folder)
    return folder


def test_sweeps_without_times_move_as_a_whole(late: Path, tmp_path: Path) -> None:
    """Compensated to their stamps before, and from there to the images, they are as those compensated at once."""
    frames = (1, 4)
    drive = read_drive(without_times(tmp_path / "drive", late, frames))
    found, timed = read_observations(drive), read_observations(read_drive(late))
    assert offsets_m(found, timed).max() < 1e-4
    for index, (one, other) in enumerate(
        zip(found.frame_observations, timed.frame_observations, strict=True)
    ):
        assert one.twist_per_s == other.twist_per_s
        assert (one.is_rigid, other.is_rigid) == (index in frames, False)
    # `point_times` says nothing of points without times.
    drive = read_drive(without_times(tmp_path / "all", late, range(6)))
    motion = drive.motion and drive.motion.model_copy(update={"point_times": "absolute"})
    absolute = read_observations(drive.model_copy(update={"motion": motion}))
    assert offsets_m(absolute, read_observations(drive)).max() == 0.0
    note = f"{len(frames)} of 6 sweeps have no point times, and are moved as a whole: if they are "
    note += "deskewed to points_stamp, motion.point_times: deskewed says so"
    assert LoadedDrive(drive, found).notes == (note,)
    assert LoadedDrive(drive, timed).notes == ()


def test_the_clock_is_checked_and_estimated_without_times(
    late: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    drive, out = without_times(tmp_path / "drive", late, range(6)), tmp_path / "c.yaml"
    code, _, err = run(capfd, "calibrate", drive, "--init", late, "-o", out)
    assert code == 3, err
    assert "clocks" in read_calibration(out).topics
    code, _, err = run(capfd, "calibrate", drive, "--init", late, "-o", out, "--estimate-delay")
    found = read_calibration(out)
    assert code == 0, err
    assert found.clock is not None
    assert found.clock.is_kept
    assert found.clock.time_offset_s == pytest.approx(0.02, abs=CLOSE_S)
    assert "6 of 6 sweeps have no point times" in " ".join(err.split())
