"""Kinds of hostile files that once took minutes or gigabytes, in a small size: each is refused for what it is."""

import shutil
from pathlib import Path

import pytest
from hostile_commands import Hostile, check
from hostile_growth import KINDS
from test_hostile_commands import drives as drives


@pytest.mark.parametrize("name", KINDS)
def test_a_kind_of_hostile_files_is_refused_in_a_line(name: str, drives: Path, tmp_path: Path) -> None:
    shutil.copytree(drives / "drive", tmp_path / "drive")
    kind = KINDS[name]
    check(
        Hostile(lambda folder: kind.make(folder, kind.small), kind.command, kind.line, kind.exit_code),
        tmp_path,
    )
