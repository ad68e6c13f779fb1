"""Assembly of the calibration from the results of the stages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from semcal_cli import _core
from semcal_cli.result.calibration import Calibration, HeldOut, Input, Quality, Repeatability, Settings, Stage
from semcal_cli.result.camera import Clock, RefinedCamera
from semcal_cli.result.hypothesis import Hypothesis
from semcal_cli.result.parts import DrivePart
from semcal_cli.result.provenance import versions
from semcal_cli.result.stage import Finding, StageResult
from semcal_cli.result.uncertainty import Uncertainty


def assemble(
    stages: Mapping[str, StageResult],
    findings: Sequence[Finding],
    *,
    settings: Mapping[str, object],
    seed: int,
    num_frames: int,
    input: Input,
    is_assessed: bool,
    notes: tuple[str, ...] = (),
    parts: tuple[DrivePart, ...] = (),
    hypotheses: tuple[Hypothesis, ...] = (),
    runner_up_margin: float | None = None,
    held_out: HeldOut | None = None,
    uncertainty: Uncertainty | None = None,
    repeatability: Repeatability | None = None,
    camera: RefinedCamera | None = None,
    clock: Clock | None = None,
) -> Calibration:
    """Make a calibration from the results of the stages.

    Args:
        stages: Results of the stages by name, in order. The pose of the last one is the answer.
        findings: Findings against the answer, which is trusted if it was assessed and there are none.
        settings: Options that change the answer, by name.
        seed: Seed of every random choice.
        num_frames: Number of frames used.
        input: Files that were read.
        is_assessed: Whether the last stage, the assessment, was run.
        notes: Sentences that a person should know and that do not speak against the answer.
        parts: Parts of the drive, if its frames fit several poses.
        hypotheses: Hypotheses of the initial calibration, best first.
        runner_up_margin: Standard errors by which the runner-up is behind.
        held_out: Test of the polish on held-out data.
        uncertainty: Uncertainty of the pose.
        repeatability: Results with other seeds.
        camera: Intrinsics that were estimated together with the pose.
        clock: Offset of the camera's clock that was estimated together with the pose.

    Raises:
        CalibrationError: the pose is not finite or not rigid.
    """
    *_, last = stages.values()
    return Calibration.from_pose(
        last.T_camera_lidar,
        status="not_trusted" if findings else "trusted" if is_assessed else "not_assessed",
        reasons=tuple(finding.sentence for finding in findings),
        topics=tuple(finding.topic for finding in findings),
        notes=notes,
        parts=parts,
        quality=_quality(last.agreement, num_frames, runner_up_margin),
        stages={name: _stage(result) for name, result in stages.items()},
        uncertainty=uncertainty,
        repeatability=repeatability,
        camera=camera,
        clock=clock,
        polish=held_out,
        hypotheses=hypotheses,
        input=input,
        settings=Settings.model_validate({"options": _plain(settings), "seed": seed, "versions": versions()}),
    )


def _quality(agreement: _core.Agreement, num_frames: int, runner_up_margin: float | None) -> Quality:
    return Quality(
        mutual_information_nats=agreement.mutual_information,
        bias_nats=agreement.bias,
        label_agreement=agreement.label_agreement,
        overlap=agreement.overlap,
        num_points=agreement.num_inside - agreement.num_hidden,
        num_frames=num_frames,
        runner_up_margin=runner_up_margin,
    )


def _stage(result: StageResult) -> Stage:
    return Stage(
        T_camera_lidar=result.T_camera_lidar.tolist(),
        mutual_information_nats=result.agreement.mutual_information,
        bound_nats=result.bound_nats,
    )


def _plain(value: object) -> object:
    """Convert tuples to lists, as which both file formats read them back."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value
