"""Every exit code through the real command."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from conftest import Cli, edited
from hostile_drives import HOSTILE, Edit, break_drive
from test_calibration import POSE, make_calibration

import semcal_cli
from semcal_cli import core
from semcal_cli.cli import EXIT_FAILURE
from semcal_cli.cli.terminal import OF_TERMINALS
from semcal_cli.drive.document import DRIVE_FILE
from semcal_cli.errors import InputError
from semcal_cli.result.calibration_document import write_calibration


@pytest.mark.parametrize(("edit", "message"), HOSTILE.values(), ids=HOSTILE.keys())
def test_hostile_drives(drive: Path, cli: Cli, edit: Edit, message: str) -> None:
    break_drive(drive, edit)
    output = drive / "earlier.yaml"
    output.write_text("semcal_calibration: 1")
    code, out, err = cli("calibrate", drive, "-o", output, "-q")
    assert code == EXIT_FAILURE
    assert out == ""
    assert re.fullmatch(f"semcal: error: {re.escape(str(drive))}/{message}\n", err), err
    assert output.read_text() == "semcal_calibration: 1"


def test_an_image_of_three_pixels_is_too_small(street: Path, tmp_path: Path, cli: Cli) -> None:
    with edited(street, tmp_path) as document:
        document["camera"]["height"] = 3
    code, _, err = cli("calibrate", tmp_path, "-o", tmp_path / "out.yaml", "-q")
    assert code == EXIT_FAILURE
    assert err.endswith("drive.yaml: camera: found 640 x 3 pixels, needed at least 4 x 4\n")


@pytest.mark.parametrize("cue", ["labels", "edges"])
def test_a_start_that_looks_away_is_no_overlap(cue: str, street: Path, tmp_path: Path, cli: Cli) -> None:
    """Whoever compares edges knows no classes."""
    with edited(street, tmp_path) as document:
        # The camera looks along the LiDAR's z axis, into the sky.
        document["T_camera_lidar"] = np.eye(4).tolist()
    output = tmp_path / "out.yaml"
    code, _, err = cli("calibrate", street, "--cue", cue, "--init", tmp_path, "-o", output, "-q")
    assert code == EXIT_FAILURE
    needed = "points land on pixels that can be compared with them, needed 100"
    assert re.fullmatch(rf"semcal: error: .*drive.yaml: no overlap: 0 of \d+ {needed}\n", err)
    assert not (tmp_path / "out.yaml").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["no_drive"], "no_drive: no such file or folder"),
        (["{street}", "-o", "{tmp}/out.txt"], "{tmp}/out.txt: .*yaml.*json.*"),
        (
            ["{street}", "-o", "{tmp}/none/out.yaml"],
            "{tmp}/none/out.yaml: found no folder {tmp}/none, expected one to write to",
        ),
        (
            ["{street}", "-o", "{street}/drive.yaml"],
            "{street}/drive.yaml: found a file that this run reads .*",
        ),
        (
            ["{street}", "--init", "{street}", "--log", "{street}/images/000000.png"],
            "{street}/images/000000.png: found a file that this run reads .*",
        ),
        (["{street}", "--init", "{start}", "-o", "{start}"], "{start}: found a file that this run reads .*"),
        (
            ["{street}", "--init", "-"],
            "-: found standard input, expected a file: the result records its name and hash",
        ),
        (["{street}", "--init", "/dev/stdin"], "/dev/stdin: found standard input, expected a file: .*"),
        (
            ["{street}", "--prior-translation-m", "5", "0", "0", "1"],
            "--prior-translation-m: found the camera 5 m from the LiDAR, needed at most 3 m; --max-baseline-m sets the "
            "limit",
        ),
        (["{street}", "--init", "{tmp}/none.yaml"], "{tmp}/none.yaml: no such file or folder"),
        (
            ["{street}", "--init-rpy-xyz", "0", "0", "180", "3", "4", "0"],
            "--init-rpy-xyz 0.0 0.0 180.0 3.0 4.0 0.0: found the camera 5 m from the LiDAR, needed at most 3 m; "
            "--max-baseline-m sets the limit",
        ),
    ],
)
def test_what_is_wrong_is_said_before_the_work_begins(
    street: Path, tmp_path: Path, cli: Cli, arguments: list[str], message: str
) -> None:
    names = {
        "street": street,
        "tmp": tmp_path,
        "start": shutil.copy(street / DRIVE_FILE, tmp_path / "start.yaml"),
    }
    code, out, err = cli("calibrate", *(argument.format(**names) for argument in arguments))
    assert (code, out) == (EXIT_FAILURE, "")
    assert re.fullmatch("semcal: error: " + message.format(**names) + "\n", err), err


def test_results_go_to_standard_output_and_all_else_to_standard_error(
    street: Path, tmp_path: Path, cli: Cli
) -> None:
    code, out, err = cli("initialize", street, "--log", tmp_path / "log.json")
    assert code == 0
    assert yaml.safe_load(out)["status"] == "not_assessed"
    assert "candidate mountings compared" in err
    assert [stage["name"] for stage in json.loads((tmp_path / "log.json").read_text())["stages"]] == [
        "load",
        "initial",
    ]
    verdict = "verdict not assessed: a rough start, not refined yet\n"
    assert cli("initialize", street, "-o", tmp_path / "a.json", "-q") == (0, "", verdict)
    as_json = json.loads((tmp_path / "a.json").read_text())
    assert as_json["T_camera_lidar"] == yaml.safe_load(out)["T_camera_lidar"]
    best, *others = as_json["hypotheses"]
    assert best["T_camera_lidar"] == as_json["stages"]["initial"]["T_camera_lidar"]
    assert best["num_inliers"] > 0
    assert best["num_pairs"] > 0
    assert all(other["mutual_information_nats"] <= best["mutual_information_nats"] for other in others)
    assert as_json["quality"]["runner_up_margin"] > 2.0


def test_mine_needs_cuda_only_where_it_is_asked_for(street: Path, tmp_path: Path, cli: Cli) -> None:
    torch = pytest.importorskip("torch")
    if torch.cuda.is_available():
        pytest.skip("there is a CUDA device")
    arguments = ("refine", street, "--init", street, "--estimator", "mine", "-o", tmp_path / "out.yaml")
    code, _, err = cli(*arguments, "--device", "cuda")
    assert code == EXIT_FAILURE
    assert "--device cuda: PyTorch finds no CUDA device here" in err


def test_a_calibration_by_labels_imports_only_what_it_uses(street: Path, tmp_path: Path) -> None:
    """Its output is a pipe: a terminal needs rich."""
    script = (
        "import sys; from semcal_cli.cli import run; assert not run(sys.argv[1:]).exit_code; "
        "others = 'rich', 'PIL', 'ssl', 'matplotlib', 'jinja2', 'torch', 'scipy', 'semcal_cli.formats', "
        "'semcal_cli.labelling', 'semcal_cli.synthetic', 'semcal_cli.importing.recording'; "
        "print([name for name in others if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, "calibrate", street, "-o", "out.yaml"],
        check=True,
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={name: value for name, value in os.environ.items() if name not in OF_TERMINALS},
    )
    assert done.stdout.splitlines()[-1] == "[]"


ORDERS = {
    "calibrate C": "semcal calibrate DRIVE|RECORDING|DATASET",
    "inspect C": "semcal inspect DRIVE",
    "refine C --init C": "semcal refine DRIVE --init FILE",
    "verify C C": "semcal verify DRIVE|RECORDING|DATASET|RIG [CALIBRATION]",
    "report C D -o O.html": "semcal report DRIVE CALIBRATION -o FILE",
    "overlay C D -o O": "semcal overlay DRIVE CALIBRATION",
    "export rerun C D -o O.rrd": "semcal export rerun DRIVE [CALIBRATION] -o FILE",
    "verify D D": "semcal verify DRIVE|RECORDING|DATASET|RIG [CALIBRATION]",
    "compare C D": "",
}
"""Commands with a calibration C or a drive D without a reference in a wrong place, and the order that they tell."""


@pytest.mark.parametrize("line", ORDERS)
def test_a_misplaced_file_is_told_with_the_order(drive: Path, tmp_path: Path, cli: Cli, line: str) -> None:
    with edited(drive) as document:
        del document["T_camera_lidar"]
    command, given = line.split(), tmp_path / "c.yaml"
    write_calibration(make_calibration(POSE), given)
    code, out, err = cli(*({"C": given, "D": drive}.get(word, word) for word in command))
    assert (code, out) == (EXIT_FAILURE, "")
    found = f"{given}: found a calibration, expected a drive"
    if line in ("verify D D", "compare C D"):
        needed = "expected a transform, or a drive with T_camera_lidar"
        found = f"{drive / DRIVE_FILE}: found a drive without a reference, {needed}"
    order = f"; the order is `{ORDERS[line]}`" if ORDERS[line] else ""
    assert err == f"semcal: error: {found}{order}\n"


def test_a_drive_without_a_transform_is_verified_with_one_from_a_file(drive: Path, cli: Cli) -> None:
    with edited(drive) as document:
        del document["T_camera_lidar"]
    advice = f"`semcal verify {drive} CALIBRATION` takes one from a file"
    found = "found no transform from the sweeps to the images to verify"
    assert cli("verify", drive) == (EXIT_FAILURE, "", f"semcal: error: {drive}: {found}; {advice}\n")


def test_ctrl_c_ends_with_130(tmp_path: Path) -> None:
    # With -I, Python takes the installed package; a parent that ignores the signal would hand that on.
    program = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    command = [sys.executable, "-I", "-c", f"{program}from semcal_cli.cli import main; main()"]
    with subprocess.Popen(
        [*command, "synth", tmp_path, "--frames", "500"], stderr=subprocess.PIPE, text=True
    ) as process:
        while process.poll() is None and not any(tmp_path.rglob("*.bin")):
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate()
    assert process.returncode == 130, stderr
    assert stderr.splitlines()[-1] == "stopped"


@pytest.mark.parametrize(
    ("library", "end"),
    [
        ("click", "return None"),
        ("cv2", "return None"),
        ("cv2", "raise ImportError('cv2')"),
    ],
)
def test_ctrl_c_while_a_library_is_loaded(street: Path, library: str, end: str) -> None:
    """A library may make an error of its own of it."""
    program = f"""
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
class Interrupted:
    def find_spec(name, path, target=None):
        if name == {library!r}:
            try:
                os.kill(os.getpid(), signal.SIGINT)
                {end}
            except KeyboardInterrupt:
                {end if "raise" in end else "raise"}
sys.meta_path.insert(0, Interrupted)
sys.argv = ["semcal", "overlay", {str(street)!r}, {str(street)!r}, "-o", "/nowhere/at/all"]
from semcal_cli.__main__ import main; main()
"""
    done = subprocess.run([sys.executable, "-I", "-c", program], capture_output=True, text=True)
    assert done.returncode == 130, done.stderr
    assert done.stderr.strip() == ("" if library == "click" else "stopped")


def test_the_name_of_the_distribution_is_no_import(tmp_path: Path) -> None:
    """Beside a clone, Python would else make an empty namespace of its folder."""
    (tmp_path / "semcal").mkdir()
    done = subprocess.run(
        [sys.executable, "-c", "import semcal"], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.stderr.splitlines()[-1] == (
        "ImportError: semcal: found the name of the distribution, expected that of its import: "
        "import semcal_cli as semcal"
    )


def test_a_clone_whose_core_is_not_built_says_so(tmp_path: Path) -> None:
    """It hides the installed package from a Python that is started in it."""
    sources = tmp_path / "semcal_cli"
    shutil.copytree(
        Path(semcal_cli.__file__).parent, sources, ignore=shutil.ignore_patterns("*.so", "__pycache__")
    )
    done = subprocess.run(
        [sys.executable, "-m", "semcal_cli", "synth", "drive"], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 1
    assert done.stderr.strip() == (
        f"semcal: error: semcal_cli: cannot be imported: {sources}: {core.NO_CORE}"
    )


def test_the_package_is_a_program() -> None:
    done = subprocess.run(
        [sys.executable, "-I", "-m", "semcal_cli", "--version"], capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("semcal, version ")


@pytest.mark.parametrize("name", ["drive.yaml", "poses.txt", "image.png", "cloud.las"])
def test_pipes_and_devices_are_refused_at_once(street: Path, tmp_path: Path, cli: Cli, name: str) -> None:
    with edited(street, tmp_path) as document:
        frame = document["frames"][0] | {"points_stamp": 0.0, "image_stamp": 0.0}
        frame |= {key: str(street / frame[key]) for key in ("points", "point_labels", "image_labels")}
        frame |= {"image.png": {"image": name}, "cloud.las": {"points": name}}.get(name, {})
        document |= {"frames": [frame]} | ({"motion": {"poses": name}} if name == "poses.txt" else {})
    for make in (os.mkfifo, lambda path: path.symlink_to("/dev/zero")):
        (tmp_path / name).unlink(missing_ok=True)
        make(tmp_path / name)
        code, out, err = cli("calibrate" if name == "poses.txt" else "inspect", tmp_path)
        assert name in out + err
        assert "special file" in out + err
        assert code == (0 if name == "image.png" else EXIT_FAILURE)


def test_names_are_no_markup_and_may_be_too_long(street: Path, tmp_path: Path, cli: Cli) -> None:
    with edited(street, tmp_path) as document:
        frame = {key: str(street / name) for key, name in document["frames"][0].items() if key != "image"}
        shutil.copy(frame["points"], tmp_path / "a[red].bin")
        document |= {"frames": [frame | {"points": "a[red].bin"}], "classes": {"points": {"x[/y]": [1, 2]}}}
    code, out, _ = cli("inspect", tmp_path)
    assert code == 0
    assert "a[red]: " in out
    assert "x[/y]" in out
    named = tmp_path / "c:car:.yaml"
    code, _, err = cli("calibrate", street, "-o", named, "--init", street, "--no-polish")
    assert code in (0, 3)
    assert str(named) in "".join(err.split())
    long = "a" * 300
    for arguments in (("inspect", long), ("calibrate", street, "-o", tmp_path / f"{long}.yaml", "-q")):
        code, _, err = cli(*arguments)
        assert code == EXIT_FAILURE
        assert err.count("\n") == 1
        assert "file name too long" in err


def test_what_cannot_be_printed_is_escaped(tmp_path: Path, cli: Cli) -> None:
    """A key with a control sequence of a terminal."""
    file = tmp_path / "T.json"
    file.write_text(json.dumps({"T\x1b[31m\x00": 1}))
    code, _, err = cli("convert", file, "--from", "semcal", "--to", "text")
    assert code == EXIT_FAILURE
    assert "T.json: unknown key 'T\\x1b[31m\\x00'" in err
    assert str(InputError("a\nb\u2028c: found nothing")) == "a b c: found nothing"
