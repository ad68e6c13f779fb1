"""Synthetic rigs that move: what they measure, and when, is what their drive.yaml and their options say."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from semcal_cli import core
from semcal_cli.checks.inspection import inspect
from semcal_cli.cli.synth import synth
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.errors import InputError
from semcal_cli.observations.reading import read_clouds, read_observations
from semcal_cli.synthetic.street_motion import lidar_twist, vehicle_motion
from semcal_cli.synthetic.synthesis import make_camera, make_renderer, mounting, synthesize, synthesize_rig

MIXED = SynthConfig(num_frames=4, seed=5, channels=32, columns=400, width=320, height=180, motion="mixed")
FASTEST = 1
"""The frame of `MIXED` with the greatest speed."""
DELAY_S = 0.08
EXACT = 1e-9  # metres and radians a second: round-off of a logarithm over a second
BORDER_PIXELS_AGREE = 0.97  # points within half a pixel of a border round to either side
AS_GOOD = 0.9  # share of the information of streets at rest that other streets have
WORSE = (
    0.85  # share of the information that is left where points are smeared by up to 1 m, or images 80 ms late
)
INCLINED_DEG = 4.0  # the vehicle leans by up to 2 degrees each way, and streets are not flat


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Drive:
    return made(replace(MIXED, motion="none"), tmp_path_factory.mktemp("still"))


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Drive:
    return made(MIXED, tmp_path_factory.mktemp("mixed"))


def made(config: SynthConfig, folder: Path) -> Drive:
    synthesize(config, folder, force=True)
    return read_drive(folder)


def agreement(drive: Drive) -> core.Agreement:
    return core.agreement(read_observations(drive).core, np.array(drive.T_camera_lidar))


def test_compensated_sweeps_agree_as_if_nothing_moved(still: Drive, mixed: Drive) -> None:
    good, at_rest = agreement(mixed), agreement(still)
    smeared = agreement(mixed.model_copy(update={"motion": None}))
    assert abs(good.label_agreement - at_rest.label_agreement) < 0.01
    assert good.mutual_information > AS_GOOD * at_rest.mutual_information
    assert smeared.mutual_information < WORSE * good.mutual_information
    assert smeared.label_agreement < good.label_agreement - 0.02


@pytest.mark.parametrize("delay_s", [DELAY_S, -DELAY_S])
def test_a_delay_is_what_the_drive_does_not_say(mixed: Drive, tmp_path: Path, delay_s: float) -> None:
    drive = made(replace(MIXED, delay_ms=1e3 * delay_s), tmp_path)
    assert drive.time_offset_s == 0.0
    assert [frame.image_stamp for frame in drive.frames] == [frame.image_stamp for frame in mixed.frames]
    right = agreement(drive.model_copy(update={"time_offset_s": delay_s}))
    assert abs(right.label_agreement - agreement(mixed).label_agreement) < 0.01
    for offset_s in (0.0, -delay_s, 1.5 * delay_s):
        wrong = agreement(drive.model_copy(update={"time_offset_s": offset_s}))
        assert wrong.mutual_information < WORSE * right.mutual_information, offset_s
        assert wrong.label_agreement < right.label_agreement, offset_s


@pytest.mark.parametrize(
    ("direction", "delay_ms"), [("down", -60.0), ("up", 0.0), ("right", 0.0), ("left", -60.0)]
)
def test_visible_points_lie_on_their_label_when_their_line_is_exposed(
    direction: str, delay_ms: float
) -> None:
    shutter = {"readout_ms": 60.0, "readout_direction": direction, "delay_ms": delay_ms}
    config = replace(MIXED, range_noise_m=0.0, width=640, height=360, **shutter)
    T_camera_lidar = mounting(config)
    frame = make_renderer(config, T_camera_lidar).frame(config.seed, FASTEST, lidar_twist(config, FASTEST))
    is_visible = frame.point_visibility == 2
    points, labels = frame.points[is_visible, :3].astype(float), frame.point_labels[is_visible] & 0xFFFF
    fired_s = frame.point_times[is_visible].astype(float) - 0.05
    camera = core_camera(make_camera(config))

    def on_own_label(is_rolling: bool) -> float:
        exposed_s = np.full(len(points), 1e-3 * (config.delay_ms + 0.5 * config.readout_ms))
        for _ in range(8 if is_rolling else 1):
            seen = carried(config, points, fired_s, exposed_s)
            pixels = camera.project(seen @ T_camera_lidar[:3, :3].T + T_camera_lidar[:3, 3])
            exposed_s = 1e-3 * (config.delay_ms + config.readout_ms * share_read(config, pixels))
        u, v = np.clip(np.rint(pixels).astype(int), 0, (config.width - 1, config.height - 1)).T
        return float(np.mean(frame.image_labels[v, u] == labels))

    assert len(points) > 1000
    assert on_own_label(is_rolling=True) > BORDER_PIXELS_AGREE
    assert on_own_label(is_rolling=False) < on_own_label(is_rolling=True) - 0.1


def carried(config: SynthConfig, points: np.ndarray, from_s: np.ndarray, to_s: np.ndarray) -> np.ndarray:
    """Points that the level LiDAR measured at some times, in the frames that it has at others."""
    motion = vehicle_motion(config, FASTEST)
    assert motion is not None
    turn = motion.yaw_rate_rad_s * (from_s - to_s)
    way = motion.speed_m_s / motion.yaw_rate_rad_s
    x, y, z = points.T
    ahead = np.cos(turn) * x - np.sin(turn) * y + way * np.sin(turn)
    left = np.sin(turn) * x + np.cos(turn) * y + way * (1.0 - np.cos(turn))
    return np.stack([ahead, left, z], axis=1)


def share_read(config: SynthConfig, pixels: np.ndarray) -> np.ndarray:
    """The part of the readout that is over when the line of each pixel is exposed."""
    across, down = ((pixels + 0.5) / (config.width, config.height)).T
    share = {"down": down, "up": 1.0 - down, "right": across, "left": 1.0 - across}
    return share[config.readout_direction]


@pytest.mark.parametrize("tilt_deg", [0.0, 25.0])
def test_poses_say_the_twist_of_each_frame_and_it_is_level(tmp_path: Path, tilt_deg: float) -> None:
    config = replace(MIXED, lidar_tilt_deg=tilt_deg)
    drive = made(config, tmp_path)
    for offset_s in (-0.3, 0.0, 0.3):
        observations = read_observations(drive.model_copy(update={"time_offset_s": offset_s}))
        twists = [frame.twist_per_s for frame in observations.frame_observations]
        np.testing.assert_allclose(twists, [lidar_twist(config, i) for i in range(4)], atol=EXACT)
    for cloud, twist in zip(observations.clouds, twists, strict=True):
        up = core.estimate_up([cloud.points])
        assert up is not None
        motion = vehicle_motion(config, twists.index(twist))
        climb = up.direction @ twist[:3] / motion.speed_m_s
        assert abs(np.degrees(np.arcsin(climb))) < INCLINED_DEG
        turn = up.direction @ twist[3:] / motion.yaw_rate_rad_s
        assert turn > np.cos(np.radians(INCLINED_DEG))


def test_steady_motion_is_straight_on_and_mixed_motion_keeps_its_bounds() -> None:
    steady = replace(MIXED, motion="steady")
    assert [lidar_twist(steady, number) for number in range(3)] == 3 * [[12.0, 0.0, 0.0, 0.0, 0.0, 0.0]]
    motions = np.array([vehicle_motion(MIXED, number) for number in range(200)])
    assert np.all(np.histogram(motions[:, 0], bins=4, range=(0.0, 20.0))[0] > 25)
    assert np.all(np.histogram(motions[:, 1], bins=4, range=(-0.4, 0.4))[0] > 25)


def test_points_have_the_times_of_their_columns(mixed: Drive) -> None:
    cloud = read_clouds(mixed)[0]
    assert cloud.time is not None
    azimuth = np.arctan2(cloud.points[:, 1], cloud.points[:, 0]) % (2.0 * np.pi)
    # Range noise moves points along their rays alone.
    np.testing.assert_allclose(cloud.time, 0.1 * azimuth / (2.0 * np.pi), atol=1e-6)
    assert not any(frame.suspicions for frame in inspect(mixed).frames)


def test_a_rosette_moves_too(tmp_path: Path) -> None:
    drive = made(replace(MIXED, pattern="rosette", num_frames=2), tmp_path)
    (cloud, _) = read_clouds(drive)
    assert cloud.time is not None
    assert np.all(np.diff(cloud.time) > 0.0)
    assert cloud.time[-1] == pytest.approx(0.1, abs=1e-4)
    assert agreement(drive).label_agreement > BORDER_PIXELS_AGREE - 0.01


def test_cameras_of_a_moving_rig_share_its_sweeps_and_poses(tmp_path: Path) -> None:
    synthesize_rig(replace(MIXED, num_frames=2, readout_ms=20.0), 2, tmp_path)
    for name in ("camera_0", "camera_1"):
        drive = read_drive(tmp_path / name)
        assert (drive.camera.readout_s, drive.camera.direction) == (0.02, "down")
        assert agreement(drive).label_agreement > BORDER_PIXELS_AGREE - 0.02
    assert not (tmp_path / "camera_1/poses.txt").exists()


def test_same_seed_same_bytes(mixed: Drive, tmp_path: Path) -> None:
    options = "--frames 4 --seed 5 --channels 32 --columns 400 --width 320 --height 180 --motion mixed -q"
    assert CliRunner().invoke(synth, [str(tmp_path / "drive"), *options.split()]).exit_code == 0
    for name in (*mixed.files(), "drive.yaml"):
        assert (tmp_path / "drive" / name).read_bytes() == mixed.resolve(name).read_bytes(), name


def test_a_program_is_told_what_cannot_be(tmp_path: Path) -> None:
    for config, complaint in [
        (replace(MIXED, readout_ms=-1.0), "readout_ms: found -1.0, expected a number from 0 to 100.0"),
        (replace(MIXED, delay_ms=float("nan")), "delay_ms: found nan, expected a number from -200 to 200.0"),
    ]:
        with pytest.raises(InputError) as error:
            synthesize(config, tmp_path / "drive")
        assert str(error.value) == complaint
