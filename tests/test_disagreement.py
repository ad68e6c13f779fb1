"""Frames that disagree about the camera, frames that are no pairs, and frames that show one scene."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from laboratory import spoiling
from laboratory.raw_drive import RawDrive, RawFrame, write_raw_drive

from semcal_cli import core
from semcal_cli.checks.moved_camera import FrameCheck, check_frames
from semcal_cli.checks.odd_frames import check_pairs
from semcal_cli.config import RefinementConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.estimation.adjust.frame_offsets import frame_offsets
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.estimation.uncertainty.covariance import estimate_uncertainty
from semcal_cli.estimation.uncertainty.frame_scores import FrameScores
from semcal_cli.findings.check import findings_among
from semcal_cli.findings.finding import Finding
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.observations.reading import load_observations
from semcal_cli.observations.scenes import alike_frames
from semcal_cli.pipeline import assess, refine_and_polish, start_at
from semcal_cli.pipeline.stages import Stages
from semcal_cli.report.figures import frames_plots

CM = 0.01


def fitted(raw: RawDrive, folder: Path) -> tuple[LoadedDrive, Stages]:
    """Load a drive, and find the pose of all its frames from the truth of the first."""
    data = load(write_raw_drive(raw, folder))
    initial = start_at(data, InitialPose(raw.frames[0].T_camera_lidar, "the truth"))
    return data, refine_and_polish(data, initial, RefinementConfig())


def compared(raw: RawDrive, folder: Path) -> FrameCheck:
    data, stages = fitted(raw, folder)
    return check_frames(data.observations, stages.T_camera_lidar, names(raw))


def paired(raw: RawDrive, folder: Path) -> tuple[Finding, ...]:
    """Check the pairs at the true pose, so that only the pairs are wrong."""
    data, T = load(write_raw_drive(raw, folder)), raw.frames[0].T_camera_lidar
    agreement = core.agreement(data.observations.core, T)
    return findings_among(check_pairs(data.observations, T, agreement, names(raw)))


def names(raw: RawDrive) -> list[str]:
    return [f"{frame.name}.bin" for frame in raw.frames]


def motion(T_camera_lidar: Pose, T_reference: Pose) -> np.ndarray:
    """Motion (6,) of the camera along and about its axes, metres and degrees."""
    error = compare_poses(T_camera_lidar, T_reference)
    return np.array([*(CM * x for x in error.camera_center_xyz_cm), *(-x for x in error.rotation_xyz_deg)])


@pytest.mark.parametrize(
    ("angle_deg", "distance_m", "share", "words"),
    [(1.0, 0.0, 0.25, "turned by "), (0.0, 0.2, 0.6, "moved by ")],
)
def test_a_knock_is_found_with_its_frame_and_offset(
    long_street: RawDrive,
    rng: np.random.Generator,
    tmp_path: Path,
    angle_deg: float,
    distance_m: float,
    share: float,
    words: str,
) -> None:
    raw = spoiling.knocked(long_street, rng, angle_deg, distance_m, share)
    found = compared(raw, tmp_path)
    first = raw.frames[raw.knock].name
    assert [part.num_frames for part in found.parts] == [raw.knock, raw.num_frames - raw.knock]
    assert [part.first_frame for part in found.parts] == ["000000.bin", f"{first}.bin"]
    assert [part.last_frame for part in found.parts] == [
        f"{raw.frames[raw.knock - 1].name}.bin",
        "000007.bin",
    ]
    (finding,) = findings_among(found.measured)
    assert finding.sentence.startswith(f"frames {first} to 000007 fit a camera {words}")
    assert finding.found.endswith(f", as if it had been knocked at {first}")
    assert finding.advice.startswith("calibrate the frames of each part as a drive of their own")
    moved = found.parts[1].moved
    assert found.parts[0].moved is None
    assert moved is not None
    truth = compare_poses(*reversed(raw.truths))
    off_m = np.abs(np.array(moved.camera_center_m) - CM * np.array(truth.camera_center_xyz_cm))
    off_deg = np.abs(np.array(moved.rotation_deg) + truth.rotation_xyz_deg)  # the camera turns the other way
    assert (off_m <= moved.half_width_95_camera_center_m).all()
    assert (off_deg <= moved.half_width_95_rotation_deg).all()
    # Intervals that contain everything say nothing.
    assert max(moved.half_width_95_camera_center_m) < 0.05
    assert max(moved.half_width_95_rotation_deg) < 0.3


def test_frames_turned_each_by_its_own_disagree_without_parts(
    long_street: RawDrive, rng: np.random.Generator, tmp_path: Path
) -> None:
    found = compared(spoiling.clouds_turned(long_street, rng), tmp_path)
    assert found.parts == ()
    (finding,) = findings_among(found.measured)
    assert finding.sentence.startswith("frames disagree about the camera, they scatter ")


def test_nothing_is_said_of_a_good_drive(long_street: RawDrive, tmp_path: Path) -> None:
    assert findings_among(compared(long_street, tmp_path).measured) == ()
    assert paired(long_street, tmp_path) == ()
    one = long_street.with_frames(long_street.frames[:1])
    assert findings_among(compared(one, tmp_path).measured) == ()
    assert paired(one, tmp_path) == ()


def test_frames_of_few_squares_are_outliers_by_chance_no_more_often(rng: np.random.Generator) -> None:
    """Squares of all frames scatter alike about zero; a frame with four of them knows its scatter badly."""
    counts, alpha, num_drives = np.array([25] * 19 + [4]), 0.01, 1000
    frames = np.repeat(np.arange(len(counts)), counts)
    found = np.zeros(len(counts))
    for _ in range(num_drives):
        squares = rng.normal(size=(len(frames), 6))
        found += FrameScores.of_squares(squares - squares.mean(axis=0), frames, len(counts)).outliers(alpha)
    *many, few = (found / num_drives).tolist()
    assert few < alpha
    assert 0.3 * alpha < np.mean(many) < alpha


def test_images_of_another_moment_and_mirrored_ones_are_named(
    long_street: RawDrive, rng: np.random.Generator, tmp_path: Path
) -> None:
    frames = list(long_street.frames)
    frames[2] = frames[2].with_image_of(frames[6])
    frames[5] = replace(frames[5], image_labels=frames[5].image_labels[:, ::-1].copy())
    raw = long_street.with_frames(frames)
    (finding,) = paired(raw, tmp_path)
    assert finding.sentence.startswith("points and pixels of frames 000002 and 000005 look mismatched; ")


def test_frames_of_one_scene_are_told_from_others(long_street: RawDrive, rng: np.random.Generator) -> None:
    a, b, c = (frame.points for frame in long_street.frames[:3])
    noisy = (a + 0.005 * rng.standard_normal(a.shape)).astype(np.float32)
    assert alike_frames(core.nearest_ranges([a, b, noisy, c, b])) == [0, 1, 0, 3, 1]
    assert alike_frames(core.nearest_ranges([frame.points for frame in long_street.frames])) == list(range(8))


@pytest.mark.parametrize("noise_m", [None, 0.005])
def test_copies_of_a_frame_are_left_out(
    long_street: RawDrive, rng: np.random.Generator, tmp_path: Path, noise_m: float | None
) -> None:
    one = long_street.with_frames(long_street.frames[:1])
    copies = spoiling.one_frame_again(one, rng, 6, noise_m, is_renamed=True)
    data = load(write_raw_drive(copies, tmp_path))
    assert len(data.drive.frames) == data.observations.num_frames == 1
    assert data.notes == ("5 of 6 frames are copies of others and are left out",)
    (cloud,) = data.observations.clouds
    np.testing.assert_array_equal(cloud.points, copies.frames[0].points)


@pytest.mark.parametrize(("noise_m", "tolerance"), [(None, 0.2), (0.005, 0.4)])
def test_copies_of_a_frame_have_its_interval(
    long_street: RawDrive, rng: np.random.Generator, tmp_path: Path, noise_m: float | None, tolerance: float
) -> None:
    """Though all are used: six frames of their own would have an interval of 0.4 times the width.

    Pairs that were seen less than a tenth of a point count for less beside six frames, by up to 14 % of the width here.
    """
    copies = spoiling.one_frame_again(long_street, rng, 6, noise_m, is_renamed=True)
    T, stated = copies.frames[0].T_camera_lidar, []
    for raw in (copies.with_frames(copies.frames[:1]), copies):
        observations = load_observations(read_drive(write_raw_drive(raw, tmp_path)))
        assert observations.num_frames == raw.num_frames
        uncertainty = estimate_uncertainty(observations, T)
        assert uncertainty is not None
        stated.append(uncertainty.half_widths)
    assert stated[1] == pytest.approx(stated[0], rel=tolerance)


def test_frames_of_one_scene_are_noted(long_street: RawDrive, tmp_path: Path) -> None:
    """Other labels, as of a passer-by, make a frame of the same scene that is no copy."""
    a, b = long_street.frames[:2]

    def again(frame: RawFrame, row: int) -> RawFrame:
        labels = frame.image_labels.copy()
        labels[row : row + 4] = labels[row]
        return replace(frame, image_labels=labels)

    for frames, words in (
        (
            [a, again(a, 60), again(a, 90)],
            "the 3 frames count as 1 frame, because all show the same scene, so whether",
        ),
        (
            [a, b, again(b, 60)],
            "the 3 frames count as 2 frames, because the others show the same scenes: add",
        ),
        ([a, b], None),
    ):
        data, stages = fitted(long_street.with_frames(frames), tmp_path)
        assert stages.polished is not None
        assert stages.polished.is_accepted
        notes = assess(data, stages, RefinementConfig(), with_label_bleed=False).notes
        assert [note for note in notes if "count as" in note] == [
            note for note in notes if words and words in note
        ]
        assert len([note for note in notes if " checked" not in note and " confirm" not in note]) == (
            words is not None
        )


@pytest.mark.parametrize("of_parts", [False, True])
def test_each_frame_has_its_own_offset(knocked: RawDrive, knocked_drive: Path, of_parts: bool) -> None:
    """About the first truth; with the parts or without them, frames are where they are."""
    data, (before, after) = load(knocked_drive), knocked.truths
    parts = ()
    if of_parts:
        parts = check_frames(data.observations, before, names(knocked)).parts
        assert len(parts) == 2
    found = frame_offsets(data.observations, before, parts)
    moved = motion(after, before)
    expected = np.array([np.zeros(6)] * knocked.knock + [moved] * (8 - knocked.knock))
    assert (np.abs(found.offsets - expected) <= found.half_widths_95).mean() > 0.9
    assert found.half_widths_95[:, 3:].max() < 0.5
    assert found.is_determined.all()
    if of_parts:
        assert np.abs(found.of_parts - expected)[:, 3:].max() < 0.1
        assert found.is_within.mean() > 0.9
    else:
        assert not found.of_parts.any()
        assert not found.is_within[knocked.knock :].all(axis=1).any()


def test_frames_are_found_from_degrees_away(
    knocked: RawDrive, knocked_drive: Path, rng: np.random.Generator
) -> None:
    """Where the labels are too far off for the blocks of a near start, coarser ones are taken."""
    observations, truth = load(knocked_drive).observations, knocked.truths[0]
    T_far = displace(truth, 6.0, 0.6, rng)
    found = frame_offsets(observations.of_frames(range(knocked.knock)), T_far)
    assert (np.abs(found.offsets - motion(truth, T_far)) <= found.half_widths_95).mean() > 0.9


def test_offsets_are_drawn_at_their_frames(knocked: RawDrive, knocked_drive: Path) -> None:
    data, (before, _) = load(knocked_drive), knocked.truths
    parts = check_frames(data.observations, before, names(knocked)).parts
    found = frame_offsets(data.observations, before, parts)
    found.offsets[3] = np.nan
    plots = frames_plots(found, names(knocked))
    for plot, offsets in zip(plots, (found.offsets[:, :3], found.offsets[:, 3:]), strict=True):
        dots = re.findall(r'<use [^>]*x="([\d.]+)" y="([\d.]+)"', plot.svg)
        x, y = np.array(dots, float).reshape(3, 7, 2).transpose(2, 0, 1)
        assert (np.diff(x, axis=1) > 0.0).all()
        # The axis points up.
        shown = np.delete(offsets, 3, axis=0).T
        np.testing.assert_array_equal(
            np.argsort(-y, axis=1)[:, [0, -1]], np.argsort(shown, axis=1)[:, [0, -1]]
        )
        assert plot.svg.count('class="step"') == 3
        assert re.findall(r">(0000\d\d[^<]*)</text>", plot.svg) == names(knocked)
    long_names = [f"a_very_long_name_{name}" for name in names(knocked)]
    svg = frames_plots(found, long_names)[0].svg
    assert re.findall(r">(\d)</text>", svg.split(">frame<")[0])[:8] == list("12345678")
