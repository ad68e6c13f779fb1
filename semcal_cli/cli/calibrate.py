"""`semcal calibrate`: the whole pipeline, on a drive, on its parts, or on the drives of a rig."""

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
from semcal_cli.cli.stages import PRIORS, STARTS, RefinementSettings, SearchSettings
from semcal_cli.config import AUTO, LABELS, CalibrationConfig, CueName, PyramidConfig, RefinementConfig
from semcal_cli.config.mine import MINE_WITH_VECTORS, MineConfig
from semcal_cli.config.setting import settings_of
from semcal_cli.errors import CalibrationError, SemcalError, check_torch, counted
from semcal_cli.files.writing import takes_several

if TYPE_CHECKING:
    from semcal_cli.cli.outputs import Outputs
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.experiments.baselines.config import PaperConfig
    from semcal_cli.result.calibration import Calibration

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
            *("--search-deg", "--zoom", "--estimator", "--edge-band", "--no-polish", "--repeat", "--split"),
            *("--refine-intrinsics", "--intrinsics-sigma", "--estimate-delay", *PRIORS),
        ).requires("--method mi"),
        given("--seed", "--roll", "--device", *BEYOND_LABELS).requires("--method mi", "--method paper"),
        given(*BEYOND_LABELS).requires(*STARTS, where=["--method paper"], because="Alg. 2 needs labels"),
        given("--to-direction", "--to-frame", "--to-camera", "--to-lidar").requires("--to"),
        given("--to").requires("-o", where=["--json"], because="both would write to standard output"),
        given("--split").requires("-o", because="it writes several files, named after that one"),
        given("--split").excludes("--to", because="it writes complete results"),
        given("--split").excludes(
            "--no-polish", "--cue features", because="frames are compared after the polish"
        ),
    ]
    method: Literal["mi", "paper", "soic"] = option(
        "mi: mutual information, as semcal maximises it. paper: the paper's method exactly as published. soic: "
        "SOIC, a competing method that needs the same class names on both sides. The last two are for comparison, and "
        "estimate no uncertainty.",
        default="mi",
    )
    repeat: int | None = option(
        "Calibrate with N seeds, and report the spread of the results next to the uncertainty.", least=2
    )
    split: bool = option(
        "If the camera was moved during the drive, also calibrate each part of the drive separately, and write "
        "OUT_part_1.yaml, OUT_part_2.yaml and so on next to -o OUT.yaml; likewise for --log. The exit code is then "
        "that of the worst part; --report and --overlay show the whole drive.",
        default=False,
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
        output = self.outputs.output
        if self.split and output is not None and takes_several(output):
            raise click.UsageError(
                f"--split: found {output}, needed -o with a file: it writes several files."
            )

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
        """Give the cues to compare; rivals and MINE default to labels."""
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
        from semcal_cli.experiments.baselines.config import PaperConfig

        if len(self.cues) > 1:
            raise click.UsageError(f"--cue: found {','.join(self.cues)}, needed one cue for --method paper.")
        usual, drift = PaperConfig(), self.max_final_drift
        has_vectors = self.known_cues(self.cues) != LABELS
        asked = {name: getattr(self, name) for name in settings_of(MineConfig)}
        mine = replace(
            MINE_WITH_VECTORS if has_vectors else usual.mine,
            edge_band_px=0,
            max_baseline_m=self.max_baseline_m,
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
        if self.method == "soic":
            from semcal_cli.experiments.baselines.soic import calibrate_by_soic

            return partial(calibrate_by_soic, **start)
        if (paper := self.paper) is not None:
            from semcal_cli.experiments.baselines.paper import calibrate_as_published

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
    from semcal_cli.rig.document import find_rig

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
    """Calibrate one camera, and with --split each part of its drive; write the results, and return the exit code."""
    from semcal_cli.assessment.disagreement import MAX_PARTS
    from semcal_cli.cli.outputs import exit_code, loaded_drive
    from semcal_cli.cli.tables import labelled
    from semcal_cli.pipeline.parts import split

    outputs, initial_pose = settings.outputs, settings.initial_pose
    of_parts = [outputs.of_part(number) for number in range(1, MAX_PARTS + 1)] if settings.split else []
    run = partial(settings.calibration(), relative_to=outputs.folder)
    if settings.split:
        run = partial(run, hashes={})
    with loaded_drive(settings, settings.config, outputs, initial_pose, of_parts) as (data, terminal):
        whole = run(data, on_event=terminal.on_event)
    code = outputs.write(whole, terminal, settings.threads, data.drive)
    if not settings.split:
        return code
    parts = split(data, whole)
    for earlier in of_parts[len(parts) :]:
        if earlier.output is not None and earlier.output.exists():
            terminal.print(labelled("from another run", str(earlier.output)))
    if not parts:
        terminal.print(labelled("parts", "none: no camera movement was found"))
        return code
    jobs = []
    for number, (part, each) in enumerate(zip(parts, of_parts, strict=False), start=1):
        frames, name = part.drive.frames, f"part {number}"
        title = f"{name}: {counted(len(frames), 'frame')}, {frames[0].points} to {frames[-1].points}"
        jobs.append(Job(name, title, partial(run, part), each, settings.terminal()))
    found, failures = calibrate_each(jobs, settings.threads)
    if failures:
        raise CalibrationError(failure_sentence(failures, len(parts), "parts"))
    return max(map(exit_code, found.values()))


class Job(NamedTuple):
    """The calibration of one camera of a rig, or of one part of a drive."""

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


def failure_sentence(failures: dict[str, str], count: int, of: str) -> str:
    """Say how many cameras or parts failed, and why the first one did."""
    name, reason = next(iter(failures.items()))
    return f"{len(failures)} of {count} {of} failed; {name}: {reason}"
