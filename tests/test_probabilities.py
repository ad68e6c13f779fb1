import zipfile
from pathlib import Path

import numpy as np
import pytest
from conftest import edited
from scipy.ndimage import uniform_filter

from semcal_cli import core
from semcal_cli.config import CalibrationConfig, ExactConfig, PolishConfig, PyramidConfig
from semcal_cli.config.mine_config import MineConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.estimation.refine.mine import MineEstimator
from semcal_cli.estimation.refine.polish import polish_pose
from semcal_cli.estimation.refine.pyramid import ExactEstimator, LevelOptimizer, refine_pose
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.loading import load
from semcal_cli.observations.observations import LabelledImage, Observations
from semcal_cli.observations.reading import load_observations, read_observations
from semcal_cli.pipeline import refine_and_polish, start_at

NUM_CLASSES = 25  # of the synthetic street's ids, 255 is unlabelled

# Three times what four frames of 640 x 360 with borders blurred over five pixels were measured to end at.
MAX_ROTATION_DEG = 0.22


def one_hot(ids: np.ndarray) -> np.ndarray:
    """(H, W) ids to (H, W, C), all zero where unlabelled."""
    return (ids[..., None] == np.arange(NUM_CLASSES)).astype(np.float32)


def save(path: Path, *arrays: np.ndarray) -> Path:
    np.savez_compressed(path, *arrays)
    return path


@pytest.fixture(scope="module")
def soft_street(street: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The street with probabilities whose borders are blurred, as a network's are."""
    folder = tmp_path_factory.mktemp("soft")
    hard = read_observations(read_drive(street))
    with edited(street, folder) as document:
        for index, frame in enumerate(document["frames"]):
            probabilities = one_hot(hard.images[index].classes)
            blurred = uniform_filter(probabilities, (5, 5, 1)).astype(np.float16)
            frame["image_labels"] = str(save(folder / f"{index}.npz", blurred))
            for key in ("points", "point_labels"):
                frame[key] = str(street / frame[key])
            frame.pop("image", None)
        document["ignore"] = {"points": [0]}
        document.pop("classes", None)
    return folder


@pytest.mark.parametrize("dtype", [np.float16, np.uint8])
def test_certain_probabilities_are_ids(tmp_path: Path, dtype: type) -> None:
    ids = np.random.default_rng(0).integers(0, NUM_CLASSES, (6, 9)).astype(np.uint8)
    scale = 255 if dtype is np.uint8 else 0.25  # any scale
    path = save(tmp_path / "a.npz", (one_hot(ids) * scale).astype(dtype))
    (shares,) = core.read_class_shares([path], (6, 9))
    np.testing.assert_array_equal(shares.classes.reshape(6, 9), ids)
    np.testing.assert_array_equal(shares.ids, np.unique(ids))
    (read,) = core.read_label_images([path], 9, 6)
    np.testing.assert_array_equal(read, ids)


def test_certain_shares_give_the_same_pose(street_observations: Observations, street_truth: Pose) -> None:
    observations = street_observations.of_frames([0, 1])
    soft = observations.with_images(
        LabelledImage(image.classes, certain(image.classes)) for image in observations.images
    )
    # Shares have no edge band.
    pairs = (each.without_edge_band for each in (observations, soft))
    poses = [polish_pose(each, street_truth, PolishConfig()).T_camera_lidar for each in pairs]
    np.testing.assert_allclose(poses[0], poses[1], atol=1e-12)


def certain(classes: np.ndarray) -> core.ClassShares:
    return core.ClassShares.certain(classes.ravel())


@pytest.mark.parametrize("estimator", ["exact", "mine"])
def test_a_networks_probabilities_end_at_the_truth(
    soft_street: Path, street_truth: Pose, estimator: str
) -> None:
    observations = load_observations(read_drive(soft_street))
    assert all(image.shares is not None for image in observations.images)
    optimizer: LevelOptimizer = (
        ExactEstimator(observations, ExactConfig(), seed=0)
        if estimator == "exact"
        else MineEstimator(observations, MineConfig(), seed=0)
    )
    refinement = refine_pose(observations, street_truth, optimizer, PyramidConfig())
    polished = polish_pose(observations, refinement.T_camera_lidar, PolishConfig())
    error = compare_poses(polished.T_camera_lidar, street_truth)
    assert error.rotation_deg < MAX_ROTATION_DEG


def test_segments_end_at_the_truth_by_soft_images(soft_street: Path, street_truth: Pose) -> None:
    data = load(soft_street, CalibrationConfig(cues=("segments",)))
    assert all(image.shares is not None for image in data.observations.images)
    start = displace(street_truth, 1.0, 0.1, np.random.default_rng(0))
    initial = start_at(data, InitialPose(start, "start"))
    found = refine_and_polish(data, initial, CalibrationConfig().refinement)
    assert compare_poses(found.T_camera_lidar, street_truth).rotation_deg < MAX_ROTATION_DEG


def test_probabilities_of_points_are_read_with_their_sweep(street: Path, tmp_path: Path) -> None:
    hard = read_observations(read_drive(street))
    with edited(street, tmp_path) as document:
        document["frames"] = document["frames"][:1]
        frame = document["frames"][0]
        ids = np.fromfile(street / frame["point_labels"], np.uint32) & 0xFFFF
        path = save(tmp_path / "a.npz", np.float16(0.75) * one_hot(ids).astype(np.float16))
        frame |= {key: str(street / frame[key]) for key in ("points", "image_labels")}
        frame["point_labels"] = str(path)
    soft = read_observations(read_drive(tmp_path))
    assert soft.clouds[0].shares is not None
    names = np.array([*soft.point_class_names, "none"]), np.array([*hard.point_class_names, "none"])
    found, expected = (
        names[i][np.minimum(each.clouds[0].classes, len(names[i]) - 1)] for i, each in enumerate((soft, hard))
    )
    np.testing.assert_array_equal(found, expected)
    save(path, one_hot(ids[1:]))
    with pytest.raises(InputError, match=rf"a\.npz: has shape .*, needs {len(ids)} x C probabilities"):
        read_observations(read_drive(tmp_path))


@pytest.mark.parametrize(
    ("array", "complaint"),
    [
        (
            np.zeros((6, 8, 3), np.float32),
            r"has shape \[6, 8, 3\], needs 6 x 9 x C probabilities, C at most 255",
        ),
        (
            np.full((6, 9, 3), -0.5, np.float32),
            "item 0: holds -0.5, a probability is finite and not negative",
        ),
        (np.full((6, 9, 3), np.nan, np.float32), "item 0: holds NaN"),
        (np.ones((6, 9, 255), np.uint8), "spreads its items over more than 32 classes each, on average"),
        (np.zeros((6, 9, 3), np.int32), "needs little-endian float16, float32, float64, or uint8"),
        (np.asfortranarray(np.zeros((6, 9, 3), np.float32)), "is Fortran-ordered, needs C order"),
    ],
)
def test_what_are_no_probabilities_is_refused(tmp_path: Path, array: np.ndarray, complaint: str) -> None:
    path = save(tmp_path / "a.npz", array)
    with pytest.raises(InputError, match=rf"a\.npz: .*{complaint}"):
        core.read_class_shares([path], (6, 9))


def test_what_is_no_single_array_is_refused(tmp_path: Path) -> None:
    two = save(tmp_path / "two.npz", np.zeros(3), np.zeros(3))
    with pytest.raises(InputError, match=r"two\.npz: holds 2 arrays, needs one"):
        core.read_class_shares([two], (6, 9))
    whole = save(tmp_path / "a.npz", np.ones((6, 9, 3), np.float32)).read_bytes()
    for end in range(0, len(whole), 7):
        (tmp_path / "cut.npz").write_bytes(whole[:end])
        with pytest.raises(InputError, match=r"cut\.npz: "):
            core.read_class_shares([tmp_path / "cut.npz"], (6, 9))


@pytest.mark.parametrize(
    ("header", "complaint"),
    [
        (b"\x93NUMPY\x02\x00" + b"\xff" * 4, "its header is too long"),
        (b"\x93NUMPY\x01\x00" + (400).to_bytes(2, "little") + b"[" * 400, "its header is nested too deeply"),
        (b"no array", "it does not start like one"),
    ],
)
def test_headers_that_ask_for_too_much_are_refused(tmp_path: Path, header: bytes, complaint: str) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("arr_0.npy", header)
    with pytest.raises(InputError, match=rf"a\.npz: is not a \.npy array: {complaint}"):
        core.read_class_shares([tmp_path / "a.npz"], (6, 9))
