"""The stages together: the library is the command line, and a listener hears every stage."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from semcal_cli.assessment.priors import Prior
from semcal_cli.cli import semcal
from semcal_cli.config import CalibrationConfig, RefinementConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.drive.observations import Observations
from semcal_cli.errors import InputError
from semcal_cli.events import Event, Progress, StageDone
from semcal_cli.geometry.poses import Pose
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.pipeline import calibrate
from semcal_cli.result.calibration import Calibration, calibration_text


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the result of the command line goes."""
    return tmp_path_factory.mktemp("results")


@pytest.fixture(scope="module")
def calibrated(street: Path, folder: Path) -> tuple[Calibration, list[Event]]:
    """A calibration by the library with every default, and what it told."""
    events: list[Event] = []
    return calibrate(street, relative_to=folder, on_event=events.append), events


def test_the_library_gives_the_bytes_of_the_command_line(
    street: Path, folder: Path, calibrated: tuple[Calibration, list[Event]]
) -> None:
    output = folder / "calibration.yaml"
    done = CliRunner().invoke(semcal, ["calibrate", str(street), "-o", str(output), "-q"])
    assert done.exit_code == 0
    assert output.read_bytes() == calibration_text(calibrated[0], "yaml").encode()


def test_every_stage_tells_a_listener(calibrated: tuple[Calibration, list[Event]]) -> None:
    calibration, events = calibrated
    done = [event for event in events if isinstance(event, StageDone)]
    assert [event.name for event in done] == ["load", "initial", "refined", "polished", "assessed"]
    informed = {event.name: event.agreement.mutual_information for event in done if event.agreement}
    assert informed == {name: stage.mutual_information_nats for name, stage in calibration.stages.items()}
    # Each says what it does before it is done.
    for before, after in zip([None, *events], events, strict=False):
        assert isinstance(after, Progress) or isinstance(before, Progress)


def test_stages_that_are_asked_for_tell_as_well(
    street: Path, street_observations: Observations, street_truth: Pose
) -> None:
    events: list[Event] = []
    calibration = calibrate(
        LoadedDrive(read_drive(street), street_observations).of_frames([0, 1]),
        CalibrationConfig(num_seeds=2),
        initial_pose=InitialPose(street_truth, "truth"),
        priors=[Prior("height", street_truth, (np.inf, 0.01, *(np.inf,) * 4))],
        on_event=events.append,
    )
    names = [event.name for event in events if isinstance(event, StageDone)]
    assert names == ["initial", "refined", "polished", "fused", "assessed", "repeated"]
    assert list(calibration.stages) == names[:4]
    assert calibration.repeatability is not None


@pytest.mark.parametrize(
    ("config", "complaint"),
    [
        (CalibrationConfig(cues=()), "cues: found (), needed a tuple of different cues"),
        (
            CalibrationConfig(cues=("nope",)),
            "cues: found 'nope', needed one of: labels, segments, edges, intensity, features, auto",
        ),  # type: ignore[arg-type]
        (CalibrationConfig(seed=-1), "seed: found -1, needed a number from 0 to 9223372036854775807"),
        (CalibrationConfig(max_frames=0), "max_frames: found 0, needed a number from 1 on"),
        (
            CalibrationConfig(refinement=RefinementConfig(estimator="x")),  # type: ignore[arg-type]
            "estimator: found 'x', needed one of: exact, mine",
        ),
    ],
)
def test_settings_out_of_range_are_refused(street: Path, config: CalibrationConfig, complaint: str) -> None:
    with pytest.raises(InputError) as refusal:
        calibrate(street, config)
    assert str(refusal.value) == complaint
