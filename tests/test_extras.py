"""semcal where torch is not installed: all works but MINE, and what needs it says what to install."""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
from commands import invoke

from semcal_cli import cli
from semcal_cli.errors import InputError, check_installed, describe_extra, is_installed
from semcal_cli.result.calibration_document import read_calibration

pytestmark = pytest.mark.slow

NEEDED = f"install {describe_extra('mine')}"
BARE = '''
import contextlib, importlib.metadata, io, json, sys

class WithoutTorch:
    """Refuses torch, as Python does where it is not installed."""

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "torch":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, WithoutTorch())
version = importlib.metadata.version

def version_without_torch(name):
    if name == "torch":
        raise importlib.metadata.PackageNotFoundError(name)
    return version(name)

importlib.metadata.version = version_without_torch
'''
COMMANDS = (
    BARE
    + """
from semcal_cli.cli import main

def run(arguments):
    sys.argv = ["semcal", *arguments]
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        try:
            main()
        except SystemExit as stop:
            return [stop.code, out.getvalue(), err.getvalue()]

if __name__ == "__main__":
    import semcal_cli.cli.demo

    semcal_cli.cli.demo.NUM_FRAMES = 2
    endings = [run(arguments) for arguments in json.loads(sys.argv[1])]
    assert "torch" not in sys.modules
    import semcal_cli.report.view.server, semcal_cli.report.view.session  # noqa
    assert "torch" not in sys.modules
    print(json.dumps(endings))
"""
)
"""Script that runs commands; the processes that a batch starts import it, and find no torch either."""


class Ending(NamedTuple):
    """How a command ended."""

    code: int
    out: str
    err: str


def python_without_torch(folder: Path, code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a script of Python in a process of its own, which finds no torch."""
    script = folder.with_suffix(".py")
    script.write_text(f"BARE = {BARE!r}\n{code}")
    return subprocess.run(
        [sys.executable, "-I", str(script), *arguments],
        capture_output=True,
        text=True,
        cwd=folder,
        check=False,
    )


def semcal_without_torch(folder: Path, *commands: str) -> list[Ending]:
    """Run commands, one after another, where there is no torch."""
    done = python_without_torch(folder, COMMANDS, json.dumps([command.split() for command in commands]))
    assert done.returncode == 0, done.stderr
    return [Ending(*ending) for ending in json.loads(done.stdout)]


WITHOUT_TORCH = (
    "synth drive --frames 2 --width 320 --height 180",
    "calibrate drive -o c.yaml --report c.html --overlay overlays",
    "initialize drive -o initial.yaml",
    "refine drive --init c.yaml -o refined.yaml",
    "verify drive c.yaml",
    "report drive c.yaml -o r.html",
    "overlay drive c.yaml -o over",
    "inspect drive",
    "compare c.yaml drive",
    "convert c.yaml --to opencalib -o c.json",
    "batch drive -o results",
    "fleet results -o fleet.yaml",
    "import folder --help",
    "experiment --help",
    "demo",
)
"""Commands in the order in which they use one another's files."""


def test_all_but_mine_runs_without_torch(tmp_path: Path) -> None:
    endings = semcal_without_torch(tmp_path, *WITHOUT_TORCH)
    assert len(endings) == len(WITHOUT_TORCH)
    for command, ending in zip(WITHOUT_TORCH, endings, strict=True):
        # Two small frames may not be enough to trust the answer.
        assert ending.code in (0, 3, 4), f"{command}: {ending.err}"
        assert "torch" not in ending.err, command
    assert [*read_calibration(tmp_path / "c.yaml").settings.versions] == [
        "semcal",
        "numpy",
        "opencv-python-headless",
    ]
    of_drive = [*(tmp_path / "results").rglob("calibration.yaml")]
    assert [*read_calibration(*of_drive).settings.versions][-1] == "opencv-python-headless"
    assert "by MINE" not in endings[-1].out + endings[-1].err


WITH_TORCH = {
    "calibrate nowhere --estimator mine": "--estimator mine",
    "calibrate nowhere --estimator mine --cue features": "--estimator mine",
    "calibrate nowhere --method paper": "--method paper",
    "refine nowhere --init none.yaml --estimator mine": "--estimator mine",
    "batch here -o results -- --method paper": "--method paper",
    "experiment pairs": "semcal experiment pairs",
    "experiment noise": "semcal experiment noise",
    "experiment table nowhere": "semcal experiment table",
}
"""What each command says that it found no torch for; no drive is there, so that no file is read before."""


def test_what_needs_torch_says_what_to_install_before_it_reads_a_file(tmp_path: Path) -> None:
    (tmp_path / "here").mkdir()
    endings = semcal_without_torch(tmp_path, *WITH_TORCH)
    for ending, asked in zip(endings, WITH_TORCH.values(), strict=True):
        assert ending == (1, "", f"semcal: error: {asked}: found no torch; {NEEDED}\n")
    assert [path.name for path in tmp_path.iterdir()] == ["here"]


@pytest.mark.parametrize(
    ("code", "asked"),
    [
        (
            "import semcal_cli as semcal\n"
            "mine = semcal.CalibrationConfig(refinement=semcal.RefinementConfig('mine'))\n"
            "semcal.calibrate('nowhere', mine)",
            "estimator 'mine'",
        ),
        ("import semcal_cli.estimation.refine.objective", "semcal_cli.estimation.refine.objective"),
    ],
)
def test_the_library_says_it_too(tmp_path: Path, code: str, asked: str) -> None:
    done = python_without_torch(tmp_path, f"exec(BARE)\n{code}")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == f"semcal_cli.errors.InputError: {asked}: found no torch; {NEEDED}"


@pytest.mark.parametrize("kind", [ImportError, OSError])
def test_a_torch_that_is_not_whole_is_told_in_a_line(
    kind: type[Exception], street: Path, tmp_path: Path
) -> None:
    """So it is after an update of the system, or with an install that was stopped."""
    (tmp_path / "torch").mkdir()
    (tmp_path / "torch/__init__.py").write_text(f"raise {kind.__name__}('libcudart.so.12: no such\\nfile')\n")
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from semcal_cli.cli import main; main()"
    refine = ["refine", str(street), "--init", str(street), "-q", "-o", "c.yaml"]
    done = python_without_torch(tmp_path, code, *refine, "--estimator", "mine")
    found = "torch: found an installation that cannot be imported (libcudart.so.12: no such file)"
    assert (done.returncode, done.stdout, done.stderr) == (1, "", f"semcal: error: {found}; {NEEDED}\n")
    assert not (tmp_path / "c.yaml").exists()


def test_any_library_that_is_not_whole_is_told_in_a_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*arguments: object) -> int:
        raise ImportError("libGL.so.1: no such\nfile", name="cv2")

    monkeypatch.setattr(cli, "_invoke", fail)
    assert cli.run(["inspect", "drive"]).exit_code == 1
    assert capsys.readouterr().err == "semcal: error: cv2: cannot be imported: libGL.so.1: no such file\n"


def test_a_library_that_is_not_there_is_named_with_its_extra() -> None:
    assert is_installed("numpy")
    check_installed("numbers", "numpy", "numbers")
    with pytest.raises(
        InputError,
        match=r"^a\.laz: found no such_library; install the extra 'las': pip install 'semcal\[las\]",
    ):
        check_installed("a.laz", "such_library", "las")
    with pytest.raises(
        InputError,
        match=r"^a\.e57: found no such_library; install the extra 'e57', which exists only on Linux on x86-64 and on a "
        r"Mac with Apple silicon: pip install 'semcal\[e57\]",
    ):
        check_installed("a.e57", "such_library", "e57")


def test_the_demo_shows_mine_beside_the_exact_estimator(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.modules["semcal_cli.cli.demo"], "NUM_FRAMES", 2)
    done = invoke("demo", tmp_path / "demo")
    assert done.exit_code == 0, done.output
    told = re.search(
        r"^with MINE        (\d\.\d{4}) deg and (\d\.\d{3}) cm off, in \d+\.\d s, ", done.output, re.MULTILINE
    )
    assert told is not None
    # About four times what it ends at: a pose of another scene, or of no refinement, is farther off.
    assert float(told[1]) < 0.04
    assert float(told[2]) < 0.6
