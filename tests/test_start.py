"""The start of a calibration: which one is used, and what is said where there is none."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import Cli, edited, make_pose

from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.twists import displace

VERDICTS = (0, 3)


@pytest.fixture
def unlabelled(drive: Path, street_truth: Pose) -> Path:
    """A drive without labels, whose transform is a degree off."""
    off = displace(street_truth, 1.0, 0.05, np.random.default_rng(1))
    with edited(drive) as document:
        for frame in document["frames"]:
            del frame["image_labels"], frame["point_labels"]
        for key in ("classes", "ignore"):
            document.pop(key, None)
        document["T_camera_lidar"] = off.tolist()
    return drive


def start_line(err: str) -> str:
    found = re.search(r"^start +(.*)$", err, re.MULTILINE)
    assert found is not None, err
    return found[1]


def test_labels_in_the_files_need_no_start(street: Path, tmp_path: Path, cli: Cli) -> None:
    _, _, err = cli("calibrate", street, "-o", tmp_path / "c.yaml")
    assert start_line(err) == "none: labels find the mounting"
    assert "candidate mountings compared" in err


def test_what_is_given_comes_first_and_then_the_own_transform(
    unlabelled: Path, tmp_path: Path, cli: Cli
) -> None:
    tf = shutil.copy(unlabelled / "drive.yaml", tmp_path / "tf.yaml")
    code, _, err = cli("calibrate", unlabelled, "--init", tf, "-o", tmp_path / "a.yaml")
    assert (code in VERDICTS, start_line(err)) == (True, f"--init {tf}")
    code, _, err = cli("calibrate", unlabelled, "-o", tmp_path / "b.yaml")
    assert code in VERDICTS
    assert start_line(err).startswith("the transform in ")
    assert (tmp_path / "a.yaml").read_text() != ""


@pytest.mark.parametrize("why", ["from nothing", "no transform", "body frame"])
def test_without_a_start_the_error_lists_what_the_drive_allows(
    unlabelled: Path, tmp_path: Path, cli: Cli, why: str
) -> None:
    """Before anything long begins: the drive is not loaded."""
    with edited(unlabelled) as document:
        if why == "no transform":
            del document["T_camera_lidar"]
        if why == "body frame":
            document["T_camera_lidar"] = make_pose((0.0, 0.0, 0.0), (0.1, 0.2, 0.3)).tolist()
    options = ["--from-nothing"] if why == "from nothing" else []
    code, _, err = cli("calibrate", unlabelled, *options, "-o", tmp_path / "c.yaml")
    assert code == 1
    assert err.startswith(
        f"semcal: error: {unlabelled / 'drive.yaml'}: a calibration by edges needs a start within 5 degrees and 0.3 m, "
        "or image labels; the motion of camera and LiDAR gives no start: the drive gives no motion"
    )
    ways = re.findall(r"\([a-f]\) `semcal (\w+) \S+ (--?[a-z-]+)", err)
    own = [] if why == "no transform" else [("calibrate", "--init")]
    assert ways[: len(own) + 3] == [
        *own, ("calibrate", "--init-rpy-xyz"), ("view", "-o"), ("calibrate", "--image-model"),
    ]  # fmt: skip
    assert ("looks up or down" in err) == (why == "body frame")


def test_a_rig_starts_each_camera_at_its_own_transform_and_says_once_where_there_is_none(
    rig: Path, tmp_path: Path, cli: Cli
) -> None:
    folder = Path(shutil.copytree(rig.parent, tmp_path / "rig"))
    drives = sorted(folder.rglob("drive.yaml")) or sorted(folder.glob("camera_*.yaml"))
    for path in drives:
        with edited(path.parent) as document:
            for frame in document["frames"]:
                del frame["image_labels"], frame["point_labels"]
            for key in ("classes", "ignore"):
                document.pop(key, None)
    code, _, err = cli("calibrate", folder / "rig.yaml", "-o", tmp_path / "out", "--max-frames", "2")
    assert code in VERDICTS, err
    assert len(re.findall(r"^start +camera_\d: the transform in", err, re.MULTILINE)) == len(drives)
    code, _, err = cli("calibrate", folder / "rig.yaml", "-o", tmp_path / "none", "--from-nothing")
    assert code == 1
    assert err.count("each needs a start within 5 degrees and 0.3 m") == 1
    assert not (tmp_path / "none").exists()


def test_an_output_that_is_not_semcals_is_kept(street: Path, tmp_path: Path, cli: Cli) -> None:
    """The default is calibration.yaml; an earlier result is replaced, and any other file only with --force."""
    output = tmp_path / "calibration.yaml"
    options = ["calibrate", street, "-o", output, "-q", "--max-frames", "2"]
    assert cli(*options)[0] in VERDICTS
    assert cli(*options)[0] in VERDICTS
    output.write_text("camera: front\n")
    code, _, err = cli(*options)
    assert code == 1
    assert err == (
        f"semcal: error: {output}: found a file that is no calibration of semcal; choose another -o, or add --force\n"
    )
    assert output.read_text() == "camera: front\n"
    assert cli(*options, "--force")[0] in VERDICTS
    assert "semcal_calibration" in output.read_text()
