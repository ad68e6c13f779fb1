"""`semcal import folder`: what does not fit is refused or noted, never taken in silence."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
import yaml
from camera_infos import ROS
from commands import unwrapped
from dataset_imports import complaint, run_import
from dataset_trees import own_data, write, write_cloud, write_ids

from semcal_cli.drive.document import read_drive
from semcal_cli.formats.frame_names import T_BODY_OPTICAL
from semcal_cli.geometry.poses import pose_from_quaternion


def test_a_reference_of_a_body_frame_is_noticed(tmp_path: Path) -> None:
    """Its camera would look up; what is printed to come next does not start from it."""
    arguments = own_data(tmp_path / "own")
    labels = arguments.index("--image-labels")
    arguments[labels] = "--images"
    T_body_lidar = pose_from_quaternion([0.0, 0.0, 0.6, 0.8], [0.3, 0.0, -0.1])
    write(tmp_path / "body.yaml", yaml.safe_dump({"T_camera_lidar": T_body_lidar.tolist()}))
    for axes, is_doubted in ((None, True), ("body", False), ("optical", False)):
        stated = () if axes is None else ("--reference-frame", axes)
        options = (*stated, "--reference", tmp_path / "body.yaml", "-o", tmp_path / "drive", "--force")
        stderr = unwrapped(run_import("folder", *arguments, *options), 6)
        assert ("probably a body frame (x forward, y left, z up)" in stderr) == is_doubted
        assert ("--reference-frame body converts the reference" in stderr) == is_doubted
        assert stderr.rstrip().endswith("--init-rpy-xyz R P Y X Y Z") == (axes != "body")
        T = np.linalg.inv(T_BODY_OPTICAL) @ T_body_lidar if axes == "body" else T_body_lidar
        np.testing.assert_allclose(read_drive(tmp_path / "drive").T_camera_lidar, T, atol=1e-12)


@pytest.mark.parametrize(
    ("width", "height", "is_of_aspect"), [(128, 64, True), (15, 7, True), (128, 61, False)]
)
def test_a_k_of_resized_images_is_converted_only_on_request(
    tmp_path: Path, width: int, height: int, is_of_aspect: bool
) -> None:
    """A side of the smaller image may be rounded, either way."""
    arguments = own_data(tmp_path / "own")
    K = [50.0, 0, 31.5, 0, 60.0, 15.5, 0, 0, 1]
    info = {"distortion_model": "plumb_bob", "width": width, "height": height, "K": K, "D": [0.0] * 5}
    write(tmp_path / "own/camera.yaml", yaml.safe_dump(info))
    problem = complaint("folder", *arguments, "-o", tmp_path / "drive")
    found = f"found an image of 64 x 32 pixels, needed {width} x {height}, as {tmp_path / 'own/camera.yaml'} states"
    advice = "; if the images were resized, --resized converts K" if is_of_aspect else ""
    assert problem == f"{tmp_path / 'own/labels/000002.png'}: {found}{advice}"
    if is_of_aspect:
        run_import("folder", *arguments, "--resized", "-o", tmp_path / "drive")
        camera = read_drive(tmp_path / "drive").camera
        assert camera.size == (64, 32)
        np.testing.assert_allclose(np.diag(camera.K)[:2], [50.0 * 64 / width, 60.0 * 32 / height])
    else:
        problem = complaint("folder", *arguments, "--resized", "-o", tmp_path / "drive")
        assert (
            problem == "--resized: found images of 64 x 32 pixels, expected the aspect of 128 x 61, as K has"
        )


def test_columns_that_do_not_fit_are_taken_and_doubted(tmp_path: Path) -> None:
    """Both where they are stated and where they are the usual ones."""
    generator = np.random.default_rng(1)
    xyz = generator.uniform((-40.0, -20.0, -2.0), (40.0, 20.0, 1.0), (8000, 3))
    others = generator.uniform(0.0, (1.0, 255.0, 255.0), (8000, 3))
    for name, columns in {
        "four": np.column_stack([xyz, others[:, 0]]),
        "six": np.column_stack([xyz, others]),
        "intensity_first": np.column_stack([others[:, 0], xyz]),
    }.items():
        columns.astype(np.float32).tofile(tmp_path / f"{name}.bin")
        write_ids(tmp_path / f"{name}.png")
    write(tmp_path / "camera.yaml", ROS)

    def doubts(name: str, *stated: str) -> str:
        files = "--points", tmp_path / f"{name}.bin", "--images", tmp_path / f"{name}.png"
        options = *(("--point-columns", *stated) if stated else ()), "--camera-info", tmp_path / "camera.yaml"
        said = unwrapped(run_import("folder", *files, *options, "-o", tmp_path / "drive", "--force"), 6)
        return next((line for line in said.splitlines() if "point columns:" in line), "")

    in_order = "in intensity_first.bin, x is never negative, and the intensity is in "
    for name, stated, expected in (
        ("four", (), ""),
        ("four", ("x,y,z,intensity",), ""),
        ("six", ("x,y,z,_,_,_",), ""),
        ("six", ("x,y,z",), "x,y,z are taken as stated, but --point-columns x,y,z,_,_,_ fits six.bin better"),
        ("intensity_first", (), in_order),
        ("intensity_first", ("x,y,z,intensity",), in_order),
        ("intensity_first", ("intensity,x,y,z",), ""),
        ("four", ("intensity,x,y,z",), "in four.bin, z is never negative"),
    ):
        said = doubts(name, *stated)
        assert expected in said
        assert bool(said) == bool(expected)


@pytest.mark.parametrize(
    ("cloud", "image", "numbers", "is_doubted"),
    [
        ("lidar_{:06d}", "cam_{:06d}", range(12), True),
        ("lidar_{}", "cam_{}", range(12), True),
        ("{:06d}", "{:06d}", range(12), True),
        ("{:06d}", "{:06d}", (0, 2, 3, *range(4, 13)), False),
        ("lidar_{:06d}", "cam_{:06d}", (0, 1, 2, 3), False),
        ("lidar_{:06d}", "cam_{:06d}", range(1, 13), False),
    ],
)
def test_files_of_another_rate_are_not_paired_by_number_in_silence(
    tmp_path: Path, cloud: str, image: str, numbers: Iterable[int], is_doubted: bool
) -> None:
    """Of 10 Hz clouds and 30 Hz images, those of one number are of different moments."""
    for number in range(4):
        write_cloud(tmp_path / f"{cloud.format(number)}.bin")
    for number in numbers:
        write_ids(tmp_path / f"{image.format(number)}.png")
    write(tmp_path / "camera.yaml", ROS)
    patterns = "--points", tmp_path / "*.bin", "--images", tmp_path / "*.png"
    stderr = run_import(
        "folder", *patterns, "--camera-info", tmp_path / "camera.yaml", "-o", tmp_path / "drive"
    )
    said = "4 clouds and 12 files are numbered from the same start: if they were recorded together"
    assert (said in unwrapped(stderr, 6)) == is_doubted
