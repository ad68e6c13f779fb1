"""The workflows on GitHub: what they run cannot change without a commit here."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from documentation import ROOT

ACTION = ROOT / ".github/actions/verify"


def test_every_action_of_others_is_pinned_to_a_commit() -> None:
    """A tag can be moved to other code, which would then publish in our name."""
    used = [
        name
        for path in sorted((ROOT / ".github").rglob("*.yml"))
        for name in re.findall(r"uses: (?!\./)(.+)", path.read_text())
    ]
    assert "pypa/gh-action-pypi-publish" in {name.partition("@")[0] for name in used}
    assert [name for name in used if not re.fullmatch(r"[\w./-]+@[0-9a-f]{40} # v[\d.]+", name)] == []


def run_step(
    number: int, folder: Path, at: Path = ACTION, **inputs: object
) -> subprocess.CompletedProcess[str]:
    """Run a shell step of the action as it stands, with a pip that only says what it was asked for."""
    action = yaml.safe_load((ACTION / "action.yml").read_text())
    given = {name: about.get("default", "") for name, about in action["inputs"].items()} | inputs
    context = {f"inputs.{name}": str(value) for name, value in given.items()} | {
        "github.action_path": str(at)
    }
    step, programs = action["runs"]["steps"][number], folder / "bin"
    environment = {
        name: re.sub(r"\$\{\{ (\S+) \}\}", lambda found: context[found[1]], text)
        for name, text in step["env"].items()
    }
    programs.mkdir(exist_ok=True)
    for name, script in {
        "pip": 'echo "pip $@"',
        "semcal": f'exec {sys.executable} -m semcal_cli "$@"',
    }.items():
        (programs / name).write_text(f"#!/bin/sh\n{script}\n")
        (programs / name).chmod(0o755)
    path = {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"}
    # GitHub runs `shell: bash` with these options.
    command = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]]
    return subprocess.run(
        command, env=os.environ | environment | path, cwd=folder, capture_output=True, text=True
    )


@pytest.mark.parametrize(
    ("install", "said"),
    [("", f"pip install {ROOT}\n"), ("semcal==1.2", "pip install semcal==1.2\n"), ("none", "")],
)
def test_the_action_installs_its_own_checkout(tmp_path: Path, install: str, said: str) -> None:
    done = run_step(0, tmp_path, install=install)
    assert (done.returncode, done.stdout) == (0, said), done.stderr
    assert '\nname = "semcal"\n' in (ROOT / "pyproject.toml").read_text()


def test_an_action_without_its_source_says_so(tmp_path: Path) -> None:
    """Its folder was copied into another repository."""
    (copied := tmp_path / ".github/actions/verify").mkdir(parents=True)
    done = run_step(0, tmp_path, copied)
    assert done.returncode == 1
    assert done.stdout.startswith("::error::found no source of semcal around the action")


def test_the_action_verifies(street: Path, tmp_path: Path) -> None:
    done = run_step(1, tmp_path, drive=street, calibration=street, junit="a verdict.xml")
    assert done.returncode == 0, done.stderr
    assert "<testsuite" in (tmp_path / "a verdict.xml").read_text()
    assert run_step(1, tmp_path, drive=tmp_path, calibration=street).returncode == 1


def test_the_shown_workflow_lets_the_action_install() -> None:
    workflow = yaml.safe_load((ROOT / ".github/workflows/verify-demo.yml").read_text())
    steps = workflow["jobs"]["verify"]["steps"]
    (used,) = [step for step in steps if step.get("uses") == "./.github/actions/verify"]
    assert "install" not in used["with"]
    assert not any(re.search(r"(?<!maker/bin/)pip install", step.get("run", "")) for step in steps)
