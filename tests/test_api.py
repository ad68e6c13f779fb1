"""What a program does with a calibration: project, draw, save, show; and many drives in one call."""

import inspect
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

import semcal_cli as semcal
from semcal_cli import core
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError
from semcal_cli.observations.reading import read_clouds, read_frame_image


@pytest.fixture(scope="module")
def calibration(synthetic: Drive) -> semcal.Calibration:
    return semcal.calibrate(synthetic)


@pytest.fixture(scope="module")
def points(synthetic: Drive) -> np.ndarray:
    return read_clouds(synthetic)[0].points


@pytest.fixture(scope="module")
def image(synthetic: Drive) -> np.ndarray:
    """Red, green, blue."""
    return np.ascontiguousarray(read_frame_image(synthetic, synthetic.frames[0])[..., ::-1])


def test_points_are_projected_as_the_core_does(
    synthetic: Drive, calibration: semcal.Calibration, points: np.ndarray
) -> None:
    found, T = calibration.project(points), calibration.T_camera_lidar
    assert found.is_in_front.tolist() == ((points @ T[:3, :3].T + T[:3, 3])[:, 2] > 0.0).tolist()
    seen = core.project_points(core_camera(synthetic.camera), points, T)
    assert found.is_in_image.tolist() == np.isfinite(seen.ranges).tolist()
    np.testing.assert_allclose(found.pixels[found.is_in_image], seen.pixels[found.is_in_image], atol=1e-9)
    assert np.isnan(found.pixels[~found.is_in_front]).all()
    with pytest.raises(InputError, match=r"^points: found shape \(3,\), needed \(N, 3\) or \(N, 4\)"):
        calibration.project([1.0, 2.0, 3.0])


def test_points_are_drawn_where_they_are_projected(
    calibration: semcal.Calibration, points: np.ndarray, image: np.ndarray
) -> None:
    before, ahead = image.copy(), calibration.T_lidar_camera @ np.array([0.0, 0.0, 3.0, 1.0])
    drawn = calibration.overlay(image, ahead[None, :3])
    assert (image == before).all()
    ((u, v),) = calibration.project(ahead[None, :3]).pixels.round().astype(int)
    red, _, blue = drawn[v, u].tolist()
    assert red > 100 > blue  # near by
    changed = np.argwhere((drawn != calibration.overlay(image, -1000.0 * ahead[None, :3])).any(axis=2))
    assert np.abs(changed - (v, u)).max() <= 2
    assert calibration.overlay(image[..., 0], points).shape == image.shape
    with pytest.raises(
        InputError, match=r"^image: found shape \(90, 160, 3\), needed \(180, 320\) or \(180, 320, 3\)"
    ):
        calibration.overlay(image[::2, ::2], points)


def test_it_is_saved_whole_and_for_other_tools(calibration: semcal.Calibration, tmp_path: Path) -> None:
    calibration.save(tmp_path / "whole.yaml")
    again = semcal.read_calibration(tmp_path / "whole.yaml")
    assert again == calibration
    assert again.trusted
    np.testing.assert_array_equal(again.covariance, calibration.uncertainty.covariance)
    calibration.save(tmp_path / "camchain.yaml", to="kalibr")
    written = yaml.safe_load((tmp_path / "camchain.yaml").read_text())
    np.testing.assert_allclose(written["cam0"]["T_cam_lidar"], calibration.T_camera_lidar, atol=1e-9)
    assert written["cam0"]["resolution"] == [320, 180]
    with pytest.raises(InputError, match="found format 'no-such-tool', expected one of"):
        calibration.save(tmp_path / "nothing", to="no-such-tool")


def test_a_notebook_shows_the_verdict_the_interval_and_the_image(calibration: semcal.Calibration) -> None:
    shown = calibration._repr_html_()
    assert "Trusted:" in shown
    assert re.search(r"\u00b1[0-9.]+ (cm|mm)", shown)
    assert 'src="data:image/jpeg;base64,' in shown
    assert "<script" not in shown
    assert len(shown) < 100_000
    doubted = calibration.model_copy(update={"status": "not_trusted", "reasons": ("a < b",), "topics": ()})
    doubted._drive = Path("/nowhere")
    assert "Not trusted" in doubted._repr_html_()
    assert "a &lt; b" in doubted._repr_html_()
    assert "<img" not in doubted._repr_html_()


def test_given_poses_are_refined_assessed_and_verified(
    synthetic: Drive, calibration: semcal.Calibration
) -> None:
    T = calibration.T_camera_lidar
    off = T.copy()
    off[:3, 3] += 0.05
    refined = semcal.refine(synthetic, off)
    assert semcal.compare_poses(refined.T_camera_lidar, T).camera_center_cm < 1.0
    assessed = semcal.assess(synthetic, T)
    assert assessed.trusted
    assert list(assessed.stages) == ["initial", "polished"]
    np.testing.assert_allclose(np.diag(assessed.covariance), np.diag(calibration.covariance), rtol=0.2)
    assert semcal.verify(synthetic, T).verdict == "pass"
    assert (
        semcal.verify(synthetic, calibration).verdict == "inconclusive"
    )  # it was calibrated from these sweeps


def test_a_batch_yields_an_error_where_a_drive_has_no_answer(synthetic: Drive) -> None:
    """That drives of a batch are calibrated is shown by docs/python.md, whose session runs."""
    ((drive, error),) = semcal.batch([synthetic], timeout_s=0.001)
    assert drive is synthetic
    assert isinstance(error, semcal.SemcalError)
    assert str(error) == "timed out after 0.001 s"


def test_the_import_is_semcal_cli_beside_a_clone_too(tmp_path: Path) -> None:
    """A folder of this name is an empty namespace to Python, in which nothing is found."""
    (tmp_path / "semcal").mkdir()
    program = "import semcal_cli as semcal; print(semcal.__version__)"
    for arguments in (["-c", program], ["-m", "semcal_cli", "--version"]):
        printed = subprocess.check_output([sys.executable, *arguments], cwd=tmp_path, text=True)
        assert semcal.__version__ in printed


def test_an_unknown_argument_names_the_one_that_was_meant(synthetic: Drive) -> None:
    with pytest.raises(InputError, match=r"^init: found an unknown argument, expected initial_pose$"):
        semcal.calibrate(synthetic, init=np.eye(4))  # type: ignore[call-arg]


def test_without_a_start_the_error_speaks_of_arguments(synthetic: Drive) -> None:
    with pytest.raises(InputError) as error:
        semcal.calibrate(synthetic, cue="edges")
    assert str(error.value).endswith("; give initial_pose, or image_labels with cue=('segments', 'edges')")
    assert "--" not in str(error.value)


def test_errors_of_the_pipeline_speak_of_arguments(synthetic: Drive) -> None:
    limits = semcal.Limits(delay_s=0.01)
    with pytest.raises(InputError, match=r"expected poses or a twist for limits\.delay_s$"):
        semcal.verify(synthetic, synthetic.T_camera_lidar, limits)


def test_a_calibration_is_printed_in_about_ten_lines(calibration: semcal.Calibration) -> None:
    lines = str(calibration).splitlines()
    assert len(lines) <= 10
    assert lines[0].startswith("Trusted. ±")
    doubted = calibration.model_copy(update={"status": "not_trusted", "reasons": ("why", "and why")})
    assert str(doubted).splitlines()[-1] == "reason          why (and 1 more in .reasons)"
    assert repr(calibration) == str(calibration)


def test_help_lists_the_arrays_and_shows_no_address() -> None:
    said = f"{inspect.signature(semcal.calibrate)} {semcal.calibrate.__doc__}"
    assert "0x" not in said
    for name in semcal.ArrayInput.__annotations__:
        assert re.search(rf"\b{name}\b", said.partition("**arrays:")[2])


def test_a_recording_in_the_place_of_a_drive_names_its_import(tmp_path: Path) -> None:
    path = tmp_path / "bag.mcap"
    path.write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(InputError, match=r"found a recording, .*`semcal import bag .* -o bag_drive`$"):
        semcal.calibrate(path)
