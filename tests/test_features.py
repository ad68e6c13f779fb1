"""Features as a cue: vectors that nobody knows the meaning of, instead of labels."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

sys.path.insert(0, str(Path(__file__).parent / "benchmarks"))
from features import embedded

from semcal_cli.api.calls import calibrate
from semcal_cli.config import CalibrationConfig, RefinementConfig
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.estimation.refine.torch_geometry import exp_se3
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.cues.cue_table import load_cues
from semcal_cli.observations.cues.features import observe_features
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.observations import Observations
from semcal_cli.pipeline import refine

RIGHT_DEG, RIGHT_CM = 0.3, 6.0
"""Of four small pairs with noise as long as classes are apart."""


@pytest.fixture(scope="module")
def drive(street: Path, tmp_path_factory: pytest.TempPathFactory) -> Drive:
    """The street without a label, its classes' vectors on either side random."""
    folder = tmp_path_factory.mktemp("features") / "drive"
    shutil.copytree(street, folder)
    return embedded(read_drive(folder), seed=1, noise=1.0)


@pytest.fixture(scope="module")
def observations(drive: Drive) -> Observations:
    return load_cues(drive, ("features",))


def off(T: Pose) -> Pose:
    twist = torch.tensor([0.06, -0.05, 0.04, 0.012, -0.01, 0.008], dtype=torch.float64)
    return exp_se3(twist).numpy() @ T


def test_mine_finds_the_pose_by_features_alone(drive: Drive, street_truth: Pose) -> None:
    config = CalibrationConfig(cues=("features",), refinement=RefinementConfig("mine"))
    calibration = calibrate(drive, config, initial_pose=InitialPose(off(street_truth), "start"))
    error = compare_poses(calibration.pose, street_truth)
    assert error.rotation_deg < RIGHT_DEG
    assert error.camera_center_cm < RIGHT_CM
    assert calibration.status in ("not_assessed", "not_trusted")
    assert "point_features_000000.npy" in calibration.input.sha256
    assert calibration.input.frames[0].image_labels is None


def test_vectors_of_blocks_are_those_of_their_pixels(drive: Drive, tmp_path: Path) -> None:
    """A network's map may be smaller than the image by a whole number."""
    frame = drive.frames[0]
    whole = np.load(drive.resolve(str(frame.image_features)))
    np.save(tmp_path / "small.npy", whole[::4, ::4])
    small = frame.model_copy(update={"image_features": str(tmp_path / "small.npy")})
    found = observe_features(drive.model_copy(update={"frames": (small,)}))
    assert found.images[0].vectors.shape == (90, 160, 16)
    assert found.images[0].classes.shape == (360, 640)


@pytest.mark.parametrize(
    ("key", "array", "complaint"),
    [
        ("image_features", np.zeros((100, 640, 4)), r"found shape \(100, 640, 4\), needed \(360, 640, C\)"),
        ("image_features", np.zeros((360, 640)), r"found shape \(360, 640\), needed"),
        (
            "point_features",
            np.zeros((3, 4)),
            r"found shape \(3, 4\), needed \(\d+, C\): points/000000.bin has",
        ),
        ("point_features", np.array(["a"]), r"found <U1, expected an array of numbers"),
        ("point_features", None, "found no NumPy array"),
        (
            "image_features",
            np.full((360, 640, 2), np.nan),
            "features of pixels: found values that are not finite",
        ),
    ],
)
def test_wrong_features_are_said(
    key: str, array: np.ndarray | None, complaint: str, drive: Drive, tmp_path: Path
) -> None:
    file = tmp_path / "wrong.npy"
    file.write_bytes(b"nothing") if array is None else np.save(file, array)
    frame = drive.frames[0].model_copy(update={key: str(file)})
    with pytest.raises(InputError, match=complaint):
        observe_features(drive.model_copy(update={"frames": (frame,)}))


def test_features_that_say_nothing(drive: Drive, tmp_path: Path) -> None:
    np.save(tmp_path / "flat.npy", np.ones((360, 640, 2)))
    frame = drive.frames[0].model_copy(update={"image_features": str(tmp_path / "flat.npy")})
    with pytest.raises(CalibrationError, match="features of pixels are all the same"):
        observe_features(drive.model_copy(update={"frames": (frame,)}))
    bare = drive.frames[0].model_copy(update={"point_features": None})
    with pytest.raises(InputError, match=r"point_features: found nothing, expected a .npy file of features"):
        observe_features(drive.model_copy(update={"frames": (bare,)}))


def test_the_exact_histogram_is_refused(drive: Drive, observations: Observations, street_truth: Pose) -> None:
    data = LoadedDrive(drive, observations, ("features",))
    with pytest.raises(InputError, match="--estimator exact: found features, which have no histogram"):
        refine(data, street_truth, RefinementConfig())


def test_features_of_returns_that_were_left_out_are_left_out(drive: Drive, tmp_path: Path) -> None:
    frame = drive.frames[0]
    cloud = np.fromfile(drive.resolve(frame.points), np.float32).reshape(-1, 4)
    features = np.load(drive.resolve(str(frame.point_features)))
    cloud = np.insert(cloud, 10, 0.0, axis=0)
    cloud.tofile(tmp_path / "p.bin")
    np.save(tmp_path / "p.npy", np.insert(features, 10, 99.0, axis=0))
    names = {"points": str(tmp_path / "p.bin"), "point_features": str(tmp_path / "p.npy")}
    one = drive.model_copy(update={"frames": (frame.model_copy(update=names),)})
    found, before = (observe_features(each) for each in (one, drive.model_copy(update={"frames": (frame,)})))
    np.testing.assert_allclose(found.clouds[0].vectors, before.clouds[0].vectors, atol=0.05)
