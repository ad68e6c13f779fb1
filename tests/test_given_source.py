"""`semcal calibrate` on a recording or a data set: one command, and the commands that it tells."""

from __future__ import annotations

import json
import re
import shlex
import tempfile
from pathlib import Path

import numpy as np
import pytest
from bag_imports import image, info, small
from bags import write_drive_as_bag
from conftest import Cli
from dataset_trees import TREES
from robots import robot

from semcal_cli.cli import given_source
from semcal_cli.cli.calibrate import calibrate
from semcal_cli.drive.document import read_drive
from semcal_cli.formats.camera_block import EXAMPLE
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.result.calibration_document import read_calibration

VERDICTS = (0, 3)
"""Exit codes of a written result: four frames of one street by edges are too few to be trusted."""

VERDICTS_OF_VERIFY = (3, 4)
"""Exit codes of a transform that is off: it fails, or the few frames do not show by how much."""


@pytest.fixture
def recording(street: Path, street_truth: Pose, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A recording of `street` without labels, whose transform is 1 degree and 5 cm off, in the working folder."""
    monkeypatch.chdir(tmp_path)
    T_start = displace(street_truth, 1.0, 0.05, np.random.default_rng(1))
    path = write_drive_as_bag(read_drive(street), tmp_path, "mcap library", T_camera_lidar=T_start)
    return path.relative_to(tmp_path)


def told_commands(err: str) -> list[list[str]]:
    """List the words of the commands that do a step alone."""
    return [shlex.split(line) for line in re.findall(r"^same as +semcal (.*)$", err, re.MULTILINE)]


def test_a_recording_is_enough(recording: Path, street_truth: Pose, cli: Cli) -> None:
    """One command writes the result and all that belongs to it; the commands that it tells do the same alone."""
    code, out, err = cli("calibrate", recording, "--max-frames", "4")
    assert (code in VERDICTS, out) == (True, ""), err
    assert re.search(r"^start +the transform in bag_drive; --from-nothing ignores it$", err, re.MULTILINE)
    written = {path.name for path in Path().iterdir()}
    assert written == {
        "bag.mcap", "bag_drive", "calibration.yaml", "calibration.html", "calibration_overlay",
    }  # fmt: skip
    first = read_calibration(Path("calibration.yaml"))
    assert compare_poses(first.pose, street_truth).rotation_deg < 0.5
    steps = told_commands(err)
    assert [words[0] for words in steps] == ["import", "calibrate", "report", "overlay"]
    (drive,) = Path().glob("bag_drive/drive.yaml")
    content = drive.read_bytes()
    for words in steps:
        assert cli(*words)[0] in VERDICTS
    assert drive.read_bytes() == content
    again = read_calibration(Path("calibration.yaml"))
    np.testing.assert_array_equal(again.pose, first.pose)


def test_without_its_library_the_motion_is_left_out_and_said(
    recording: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(given_source, "is_installed", lambda package: False)
    code, _, err = cli("calibrate", recording, "-o", "front.json")
    assert code in VERDICTS
    assert "note: the motion of the LiDAR is not estimated: found no kiss_icp" in err
    assert told_commands(err)[0] == ["import", "bag", "bag.mcap", "-o", "bag_drive"]
    assert all(Path(name).exists() for name in ("front.json", "front.html", "front_overlay"))


def test_several_topics_are_listed_with_the_command_for_each(tmp_path: Path, cli: Cli) -> None:
    cameras = {f"{side}/{name}": maker for side in ("left", "right")
               for name, maker in (("camera_info", info()), ("image_raw", image()))}  # fmt: skip
    changes = {"info": lambda *about: None, "image": lambda *about: None, **cameras}
    path = small(tmp_path, "mcap library", **changes)
    output = tmp_path / "c.yaml"
    rig = f"semcal import bag {path} --odometry --all-cameras -o {tmp_path / f'{path.stem}_drive'}"
    for command in (["calibrate", path, "-o", output], ["import", "bag", path, "-o", output]):
        code, _, err = cli(*command)
        typed = shlex.join(["semcal", *map(str, command)])
        assert code == 1
        assert err == (
            f"semcal: error: {path}: found 1 topic of sweeps and 2 topics of images"
            f"{f' (or `{rig}`)' if command[0] == 'calibrate' else ''}, choose one: "
            f"`{typed} --image /left/image_raw`, `{typed} --image /right/image_raw`"
            f"{f', `{typed} --all-cameras`' if command[0] == 'import' else ''}\n"
        )
    assert not [*tmp_path.glob("*drive*")]


def test_a_file_gives_the_intrinsics_that_a_recording_lacks(tmp_path: Path, cli: Cli) -> None:
    """The example of a camera_info that messages show is one; tiny clouds then cannot be calibrated."""
    path, camera = small(tmp_path, "mcap library", info=lambda *about: None), tmp_path / "camera.yaml"
    code, _, err = cli("calibrate", path, "-o", tmp_path / "c.yaml")
    assert code == 1
    assert err.endswith("; expected one, or --intrinsics FILE\n")
    camera.write_text(EXAMPLE.replace("1242", "16").replace("375", "16"))
    cli("calibrate", path, "-o", tmp_path / "c.yaml", "--intrinsics", camera)
    (drive,) = tmp_path.glob("*_drive/drive.yaml")
    assert read_drive(drive).camera.K[0][0] == 721.5


def test_a_recording_in_the_place_of_a_calibration_is_told_with_the_order(tmp_path: Path, cli: Cli) -> None:
    path = small(tmp_path, "mcap library")
    code, _, err = cli("verify", tmp_path / "c.yaml", path)
    order = "the order is `semcal verify DRIVE|RECORDING|DATASET|RIG [CALIBRATION]`"
    assert (code, err) == (
        1,
        f"semcal: error: {path}: found a recording, expected a calibration; {order}\n",
    )


def test_a_data_set_is_enough_too(tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its sequences are listed; tiny clouds then cannot be calibrated, but are imported."""
    monkeypatch.chdir(tmp_path)
    TREES["opencalib"](tmp_path / "road")
    code, _, err = cli("calibrate", "road")
    assert code == 1
    assert "choose one: `semcal calibrate road --sequence 1`, `semcal calibrate road --sequence 3`" in err
    TREES["kitti-object"](tmp_path / "kitti")
    code, _, err = cli("calibrate", "kitti")
    assert code == 1
    assert told_commands(err)[0] == ["import", "kitti-object", "kitti", "-o", "kitti_drive"]
    assert len(read_drive(Path("kitti_drive")).frames) == 2


@pytest.mark.parametrize("typed", ["bag.mcap", "./bag.mcap", "kitti/"])
def test_the_drive_takes_the_place_of_what_was_typed(typed: str) -> None:
    words = ["--image", "/front", typed, "--seed=3", "--sequence=00"]
    with calibrate.make_context("semcal calibrate", words):
        assert given_source.typed_for(Path("made_drive")) == "semcal calibrate made_drive --seed=3"


def test_a_drive_of_other_data_is_not_replaced_even_by_force(
    tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    """--force is about the result; the import that replaces the drive is told."""
    monkeypatch.chdir(tmp_path)
    TREES["kitti-object"](tmp_path / "kitti")
    drive = Path("kitti_drive/drive.yaml")
    drive.parent.mkdir()
    drive.write_text("mine: 1\n")
    code, _, err = cli("calibrate", "kitti", "--force")
    assert (code, drive.read_text()) == (1, "mine: 1\n")
    assert err == (
        f"semcal: error: {drive}: found a file that cannot be read as a drive, expected -o in another folder, or first "
        "`semcal import kitti-object kitti --force -o kitti_drive`\n"
    )


def test_options_of_something_else_are_refused(street: Path, recording: Path, cli: Cli) -> None:
    for path, option in ((street, "--image"), (street, "--sequence"), (recording, "--camera")):
        code, _, err = cli("calibrate", path, option, "x")
        assert code == 2
        assert f"semcal: error: {option} " in err


def test_nothing_that_was_not_named_is_replaced(
    tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pages, overlays and links in the place of those that semcal names, and values that were put into the drive."""
    monkeypatch.chdir(tmp_path)
    TREES["kitti-object"](tmp_path / "kitti")
    page, image, drive = Path("calibration.html"), Path("calibration_overlay/000000.png"), Path("kitti_drive")
    page.write_text("my own page")
    code, _, err = cli("calibrate", "kitti")
    assert (code, page.read_text()) == (1, "my own page")
    assert "calibration.html: found a file of no calibration here; choose another -o, or add --force" in err
    page.unlink()
    image.parent.mkdir()
    image.write_text("mine")
    assert cli("calibrate", "kitti")[0] == 1
    assert (image.read_text(), drive.exists()) == ("mine", False)
    image.unlink()
    image.parent.rmdir()
    for folder in (image.parent, drive):
        elsewhere = tmp_path / f"elsewhere_{folder}"
        elsewhere.mkdir()
        folder.symlink_to(elsewhere)
        code, _, err = cli("calibrate", "kitti")
        assert (code, [*elsewhere.iterdir()]) == (1, [])
        assert f"{folder}: found a link, expected a folder or nothing" in err
        folder.unlink()
    assert "found suffix '.txt'" in cli("calibrate", "kitti", "-o", "x.txt")[2]
    assert "found the name of a drive" in cli("calibrate", "kitti", "-o", "drive.yaml", "--force")[2]
    assert not drive.exists()
    cli("calibrate", "kitti")
    document = drive / "drive.yaml"
    edited = document.read_text().replace("synchronization: hardware", "synchronization: stamps")
    assert edited != document.read_text()
    document.write_text(edited)
    code, _, err = cli("calibrate", "kitti")
    assert (code, document.read_text()) == (1, edited)
    assert "`semcal calibrate kitti_drive` takes them" in err


@pytest.mark.parametrize("command", ["calibrate", "inspect", "odometry"])
def test_an_empty_folder_gets_advice(command: str, tmp_path: Path, cli: Cli) -> None:
    output = [] if command == "inspect" else ["-o", tmp_path / "c.yaml"]
    code, _, err = cli(command, tmp_path, *output)
    assert code == 1
    assert err == (
        f"semcal: error: {tmp_path}: found a folder without a drive.yaml that is no known data set either; "
        "`semcal import --help` lists what makes a drive\n"
    )


def test_each_sequence_is_a_drive_of_its_own(
    tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    TREES["opencalib"](tmp_path / "road")
    for sequence in ("1", "3"):
        _, _, err = cli("calibrate", "road", "--sequence", sequence)
        assert told_commands(err)[0] == [
            "import", "opencalib", "road", "--sequence", sequence, "-o", f"{sequence}_drive",
        ]  # fmt: skip
        assert Path(f"{sequence}_drive/drive.yaml").is_file()


@pytest.mark.parametrize(
    ("name", "drive"),
    [("v1.2", "v1.2_drive"), ("v1.2.mcap", "v1.2_drive"), ("-v.mcap", "./-v_drive")],
)
def test_a_recording_names_its_drive_and_its_commands(
    name: str, drive: str, tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    small(tmp_path, "mcap library").rename(name)
    given = f"./{name}"
    _, _, err = cli("calibrate", given, "--from-nothing")
    typed = given if name.startswith("-") else name
    assert told_commands(err)[0] == ["import", "bag", typed, "--odometry", "-o", drive]
    assert Path(drive, "drive.yaml").is_file()


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder for temporary drives."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def offsets(out: str) -> dict[str, float]:
    """Read the offsets of a verification in JSON, by check."""
    return {check["name"]: check["offset"] for check in json.loads(out)["checks"]}


@pytest.mark.parametrize("kind", ["mcap library", "ros1", "sqlite3"])
def test_the_transform_of_a_recording_is_verified(
    street: Path, street_truth: Pose, tmp_path: Path, temporary: Path, cli: Cli, kind: str
) -> None:
    """Its own, 1 degree off, and then another; the drive is temporary, and only the outputs are left."""
    T = displace(street_truth, 1.0, 0.05, np.random.default_rng(1))
    path = write_drive_as_bag(read_drive(street), tmp_path, kind, T_camera_lidar=T)
    before, page, junit = {*tmp_path.iterdir()}, tmp_path / "v.html", tmp_path / "v.xml"
    code, out, err = cli("verify", path, "--json", "--max-frames", "4", "--report", page, "--junit", junit)
    assert code in VERDICTS_OF_VERIFY, err
    assert offsets(out)["rotation overall"] == pytest.approx(1.0, abs=0.3)
    assert f"read {path}: " in err
    assert {*tmp_path.iterdir()} == before | {page, junit}
    assert f"{path} on {path}, " in page.read_text()
    assert f'file="{path}"' in junit.read_text()
    other = tmp_path / "other.yaml"
    other.write_text(f"semcal_transform: 1\nT_camera_lidar: {street_truth.tolist()}\n")
    code, out, err = cli("verify", path, other, "--json", "--max-frames", "4", "-q")
    assert code in (*VERDICTS_OF_VERIFY, 0)
    assert offsets(out)["rotation overall"] < 0.5
    assert str(temporary) not in out + err + page.read_text()
    assert not [*temporary.iterdir()]


def test_the_frames_of_a_recording_choose_among_those_of_a_robot(
    recording: Path, street_truth: Pose, cli: Cli
) -> None:
    """The recording names its frames only once it is imported."""
    cameras = {
        "left_optical": displace(street_truth, 30.0, 0.5, np.random.default_rng(2)),
        "optical": street_truth,
    }
    Path("robot.urdf").write_text(robot("lidar", cameras))
    code, out, err = cli("verify", recording, "robot.urdf", "--json", "--max-frames", "4", "-q")
    assert code in (*VERDICTS_OF_VERIFY, 0), err
    assert offsets(out)["rotation overall"] < 0.5
    code, _, err = cli("calibrate", recording, "--init", "robot.urdf", "--max-frames", "2", "--no-polish")
    assert "start            --init robot.urdf" in err


def test_a_recording_without_a_transform_names_what_verifies_one(
    tmp_path: Path, temporary: Path, cli: Cli
) -> None:
    path = small(tmp_path, "mcap library")
    code, out, err = cli("verify", path, "-q")
    assert (code, out) == (1, "")
    assert err == (
        f"semcal: error: {path}: found no transform from the sweeps to the images to verify; "
        f"`semcal verify {path} CALIBRATION` takes one from a file\n"
    )
    assert not [*temporary.iterdir()]


def test_a_verification_takes_a_drive_or_a_data_set_by_its_own_transform(
    street: Path, tmp_path: Path, cli: Cli
) -> None:
    own, named = (cli("verify", *given, "--json", "-q") for given in ([street], [street, street]))
    assert own == named
    assert own[0] == 0
    code, _, err = cli("verify", TREES["opencalib"](tmp_path / "road").root)
    assert code == 1
    assert f"`semcal verify {tmp_path / 'road'} --sequence 1`" in err
    recorded = small(tmp_path, "mcap library")
    code, _, err = cli("verify", recorded, "--junit", recorded)
    assert (code, "found a file that this run reads or writes" in err) == (1, True)
