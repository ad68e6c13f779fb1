from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from laboratory.label_errors import imitate_network, with_ragged_things

from semcal_cli.checks.inspection import inspect
from semcal_cli.checks.shifted_labels import check_label_alignment, spread
from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.files.image_files import read_image, write_image
from semcal_cli.findings.check import findings_among
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.frame_naming import frame_list
from semcal_cli.observations.loading import load
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.reading import load_observations
from semcal_cli.pipeline import calibrate
from semcal_cli.pipeline.verification import verify
from semcal_cli.synthetic.label_noise import with_wrong_labels

Labels = npt.NDArray[np.uint8]


@pytest.fixture(scope="module")
def street_drive(street: Path) -> Drive:
    return read_drive(street)


def with_points_changed(
    observations: Observations, change: Callable[[int], npt.NDArray[np.intp]]
) -> Observations:
    """Permute points with their labels, by a permutation of each number of points."""
    clouds = []
    for cloud in observations.clouds:
        order = change(cloud.num_points)
        clouds.append(cloud.with_points(cloud.points[order]).with_classes(cloud.classes[order]))
    return observations.with_clouds(clouds)


def with_point_labels_moved(observations: Observations, entries: int, step: int = 1) -> Observations:
    return observations.with_clouds(
        cloud if index % step else cloud.with_classes(np.roll(cloud.classes, entries))
        for index, cloud in enumerate(observations.clouds)
    )


def with_pixels_moved(
    observations: Observations, move: Callable[[Labels], Labels], step: int = 1
) -> Observations:
    return observations.with_images(
        image if index % step else image.with_classes(move(image.classes))
        for index, image in enumerate(observations.images)
    )


def resized(labels: Labels) -> Labels:
    """Shrink a label image by 1.5 % about its corner, as a tool does that takes the sizes of two cameras for one."""
    matrix = np.array([[0.985, 0.0, 0.0], [0.0, 0.985, 0.0]])
    size = labels.shape[::-1]
    return cv2.warpAffine(labels, matrix, size, flags=cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)


GOOD: dict[str, Callable[[Observations, np.random.Generator], Observations]] = {
    "exact": lambda observations, rng: observations,
    "30 % wrong": lambda observations, rng: with_wrong_labels(observations, 0.3, rng),
    "a network's": imitate_network,
    "grown": lambda observations, rng: with_ragged_things(observations, 2),
    "points in no order": lambda observations, rng: with_points_changed(observations, rng.permutation),
}


@pytest.mark.parametrize("kind", GOOD)
def test_labels_where_they_belong_give_no_finding(
    street_drive: Drive, street_observations: Observations, kind: str
) -> None:
    good = GOOD[kind](street_observations, np.random.default_rng(3))
    assert findings_among(check_label_alignment(street_drive, good).measured) == ()


POINTS = "point labels{of} fit the clouds better when shifted by {by}"
PIXELS = "label images{of} fit their images better when {by}"
EVEN = " of frames 000000 and 000002"
DISPLACED: dict[str, tuple[Callable[[Observations], Observations], str]] = {
    "1 entry": (
        lambda seen: with_point_labels_moved(seen, 1),
        POINTS.format(of="", by="1 entry towards the start"),
    ),
    "3 back": (
        lambda seen: with_point_labels_moved(seen, -3),
        POINTS.format(of="", by="3 entries towards the end"),
    ),
    "some points": (lambda seen: with_point_labels_moved(seen, 5, step=2), POINTS.format(of=EVEN, by="5 ")),
    "3 right": (
        lambda seen: with_pixels_moved(seen, lambda labels: np.roll(labels, 3, axis=1)),
        PIXELS.format(of="", by="shifted by 3 pixels left, by "),
    ),
    "2 right and 3 up": (
        lambda seen: with_pixels_moved(seen, lambda labels: np.roll(labels, (-3, 2), axis=(0, 1))),
        PIXELS.format(of="", by="shifted by 2 pixels left and 3 down, by "),
    ),
    "resized": (
        lambda seen: with_pixels_moved(seen, resized),
        PIXELS.format(
            of="", by="scaled by 1.015 about the middle and shifted by 5 pixels right and 3 down, by "
        ),
    ),
    "some pixels": (
        lambda seen: with_pixels_moved(seen, lambda labels: np.roll(labels, 4, axis=0), step=2),
        PIXELS.format(of=EVEN, by="shifted by 4 pixels up"),
    ),
    "4 pixels down": (
        lambda seen: with_pixels_moved(seen, lambda labels: np.roll(labels, 4, axis=0)),
        PIXELS.format(of="", by="shifted by 4 pixels up"),
    ),
}


@pytest.mark.parametrize(
    ("displaced", "noise"),
    [
        *((name, "exact") for name in DISPLACED),
        ("1 entry", "30 % wrong"),
        ("3 back", "a network's"),
        ("4 pixels down", "a network's"),
    ],
)
def test_labels_of_others_are_found(
    street_drive: Drive, street_observations: Observations, displaced: str, noise: str
) -> None:
    displace, start = DISPLACED[displaced]
    good = GOOD[noise](street_observations, np.random.default_rng(3))
    (found,) = findings_among(check_label_alignment(street_drive, displace(good)).measured)
    assert found.sentence.startswith(start)


def test_images_that_cannot_be_read_are_left_out(drive: Path, street_observations: Observations) -> None:
    moved = with_pixels_moved(street_observations, lambda labels: np.roll(labels, 4, axis=1))
    (drive / "images/000001.png").unlink()
    aligned = check_label_alignment(read_drive(drive), moved)
    (finding,), (note,) = findings_among(aligned.measured), aligned.notes
    assert finding.sentence.startswith("label images fit their images better when shifted by 4 pixels left")
    assert note == (
        "not all label images were checked against their images: images/000001.png: no such file or folder"
    )
    for file in (drive / "images").iterdir():
        file.unlink()
    assert findings_among(check_label_alignment(read_drive(drive), moved).measured) == ()


def test_calibrate_and_verify_doubt_and_inspect_suspects(drive: Path, street_truth: Pose) -> None:
    for path in (drive / "point_labels").iterdir():
        np.roll(np.fromfile(path, "<u4"), 3).tofile(path)
    for path in (drive / "image_labels").iterdir():
        write_image(np.roll(read_image(path)[..., 0], 3, axis=1), path)
    of_points = "point labels fit the clouds better when shifted by 3 entries"
    of_pixels = "label images fit their images better when shifted by 3 pixels left"
    data = load(drive, CalibrationConfig())
    truth = InitialPose(street_truth, "the truth")
    verification = verify(data, truth)
    assert verification.verdict == "inconclusive"
    calibration = calibrate(data, initial_pose=truth)
    assert calibration.status == "not_trusted"
    for sentences in (verification.reasons, calibration.reasons, inspect(read_drive(drive)).suspicions):
        assert any(sentence.startswith(of_points) for sentence in sentences)
        assert any(sentence.startswith(of_pixels) for sentence in sentences)


@pytest.mark.parametrize("num_frames", [5, 10, 13, 70])
def test_few_images_are_of_even_and_odd_frames(num_frames: int) -> None:
    chosen = spread(num_frames)
    assert len(set(chosen)) == 4
    assert 0 <= min(chosen) <= max(chosen) < num_frames
    assert sum(index % 2 for index in chosen) == 2


def test_long_lists_of_frames_are_short() -> None:
    names = [f"points/{index:06d}.bin" for index in range(80)]
    assert frame_list(names, [7]) == "frame 000007"
    assert frame_list(names, [1, 2]) == "frames 000001 and 000002"
    assert frame_list(names, [1, 2, 3, 9]) == "frames 000001 to 000003 and 000009"
    assert frame_list(names, range(1, 71)) == "frames 000001 to 000070"
    every_other = "frames 000000, 000002, 000004, 000006, 000008 and 30 others"
    assert frame_list(names, range(0, 70, 2)) == every_other


def test_labels_of_a_real_frame_belong_to_its_points_and_pixels(rellis3d: Path) -> None:
    drive = read_drive(rellis3d)
    observations = load_observations(drive)
    assert findings_among(check_label_alignment(drive, observations).measured) == ()
    (found,) = findings_among(check_label_alignment(drive, with_point_labels_moved(observations, 1)).measured)
    assert found.sentence.startswith(
        "point labels fit the clouds better when shifted by 1 entry towards the start"
    )
