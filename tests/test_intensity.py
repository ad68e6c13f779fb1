"""Intensity as a cue: levels that light and distance do not change, and what they find."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from commands import invoke
from conftest import edited, make_pose

from semcal_cli import core
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.formats import read_transform, write_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.cues.cue_table import choose_frames, load_cues, summed
from semcal_cli.observations.cues.intensity import INTENSITY, observe_intensity
from semcal_cli.observations.observations import Observations

UNMOVED = 0.9
"""Share of the levels that a slow change leaves within one of where they were."""


@pytest.fixture(scope="module")
def intensities(street: Path) -> Observations:
    return observe_intensity(read_drive(street))


def changed(
    street: Path, folder: Path, *, image: Callable | None = None, cloud: Callable | None = None
) -> Drive:
    """A copy of the drive, with one frame's image or cloud changed."""
    shutil.copytree(street, folder)
    drive = read_drive(folder)
    frame = drive.frames[0]
    if image is not None:
        path = str(drive.resolve(str(frame.image)))
        cv2.imwrite(path, image(cv2.imread(path).astype(float)).clip(0, 255).astype(np.uint8))
    if cloud is not None:
        file = drive.resolve(frame.points)
        cloud(np.fromfile(file, np.float32).reshape(-1, 4)).astype(np.float32).tofile(file)
    return drive.model_copy(update={"frames": (frame,)})


def near(before: np.ndarray, after: np.ndarray) -> float:
    return float(np.mean(np.abs(before.astype(int) - after.astype(int)) <= 1))


def test_levels_are_equally_frequent(intensities: Observations) -> None:
    for ids in (
        np.concatenate([cloud.classes for cloud in intensities.clouds]),
        intensities.images[0].classes.ravel(),
    ):
        shares = np.bincount(ids, minlength=INTENSITY.num_levels) / len(ids)
        assert len(shares) == INTENSITY.num_levels
        np.testing.assert_allclose(shares, 1.0 / INTENSITY.num_levels, atol=0.015)


def test_light_and_exposure_change_no_level(street: Path, intensities: Observations, tmp_path: Path) -> None:
    def dusk(image: np.ndarray) -> np.ndarray:
        """Darker, and towards the right more so."""
        return image * np.linspace(0.9, 0.6, image.shape[1])[:, None] + 5.0

    dark = observe_intensity(changed(street, tmp_path / "dusk", image=dusk))
    assert near(intensities.images[0].classes, dark.images[0].classes) > UNMOVED
    negative = observe_intensity(changed(street, tmp_path / "negative", image=lambda p: 255.0 - p))
    assert (
        near(intensities.images[0].classes, INTENSITY.num_levels - 1 - negative.images[0].classes) > UNMOVED
    )


def test_range_and_gain_change_no_level(street: Path, intensities: Observations, tmp_path: Path) -> None:
    """Of points that have others near by at about the same range; falling off across an edge is no slow change."""

    def weaker(cloud: np.ndarray) -> np.ndarray:
        azimuth = np.arctan2(cloud[:, 1], cloud[:, 0])
        return np.column_stack([cloud[:, :3], cloud[:, 3] * 200.0 * (1.0 + 0.5 * np.sin(azimuth))])

    one = observe_intensity(read_drive(street).model_copy(update={"frames": read_drive(street).frames[:1]}))
    found = observe_intensity(changed(street, tmp_path / "weaker", cloud=weaker))
    assert near(one.clouds[0].classes, found.clouds[0].classes) > UNMOVED


def test_a_start_that_is_off_is_mended_without_labels(
    street: Path, street_truth: Pose, tmp_path: Path
) -> None:
    with edited(street, tmp_path) as document:
        for frame in document["frames"]:
            del frame["point_labels"], frame["image_labels"]
            for key in ("points", "image"):
                frame[key] = str(street / frame[key])
        del document["ignore"], document["classes"], document["T_camera_lidar"]
    rng = np.random.default_rng(1)
    turn, shift = rng.normal(size=(2, 3))
    off = make_pose(tuple(0.02 * turn / np.linalg.norm(turn)), tuple(0.05 * shift / np.linalg.norm(shift)))
    write_transform(off @ street_truth, tmp_path / "start.yaml", "semcal")
    outputs = ["-o", tmp_path / "c.yaml", "--report", tmp_path / "r.html"]
    found = invoke("calibrate", tmp_path, "--cue", "intensity", "--init", tmp_path / "start.yaml", *outputs)
    assert found.exit_code in (0, 3), found.output
    error = compare_poses(read_transform(tmp_path / "c.yaml"), street_truth)
    assert error.rotation_deg < 0.3
    assert error.camera_center_cm < 6.0
    assert "label of the pixel" in (tmp_path / "r.html").read_text()
    written = yaml.safe_load((tmp_path / "c.yaml").read_text())
    assert written["settings"]["options"]["cues"] == {
        "intensity": {"num_levels": INTENSITY.num_levels, "surroundings_deg": INTENSITY.surroundings_deg}
    }
    assert str(street / "images/000000.png") in written["input"]["sha256"]


def test_frames_without_labels_are_chosen_evenly(street: Path) -> None:
    drive = read_drive(street)
    bare = [frame.model_copy(update={"image_labels": None}) for frame in drive.frames]
    chosen = choose_frames(drive.model_copy(update={"frames": tuple(bare)}), ("intensity",), 2)
    assert [frame.points for frame in chosen.frames] == ["points/000000.bin", "points/000003.bin"]


def test_cues_together_add_up(street: Path, street_observations: Observations, street_truth: Pose) -> None:
    """The block of each has its share w of the pairs: I = sum w I_i - sum w log w."""
    intensity = observe_intensity(read_drive(street))
    both = core.agreement(summed(street_observations, intensity).core, street_truth)
    parts = [core.agreement(each.core, street_truth) for each in (street_observations, intensity)]
    weights = np.array([part.joint.sum() for part in parts]) / both.joint.sum()
    each = np.array([part.mutual_information for part in parts])
    assert both.mutual_information == pytest.approx(weights @ each - weights @ np.log(weights))
    loaded = load_cues(read_drive(street), ("labels", "intensity"))
    assert (loaded.num_frames, len(loaded.frame_observations)) == (4, 8)
    many = replace(street_observations, point_class_names=[str(i) for i in range(250)])
    with pytest.raises(CalibrationError, match="found more than 255 classes in all cues"):
        summed(many, intensity)


def test_what_the_cue_needs_is_said(street: Path, tmp_path: Path) -> None:
    drive = read_drive(street)
    bare = drive.model_copy(update={"frames": (drive.frames[0].model_copy(update={"image": None}),)})
    with pytest.raises(
        InputError, match=r"frames\[points/000000.bin\].image: found nothing, expected an image"
    ):
        observe_intensity(bare)
    np.save(tmp_path / "xyz.npy", np.ones((50, 3), np.float32))
    blank = drive.frames[0].model_copy(update={"points": str(tmp_path / "xyz.npy"), "point_labels": None})
    blind = drive.model_copy(update={"frames": (blank,)})
    with pytest.raises(InputError, match=r"xyz.npy: found no intensity, expected one for each point"):
        observe_intensity(blind)
    flat = changed(street, tmp_path / "flat", image=lambda image: np.full_like(image, 90.0))
    with pytest.raises(CalibrationError, match="grey is nearly the same everywhere"):
        observe_intensity(flat)
