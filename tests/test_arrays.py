"""Arrays of a program in place of files: the same numbers, to the bit, and errors that name the argument."""

import re
import shutil
import sys
from collections.abc import Iterator
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from conftest import SMALL_DRIVE

sys.path.insert(0, str(Path(__file__).parent / "benchmarks"))
from arrays import arrays_of
from features import embedded

import semcal_cli as semcal
from semcal_cli.config import CalibrationConfig, CueName, RefinementConfig
from semcal_cli.drive.camera import Camera
from semcal_cli.drive.class_ids import Ignore
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.errors import InputError
from semcal_cli.observations.frame_selection import select_frames
from semcal_cli.observations.loading import load
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.reading import load_observations, read_clouds
from semcal_cli.result.provenance import hash_input
from semcal_cli.synthetic.synthesis import synthesize

CUES: tuple[tuple[CueName, ...], ...] = (
    ("labels",),
    ("segments",),
    ("edges",),
    ("intensity",),
    ("segments", "intensity"),
    ("labels", "intensity"),
)


def numbers(observations: Observations) -> Iterator[npt.NDArray[Any] | None]:
    """All arrays that a calibration computes with."""
    for cloud, image in zip(observations.clouds, observations.images, strict=True):
        yield from (cloud.points, cloud.classes, cloud.vectors, cloud.exposed_s)
        yield from (image.classes, image.vectors)
        for shares in (cloud.shares, image.shares):
            yield None if shares is None else shares.classes


def assert_same(a: Observations, b: Observations) -> None:
    for left, right in zip(numbers(a), numbers(b), strict=True):
        np.testing.assert_array_equal(left, right)
        assert left is None or left.dtype == right.dtype
    for observed, other in zip(a.frame_observations, b.frame_observations, strict=True):
        assert (observed.weight, observed.twist_per_s, observed.is_rigid) == (
            other.weight,
            other.twist_per_s,
            other.is_rigid,
        )
    assert (a.point_class_names, a.image_class_names) == (b.point_class_names, b.image_class_names)


def both(drive: Drive, config: CalibrationConfig) -> tuple[Observations, Observations]:
    """What is loaded of a drive, from its arrays and from its files."""
    of_arrays, of_files = (load(each, config) for each in (Drive.from_arrays(**arrays_of(drive)), drive))
    return of_arrays.observations, of_files.observations


@pytest.mark.parametrize("cues", CUES, ids="+".join)
def test_arrays_load_as_files_do(synthetic: Drive, cues: tuple[CueName, ...]) -> None:
    of_arrays, of_files = both(synthetic, CalibrationConfig(cues=cues))
    assert_same(of_arrays, of_files)
    assert of_arrays.starts == of_files.starts


def test_features_load_as_files_do(synthetic: Drive, tmp_path: Path) -> None:
    drive = embedded(read_drive(shutil.copytree(synthetic.root, tmp_path / "drive")), seed=1, noise=1.0)
    assert_same(*both(drive, CalibrationConfig(cues=("features",), refinement=RefinementConfig("mine"))))


def test_sweeps_of_arrays_are_untwisted_by_the_same_poses(tmp_path: Path) -> None:
    synthesize(replace(SMALL_DRIVE, num_frames=2, motion="mixed"), tmp_path / "drive")
    drive = read_drive(tmp_path / "drive")
    of_arrays, of_files = both(drive, CalibrationConfig())
    assert of_arrays.frame_observations[0].twist_per_s is not None
    assert_same(of_arrays, of_files)
    hashed = hash_input(Drive.from_arrays(**arrays_of(drive)), ["points"])
    assert list(hashed) == ["points[0]", "points[1]", "poses", "point_times[0]", "point_times[1]"]


def test_probabilities_load_as_files_do(synthetic: Drive, tmp_path: Path) -> None:
    arrays, rng = arrays_of(synthetic), np.random.default_rng(0)
    arrays |= {"classes": None, "ignore": {}}
    for key in ("point_labels", "image_labels"):
        labels = [np.where(each < 30, each, 0).astype(np.intp) for each in arrays[key]]
        shares = (np.eye(30)[each] + 0.1 * rng.random((*each.shape, 1)) * np.eye(30)[3] for each in labels)
        arrays[key] = [each.astype(np.float16) for each in shares]
    frames = []
    for index, frame in enumerate(synthetic.frames):
        files = {key: str(tmp_path / f"{key}_{index}.npz") for key in ("point_labels", "image_labels")}
        for key, file in files.items():
            np.savez_compressed(file, arrays[key][index])
        frames.append(frame.model_copy(update=files))
    drive = synthetic.model_copy(update={"frames": tuple(frames), "classes": None, "ignore": Ignore()})
    of_arrays, of_files = (load_observations(each) for each in (Drive.from_arrays(**arrays), drive))
    assert of_files.clouds[0].shares is not None
    assert_same(of_arrays, of_files)
    assert chosen(Drive.from_arrays(**arrays)) == [
        f"points[{drive.frames.index(frame)}]" for frame in select_frames(drive, 3).frames
    ]


def chosen(drive: Drive) -> list[str]:
    return [frame.points for frame in select_frames(drive, 3).frames]


def test_the_same_frames_are_chosen(synthetic: Drive) -> None:
    of_files = select_frames(synthetic, 3).frames
    expected = [f"points[{synthetic.frames.index(frame)}]" for frame in of_files]
    assert chosen(Drive.from_arrays(**arrays_of(synthetic))) == expected


def test_entries_without_a_return_are_left_out_and_others_are_not_copied(synthetic: Drive) -> None:
    arrays = arrays_of(synthetic)
    whole = load_observations(Drive.from_arrays(**arrays))
    places, none = [0, 7, 7], np.array([[np.nan, 1, 1, 0], [0, 0, 0, 5], [np.inf, 1, 1, 0]], np.float32)
    arrays["points"] = [np.insert(each, places, none, axis=0) for each in arrays["points"]]
    arrays["point_labels"] = [np.insert(each, places, 99) for each in arrays["point_labels"]]
    assert_same(load_observations(Drive.from_arrays(**arrays)), whole)
    plain = np.ascontiguousarray(arrays["points"][0][10:, :3])
    (cloud,) = read_clouds(Drive.from_arrays(points=[plain], camera=arrays["camera"]))
    assert np.shares_memory(cloud.points, plain)


def test_a_calibration_of_arrays_is_that_of_files(synthetic: Drive, tmp_path: Path) -> None:
    """`tests/benchmarks/arrays.py` compares other cues; they compute with what is loaded, which is the same."""
    arrays = arrays_of(synthetic)
    found, expected = semcal.calibrate(cue="labels", **arrays), semcal.calibrate(synthetic)
    assert found.model_dump(exclude={"input"}) == expected.model_dump(exclude={"input"})
    assert found.input.drive == "arrays"
    np.save(tmp_path / "points.npy", arrays["points"][2])
    assert found.input.sha256["points[2]"] == sha256((tmp_path / "points.npy").read_bytes()).hexdigest()
    assert found.input.frames[2].points == "points[2]"


POINTS, LABELS = np.ones((50, 3), np.float32), np.tile(np.arange(320, dtype=np.uint8) % 2, (180, 1))
K = np.array([[160.0, 0.0, 159.5], [0.0, 160.0, 89.5], [0.0, 0.0, 1.0]])
CAMERA = Camera(model="plumb_bob", width=320, height=180, K=K)


def test_a_camera_takes_the_numbers_of_numpy() -> None:
    rows = [np.float32(K[0]), [0, np.int64(160), 89.5], np.array([0, 0, 1])]
    assert Camera(model="plumb_bob", width=np.int64(320), height=np.uint16(180), K=rows) == CAMERA
    assert Camera(**dict(CAMERA) | {"distortion": np.arange(4)}).distortion == (0.0, 1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ({"width": 0}, "width: found 0, needed more than 0"),
        ({"width": np.float64(320)}, "width: found 320.0, expected a whole number"),
        ({"K": np.eye(4)}, "K[0]: found a list of 4, needed at most 3"),
        ({"distortion": np.zeros(3)}, "distortion: found 3 coefficients, needed 0 or 4 or 5 for plumb_bob"),
        ({"hight": 180}, "unknown key 'hight'; the nearest known key is 'height'"),
    ],
)
def test_what_is_wrong_with_a_camera_is_said_in_a_line(given: dict[str, Any], complaint: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape('Camera: ' + complaint)}$"):
        Camera(**dict(CAMERA) | given)


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ({"camera": None}, "camera: found NoneType, expected semcal.Camera"),
        ({"points": []}, "points: found nothing, expected an array (N, 3) or (N, 4) for each frame"),
        ({"points": [np.ones((100, 2))]}, "points[0]: found shape (100, 2), needed (N, 3) or (N, 4)"),
        ({"points": 3}, "points: found int, expected a list with an array for each frame"),
        ({"point_times": 0.1}, "point_times: found float, expected a list with an entry for each frame"),
        ({"points_stamps": ["noon"]}, "points_stamps[0]: found 'noon', expected seconds"),
        ({"name": Path("a")}, "name: found PosixPath('a'), expected text"),
        ({"points": [[[1, 2, 3]]]}, "points[0]: found list, expected an array of shape (N, 3) or (N, 4)"),
        ({"points": [POINTS.astype(str)]}, "points[0]: found <U32, expected numbers"),
        (
            {"points": [0 * POINTS]},
            "points[0]: found no points, expected coordinates that are finite and not all zero",
        ),
        ({"images": []}, "images: found 0 entries, needed 1, one for each entry of points"),
        ({"images": [LABELS[1:]]}, "images[0]: found shape (179, 320), needed (180, 320) or (180, 320, 3)"),
        ({"images": [LABELS / 255]}, "images[0]: found float64, expected uint8"),
        ({"image_labels": [LABELS / 255]}, "image_labels[0]: found float64, expected ids as whole numbers"),
        (
            {"image_labels": [LABELS - np.int64(1)]},
            "image_labels[0]: found the id -1, expected ids from 0 to 65535",
        ),
        (
            {"image_labels": [np.full((180, 320, 2), -0.5)]},
            "image_labels[0]: item 0: holds -0.5, a probability is finite and not negative",
        ),
        ({"point_labels": [LABELS[0]]}, "point_labels[0]: found shape (320,), needed (50,) or (50, C)"),
        ({"point_times": [np.arange(50)]}, "point_times[0]: found int64, expected seconds as floats"),
        ({"poses": np.eye(4)}, "poses: found shape (4, 4), needed (M, 8)"),
        ({"motion": {"poses": "a.txt"}}, "arrays: motion.poses: found 'a.txt', expected 'poses', the array"),
        (
            {"image": [LABELS]},
            "image: found an unknown argument, expected one of 20, nearest: images, ",
        ),
        ({"image_labels": [None]}, "arrays: frames[points[0]].image_labels: found nothing, expected a file"),
        ({"lidar": {"channels": 1}}, "arrays: lidar.channels: found 1, needed at least 2"),
    ],
)
def test_what_is_wrong_with_arrays_is_said(given: dict[str, Any], complaint: str) -> None:
    arrays = {
        "points": [POINTS],
        "camera": CAMERA,
        "image_labels": [LABELS],
        "point_labels": [LABELS[0, :50]],
    }
    with pytest.raises(InputError) as error:
        load(Drive.from_arrays(**{**arrays, **given}), CalibrationConfig(cues=("labels",)))
    assert str(error.value).startswith(complaint)


def test_a_drive_or_arrays_are_needed(synthetic: Drive) -> None:
    with pytest.raises(InputError, match="drive: found nothing, expected a drive, or arrays"):
        semcal.calibrate()
    with pytest.raises(InputError, match="images: found arrays and a drive, expected only one of the two"):
        semcal.calibrate(synthetic, images=[LABELS])
    with pytest.raises(InputError, match="drive: found ndarray, expected a drive or its path"):
        semcal.calibrate(POINTS)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="transform: found nothing, expected"):
        semcal.verify(synthetic)
    with pytest.raises(
        InputError, match="transform: found no array of real numbers, expected a 4 x 4 matrix"
    ):
        semcal.verify(synthetic, np.eye(4) + 1j)
    with pytest.raises(InputError, match="cue: found 3, expected a name or a list of names"):
        semcal.refine(synthetic, np.eye(4), cue=3)  # type: ignore[arg-type]
