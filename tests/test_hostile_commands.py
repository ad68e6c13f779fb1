"""Nothing is lost, nothing hangs, nothing eats the machine: hostile cases of the real command."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from hostile_batches import BATCHES
from hostile_commands import Hostile, check
from hostile_joint import JOINT
from hostile_outputs import OUTPUTS
from hostile_sizes import SIZES
from hostile_transforms import TRANSFORMS

from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.synthetic.synthesis import synthesize

SMALL = SynthConfig(num_frames=1, channels=32, columns=400, width=320, height=180)
CASES: dict[str, Hostile] = TRANSFORMS | BATCHES | SIZES | OUTPUTS | JOINT


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("hostile")
    for seed, name in enumerate(("drive", "other")):
        synthesize(replace(SMALL, seed=seed), root / name)
    return root


@pytest.mark.parametrize("name", CASES)
def test_hostile_cases_are_refused_in_a_line(name: str, drives: Path, tmp_path: Path) -> None:
    if ".e57" in name:
        pytest.importorskip("pye57")
    for drive in ("drive", "other"):
        shutil.copytree(drives / drive, tmp_path / drive)
    check(CASES[name], tmp_path)
