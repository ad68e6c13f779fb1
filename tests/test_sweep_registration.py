"""Registration of the sweeps of two LiDARs: how near, from which pairs, and where the scene does not hold the pose."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from conftest import LIDAR, SMALL_LIDARS, make_pose
from rigs import exp

from semcal_cli import core
from semcal_cli.drive.document import Drive
from semcal_cli.drive.stated_motion import Motion
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses, inverse
from semcal_cli.many.rig.rig_document import read_rig
from semcal_cli.many.rig.sweep_registration import (
    MIN_PAIRS,
    OF_UNKNOWN_MOMENTS,
    NotRegistered,
    Registration,
    SweepPair,
    SweepPairs,
    read_sweep_pairs,
    register_sweeps,
    robust_mean_of_vectors,
    stiffness,
)


@pytest.fixture(scope="module")
def sweeps(lidars: Path) -> SweepPairs:
    drives = read_rig(lidars).read_drives()
    return read_sweep_pairs([drives["camera_1"]], [drives["camera_1_on_lidar_1"]])


def register(sweeps: SweepPairs, T_start: Pose) -> Registration:
    registration = register_sweeps(sweeps, T_start)
    assert isinstance(registration, Registration)
    return registration


def test_a_registration_is_as_near_the_truth_as_it_says(lidars: Path, sweeps: SweepPairs) -> None:
    truth = read_rig(lidars).reference("lidar", LIDAR)
    start = exp(np.array([0.05, -0.03, 0.04, 0.01, -0.008, 0.012])) @ truth
    registration = register(sweeps, start)
    assert (registration.num_pairs, registration.num_left_out) == (SMALL_LIDARS.num_frames, 0)
    error = compare_poses(np.array(registration.T_lidar_further), truth)
    assert (np.abs(error.offsets) <= registration.tie(LIDAR).uncertainty.half_widths).all()
    # With the points moved, so is the answer; voxels divide the points another way, which costs a millimetre.
    S = make_pose((0.0, 0.0, 0.5), (0.4, 0.0, 0.1))
    moved = tuple(
        SweepPair(first, (further @ S[:3, :3].T + S[:3, 3]).astype(np.float32))
        for first, further in sweeps.pairs
    )
    found = np.array(register(SweepPairs(moved), start @ inverse(S)).T_lidar_further)
    away = compare_poses(found, np.array(registration.T_lidar_further) @ inverse(S))
    assert (away.rotation_deg, away.camera_center_m) == pytest.approx((0.0, 0.0), abs=0.01)


def test_what_cannot_be_registered_is_left_out(lidars: Path, sweeps: SweepPairs) -> None:
    """A pair has nothing in common, and another jumps."""
    truth = read_rig(lidars).reference("lidar", LIDAR)
    (first, further), *others = sweeps.pairs
    away = inverse(truth)[:3, :3] @ (0.0, 0.7, 0.0)
    jumped = SweepPair(first, (further + away).astype(np.float32))
    mixed = (*sweeps.pairs, SweepPair(first, 100.0 + further), jumped)
    registration = register(SweepPairs(mixed, Counter({"are of different moments": 3})), truth)
    assert (registration.num_pairs, registration.num_left_out) == (SMALL_LIDARS.num_frames, 5)
    few = register_sweeps(SweepPairs((*others, *mixed[-2:])), truth)
    assert isinstance(few, NotRegistered)
    assert few.reason == (
        "4 of 6 pairs of sweeps could be, needed 5; 1 overlap by less than 30 %; "
        "1 end more than 0.5 m or 5 degrees from the start"
    )


def surroundings(kind: str, rng: np.random.Generator, num: int = 6_000) -> np.ndarray:
    """Points (N, 3) on the ground, walls and the ceiling of a scene along x, with noise of two centimetres."""
    along = [rng.uniform(-40.0, 40.0, num) for _ in range(5)]
    across, up = [rng.uniform(-5.0, 6.0, num) for _ in range(2)], rng.uniform(-1.8, 4.0, (3, num))
    ground = np.stack([along[0], across[0], np.full(num, -1.8)], axis=1)
    walls = [np.stack([along[1 + i], np.full(num, y), up[i]], axis=1) for i, y in enumerate((6.0, -5.0))]
    ceiling = np.stack([along[3], across[1], np.full(num, 4.0)], axis=1)
    end = np.stack([np.full(num // 5, 20.0), rng.uniform(-5, 6, num // 5), up[2][: num // 5]], axis=1)
    surfaces = {
        "ground and one wall": [ground, walls[0]],
        "tunnel": [ground, *walls, ceiling],
        "tunnel with an end": [ground, *walls, ceiling, end],
    }
    points = np.concatenate(surfaces[kind])
    return points + 0.02 * rng.standard_normal(points.shape)


@pytest.mark.parametrize("kind", ["ground and one wall", "tunnel"])
def test_a_scene_that_does_not_hold_the_pose_gives_no_registration(
    kind: str, rng: np.random.Generator
) -> None:
    """Every pair would stay 30 cm off along the walls, where it started."""
    pair = SweepPair(surroundings(kind, rng), surroundings(kind, rng))
    start = exp(np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0]))
    result = register_sweeps(SweepPairs((pair,) * MIN_PAIRS), start)
    assert isinstance(result, NotRegistered)
    assert result.reason == (
        "0 of 5 pairs of sweeps could be, needed 5; 5 do not hold the pose in all directions, as in a tunnel"
    )


def test_the_end_of_a_tunnel_holds_the_pose(rng: np.random.Generator) -> None:
    pairs = tuple(
        SweepPair(*(surroundings("tunnel with an end", rng) for _ in range(2))) for _ in range(MIN_PAIRS)
    )
    registration = register(SweepPairs(pairs), exp(np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.0])))
    error = compare_poses(np.array(registration.T_lidar_further), np.eye(4))
    assert error.camera_center_m < 0.02


def test_stiffness_is_that_of_the_best_turn_and_the_best_shift() -> None:
    """Points on a plane at a distance resist one shift and two turns; a lever arm adds nothing."""
    rng = np.random.default_rng(1)
    points = np.stack([*rng.uniform(-5.0, 5.0, (2, 400)), np.full(400, 3.0)], axis=1)
    slopes = np.hstack([np.cross(points, (0.0, 0.0, 1.0)), np.tile((0.0, 0.0, 1.0), (400, 1))])
    values = stiffness(slopes.T @ slopes / 400, 1.0)
    assert values[[0, 1, 3]] == pytest.approx(0.0, abs=1e-9)
    assert values[2] == pytest.approx(1.0, abs=0.05)
    # The variance of a uniform distribution of 10 m.
    assert values[4:] == pytest.approx(100.0 / 12.0, rel=0.2)


@pytest.mark.parametrize(
    ("changes", "stamps", "cause"),
    [
        ({}, (None, None), None),
        ({"synchronization": "stamps"}, (None, None), OF_UNKNOWN_MOMENTS),
        ({"synchronization": "stamps"}, (1.0, None), OF_UNKNOWN_MOMENTS),
        ({"synchronization": "stamps"}, (1.0, 1.0009), None),
        ({"synchronization": "stamps", "motion": Motion(speed_m_s=0.0)}, (None, None), None),
        ({"synchronization": "stamps", "motion": Motion(speed_m_s=1.0)}, (None, None), OF_UNKNOWN_MOMENTS),
        ({}, (1.0, 1.05), "are of different moments by their points_stamp"),
        ({"motion": Motion(speed_m_s=0.0)}, (1.0, 1.05), None),
    ],
)
def test_only_sweeps_of_one_moment_are_pairs(
    lidars: Path, changes: dict, stamps: tuple[float | None, float | None], cause: str | None
) -> None:
    """They are by their stamps, by a signal that triggers all, or since the rig stood still."""
    drives = read_rig(lidars).read_drives()

    def changed(name: str, stamp: float | None) -> Drive:
        frame = drives[name].frames[0].model_copy(update={"points_stamp": stamp})
        return drives[name].model_copy(update={**changes, "frames": (frame,)})

    found = read_sweep_pairs(
        *([changed(*each)] for each in zip(("camera_1", "camera_1_on_lidar_1"), stamps, strict=True))
    )
    assert (len(found.pairs), found.left_out) == ((0, {cause: 1}) if cause else (1, {}))


def test_the_robust_mean_ignores_what_is_far_off(rng: np.random.Generator) -> None:
    values = rng.standard_normal((40, 6))
    values[:4] += 50.0
    mean, _ = robust_mean_of_vectors(values)
    assert np.abs(mean - values[4:].mean(axis=0)).max() < 0.2


@pytest.mark.parametrize("num", [MIN_PAIRS, 8, 30])
def test_intervals_of_the_robust_mean_hold_it(num: int) -> None:
    rng, quantile = np.random.default_rng(num), core.student_quantile(0.975, num - 2)
    held, squares, stated = [], [], []
    for _ in range(400):
        mean, errors_of_mean = robust_mean_of_vectors(rng.standard_normal((num, 6)))
        held.append(np.abs(mean) <= quantile * errors_of_mean)
        squares.append(mean**2)
        stated.append(errors_of_mean**2)
    # Six axes of 400 means: three standard errors are 1.3 %; weights cost small numbers a per cent or two.
    assert 0.925 < np.mean(held) < 0.97
    assert np.sqrt(np.mean(stated) / np.mean(squares)) == pytest.approx(1.0, abs=0.15)
