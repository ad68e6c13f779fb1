"""Verification of a transform: the pose is estimated again, and the difference is judged axis by axis."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from semcal_cli.checks import precedence
from semcal_cli.checks.own_drive import check_own_drive
from semcal_cli.config import (
    AdjustmentConfig,
    CalibrationConfig,
    InitializationConfig,
    Limits,
    RefinementConfig,
)
from semcal_cli.config.setting import check_settings
from semcal_cli.drive.camera import IntrinsicsSigma
from semcal_cli.drive.document import Drive
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.estimation.adjust.joint import DELAY_NOT_DETERMINED
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.estimation.stage import StageResult
from semcal_cli.estimation.uncertainty.quantiles import joint_quantile
from semcal_cli.events import Listener, ignore
from semcal_cli.findings.symptoms import CLOCKS, LOOKS_LIKE, OF_THE_DRIVE, UNTIED_CLOCKS
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.poses import (
    PoseError,
    compare_poses,
)
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.observations.motion import twists_per_s
from semcal_cli.pipeline.assessment import assess
from semcal_cli.pipeline.mistaken_transform import likely_mistakes, remedy
from semcal_cli.pipeline.pose_stages import initialize, refine_and_polish, start_at
from semcal_cli.pipeline.stages import Stages
from semcal_cli.pipeline.verdict import (
    CLOCK,
    AxisVerdict,
    Verdict,
    judge,
    judge_clock,
    sufficient_limits,
    together,
)
from semcal_cli.readable import figure
from semcal_cli.result.applied import apply_result, cues_applied
from semcal_cli.result.refined_camera import camera_differences
from semcal_cli.result.uncertainty import PoseChange, Uncertainty

CHANCE = 0.05
"""Probability of offsets as large by chance, below which the camera has moved."""
NEAR_DEG, NEAR_M = 5.0, 0.5
"""Rotation and distance between transform and estimate beyond which all mounting directions are searched."""

SENTENCES: dict[Verdict, str] = {
    "pass": "The transform still holds on this drive.",
    "fail": "The camera is not where the transform says. Calibrate again, or find out what moved it.",
    "inconclusive": "This drive does not constrain the transform well enough. Add frames from other places.",
}
MISREAD = "The transform does not hold as it was read. Correct how it is written or read, and verify again."
"""Sentence for a transform that looks like a mistake, since nothing then says that the camera moved."""
MOVED = (
    "The camera has moved, but this drive cannot show whether by more than is allowed. Try more frames, or other "
    "places."
)
"""Sentence for an inconclusive verdict on a transform that is off by more than chance."""
OF_CLOCK: dict[Verdict, str] = {
    "fail": "The transform still holds on this drive, but the camera's clock is off. Calibrate again with "
    "--estimate-delay, or find out what changed the clock.",
    "inconclusive": "The transform still holds on this drive, but the drive cannot show whether the camera's clock is "
    "right.",
}
"""Sentences for a transform that passes all its checks."""


@dataclass(frozen=True)
class Verification:
    """Verdict on a transform, with its checks."""

    verdict: Verdict
    """Verdict on all checks together."""
    checks: tuple[AxisVerdict, ...]
    """Checks of the transform minus the estimate: the camera's position and rotation, by axis and in total. If the
    offset of the camera's clock is limited, its check follows: the estimate minus the offset that the drive states."""
    reasons: tuple[str, ...]
    """Findings that make the verdict inconclusive, or mistakes that the transform looks like."""
    topics: tuple[str, ...]
    """Topic of each of the reasons: its entry in docs/troubleshooting.md."""
    notes: tuple[str, ...]
    """Sentences that the user should read and that do not change the verdict."""
    T_camera_lidar: Pose
    """(4, 4) estimate of the pose, metres."""
    time_offset_s: float
    """Time by which images are later than image_stamp says, in seconds, for which the estimate holds."""
    has_moved: bool | None
    """Whether all six offsets together are more than chance, at 5 %; None where the estimate is not trusted."""
    smallest_visible: PoseChange | None
    """Move of the camera along each of its axes, and turn about each, that would be more than chance, at 5 %; None
    where the estimate is not trusted."""
    covariance: list[list[float]] | None = None
    """Covariance (6, 6) of the estimate by which offsets are judged together, of a twist on its left, metres and
    radians; without correlations by edges. None where the estimate is not trusted."""
    degrees_of_freedom: float | None = None
    """Smallest number of degrees of freedom of its axes; None where the estimate is not trusted."""

    @property
    def sentence(self) -> str:
        """What the verdict means, and what to do."""
        if LOOKS_LIKE in self.topics:
            return MISREAD
        if self.has_moved and self.verdict == "inconclusive" and not self.is_reasoned:
            return MOVED
        is_clock_alone = self.of_transform == "pass" and {*self.topics} <= {CLOCKS}
        sentence = (
            OF_CLOCK.get(self.verdict, SENTENCES[self.verdict]) if is_clock_alone else SENTENCES[self.verdict]
        )
        is_open = self.verdict == "inconclusive" and not self.is_reasoned
        limits = sufficient_limits(self.checks) if is_open else []
        return f"{sentence} It would pass with {' '.join(limits)}." if limits else sentence

    @property
    def of_transform(self) -> Verdict:
        """Verdict on all checks but that of the clock."""
        return together(check.verdict for check in self.checks if check.name != CLOCK)

    @property
    def is_off(self) -> bool:
        """Whether the transform itself is beyond its limits, and does not look misread."""
        return self.of_transform == "fail" and LOOKS_LIKE not in self.topics

    @property
    def is_reasoned(self) -> bool:
        """Whether the reasons make it inconclusive, whatever the offsets are."""
        return self.verdict == "inconclusive" and bool({*self.topics} - {CLOCKS})

    def word(self, check: AxisVerdict) -> str:
        """Verdict on a check in a word; none is judged where reasons leave all of them open."""
        return "not judged" if self.is_reasoned else check.verdict

    @property
    def document(self) -> dict[str, Any]:
        """The verification as JSON, from which `of_document` makes it again."""
        smallest = self.smallest_visible
        return asdict(self) | {
            "T_camera_lidar": self.T_camera_lidar.tolist(),
            "smallest_visible": None if smallest is None else smallest.model_dump(),
        }

    @classmethod
    def of_document(cls, document: Mapping[str, Any]) -> Verification:
        """Make the verification that `document` describes."""
        smallest = document["smallest_visible"]
        made = {
            "checks": tuple(AxisVerdict(**check) for check in document["checks"]),
            "T_camera_lidar": np.array(document["T_camera_lidar"]),
            "smallest_visible": None if smallest is None else PoseChange.model_validate(smallest),
        }
        made |= {key: tuple(document[key]) for key in ("reasons", "topics", "notes")}
        return cls(**{**document, **made})


def verify(
    data: LoadedDrive,
    stated: InitialPose,
    limits: Limits | None = None,
    config: CalibrationConfig | None = None,
    on_event: Listener = ignore,
) -> Verification:
    """Check whether a transform still holds on a drive.

    The pose is refined from the transform. If the result is not near the transform, or leaves findings that another
    pose might not have, all mounting directions are searched; with edges alone, which cannot distinguish mountings, the
    first estimate stands. An offset fails if it is beyond its limit with a certainty of 95 %, and passes if it is
    within with the same. Everything between is inconclusive, and so are offsets that the data do not determine, and a
    pass on the drive that the transform was calibrated from. Errors of K do not count where the transform belongs to
    the K of the drive. If the offset of the clock is limited, it is estimated together with the pose; if this estimate
    is kept, the pose is the joint one.

    Args:
        data: The drive, as `load_as_stated` returns it.
        stated: The transform.
        limits: Largest allowed errors; None takes the defaults.
        config: Seed and cues; None takes the defaults.
        on_event: Called with each event of the run.

    Raises:
        InputError: a limit or a setting is out of range, or the offset of the clock is limited and the drive gives no
            direction of its motion.
        CalibrationError: the drive cannot be calibrated at all.
    """
    config = CalibrationConfig() if config is None else config
    limits = Limits() if limits is None else limits
    check_limits(limits)
    data, camera_notes = _with_common_camera(load(data, config), stated)
    if limits.delay_s is not None and twists_per_s(data.observations) is None:
        raise InputError(
            f"{data.drive.path}: motion: found no direction of motion, expected poses or a twist for --max-delay-ms"
        )
    jointly = AdjustmentConfig(with_delay=limits.delay_s is not None)
    refinement = RefinementConfig(jointly=jointly)
    stages = _estimate(data, stated, refinement, config.seed, on_event)
    verification = _judged(data, stated, stages, limits)
    return replace(verification, notes=(*verification.notes, *camera_notes))


def _with_common_camera(data: LoadedDrive, stated: InitialPose) -> tuple[LoadedDrive, tuple[str, ...]]:
    """Leave out errors of K where the transform belongs to the same K: they move both poses alike.

    A transform in a file without a camera is taken to belong to that of the drive.

    Returns:
        The drive, and a note where the two cameras differ, so that errors of K stay in the intervals.
    """
    camera = data.drive.camera
    if stated.record is not None:
        differences = camera_differences(camera, stated.record.used_camera, stated.name)
        if differences:
            return data, (
                f"K is not that of the transform: {', '.join(differences)}; the intervals include errors of K",
            )
    exact = camera.model_copy(update={"intrinsics_sigma": IntrinsicsSigma()})
    return data.with_camera(exact), ()


def check_limits(limits: Limits) -> None:
    """Check the limits of a verification.

    Raises:
        InputError: they are no limits, or one is out of range.
    """
    if not isinstance(limits, Limits):
        raise InputError(f"limits: found {limits!r}, expected Limits")
    check_settings(limits)


def load_as_stated(
    drive: LoadedDrive | Drive,
    stated: InitialPose,
    config: CalibrationConfig | None = None,
    on_event: Listener = ignore,
) -> LoadedDrive:
    """Load a drive to verify a transform on it.

    Intrinsics and a clock that a calibration estimated together with its transform replace the drive's. The cues `auto`
    are those that it compared, as far as the drive allows them. A loaded drive is loaded again only if its camera or
    its clock changes.

    Raises:
        InputError: a file is missing or wrong, or a setting is out of range.
        CalibrationError: one side's labels carry no information.
    """
    config = CalibrationConfig() if config is None else config
    document = drive.drive if isinstance(drive, LoadedDrive) else drive
    applied = apply_result(stated.record, document, stated.name).drive
    if isinstance(drive, LoadedDrive) and applied == document:
        return load(drive, config, on_event)
    cues = cues_applied(stated.record, config.cues, applied)
    return load(applied, replace(config, cues=cues), on_event)


def _estimate(
    data: LoadedDrive, stated: InitialPose, config: RefinementConfig, seed: int, on_event: Listener
) -> Stages:
    """Estimate the pose from the transform, or by a search over all mounting directions if another pose may be better.

    That is so if the estimate is far from the transform, or leaves findings that depend on the pose.
    """

    def assessed(initial: StageResult, *, is_nearby: bool = False) -> Stages:
        stages = refine_and_polish(data, initial, config, seed, on_event=on_event, from_afar=is_nearby)
        if stages.joint is not None:
            # The transform is judged with the drive's clock, and the clock is judged separately.
            stages = replace(stages, joint=replace(stages.joint, left_open=None))
        return assess(data, stages, config, on_event, with_label_bleed=False)

    start = start_at(data, stated, on_event)
    if not data.policy.can_find_mounting:
        return assessed(start)
    with suppress(CalibrationError):
        nearby = assessed(start, is_nearby=True)
        is_near = compare_poses(nearby.T_camera_lidar, stated.T_camera_lidar).is_within(NEAR_DEG, NEAR_M)
        if is_near and nearby.uncertainty is not None and _are_of_drive(nearby, data.drive):
            return nearby
    return assessed(initialize(data, InitializationConfig(), seed, on_event=on_event))


def _are_of_drive(stages: Stages, drive: Drive) -> bool:
    """Whether the findings, if any, would speak against any other pose as well."""
    # Where the motion is known, the frames may tie the clocks at another pose.
    at_any_pose = OF_THE_DRIVE | ({UNTIED_CLOCKS} if drive.motion is None else set())
    return {finding.topic for finding in stages.findings} <= at_any_pose


def _judged(data: LoadedDrive, stated: InitialPose, stages: Stages, limits: Limits) -> Verification:
    """Judge how far the transform is from the estimate, and say why if that is inconclusive."""
    findings, uncertainty, notes = stages.findings, stages.uncertainty, stages.notes
    T_stated, estimate = stated.T_camera_lidar, stages.T_camera_lidar
    error = compare_poses(T_stated, estimate)
    half_widths = None if uncertainty is None else uncertainty.half_widths
    checks = judge(error.camera_center_xyz_m, error.rotation_xyz_deg, half_widths, limits)
    clock_notes = list[str]()
    if limits.delay_s is not None:
        check, clock_notes = _check_clock(data, stages, limits.delay_s)
        checks, notes = (*checks, check), tuple(note for note in notes if note not in clock_notes)
    verdict: Verdict = "inconclusive"
    # The transform is a start, though none that could be left out.
    doubts = precedence.diagnosed(findings, weak=data.policy.weak, start=stated.name)
    reasons = [(finding.topic, finding.sentence) for finding in doubts]
    if uncertainty is not None and _are_of_drive(stages, data.drive):
        verdict = "inconclusive" if findings else together(check.verdict for check in checks)
        looks = likely_mistakes(T_stated, estimate) if findings or verdict == "fail" else []
        misread = [(LOOKS_LIKE, f"{sentence}: {remedy(sentence, stated)}") for sentence in looks]
        reasons = [*misread, *(reasons if findings else [])]
    reasons += [(CLOCKS, sentence) for sentence in clock_notes]
    record_findings = () if stated.record is None else check_own_drive(data.drive, stated.record)
    reasons += [(finding.topic, finding.sentence) for finding in record_findings]
    if record_findings:
        verdict = "inconclusive" if verdict == "pass" else verdict
    has_moved, smallest, covariance = None, None, None
    if not findings and uncertainty is not None:
        is_beyond = any(check.verdict == "fail" for check in checks if check.name != CLOCK)
        covariance = _judged_covariance(uncertainty, is_rough=data.observations.is_multimodal)
        is_shown, smallest = _moved(error, covariance, min(uncertainty.degrees_of_freedom))
        has_moved = is_shown or is_beyond
        notes = (*notes, _visible(smallest))
    is_trusted = smallest is not None
    if verdict == "inconclusive" and (record_findings or not is_trusted):
        checks = tuple(check.not_judged(is_trusted=is_trusted) for check in checks)
    clock = stages.joint.clock if stages.joint is not None and stages.is_joint else None
    return Verification(
        verdict,
        checks,
        tuple(sentence for _, sentence in reasons),
        tuple(topic for topic, _ in reasons),
        notes,
        estimate,
        data.drive.time_offset_s if clock is None else clock.time_offset_s,
        has_moved,
        smallest,
        None if covariance is None else covariance.tolist(),
        None if covariance is None or uncertainty is None else min(uncertainty.degrees_of_freedom),
    )


def _judged_covariance(uncertainty: Uncertainty, *, is_rough: bool) -> Matrix:
    """Return the covariance (6, 6) by which offsets are judged together.

    By edges, correlations do not count: frames share errors that only the width of each axis covers, and with them the
    published poses of three KITTI sets counted as moved (`tests/benchmarks/verify.py`).
    """
    covariance = np.array(uncertainty.covariance)
    return np.diag(np.diag(covariance)) if is_rough else covariance


def _moved(error: PoseError, covariance: Matrix, degrees_of_freedom: float) -> tuple[bool, PoseChange]:
    """Test all six offsets together, and find the smallest offset along each axis alone that the test would show.

    Rotation and position are correlated: a drive that cannot distinguish them still shows either one alone.
    """
    # A translation in the camera frame moves the camera's centre in the opposite direction.
    signs = np.repeat([-1.0, 1.0], 3)
    information = np.linalg.inv(covariance * np.outer(signs, signs))
    offsets = np.concatenate([error.camera_center_xyz_m, error.rotation_xyz_rad])
    limit = joint_quantile(CHANCE, degrees_of_freedom)
    smallest = np.sqrt(limit / np.diag(information))
    visible = PoseChange(
        camera_center_m=smallest[:3].tolist(), rotation_deg=np.degrees(smallest[3:]).tolist()
    )
    return bool(offsets @ information @ offsets > limit), visible


def _visible(smallest: PoseChange) -> str:
    """Describe what a verification would have shown."""
    move = ", ".join(figure(100.0 * each) for each in smallest.camera_center_m)
    turn = ", ".join(map(figure, smallest.rotation_deg))
    return f"the smallest errors that these frames would have shown: {move} cm along x, y, z, {turn} degrees about them"


def _check_clock(data: LoadedDrive, stages: Stages, limit_s: float) -> tuple[AxisVerdict, list[str]]:
    """Judge the offset of the clock, and say why if it cannot be judged.

    An offset beyond the limit fails only if it is kept, that is, if data from which it was not estimated confirm it.
    """
    joint = stages.joint
    if joint is None or joint.clock is None or not joint.clock.is_determined:
        return judge_clock(0.0, None, limit_s), [DELAY_NOT_DETERMINED]
    clock = joint.clock
    check = judge_clock(clock.time_offset_s - data.drive.time_offset_s, clock.half_width_95_s, limit_s)
    if check.verdict == "fail" and not joint.is_kept:
        return replace(check, verdict="inconclusive"), [*joint.notes]
    return check, []
