"""The options of `semcal calibrate`, which `semcal batch` takes, too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from semcal_cli.cli.image_networks import ImageSettings
from semcal_cli.cli.options import RecordingSettings, ResultSettings, result_file
from semcal_cli.cli.rules import given
from semcal_cli.cli.settings import argument, option, output_file, setting_of
from semcal_cli.cli.stage_options import (
    PRIORS,
    STARTS,
    RefinementSettings,
    SearchSettings,
    as_far_as_named,
)
from semcal_cli.cli.written_format import WrittenSettings
from semcal_cli.config import AUTO, LABELS, CalibrationConfig, CueName, PyramidConfig, RefinementConfig
from semcal_cli.config.mine_config import MINE_WITH_VECTORS, MineConfig
from semcal_cli.config.setting import settings_of
from semcal_cli.errors import check_torch

if TYPE_CHECKING:
    from semcal_cli.cli.outputs import Outputs
    from semcal_cli.config.paper_config import PaperConfig
    from semcal_cli.estimation.search.initial_pose import InitialPose
    from semcal_cli.result.calibration_document import CalibrationDocument

DEFAULT_OUTPUT = Path("calibration.yaml")
BEYOND_LABELS = ("--cue segments", "--cue edges", "--cue intensity", "--cue features")
paper_setting = partial(setting_of, help="{} Only with --method paper.", is_open=True)


@dataclass(frozen=True, kw_only=True)
class PaperSettings:
    """Options for the choices that the paper leaves open."""

    section = "The paper's method"
    rules = [
        given(
            *(
                setting.option
                for config in (MineConfig, PyramidConfig)
                for setting in settings_of(config).values()
            )
        ).requires("--method paper"),
    ]
    steps_per_level: int | None = paper_setting(MineConfig, "steps_per_level")
    warm_up_steps: int | None = paper_setting(MineConfig, "warm_up_steps")
    batch_size: int | None = paper_setting(MineConfig, "batch_size")
    num_hidden: int | None = paper_setting(MineConfig, "num_hidden")
    learning_rate_theta: float | None = paper_setting(MineConfig, "learning_rate_theta")
    learning_rate_pose: float | None = paper_setting(MineConfig, "learning_rate_pose")
    max_final_drift: float | None = paper_setting(PyramidConfig, "max_final_drift")


@dataclass(frozen=True, kw_only=True)
class OwnTransformSettings:
    """The option that ignores what the input states about the transform."""

    section = "Start"
    rules = [given("--from-nothing").excludes(*STARTS)]
    is_from_nothing: bool = option(
        "Do not start from the transform that a recording or a drive states.", "--from-nothing", default=False
    )


@dataclass(frozen=True, kw_only=True)
class CalibrateSettings(
    SearchSettings,
    OwnTransformSettings,
    RefinementSettings,
    ImageSettings,
    RecordingSettings,
    PaperSettings,
    WrittenSettings,
    ResultSettings,
):
    """Settings of `calibrate`."""

    takes_recordings = True
    shown_first = (
        *("--output", "--report", "--overlay", "--init", "--init-rpy-xyz", "--cue", "--image-model"),
        *("--points", "--image", "--frames", "--exclude", "--refine-intrinsics", "--estimate-delay", "--to"),
        *("--force", "--json", "--verbose", "--quiet"),
    )
    rules = [
        given(
            *(
                "--search-deg",
                "--zoom",
                "--estimator",
                "--edge-band",
                "--no-polish",
                "--repeat",
                "--cross-validate",
            ),
            *("--refine-intrinsics", "--intrinsics-sigma", "--estimate-delay", *PRIORS),
        ).requires("--method mi"),
        given(*BEYOND_LABELS).requires(*STARTS, where=["--method paper"], because="Alg. 2 needs labels"),
        given("--to-direction", "--to-frame", "--to-camera", "--to-lidar").requires("--to"),
        given("--cross-validate").excludes(
            "--no-polish",
            "--refine-intrinsics",
            "--estimate-delay",
            *PRIORS,
            because="parts of the drive are only polished",
        ),
        given("--to").requires("-o", where=["--json"], because="both would write to standard output"),
    ]
    drive: Path = argument(metavar="DRIVE|RECORDING|DATASET")
    output: Path | None = result_file(
        "File for the result: .yaml, .yml or .json; - is standard output. Without it, --json and --to print the result "
        "and write no file.",
        default=DEFAULT_OUTPUT,
        brief="File for the result: .yaml, .yml or .json.  [default: calibration.yaml]",
    )
    force: bool = option(
        "Replace an output that is no calibration of semcal. A drive of other data is never replaced.",
        default=False,
        brief="Replace an output that is no calibration of semcal.",
    )
    method: Literal["mi", "paper"] = option(
        "mi: mutual information, as semcal maximises it. paper: the paper's method exactly as published, for "
        "comparison; it estimates no uncertainty.",
        default="mi",
    )
    repeat: int | None = option(
        "Calibrate with N seeds, and report the spread of the results next to the uncertainty.", minimum=2
    )
    cross_validate: int | None = option(
        "Also calibrate K parts of the drive, which share no scene, each alone, and compare how far they differ with "
        "what their intervals predict.",
        metavar="K",
        minimum=2,
    )
    page: Path | None = output_file("Also write a report of the result: .html.", "--report")
    images: Path | None = option(
        "Also draw the points on the images of at most 20 frames, before and after refinement.",
        "--overlay",
        metavar="DIR",
        brief="Also draw the points on at most 20 images.",
    )

    def check(self) -> None:
        """Check everything about the options that can be checked without the drive.

        Raises:
            click.UsageError: options conflict in a way that no rule covers.
            InputError: the file of `--init` is not a transform, or a pose puts the camera too far from the LiDAR.
        """
        is_rig = False
        if self.init is not None and self.drive.exists():
            from semcal_cli.many.rig.rig_document import find_rig

            # The starts of a rig are read with its drives.
            is_rig = find_rig(self.drive) is not None
        if not is_rig:
            with as_far_as_named(self.drive):
                _ = self.initial_pose, self.priors
        _ = self.paper, self.config

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
        config = super().refinement
        return replace(config, estimator="mine") if self.method == "paper" else config

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
            self.cross_validate or 1,
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
            raise click.UsageError(
                f"--cue: found {','.join(self.cues)}, expected one cue for --method paper."
            )
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
        outputs = replace(Outputs.of_result(self), to=to, page=self.page, images=self.images)
        return replace(outputs, replaces_any=self.force or to is not None)

    def calibration(self, initial_pose: InitialPose | None = None) -> Callable[..., CalibrationDocument]:
        """Choose the function that calibrates a drive by the chosen method, with all settings.

        Args:
            initial_pose: Pose to start from, in place of the one that is given.
        """
        start: dict[str, Any] = {"config": self.config, "initial_pose": initial_pose or self.initial_pose}
        if (paper := self.paper) is not None:
            from semcal_cli.pipeline.paper import calibrate_as_published

            return partial(calibrate_as_published, paper=paper, **start)
        from semcal_cli.pipeline import calibrate

        return partial(calibrate, priors=self.priors, **start)
