"""Scripts whose figures are in the README run to their end on their smallest input."""

import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parent / "benchmarks"


@pytest.fixture
def semcal(tmp_path: Path) -> Path:
    """An executable of the installed package."""
    path = tmp_path / "semcal"
    path.write_text(f"#!{sys.executable}\nfrom semcal_cli.cli import main\nmain()\n")
    path.chmod(0o755)
    return path


def test_the_ratio_of_a_version_to_itself(semcal: Path, tmp_path: Path) -> None:
    small = ["--repeats", "1", "--pairs", "1", "--width", "64", "--height", "48"]
    command = [sys.executable, BENCHMARKS / "speed_ratio.py", "--pool", tmp_path / "pool", *small]
    versions = ["--before", semcal, "--after", semcal]
    found = subprocess.run([*command, *versions], capture_output=True, text=True, check=True)
    *_, help_row, calibrate_row = found.stdout.splitlines()
    assert help_row.startswith("| --help | ")
    assert calibrate_row.startswith("| calibrate, 1 pair | ")
    for row in (help_row, calibrate_row):
        before_s, after_s, ratio = (float(cell) for cell in row.split("|")[2:5])
        assert min(before_s, after_s, ratio) > 0.0


def test_the_picture_of_a_knocked_drive(tmp_path: Path) -> None:
    picture = tmp_path / "knocked.png"
    small = ["--frames", "4", "--width", "320", "--height", "180", "--angle-deg", "3"]
    command = [sys.executable, BENCHMARKS / "knocked_drive.py", "-o", picture, *small]
    found = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "truth: frame 2, 3.00 degrees, 5.0 cm" in found.stdout
    assert picture.stat().st_size > 1000
