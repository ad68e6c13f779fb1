from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from semcal_cli import core
from semcal_cli.config import (
    AlignmentConfig,
    AscentConfig,
    ExactConfig,
    InitializationConfig,
    PolishConfig,
    SensitivityConfig,
)
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.errors import InputError
from semcal_cli.experiments.soic_config import SoicConfig
from semcal_cli.geometry.arrays import Pose
from semcal_cli.labelling.card import NeighborsConfig
from semcal_cli.observations.cues.segments import SegmentationConfig
from semcal_cli.observations.observations import Observations

SUM_ORDER = 1e-9


def test_agreement_is_the_information_of_the_bilinear_joint_histogram(
    street_observations: Observations, street_truth: Pose
) -> None:
    observations = street_observations
    weights = np.zeros((256, 256))
    camera = core_camera(observations.camera)
    width, height = observations.camera.width, observations.camera.height
    num_visible = 0
    for frame in observations.frame_observations:
        points, classes, image = frame.cloud.points, frame.cloud.classes, frame.image.classes
        projected = core.project_points(camera, points, street_truth)
        keep = ~np.isnan(projected.ranges) & ~projected.is_hidden & (classes != 255)
        num_visible += int(keep.sum())
        u, v = np.clip(projected.pixels[keep].T, 0.0, [[width - 1.0], [height - 1.0]])
        left, up = u.astype(int), v.astype(int)
        right, down = np.minimum(left + 1, width - 1), np.minimum(up + 1, height - 1)
        for column, wu in ((left, 1 - (u - left)), (right, u - left)):
            for row, wv in ((up, 1 - (v - up)), (down, v - up)):
                np.add.at(weights, (classes[keep], image[row, column]), wu * wv)
    p = weights[:255, :255] / weights[:255, :255].sum()
    independent = p.sum(1, keepdims=True) * p.sum(0, keepdims=True)
    pointwise = np.log(p, where=p > 0, out=np.zeros_like(p)) - np.log(
        independent, where=independent > 0, out=np.zeros_like(p)
    )
    agreement = core.agreement(observations.core, street_truth)
    assert agreement.mutual_information == pytest.approx((p * pointwise).sum(), abs=SUM_ORDER)
    assert agreement.label_agreement == pytest.approx(p[(p > 0) & (pointwise > 0)].sum(), abs=SUM_ORDER)
    assert agreement.num_inside - agreement.num_hidden == num_visible


def test_wrong_arguments_are_errors(street_observations: Observations, street_truth: Pose) -> None:
    """A panic would be no `Exception`."""
    observations, config = street_observations.core, InitializationConfig()
    images = core.SphericalImages(observations, core.estimate_grid([street_observations.clouds[0].points]))
    cloud = core.LabelledCloud(np.zeros((50, 3), np.float32), np.zeros(5, np.uint8))
    joint = AscentConfig(factors=(1,), changes=(0.0,), sigmas=(1.0,), evidence=1.0)
    for factor in (0, 1000):
        with pytest.raises(ValueError, match="does not fit the image"):
            core.sensitivity(observations, street_truth, SensitivityConfig(factor=factor))
    wrong = "InitializationConfig.roll_step_deg: found 0.0, expected a finite number above 0"
    with pytest.raises(ValueError, match=wrong):
        core.register(observations, images, replace(config, roll_step_deg=0.0))
    with pytest.raises(ValueError, match="50 points have 5 classes"):
        core.steps_at_label_changes([cloud], reach=2, num_blocks=1)
    with pytest.raises(ValueError, match="no lens has the intrinsic radial"):
        core.maximise(observations, street_truth, joint, ["radial"])


CONFIGS: dict[str, tuple[type, ...]] = {
    "Neighbors": (NeighborsConfig,),
    "AlignmentConfig": (AlignmentConfig, ExactConfig),
    "PolishConfig": (PolishConfig,),
    "SensitivityConfig": (SensitivityConfig,),
    "AscentConfig": (AscentConfig,),
    "RegistrationConfig": (InitializationConfig,),
    "SegmentationConfig": (SegmentationConfig,),
    "DescentConfig": (SoicConfig,),
    "Lidar": (SynthConfig,),
    "Shutter": (SynthConfig,),
}


def test_what_the_core_reads_of_settings_is_what_they_are_called() -> None:
    read = dict(core.config_attributes())
    assert read.keys() == CONFIGS.keys()
    for name, attributes in read.items():
        for config in CONFIGS[name]:
            missing = set(attributes) - config.__annotations__.keys()
            assert not missing, f"{config.__name__} has no {missing}"


@pytest.mark.parametrize("num_threads", [2**31, 4097])
def test_more_threads_than_any_machine_has_are_refused(num_threads: int) -> None:
    with pytest.raises(ValueError, match=f"found {num_threads} threads, needed at most 4096"):
        core.set_num_threads(num_threads)


def test_clouds_and_labels_are_read_as_numpy_reads_them(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    cloud = rng.normal(size=(50, 4)).astype(np.float32)
    cloud[[3, 8]] = 0.0
    cloud[5, 1] = np.nan
    ids = rng.integers(0, 2**32, 50, dtype=np.uint32)
    cloud.tofile(tmp_path / "a.bin")
    ids.tofile(tmp_path / "a.label")
    np.save(tmp_path / "b.npy", cloud.astype(np.float64))
    np.save(tmp_path / "c.npy", (ids & 0xFFFF).astype(np.int64))
    kept = np.delete(np.arange(50), [3, 5, 8])
    for names in (("a.bin", "a.label"), ("b.npy", "c.npy")):
        paths = [(tmp_path / names[0], tmp_path / names[1])]
        (sweep,) = core.read_point_clouds(paths)
        np.testing.assert_array_equal(sweep.points, cloud[kept, :3])
        np.testing.assert_array_equal(sweep.intensity, cloud[kept, 3])
        np.testing.assert_array_equal(sweep.labels, (ids & 0xFFFF)[kept])
        assert sweep.num_no_returns == 3


def png(channels: int = 1, size: tuple[int, int] = (4, 3)) -> bytes:
    width, height = size
    image = np.zeros((height, width, channels), np.uint8)
    return cv2.imencode(".png", image)[1].tobytes()


HOSTILE_IMAGES = {
    "a.png: has 3 channels, needs one of class ids, or a palette: of colours in the drive": png(3),
    "a.png: is 5 x 3, the camera is 4 x 3": png(size=(5, 3)),
    "a.png: is not a readable PNG": b"GIF89a",
    "a.png: is not a readable PNG: unexpected end": png()[:40],
}


@pytest.mark.parametrize(("message", "content"), HOSTILE_IMAGES.items(), ids=HOSTILE_IMAGES.keys())
def test_hostile_label_images(tmp_path: Path, message: str, content: bytes) -> None:
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(InputError) as complaint:
        core.read_label_images([tmp_path / "a.png"], 4, 3)
    assert str(complaint.value).startswith(f"{tmp_path}/{message}")
    assert "\n" not in str(complaint.value)


def npy(array: np.ndarray, tmp_path: Path) -> bytes:
    np.save(tmp_path / "made.npy", array)
    return (tmp_path / "made.npy").read_bytes()


def test_hostile_npy(tmp_path: Path) -> None:
    whole = npy(np.ones((5, 3), np.float32), tmp_path)
    hostile = {
        "is not a .npy array": b"\x93NUMPY",
        "holds 56 bytes of data, its header needs shape [5, 3] of <f4": whole[:-4],
        "has shape [5, 2], needs N x 3, or N x 4 and more (x y z intensity ...)": npy(
            np.ones((5, 2)), tmp_path
        ),
        "has the fields x, needs x, y and z": npy(np.zeros(3, [("x", "f4")]), tmp_path),
    }
    for message, content in hostile.items():
        (tmp_path / "a.npy").write_bytes(content)
        with pytest.raises(InputError) as complaint:
            core.read_point_clouds([(tmp_path / "a.npy", None)])
        assert str(complaint.value).startswith(f"{tmp_path}/a.npy: {message}")


@pytest.mark.parametrize("scan", [(1, 1, 0.1, -0.1), (10**9, 10**9, 0.1, -0.1), (64, 1024, -0.1, 0.1)])
def test_a_lidar_of_no_sensible_size(scan: tuple[int, int, float, float]) -> None:
    with pytest.raises(InputError, match=rf"lidar: found {scan[0]} channels x {scan[1]} columns from"):
        core.scan_grid(*scan)
