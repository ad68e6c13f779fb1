"""Sweeps that follow one another become one dense cloud for each image, if they fit and nothing moves."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bag_imports import image, nothing, recorded
from commands import invoke, unwrapped
from conftest import make_pose
from moving_street import MovingStreet

from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.frames import Frame
from semcal_cli.files.point_clouds import read_point_clouds
from semcal_cli.geometry.arrays import Points
from semcal_cli.geometry.poses import inverse, rotation_error_deg
from semcal_cli.importing.accumulated_drive import accumulate_drive
from semcal_cli.importing.accumulation import AccumulatedCloud, Accumulation
from semcal_cli.importing.lines_of_sight import are_seen, are_unmoved
from semcal_cli.importing.sweep_agreement import Surfaces

NUM_SWEEPS = 12
MID_360 = {"fov_up_deg": 52.0, "fov_down_deg": -7.0, "points": 20_000, "width": 64}
"""A Livox Mid-360: 360 by 59 degrees, 200,000 points a second at 10 Hz."""
LARGEST_SEEMING_M = 0.01
"""How far sweeps of one place seem to be apart: some millimetres of noise."""


@pytest.fixture(scope="module")
def standing() -> MovingStreet:
    return MovingStreet(0.0, 0.0, seed=120, num_sweeps=NUM_SWEEPS, **MID_360)


@pytest.fixture(scope="module")
def moving() -> MovingStreet:
    return MovingStreet(6.0, 0.2, seed=121, num_sweeps=NUM_SWEEPS, **MID_360)


def with_keys(path: Path, **keys: object) -> Path:
    document = yaml.safe_load(path.read_text()) | keys
    path.write_text(yaml.safe_dump(document))
    return path


def clouds(drive: Drive) -> list[Points]:
    files = [(drive.resolve(frame.points), None) for frame in drive.frames]
    return [cloud.points for cloud in read_point_clouds(files)]


def test_a_standing_rig_gets_one_cloud_of_all_its_sweeps(
    standing: MovingStreet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = standing.write(tmp_path / "drive", count=NUM_SWEEPS, images=[6])
    monkeypatch.chdir(tmp_path)
    result = invoke("accumulate", "drive", "--seconds", "10", "-o", "dense")
    assert result.exit_code == 0, result.output
    assert "wrote dense/drive.yaml: 1 frame, each of 12 sweeps\n" in result.stderr
    assert max(map(len, result.stderr.splitlines())) <= 80
    drive = read_drive(tmp_path / "dense")
    (frame,) = drive.frames
    assert (frame.image, frame.image_labels) == ("../drive/000006.png", "../drive/000006_labels.png")
    assert drive.motion is not None
    assert drive.motion.speed_m_s == 0.0
    (dense,) = clouds(drive)
    recorded_points = {point.tobytes() for points in clouds(read_drive(path)) for point in points}
    assert {point.tobytes() for point in dense} <= recorded_points
    assert len(dense) > 0.98 * len(recorded_points)
    assert np.fromfile(drive.resolve(str(frame.point_labels)), "<u4").shape == dense.shape[:1]


def test_each_sweep_is_in_one_cloud_whose_image_is_in_its_middle(
    standing: MovingStreet, tmp_path: Path
) -> None:
    path = standing.write(tmp_path / "drive", count=NUM_SWEEPS)
    result = invoke("accumulate", path, "--sweeps", "4", "-o", tmp_path / "dense")
    assert result.exit_code == 0, result.output
    drive = read_drive(tmp_path / "dense")
    assert [Path(str(frame.image)).stem for frame in drive.frames] == ["000001", "000005", "000009"]
    dense = [{point.tobytes() for point in points} for points in clouds(drive)]
    sweeps = [points[::50] for points in clouds(read_drive(path))]
    holders = [
        {index for index, cloud in enumerate(dense) if any(p.tobytes() in cloud for p in sweep)}
        for sweep in sweeps
    ]
    assert holders == [{index // 4} for index in range(NUM_SWEEPS)]


def test_the_clouds_before_the_last_are_not_kept_in_memory(
    standing: MovingStreet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = read_drive(standing.write(tmp_path / "drive", count=NUM_SWEEPS))
    all_clouds, seen = Accumulation.clouds, list[weakref.ref[Any]]()

    def watched(accumulation: Accumulation) -> Iterator[tuple[Frame, AccumulatedCloud]]:
        for frame, cloud in all_clouds(accumulation):
            assert not any(array() is not None for array in seen[:-2])
            seen.extend(map(weakref.ref, (cloud.points, cloud.labels)))
            yield frame, cloud

    monkeypatch.setattr(Accumulation, "clouds", watched)
    assert len(accumulate_drive(drive, tmp_path / "dense", num_sweeps=4).drive.frames) == 3


def test_a_moving_rig_is_registered_by_its_poses(moving: MovingStreet, tmp_path: Path) -> None:
    path = with_keys(
        moving.write(tmp_path / "drive", count=NUM_SWEEPS, images=[5]), motion={"poses": "true.txt"}
    )
    result = invoke("accumulate", path, "--sweeps", str(NUM_SWEEPS), "-o", tmp_path / "dense")
    assert result.exit_code == 0, result.output
    drive = read_drive(tmp_path / "dense")
    assert drive.motion is not None
    assert (drive.motion.poses, drive.motion.point_times) == ("../drive/true.txt", "deskewed")
    (dense,) = clouds(drive)
    own = moving.sweep(5)
    assert len(dense) > 8 * len(own.points)
    # The end of the sweep is 60 cm before its start, so that only untwisted points lie on the surfaces.
    there = [
        inverse(moving.pose(100.5)) @ moving.pose(100.5 + time_s) @ np.append(point, 1.0)
        for point, time_s in zip(own.points[::5], own.times_s[::5], strict=True)
    ]
    apart = Surfaces(dense).displacement(np.array(there, np.float32)[:, :3])
    assert apart is not None
    assert np.linalg.norm(apart.T[:3, 3]) < LARGEST_SEEMING_M


def test_a_rig_that_moves_needs_a_motion_that_fits(moving: MovingStreet, tmp_path: Path) -> None:
    path = moving.write(tmp_path / "drive", count=NUM_SWEEPS, images=[5])
    result = invoke("accumulate", path, "-o", tmp_path / "dense")
    assert result.exit_code == 1
    assert "the rig moves, expected `motion:`, which `semcal odometry`" in str(result.exception)
    rows = np.loadtxt(tmp_path / "drive/true.txt")
    rows[:, 1:4] *= 3.0
    np.savetxt(tmp_path / "drive/wrong.txt", rows)
    result = invoke("accumulate", with_keys(path, motion={"poses": "wrong.txt"}), "-o", tmp_path / "dense")
    assert result.exit_code == 1
    assert "expected a motion that fits the sweeps" in str(result.exception)
    result = invoke("accumulate", with_keys(path, motion={"speed_m_s": 6.0}), "-o", tmp_path / "dense")
    assert "motion: found a speed without a direction, expected `motion:`" in str(result.exception)
    assert not (tmp_path / "dense").exists()


def test_what_cannot_be_accumulated_is_named(standing: MovingStreet, tmp_path: Path) -> None:
    path = standing.write(tmp_path / "drive", count=4, images=[1])
    for changes, options, needed in (
        ({}, ["-o", tmp_path / "drive"], "found the drive to accumulate; choose another -o"),
        ({}, ["--max-points", "30000"], "points of 4 sweeps, needed at most 30,000: accumulate fewer sweeps"),
        (
            {2: {"point_labels": None}},
            [],
            "frames[000002.pcd].point_labels: found nothing, expected labels of all",
        ),
        (
            {2: {"points_stamp": None}},
            [],
            "frames[000002.pcd].points_stamp: found nothing, expected a time, or --s",
        ),
        ({1: {"image": None, "image_labels": None}}, [], "found no frame with an image or label image"),
    ):
        document = yaml.safe_load(path.read_text())
        frames = [
            {key: value for key, value in (frame | changes.get(index, {})).items() if value is not None}
            for index, frame in enumerate(document["frames"])
        ]
        other = path.with_name("other.yaml") if changes else path
        other.write_text(yaml.safe_dump(document | {"frames": frames}))
        result = invoke(
            "accumulate", other, *(options if "-o" in options else [*options, "-o", tmp_path / "dense"])
        )
        assert result.exit_code == 1
        assert needed in str(result.exception)
        assert not (tmp_path / "dense").exists()


def test_walls_on_two_sides_do_not_show_that_a_rig_stands(standing: MovingStreet, tmp_path: Path) -> None:
    path = standing.write(tmp_path / "drive", count=2, images=[1])
    rng = np.random.default_rng(3)
    for index in range(2):
        along, across, height = rng.uniform((-30.0, -2.0, -1.5), (30.0, 2.0, 1.5), (9000, 3)).T
        across[:6000] = np.where(across[:6000] > 0.0, 2.0, -2.0)
        height[6000:] = -1.5
        np.column_stack([along, across, height, 0 * along]).astype("<f4").tofile(
            tmp_path / f"drive/{index}.bin"
        )
    document = yaml.safe_load(path.read_text())
    frames = [
        {key: frame[key] for key in frame if key != "point_labels"} | {"points": f"{index}.bin"}
        for index, frame in enumerate(document["frames"])
    ]
    result = invoke("accumulate", with_keys(path, frames=frames), "-o", tmp_path / "dense")
    assert result.exit_code == 1
    assert "whose surfaces do not face all directions" in str(result.exception)


def test_a_displacement_is_found_to_millimetres(standing: MovingStreet) -> None:
    surfaces = Surfaces(standing.sweep(0).points)
    T = make_pose((0.004, -0.01, 0.02), (0.25, -0.3, 0.1))
    moved = standing.sweep(1).points @ T[:3, :3].T + T[:3, 3]
    found = surfaces.displacement(moved.astype(np.float32))
    assert found is not None
    assert np.linalg.norm((found.T @ T)[:3, 3]) < LARGEST_SEEMING_M
    assert rotation_error_deg(found.T, inverse(T)) < 0.1


def rays(count: int, seed: int) -> Points:
    """Directions over 40 by 20 degrees, ahead."""
    azimuth, elevation = np.radians(
        np.random.default_rng(seed).uniform((-20.0, -10.0), (20.0, 10.0), (count, 2)).T
    )
    level = np.cos(elevation)
    return np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]).astype(
        np.float32
    )


def test_what_moves_is_left_out_and_what_stands_is_kept() -> None:
    sweeps, is_moving, is_post = [], [], []
    for index in range(20):
        directions = rays(3000, index)
        azimuth = np.degrees(np.arctan2(directions[:, 1], directions[:, 0]))
        passes = np.abs(azimuth - (index - 10.0) * 1.5) < 1.5
        stands = np.abs(azimuth - 5.2) < 0.3
        ranges_m = np.where(passes, 8.0, np.where(stands, 12.0, 20.0)).astype(np.float32)
        sweeps.append(directions * ranges_m[:, None])
        is_moving.append(passes)
        is_post.append(stands & ~passes)
    keeps = are_unmoved(sweeps, [np.zeros(3)] * 20)
    moves, post = np.concatenate(is_moving), np.concatenate(is_post)
    assert keeps[moves].mean() < 0.02
    assert keeps[post].mean() > 0.98
    assert keeps[~moves].mean() > 0.99


def test_what_another_origin_sees_behind_a_wall_is_hidden() -> None:
    wall, behind = rays(60_000, 1), rays(60_000, 2)
    ends_at = np.radians(5.0)
    wall = wall[np.arctan2(wall[:, 1], wall[:, 0]) < ends_at] * np.float32(10.0)
    behind = behind * np.float32(15.0)
    keeps = are_seen(np.concatenate([wall, behind]), np.zeros(3))
    azimuth = np.arctan2(behind[:, 1], behind[:, 0])
    assert keeps[: len(wall)].all()
    inner = azimuth < ends_at - np.radians(0.5)
    inner &= (np.abs(np.arcsin(behind[:, 2] / 15.0)) < np.radians(9.5)) & (azimuth > np.radians(-19.5))
    assert keeps[len(wall) :][inner].mean() < 0.01
    assert keeps[len(wall) :][azimuth > ends_at].all()


def test_folders_and_recordings_are_accumulated_when_they_are_imported(
    standing: MovingStreet, tmp_path: Path
) -> None:
    path = standing.write(tmp_path / "files", count=NUM_SWEEPS, images=[6])
    camera_info = tmp_path / "camera.yaml"
    camera = read_drive(path).camera
    camera_info.write_text(
        yaml.safe_dump(
            {
                "image_width": camera.width,
                "image_height": camera.height,
                "distortion_model": "plumb_bob",
                "camera_matrix": {"rows": 3, "cols": 3, "data": np.ravel(camera.K).tolist()},
                "distortion_coefficients": {"rows": 1, "cols": 5, "data": [0.0] * 5},
            }
        )
    )
    files = tmp_path / "files"
    result = invoke(
        *("import", "folder", "--points", f"{files}/*.pcd", "--images", f"{files}/000006.png"),
        *("--camera-info", camera_info, "--accumulate", "5", "-o", tmp_path / "dense"),
    )
    assert result.exit_code == 0, result.output
    assert "1 frame, each of 5 sweeps" in unwrapped(result.stderr, 0)
    assert len(read_drive(tmp_path / "dense").frames) == 1
    assert len(read_drive(tmp_path / "dense/sweeps").frames) == NUM_SWEEPS
    once = image()
    bag = recorded(
        tmp_path,
        standing,
        image=lambda bag, index, stamp: (once if index == 6 else nothing)(bag, index, stamp),
    )
    result = invoke("import", "bag", bag, "--accumulate", "0.6", "-o", tmp_path / "of_bag")
    assert result.exit_code == 0, result.output
    assert "1 frame, each of 7 sweeps" in unwrapped(result.stderr, 0)
    assert "between the times" not in result.stderr
    assert len(read_drive(tmp_path / "of_bag/sweeps").frames) == 7
    other = result_of_another(tmp_path / "of_bag")
    result = invoke("import", "bag", bag, "--accumulate", "0.6", "-o", tmp_path / "of_bag")
    assert result.exit_code == 1
    assert "found a drive of other data" in str(result.exception)
    assert (tmp_path / "of_bag/drive.yaml").read_text() == other


def result_of_another(folder: Path) -> str:
    """Let a folder hold the drive of other data."""
    document = yaml.safe_load((folder / "drive.yaml").read_text())
    frames = [{"points": "elsewhere.bin", "image": "elsewhere.png"}]
    text = yaml.safe_dump(document | {"frames": frames})
    (folder / "drive.yaml").write_text(text)
    return text


def test_places_one_after_another_get_a_cloud_each(
    standing: MovingStreet, moving: MovingStreet, tmp_path: Path
) -> None:
    """What is before a cloud is not lost: the first place is shorter than half of the time asked for."""
    path = standing.write(tmp_path / "drive", count=NUM_SWEEPS, images=[1, 2, 8])
    there = moving.write(tmp_path / "there", count=1, images=[])
    document = yaml.safe_load(path.read_text())
    for frame in document["frames"][:4]:
        frame["points_stamp"] -= 100.0
        if "image_stamp" in frame:
            frame["image_stamp"] -= 100.0
    elsewhere = yaml.safe_load(there.read_text())["frames"][0]
    elsewhere |= {key: f"../there/{elsewhere[key]}" for key in ("points", "point_labels")}
    elsewhere["points_stamp"] = document["frames"][4]["points_stamp"] - 0.1
    path.write_text(yaml.safe_dump(document | {"frames": [*document["frames"], elsewhere]}))
    result = invoke("accumulate", path, "--seconds", "10", "-o", tmp_path / "dense")
    assert result.exit_code == 0, result.output
    drive = read_drive(tmp_path / "dense")
    assert [Path(str(frame.image)).stem for frame in drive.frames] == ["000002", "000008"]
    assert "left out 1 more image of the same sweeps" in unwrapped(result.stderr, 0)
    # Less than a second of the first place does not show that the rig stood.
    assert drive.motion is None


def test_an_interrupted_run_leaves_no_drive_of_two_runs(standing: MovingStreet, tmp_path: Path) -> None:
    path = standing.write(tmp_path / "drive", count=NUM_SWEEPS, images=[1, 8])
    assert invoke("accumulate", path, "--sweeps", "5", "-o", tmp_path / "dense").exit_code == 0
    (path.parent / "000009.pcd").unlink()
    result = invoke("accumulate", path, "--sweeps", "4", "-o", tmp_path / "dense")
    assert result.exit_code == 1
    assert not (tmp_path / "dense/drive.yaml").exists()


def test_sweeps_without_intensity_stay_without(standing: MovingStreet, tmp_path: Path) -> None:
    path = standing.write(tmp_path / "drive", count=3, images=[1])
    document = yaml.safe_load(path.read_text())
    for index, frame in enumerate(document["frames"]):
        standing.sweep(index).points.astype("<f4").tofile(path.parent / f"{index}.bin")
        frame["points"] = f"{index}.bin"
    path.write_text(yaml.safe_dump(document | {"point_columns": ["x", "y", "z"]}))
    result = invoke("accumulate", path, "--sweeps", "3", "-o", tmp_path / "dense")
    assert result.exit_code == 0, result.output
    drive = read_drive(tmp_path / "dense")
    (cloud,) = read_point_clouds([(drive.resolve(drive.frames[0].points), None)], form=drive.point_form)
    assert cloud.intensity is None


def test_only_the_lidars_own_points_are_accumulated(standing: MovingStreet, tmp_path: Path) -> None:
    path = standing.write(tmp_path / "drive", count=3, images=[1])
    document = yaml.safe_load(path.read_text())
    for index, frame in enumerate(document["frames"]):
        own = standing.sweep(index).points
        rows = np.vstack([np.insert(own, 3, 1.0, axis=1), np.insert(own[:, ::-1], 3, 2.0, axis=1)])
        rows.astype("<f4").tofile(path.parent / f"{index}.bin")
        frame["points"] = f"{index}.bin"
        frame.pop("point_labels")
    document |= {"point_columns": ["x", "y", "z", "lidar"]}
    lidar = {"own_points": {"field": "lidar", "range": [1, 1]}, "origin_m": [0.0, 0.0, 0.1]}
    path.write_text(yaml.safe_dump(document | {"lidar": lidar}))
    result = invoke("accumulate", path, "--sweeps", "3", "-o", tmp_path / "dense")
    assert result.exit_code == 0, result.output
    drive = read_drive(tmp_path / "dense")
    assert drive.lidar is not None
    assert (drive.lidar.own_points, drive.lidar.origin_m) == (None, (0.0, 0.0, 0.1))
    (dense,) = read_point_clouds([(drive.resolve(drive.frames[0].points), None)], form=drive.point_form)
    sweeps = [standing.sweep(index).points.astype("<f4") for index in range(3)]
    assert {point.tobytes() for point in dense.points} <= {
        point.tobytes() for sweep in sweeps for point in sweep
    }
