"""Who follows the recipe of CONTRIBUTING.md has a new cue: one file, one line, one test."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest
from documentation import ROOT

import semcal_cli
from semcal_cli.config.cues import BuiltInCue

PLACES = r"`(\w+\.py)` in `([\w/]+/)`:\n\n```python\n(.*?)```"
"""A file and its folder, which the text names before a block, and the block."""


def recipe() -> dict[str, str]:
    """The blocks of the recipe, by the files that they belong to."""
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (section,) = re.findall(r"^## A cue\n(.*?)^## ", page, re.MULTILINE | re.DOTALL)
    return {folder + name: text for name, folder, text in re.findall(PLACES, section, re.DOTALL)}


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of semcal and of its fixtures in which the recipe was followed."""
    folder = tmp_path_factory.mktemp("clone")
    ignored = shutil.ignore_patterns("__pycache__", "*.pyc")
    shutil.copytree(Path(semcal_cli.__file__).parent, folder / "semcal_cli", ignore=ignored)
    (folder / "tests").mkdir()
    for path in (ROOT / "tests").glob("*.py"):
        if not path.name.startswith("test_"):
            shutil.copy(path, folder / "tests")
    shutil.copytree(ROOT / "tests/benchmarks", folder / "tests/benchmarks", ignore=ignored)
    shutil.copy(ROOT / "pyproject.toml", folder)
    for name, text in recipe().items():
        path = folder / name
        if path.exists():
            start = text.partition("=")[0]
            text = re.sub(rf"^{re.escape(start)}.*\n", text, path.read_text(), flags=re.MULTILINE)
        path.write_text(text)
    return folder


def run(copy: Path, *words: object) -> str:
    env = os.environ | {"PYTHONPATH": str(copy)}
    command = [sys.executable, "-m", *map(str, words)]
    done = subprocess.run(command, env=env, capture_output=True, text=True, cwd=copy)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_recipe_is_one_file_one_line_and_one_test() -> None:
    cue, line, test = recipe().values()
    assert cue.count("CUE = Cue(") == 1
    assert line.count("\n") == 1
    assert test.count("def test_") == 1
    names = re.findall(r'"(\w+)"', line)
    assert [name for name in names if name != "height"] == list(get_args(BuiltInCue))


def test_its_test_passes(copy: Path) -> None:
    run(copy, "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", "tests/test_height.py")


def test_the_command_has_the_cue(copy: Path, street: Path, tmp_path: Path) -> None:
    path = tmp_path / "made.yaml"
    asked = ("--init", street, "--cue", "height", "--no-polish", "-q", "-o", path)
    run(copy, "semcal_cli", "refine", street, *asked)
    assert "height: {}" in path.read_text()
