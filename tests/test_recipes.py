"""Who follows a recipe of CONTRIBUTING.md to the letter has a new format, cue, data set or check."""

import os
import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from documentation import ROOT

import semcal_cli
from semcal_cli.drive.document import read_drive
from semcal_cli.files.image_files import write_image

TITLES = ("Add a format", "Add a cue", "Add a data set", "Add a check")
STEP = re.compile(r"^\d\. ((?:(?!^ +```).)*?)\n\n +```\w+\n(.*?)^ +```$", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"`([\w/]+\.py)`")


class Step(NamedTuple):
    """A step of a recipe: a file to write, or a line to add to a table or a call of a file."""

    path: str
    table: str | None
    text: str


def recipe(title: str) -> list[Step]:
    """List the steps under a heading that have a block."""
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    section = re.split(r"^##", page.partition(f"### {title}\n")[2], maxsplit=1, flags=re.MULTILINE)[0]
    steps = []
    for words, block in STEP.findall(section):
        path = FILE.findall(words)[-1]
        table = re.search(r"`(\w+)` of", words)
        steps.append(Step(path, table and table[1], textwrap.dedent(block)))
    return steps


def follow(step: Step, folder: Path) -> None:
    """Do what a step says: write the file, replace the line of an assignment, or add an entry and its import.

    The line of an entry may follow that of its import; if not, a table imports the modules of its folder by name.
    """
    path = folder / step.path
    if step.table is None:
        path.write_text(step.text)
        return
    *imports, entry = step.text.splitlines(keepends=True)
    text = path.read_text()
    for line in imports:
        text, count = re.subn(r"^(?=from semcal_cli)", line, text, count=1, flags=re.MULTILINE)
        assert count == 1, step
    if step.text.startswith(step.table):
        pattern, new = rf"^{step.table}\b.*\n", step.text
    else:
        pattern, new = rf"^( *)(\w+ = \w+\.)?{step.table}\b.*[\[({{]\n", rf"\g<0>\g<1>    {entry}"
    text, count = re.subn(pattern, new, text, flags=re.MULTILINE)
    assert count == 1, step
    if module := re.fullmatch(r"(\w+)\.\w+,\n", step.text):
        package = path.parent.relative_to(folder).as_posix().replace("/", ".")
        opening = rf"^from {package} import \(\n"
        text, count = re.subn(opening, rf"\g<0>    {module[1]},\n", text, flags=re.MULTILINE)
        assert count == 1, step
    path.write_text(text)


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of semcal, and of the modules that its tests share, in which all recipes were followed."""
    folder = tmp_path_factory.mktemp("clone")
    ignored = shutil.ignore_patterns("__pycache__", "*.pyc", "test_*.py")
    shutil.copytree(Path(semcal_cli.__file__).parent, folder / "semcal_cli", ignore=ignored)
    shutil.copytree(ROOT / "tests", folder / "tests", ignore=ignored)
    shutil.copy(ROOT / "pyproject.toml", folder)
    for step in (step for title in TITLES for step in recipe(title)):
        follow(step, folder)
    return folder


def run(copy: Path, *words: object, exit_code: int = 0) -> str:
    env = os.environ | {"PYTHONPATH": str(copy)}
    command = [sys.executable, *map(str, words)]
    done = subprocess.run(command, env=env, capture_output=True, text=True, cwd=copy)
    assert done.returncode == exit_code, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("title", TITLES)
def test_a_recipe_is_one_file_one_line_and_one_test(title: str) -> None:
    file, line, test, *calls = recipe(title)
    assert (file.table, test.table) == (None, None)
    assert len(calls) == (title == "Add a check")
    assert line.table is not None
    assert len(line.text.splitlines()) == 1
    assert test.path.startswith("tests/test_")


def test_the_tests_of_the_recipes_pass(copy: Path) -> None:
    paths = [recipe(title)[2].path for title in TITLES]
    run(copy, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", *paths)


def test_the_commands_know_what_was_added(copy: Path, street: Path, tmp_path: Path) -> None:
    assert "my-robot" in run(copy, "-m", "semcal_cli", "convert", "--formats")
    assert "my-rig" in run(copy, "-m", "semcal_cli", "import", "--help")
    path = tmp_path / "made.yaml"
    words = ("refine", street, "--init", street, "--cue", "height", "--no-polish", "-q", "-o", path)
    run(copy, "-m", "semcal_cli", *words)
    assert "height: {}" in path.read_text()


def test_the_check_is_called(copy: Path, street: Path, tmp_path: Path) -> None:
    """A calibration by white images is not trusted; one by the images as they were made is."""
    white = shutil.copytree(street, tmp_path / "white")
    drive = read_drive(white)
    for frame in drive.frames:
        assert frame.image is not None
        width, height = drive.camera.size
        write_image(np.full((height, width, 3), 255, np.uint8), drive.resolve(frame.image))
    sentence = "100% of the pixels are white (limit 20%): record again with a shorter exposure"
    for folder, is_doubted in ((white, True), (street, False)):
        path = tmp_path / f"{folder.name}.yaml"
        words = ("refine", folder, "--init", street, "--cue", "labels", "-q", "-o", path)
        run(copy, "-m", "semcal_cli", *words, exit_code=3 if is_doubted else 0)
        text = " ".join(path.read_text().split())
        assert (sentence in text) == ("overexposed" in text) == is_doubted


def test_the_check_is_on_the_page(copy: Path) -> None:
    run(copy, "tests/benchmarks/troubleshooting.py", copy)
    text = (copy / "troubleshooting.md").read_text()
    assert "| [overexposed](#overexposed) | Images are overexposed | at most 20 % |" in text
    assert "- **What to do.** Record again with a shorter exposure.\n- **Figure.**" in text
    limits = (copy / "benchmarks_limits.md").read_text()
    assert "- [Images are overexposed](troubleshooting.md#overexposed). At most 20 %: an example." in limits
