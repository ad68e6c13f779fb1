"""`semcal calibrate`: the whole pipeline, on a drive or on the drives of a rig."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import click

from semcal_cli.cli.convert import WrittenSettings
from semcal_cli.cli.label import ImageSettings, label_on_the_way
from semcal_cli.cli.options import ResultSettings
from semcal_cli.cli.rules import given
from semcal_cli.cli.settings import command, option, output_file, setting_of
from semcal_cli.cli.stage_options import PRIORS, STARTS, RefinementSettings, SearchSettings
from semcal_cli.config import AUTO, LABELS, CalibrationConfig, CueName, PyramidConfig, RefinementConfig
from semcal_cli.config.mine_config import MINE_WITH_VECTORS, MineConfig
from semcal_cli.config.setting import settings_of
from semcal_cli.errors import SemcalError, check_torch

if TYPE_CHECKING:
    from semcal_cli.cli.outputs import Outputs
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.config.paper_config import PaperConfig
    from semcal_cli.result.calibration_document import Calibration

BEYOND_LABELS = ("--cue segments", "--cue edges", "--cue intensity", "--cue features")
of_paper = partial(setting_of, help="{} Only with --method paper.", is_open=True)


@dataclass(frozen=True, kw_only=True)
class PaperSettings:
    """Options for the choices that the paper leaves open."""

    section = "The paper's method"
    rules = [
        given(
            *(each.option for config in (MineConfig, PyramidConfig) for each in settings_of(config).values())
        ).requires("--method paper"),
    ]
    steps_per_level: int | None = of_paper(MineConfig, "steps_per_level")
    warm_up_steps: int | None = of_paper(MineConfig, "warm_up_steps")
    batch_size: int | None = of_paper(MineConfig, "batch_size")
    num_hidden: int | None = of_paper(MineConfig, "num_hidden")
    learning_rate_theta: float | None = of_paper(MineConfig, "learning_rate_theta")
    learning_rate_pose: float | None = of_paper(MineConfig, "learning_rate_pose")
    max_final_drift: float | None = of_paper(PyramidConfig, "max_final_drift")


@dataclass(frozen=True, kw_only=True)
class CalibrateSettings(
    SearchSettings, RefinementSettings, ImageSettings, PaperSettings, WrittenSettings, ResultSettings
):
    """Settings of `calibrate`."""

    rules = [
        given(
            *("--search-deg", "--zoom", "--estimator", "--edge-band", "--no-polish", "--repeat"),
            *("--refine-intrinsics", "--intrinsics-sigma", "--estimate-delay", *PRIORS),
        ).requires("--method mi"),
        given(*BEYOND_LABELS).requires(*STARTS, where=["--method paper"], because="Alg. 2 needs labels"),
        given("--to-direction", "--to-frame", "--to-camera", "--to-lidar").requires("--to"),
        given("--to").requires("-o", where=["--json"], because="both would write to standard output"),
    ]
    method: Literal["mi", "paper"] = option(
        "mi: mutual information, as semcal maximises it. paper: the paper's method exactly as published, for "
        "comparison; it estimates no uncertainty.",
        default="mi",
    )
    repeat: int | None = option(
        "Calibrate with N seeds, and report the spread of the results next to the uncertainty.", minimum=2
    )
    page: Path | None = output_file("Also write a report of the result: .html.", "--report")
    images: Path | None = option(
        "Also draw the points on the images of at most 20 frames, before and after refinement.",
        "--overlay",
        metavar="DIR",
    )

    def check(self) -> None:
        """Check everything about the options that can be checked without the drive.

        Raises:
            click.UsageError: options conflict in a way that no rule covers.
            InputError: the file of `--init` is not a transform, or a pose puts the camera too far from the LiDAR.
        """
        for name in ("initial_pose", "paper", "config", "priors"):
            getattr(self, name)

    def check_estimator(self) -> None:
        """Check that torch is installed if MINE is chosen.

        Raises:
            InputError: it is not installed.
        """
        if self.method == "paper":
            check_torch("--method paper")
        super().check_estimator()

    @property
    def refinement(self) -> RefinementConfig:
        """Settings of the refinement."""
        found = super().refinement
        return replace(found, estimator="mine") if self.method == "paper" else found

    def known_cues(self, cues: tuple[CueName, ...]) -> tuple[CueName, ...]:
        """Return the cues to compare; the paper's method and MINE default to labels."""
        return LABELS if self.method != "mi" and cues == AUTO else super().known_cues(cues)

    @property
    def config(self) -> CalibrationConfig:
        """All settings of the calibration."""
        return CalibrationConfig(
            self.seed,
            self.known_cues(self.cues),
            self.max_frames,
            self.initialization,
            self.refinement,
            self.repeat or 1,
            is_raw=self.method == "paper",
        )

    @property
    def paper(self) -> PaperConfig | None:
        """Settings of the paper's method, with the in-plane rotations and distance of the search; None for others.

        Raises:
            click.UsageError: several cues are given.
        """
        if self.method != "paper":
            return None
        from semcal_cli.config.paper_config import PaperConfig
        from semcal_cli.observations.cues.cue_table import find_cue

        if len(self.cues) > 1:
            raise click.UsageError(f"--cue: found {','.join(self.cues)}, needed one cue for --method paper.")
        usual, drift = PaperConfig(), self.max_final_drift
        (cue,) = self.known_cues(self.cues)
        asked = {name: getattr(self, name) for name in settings_of(MineConfig)}
        mine = replace(
            usual.mine if find_cue(cue).has_point_labels else MINE_WITH_VECTORS,
            **{name: value for name, value in asked.items() if value is not None},
        )
        pyramid = usual.pyramid if drift is None else replace(usual.pyramid, max_final_drift=drift)
        return PaperConfig(replace(self.initialization, zoom=usual.initialization.zoom), pyramid, mine)

    @property
    def outputs(self) -> Outputs:
        """Output files."""
        from semcal_cli.cli.outputs import Outputs

        to = None if self.to is None else (self.to, self.written())
        return replace(Outputs.of_result(self), to=to, page=self.page, images=self.images)

    def calibration(self) -> Callable[..., Calibration]:
        """Choose the function that calibrates a drive by the chosen method, with all settings."""
        start: dict[str, Any] = {"config": self.config, "initial_pose": self.initial_pose}
        if (paper := self.paper) is not None:
            from semcal_cli.pipeline.paper import calibrate_as_published

            return partial(calibrate_as_published, paper=paper, **start)
        from semcal_cli.pipeline import calibrate

        return partial(calibrate, priors=self.priors, **start)


@command(CalibrateSettings)
def calibrate(settings: CalibrateSettings) -> None:
    """Calibrate the camera and the LiDAR of DRIVE, a folder with a drive.yaml or the file itself.

    No initial guess is needed: all mounting directions are searched, then the best pose is refined. Exit code 3 means
    that a result was written but is not trusted.

    DRIVE may be a rig.yaml, which lists the drives of several cameras with one LiDAR. All of them are calibrated. -o is
    then a folder, for the result of each camera and for rig_calibration.yaml, which relates the cameras to each other.
    """
    from semcal_cli.many.rig.rig_document import find_rig

    settings.check_estimator()
    settings.check()
    if (rig := find_rig(settings.drive)) is not None:
        from semcal_cli.cli.rig import calibrate_rig

        sys.exit(calibrate_rig(rig, settings))
    if settings.image_model:
        with settings.terminal() as terminal:
            drive = label_on_the_way(
                settings.drive, settings, settings.max_frames, settings.max_points, terminal
            )
        settings = replace(settings, drive=drive)
    sys.exit(_calibrate_drive(settings))


def _calibrate_drive(settings: CalibrateSettings) -> int:
    """Calibrate one camera, write the result, and return the exit code."""
    from semcal_cli.cli.outputs import loaded_drive

    outputs, initial_pose = settings.outputs, settings.initial_pose
    run = partial(settings.calibration(), relative_to=outputs.folder)
    with loaded_drive(settings, settings.config, outputs, initial_pose) as (data, terminal):
        calibration = run(data, on_event=terminal.on_event)
    return outputs.write(calibration, terminal, settings.threads, data.drive)


class Job(NamedTuple):
    """The calibration of one camera of a rig."""

    name: str
    title: str
    run: Callable[..., Calibration]
    """Calibrates, and reports its progress to `on_event`."""
    outputs: Outputs
    terminal: Terminal


def calibrate_each(
    jobs: Sequence[Job], num_threads: int | None
) -> tuple[dict[str, Calibration], dict[str, str]]:
    """Run jobs one after another, and write and show the result of each.

    Returns:
        The calibrations that succeeded, and the errors of the others, by name.
    """
    from semcal_cli.cli.tables import labelled

    calibrations: dict[str, Calibration] = {}
    failures: dict[str, str] = {}
    for name, title, run, outputs, terminal in jobs:
        terminal.print(f"[{title}]")
        try:
            with terminal:
                found = run(on_event=terminal.on_event)
            outputs.write(found, terminal, num_threads)
            calibrations[name] = found
        except SemcalError as error:
            failures[name] = " ".join(str(error).splitlines())
            terminal.print(labelled("failed", failures[name]))
    return calibrations, failures


def failure_sentence(failures: dict[str, str], count: int) -> str:
    """Describe how many cameras failed, and why the first one did."""
    name, reason = next(iter(failures.items()))
    return f"{len(failures)} of {count} cameras failed; {name}: {reason}"
