"""The stages together: the library is the command line, and a listener hears every stage."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import invoke
from conftest import make_pose

from semcal_cli import core
from semcal_cli.api.calls import calibrate, verify
from semcal_cli.config import (
    AdjustmentConfig,
    CalibrationConfig,
    InitializationConfig,
    RefinementConfig,
    check_config,
)
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.estimation.adjust.priors import Prior
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.estimation.stage import StageResult, announced
from semcal_cli.events import Event, Progress, StageDone
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.observations import Observations
from semcal_cli.result.calibration_document import CalibrationDocument, calibration_text


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the result of the command line goes."""
    return tmp_path_factory.mktemp("results")


@pytest.fixture(scope="module")
def calibrated(street: Path, folder: Path) -> tuple[CalibrationDocument, list[Event]]:
    """A calibration by the library with every default, and what it told."""
    events: list[Event] = []
    return calibrate(street, relative_to=folder, on_event=events.append), events


def test_the_library_gives_the_bytes_of_the_command_line(
    street: Path, folder: Path, calibrated: tuple[CalibrationDocument, list[Event]]
) -> None:
    output = folder / "calibration.yaml"
    done = invoke("calibrate", street, "-o", output, "-q")
    assert done.exit_code == 0
    assert output.read_bytes() == calibration_text(calibrated[0], "yaml").encode()


def test_every_stage_tells_a_listener(calibrated: tuple[CalibrationDocument, list[Event]]) -> None:
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
    ("settings", "complaint"),
    [
        ({"cues": ()}, "cues: found (), expected a tuple of different cues"),
        ({"cues": ["labels"]}, "cues: found ['labels'], expected a tuple of different cues"),
        (
            {"cues": ({},)},
            "cues: found {}, expected one of: labels, segments, edges, intensity, features, auto",
        ),
        ({"seed": -1}, "seed: found -1, expected a whole number from 0 to 9223372036854775807"),
        ({"seed": True}, "seed: found True, expected a whole number from 0 to 9223372036854775807"),
        ({"seed": 10**400}, f"seed: found {10**400}, expected a whole number from 0 to 9223372036854775807"),
        (
            {"refinement": RefinementConfig(max_baseline_m=10**400)},
            f"max_baseline_m: found {10**400}, expected a number above 0",
        ),
        (
            {"refinement": RefinementConfig(jointly=AdjustmentConfig(intrinsics=(1,)))},  # type: ignore[arg-type]
            "intrinsics: found (1,), expected a tuple of str",
        ),
        ({"max_frames": 0}, "max_frames: found 0, expected a whole number from 1 on"),
        ({"max_frames": 2.0}, "max_frames: found 2.0, expected a whole number from 1 on"),
        ({"is_raw": "yes"}, "is_raw: found 'yes', expected True or False"),
        ({"refinement": None}, "refinement: found None, expected RefinementConfig"),
        (
            {"initialization": RefinementConfig()},
            "initialization: found RefinementConfig, expected InitializationConfig",
        ),
        (
            {"initialization": InitializationConfig(coarse_cell_deg=math.nan)},
            "coarse_cell_deg: found nan, expected a number",
        ),
        (
            {"refinement": RefinementConfig(estimator="x")},  # type: ignore[arg-type]
            "estimator: found 'x', expected one of: exact, mine",
        ),
        (
            {"refinement": RefinementConfig(jointly=AdjustmentConfig(intrinsics=None))},  # type: ignore[arg-type]
            "intrinsics: found None, expected a tuple of str",
        ),
    ],
)
def test_settings_out_of_range_are_refused(street: Path, settings: dict[str, Any], complaint: str) -> None:
    with pytest.raises(InputError) as refusal:
        calibrate(street, CalibrationConfig(**settings))
    assert str(refusal.value) == complaint


def test_numbers_of_arrays_are_numbers() -> None:
    check_config(
        CalibrationConfig(seed=np.int64(3), refinement=RefinementConfig(max_baseline_m=np.float32(2.0)))
    )  # type: ignore[arg-type]


def test_what_are_no_settings_is_refused(street: Path, street_truth: Pose) -> None:
    for refused in (3, {}):
        with pytest.raises(InputError, match=rf"^config: found {refused}, expected a CalibrationConfig$"):
            calibrate(street, refused)  # type: ignore[arg-type]
        with pytest.raises(InputError, match=rf"^limits: found {refused}, expected Limits$"):
            verify(street, street_truth, refused)  # type: ignore[arg-type]


@pytest.mark.parametrize("is_moved", [True, False])
def test_a_stage_that_keeps_the_pose_is_told_as_one_that_has_not_moved(
    street_observations: Observations, street_truth: Pose, is_moved: bool
) -> None:
    events: list[Event] = []
    T = make_pose((0.01, 0.0, 0.0), (0.0, 0.1, 0.0)) @ street_truth if is_moved else street_truth
    agreement = core.agreement(street_observations.core, T)
    found = StageResult(T_camera_lidar=T, agreement=agreement, note="kept", details="of all data")
    assert announced("polished", "polishing", lambda: found, events.append, street_truth) is found
    doing, done = events
    assert doing == Progress("polishing")
    assert isinstance(done, StageDone)
    assert (done.name, done.note, done.details, done.agreement) == (
        "polished",
        "kept",
        "of all data",
        agreement,
    )
    assert (done.moved is not None) == is_moved
