"""Covariances for ROS and GTSAM, against what samples of the pose show in the definitions of both."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from commands import invoke
from format_files import T_ANY
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from test_calibration import make_calibration

from semcal_cli.api.results import Calibration
from semcal_cli.errors import InputError
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import inverse
from semcal_cli.geometry.twists import adjoint
from semcal_cli.result.calibration_document import CalibrationDocument, write_calibration
from semcal_cli.result.uncertainty import Uncertainty

NUM_SAMPLES = 100_000
SAMPLING_ERROR = 0.02
"""Four standard errors of a sampled correlation."""
MIX = np.random.default_rng(5).normal(size=(6, 6)) * [[1e-3], [2e-3], [4e-3], [3e-3], [1e-3], [2e-3]]
COVARIANCE = MIX @ MIX.T
"""Correlated, of another size along each axis; metres and radians."""
T_LIDAR_CAMERA = inverse(T_ANY)


@pytest.fixture(scope="module")
def samples() -> np.ndarray:
    """Poses (N, 4, 4) of the camera in the LiDAR frame: the inverses of exp(xi) T_camera_lidar."""
    xi = np.random.default_rng(1).multivariate_normal(np.zeros(6), COVARIANCE, NUM_SAMPLES)
    generators = np.zeros((NUM_SAMPLES, 4, 4))
    generators[:, :3, 3] = xi[:, :3]
    for axis, (row, column) in enumerate(((2, 1), (0, 2), (1, 0))):
        generators[:, row, column], generators[:, column, row] = xi[:, 3 + axis], -xi[:, 3 + axis]
    return np.linalg.inv(expm(generators) @ T_ANY)


def trusted() -> CalibrationDocument:
    uncertainty = Uncertainty.from_covariance(T_ANY, COVARIANCE, np.full(6, 1e9))
    return make_calibration(T_ANY).model_copy(update={"uncertainty": uncertainty})


def sampled_ros(samples: np.ndarray) -> np.ndarray:
    """Sample positions, and rotations about the fixed axes, as PoseWithCovariance defines them."""
    turns = Rotation.from_matrix(samples[:, :3, :3] @ T_LIDAR_CAMERA[:3, :3].T).as_rotvec()
    return np.cov(np.hstack([samples[:, :3, 3], turns]).T)


def sampled_gtsam(samples: np.ndarray) -> np.ndarray:
    """Sample Pose3's local coordinates, the rotation first, of T_lidar_camera^-1 T_sample."""
    local = np.linalg.inv(T_LIDAR_CAMERA) @ samples
    turns = Rotation.from_matrix(local[:, :3, :3]).as_rotvec()
    return np.cov(np.hstack([turns, local[:, :3, 3]]).T)


def difference(a: np.ndarray, b: np.ndarray) -> float:
    """Compute the largest difference of two covariances, relative to the standard deviations of the second."""
    sigmas = np.sqrt(np.diag(b))
    return float(np.abs((a - b) / np.outer(sigmas, sigmas)).max())


def swapped(covariance: np.ndarray) -> np.ndarray:
    """Exchange rotation and translation."""
    return np.roll(covariance, (3, 3), (0, 1))


@pytest.mark.parametrize(
    ("name", "sampled", "key"),
    [("pose-with-covariance", sampled_ros, "pose"), ("gtsam", sampled_gtsam, "T_lidar_camera")],
)
def test_the_written_covariance_is_that_of_samples(
    name: str, sampled: Callable[[np.ndarray], np.ndarray], key: str, samples: np.ndarray, tmp_path: Path
) -> None:
    """Another side, order or frame differs by far more than the samples do."""
    write_calibration(trusted(), tmp_path / "c.yaml")
    done = invoke("convert", tmp_path / "c.yaml", "--to", name, "-o", tmp_path / "out")
    assert (done.exit_code, done.output) == (0, "")
    document = yaml.safe_load((tmp_path / "out").read_text())
    written, truth = np.reshape(document["covariance"], (6, 6)), sampled(samples)
    assert key in document
    assert difference(written, truth) < SAMPLING_ERROR
    other_sides = [COVARIANCE, *(Ad @ COVARIANCE @ Ad.T for Ad in map(adjoint, (T_ANY, T_LIDAR_CAMERA)))]
    wrong = [swapped(written), *other_sides[name == "gtsam" :], *map(swapped, other_sides[1:])]
    assert min(difference(each, truth) for each in wrong) > 10.0 * SAMPLING_ERROR
    np.testing.assert_allclose(read_transform(tmp_path / "out"), T_ANY, atol=1e-8)


def test_the_message_is_what_ros_takes(tmp_path: Path) -> None:
    from rosbags.typesys import Stores, get_typestore

    Calibration.of(trusted()).save(tmp_path / "pose.yaml", "pose-with-covariance")
    document = yaml.safe_load((tmp_path / "pose.yaml").read_text())
    fields = get_typestore(Stores.ROS2_HUMBLE).fielddefs
    for kind, part in (
        ("PoseWithCovariance", document),
        ("Pose", document["pose"]),
        ("Point", document["pose"]["position"]),
        ("Quaternion", document["pose"]["orientation"]),
    ):
        assert [name for name, _ in fields[f"geometry_msgs/msg/{kind}"][1]] == [*part]
    assert [len(document["covariance"]), {*map(type, document["covariance"])}] == [36, {float}]


def test_the_interval_by_students_t_is_not_narrowed(tmp_path: Path) -> None:
    """A reader takes the covariance as that of a normal distribution."""
    uncertainty = Uncertainty.from_covariance(T_ANY, COVARIANCE, np.full(6, 4.0))
    few = make_calibration(T_ANY).model_copy(update={"uncertainty": uncertainty})
    write_calibration(few, tmp_path / "c.yaml")
    document = json.loads(invoke("convert", tmp_path / "c.yaml", "--to", "gtsam").stdout)
    widths_m = 1.96 * np.sqrt(np.diag(document["covariance"])[3:])
    np.testing.assert_allclose(widths_m, few.uncertainty.half_width_95_camera_center_m, rtol=1e-4)


@pytest.mark.parametrize("name", ["pose-with-covariance", "gtsam"])
def test_without_a_believed_uncertainty_there_is_no_covariance(name: str, tmp_path: Path) -> None:
    bare, doubted, unknown = (tmp_path / f"{file}.yaml" for file in ("bare", "doubted", "unknown"))
    bare.write_text(f"semcal_transform: 1\nT_camera_lidar: {T_ANY.tolist()}\n")
    write_calibration(trusted().model_copy(update={"status": "not_trusted", "reasons": ("x",)}), doubted)
    write_calibration(trusted().model_copy(update={"uncertainty": None}), unknown)
    needed = "found no uncertainty that is believed, expected a calibration of semcal that states one and is trusted"
    for path in (bare, doubted, unknown):
        done = invoke("convert", path, "--to", name, "-o", tmp_path / "out")
        assert isinstance(done.exception, InputError)
        assert str(done.exception) == f"--to {name}: {needed}"
        assert not (tmp_path / "out").exists()
