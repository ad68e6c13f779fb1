"""What keeps a wrong pose from being trusted: rivals by labels, errors of K, labels from images, its own drive."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import invoke
from conftest import edited, run

from semcal_cli import core
from semcal_cli.api.calls import calibrate
from semcal_cli.checks.leaked_labels import check_leaks
from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import read_drive
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.estimation.uncertainty.information import InformationBySquares
from semcal_cli.estimation.uncertainty.quantiles import hotelling_quantile
from semcal_cli.findings.check import findings_among
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.loading import load
from semcal_cli.observations.observations import NO_CLASS, Observations
from semcal_cli.pipeline.verification import verify
from semcal_cli.result.calibration_document import read_calibration
from semcal_cli.result.uncertainty import Uncertainty

LABELS_ALONE = CalibrationConfig(cues=("labels",))


def painted(observations: Observations, T_camera_lidar: Pose) -> Observations:
    """Label points by the pixels that they land on, as a tool does that projects label images into clouds."""
    camera, clouds = core_camera(observations.camera), []
    height, width = observations.images[0].classes.shape
    for cloud, image in zip(observations.clouds, observations.images, strict=True):
        projected = core.project_points(camera, cloud.points, T_camera_lidar)
        is_seen = np.isfinite(projected.ranges)
        column, row = np.rint(np.where(is_seen[:, None], projected.pixels, 0.0)).astype(int).T
        pixels = image.classes[row.clip(0, height - 1), column.clip(0, width - 1)]
        clouds.append(cloud.with_classes(np.where(is_seen, pixels, NO_CLASS).astype(np.uint8)))
    return observations.with_clouds(clouds)


def test_labels_from_images_are_named(street_observations: Observations, street_truth: Pose) -> None:
    assert findings_among(check_leaks(street_observations, street_truth)) == ()
    wrong = displace(street_truth, 2.0, 0.2, np.random.default_rng(3))
    (found,) = findings_among(check_leaks(painted(street_observations, wrong), wrong))
    assert found.topic == "leaked-labels"


@pytest.mark.parametrize("seed", [91, 93, 95])
def test_a_real_frame_with_many_tops_is_not_trusted(rellis3d: Path, seed: int) -> None:
    """Each of these was trusted 1.2 to 1.5 m from the published place."""
    T_start = displace(read_transform(rellis3d), 2.0, 0.2, np.random.default_rng(seed))
    found = calibrate(
        load(rellis3d, LABELS_ALONE), LABELS_ALONE, initial_pose=InitialPose(T_start, "a start")
    )
    assert "other-pose" in found.topics


def test_a_synthetic_frame_is_trusted(street: Path) -> None:
    data = load(street, LABELS_ALONE).of_frames([1])
    T_start = displace(read_transform(street), 2.0, 0.2, np.random.default_rng(1))
    found = calibrate(data, LABELS_ALONE, initial_pose=InitialPose(T_start, "a start"))
    assert found.topics == ()


def forget_sigma(drive: Path) -> None:
    """Let a drive say nothing of how well its K is known."""
    with edited(drive) as document:
        assert set(document["camera"].pop("intrinsics_sigma").values()) == {0.0}


def interval(drive: Path, folder: Path, *options: object) -> tuple[Uncertainty, str]:
    answer = invoke("calibrate", drive, "-o", folder / "found.yaml", *options)
    assert answer.exit_code in (0, 3), answer.output
    found = read_calibration(folder / "found.yaml").uncertainty
    assert found is not None
    return found, answer.output


def test_k_is_part_of_the_interval_unless_it_is_exact(drive: Path, tmp_path: Path) -> None:
    """A drive that states nothing has 0.1 % and one pixel; zeros leave the interval of the labels alone."""
    forget_sigma(drive)
    exact, said_exact = interval(drive, tmp_path, "--intrinsics-sigma", "0", "0")
    stated, _ = interval(drive, tmp_path, "--intrinsics-sigma", "0.1", "1")
    default, said = interval(drive, tmp_path)
    assert exact.covariance_of_intrinsics is None
    np.testing.assert_allclose(default.covariance, stated.covariance)
    by_k = np.array(default.covariance_of_intrinsics)
    np.testing.assert_allclose(
        np.array(default.covariance), np.array(exact.covariance) + by_k, rtol=1e-9, atol=1e-18
    )
    assert ("errors of K account" in said, "errors of K account" in said_exact) == (True, False)


def test_labels_without_images_are_said_to_be_unchecked(street: Path) -> None:
    drive = read_drive(street)
    frames = tuple(frame.model_copy(update={"image": None}) for frame in drive.frames)
    found = calibrate(drive.model_copy(update={"frames": frames}), LABELS_ALONE)
    assert "labels were not checked against images: the drive has no images" in found.notes


def test_its_own_drive_proves_nothing(street: Path) -> None:
    drive = read_drive(street)
    record = calibrate(drive, LABELS_ALONE)
    stored = InitialPose(record.pose, "stored", record=record)
    data = load(drive, LABELS_ALONE)
    found = verify(data, stored)
    assert (found.verdict, found.topics) == ("inconclusive", ("own-drive",))
    assert verify(data, replace(stored, record=None)).verdict == "pass"


def test_a_conversion_tells_that_the_transform_is_not_trusted(
    rellis3d: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "found.yaml"
    found = invoke("calibrate", rellis3d, "--init", rellis3d, "-o", out)
    assert found.exit_code == 3
    assert "95 % interval" not in found.output
    warning = f"{out}: the transform is not trusted"
    _, _, said = run(capfd, "convert", out, "--to", "kalibr", "-o", tmp_path / "chain.yaml")
    assert warning in said
    # Of what was not written, nothing is said but why.
    code, _, said = run(capfd, "convert", out, "--to", "kalibr", "-o", tmp_path / "none" / "chain.yaml")
    assert code == 1
    assert warning not in said


def test_the_quantile_of_a_scatter_matrix_is_hotellings() -> None:
    """Six means of 13 draws are as often beyond it as it says, and of six they tell nothing."""
    draws = np.random.default_rng(0).normal(size=(20_000, 13, 6))
    means, covariances = draws.mean(axis=1), np.array([np.cov(each.T) for each in draws]) / 13
    squared = np.einsum("ni,nij,nj->n", means, np.linalg.inv(covariances), means)
    share = np.mean(squared > hotelling_quantile(0.05, 12))
    assert abs(share - 0.05) < 4 * np.sqrt(0.05 * 0.95 / len(draws))
    assert hotelling_quantile(0.05, 5) == np.inf


def test_a_frame_of_one_square_has_no_standard_error() -> None:
    found = InformationBySquares(
        np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1]]), np.array([1.0, 2.0, 4.0]), np.ones(3), np.arange(3)
    )
    # Two squares: half their difference, times the root of n / (n - 1) over n.
    np.testing.assert_allclose(found.sigma_by_frame, [np.inf, 1.0, np.inf])


@pytest.mark.parametrize(
    "known",
    [
        ("--fix", "rx,ry,rz", "--intrinsics-sigma", "5", "20"),
        ("--prior-rotation-deg", "0", "0", "0", "400"),
    ],
)
def test_errors_of_k_beside_priors_are_part_of_the_covariance(
    drive: Path, tmp_path: Path, known: tuple[str, ...]
) -> None:
    forget_sigma(drive)
    found, _ = interval(drive, tmp_path, "--init", drive, *known)
    whole, part = np.array(found.covariance), np.array(found.covariance_of_intrinsics)
    assert np.linalg.eigvalsh(whole - part).min() > -1e-6 * np.abs(whole).max()
