"""What findings advise: options of the command, also where no pose was kept."""

import re

import click
import pytest

from semcal_cli.checks.focal_length import WRONG_FOCAL_LENGTH
from semcal_cli.checks.registry import CHECKS
from semcal_cli.checks.wrong_clocks import WRONG_CLOCKS
from semcal_cli.checks.wrong_intrinsics import WRONG_INTRINSICS
from semcal_cli.cli import semcal
from semcal_cli.config import CalibrationConfig, PolishConfig, RefinementConfig
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.findings.check import Check
from semcal_cli.formats import read_transform
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.pipeline import assess, refine_and_polish, start_at
from semcal_cli.pipeline.stages import Stages
from semcal_cli.synthetic.synthesis import synthesize


@pytest.fixture(scope="module")
def early(tmp_path_factory: pytest.TempPathFactory) -> LoadedDrive:
    """A drive at mixed speeds, whose images are 20 ms earlier than their stamps say."""
    folder = tmp_path_factory.mktemp("early") / "drive"
    config = SynthConfig(num_frames=6, seed=11, width=640, height=360, motion="mixed", delay_ms=-20.0)
    synthesize(config, folder)
    return load(read_drive(folder), CalibrationConfig())


def assessed(data: LoadedDrive, config: RefinementConfig | None = None) -> Stages:
    config = config or RefinementConfig()
    start = start_at(data, InitialPose(read_transform(data.drive.path), "start"))
    stages = refine_and_polish(data, start, config, from_afar=True)
    return assess(data, stages, config, with_label_bleed=False)


def test_wrong_clocks_are_told(early: LoadedDrive) -> None:
    """By a whole assessment, beside all other findings."""
    (clocks,) = (finding for finding in assessed(early).findings if finding.topic == "clocks")
    assert re.search(r"images seem to be (19|20)\.\d ms earlier than image_stamp says", clocks.found)
    assert clocks.advice == WRONG_CLOCKS.advice


def test_wrong_clocks_are_told_also_where_the_polish_is_rejected(early: LoadedDrive) -> None:
    # As if held-out data had to get better by a lot.
    stages = assessed(early, RefinementConfig(polish=PolishConfig(max_loss=-1e6)))
    assert stages.uncertainty is None
    assert {"polish-rejected", "clocks"} <= {finding.topic for finding in stages.findings}


@pytest.mark.parametrize(
    ("check", "option"),
    [
        (WRONG_FOCAL_LENGTH, "--refine-intrinsics fx,fy,cx,cy"),
        (WRONG_INTRINSICS, "--refine-intrinsics fx,fy,cx,cy"),
    ],
)
def test_what_can_be_estimated_is_advised(check: Check, option: str) -> None:
    assert check.advice.endswith(f", or calibrate with {option}")


def test_a_clock_that_is_off_is_estimated_first() -> None:
    assert WRONG_CLOCKS.advice.startswith("calibrate with --estimate-delay, or ")


@pytest.mark.parametrize("check", CHECKS.values(), ids=CHECKS)
def test_every_option_that_is_advised_exists(check: Check) -> None:
    for words, *options in re.findall(r"(?:`semcal ([a-z ]+?) ?(?=-|`))?[^`]*?(--[a-z-]+)", check.advice):
        known: click.Command | None = semcal
        for word in (words or "calibrate").split():
            assert isinstance(known, click.Group)
            known = known.get_command(click.Context(semcal), word)
        assert known is not None
        assert {*options} <= {name for option in known.params for name in option.opts}
