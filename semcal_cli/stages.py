"""What the stages of one calibration arrived at, what speaks against the pose of the last one, and the settings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from semcal_cli.assessment.assess import Assessment
from semcal_cli.assessment.fusion import Fused
from semcal_cli.assessment.joint import Joint
from semcal_cli.assessment.pose_checks import check_pose
from semcal_cli.assessment.priors import Prior
from semcal_cli.config import LABELS, CalibrationConfig, RefinementConfig
from semcal_cli.drive.cues import describe_cues
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.poses import Pose
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.refinement.polish import Polish
from semcal_cli.refinement.pyramid import Refinement
from semcal_cli.result.calibration import Repeatability
from semcal_cli.result.parts import DrivePart
from semcal_cli.result.stage import Finding, StageResult
from semcal_cli.result.uncertainty import Uncertainty


@dataclass(frozen=True)
class Stages:
    """Results of the stages of one calibration; None for stages that were not run."""

    initial: StageResult
    refined: StageResult | None = None
    polished: Polish | None = None
    joint: Joint | None = None
    """Estimate of the pose with intrinsics or the offset of the clock."""
    fused: Fused | None = None
    assessment: Assessment | None = None
    repeatability: Repeatability | None = None
    unrolled: Observations | None = None
    """Observations that all stages after the refinement saw, line by line, if the shutter rolls; None if they saw those
    of the drive."""
    of_data: tuple[Finding, ...] = ()
    """Findings against the data."""
    notes_on_data: tuple[str, ...] = ()
    """Sentences on the data that do not speak against the pose."""
    of_comparison: tuple[Finding, ...] = ()
    """Findings of a comparison of the last pose with something else, such as the poses of other seeds."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings against the pose of the last stage."""
        findings = [*self.initial.findings, *self.of_data]
        if self.is_joint:
            return (
                *findings,
                *(() if self.assessment is None else self.assessment.findings),
                *self.of_comparison,
            )
        # If labels alone determine no pose, their polish is not expected to settle.
        if self.polished is not None and (self.fused is None or self.fused.is_alone):
            findings += self.polished.findings
        # A pose that is polished or fused need not have settled before.
        is_last = self.fused is None and (self.polished is None or not self.polished.is_accepted)
        if self.refined is not None and is_last:
            findings += self.refined.findings
        for later in (self.fused, self.assessment):
            findings += () if later is None else later.findings
        return (*findings, *self.of_comparison)

    @property
    def is_joint(self) -> bool:
        """Whether the pose belongs to an estimate of the intrinsics or of the clock."""
        return self.joint is not None and self.joint.is_kept

    @property
    def seen(self) -> Observations | None:
        """Observations as the camera sees them that the last pose belongs to; None if those of the drive."""
        return self.joint.observations if self.joint is not None and self.joint.is_kept else self.unrolled

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences that a person should know and that do not speak against the pose."""
        of_joint = () if self.joint is None else self.joint.notes
        of_assessment = () if self.assessment is None else self.assessment.notes
        return self.notes_on_data + of_joint + of_assessment

    @property
    def parts(self) -> tuple[DrivePart, ...]:
        """Parts of the drive, if its frames fit several poses."""
        return () if self.assessment is None else self.assessment.parts

    @property
    def poses(self) -> dict[str, StageResult]:
        """Results of the stages that give a pose, by name, in order."""
        stages = {
            "initial": self.initial,
            "refined": self.refined,
            "polished": self.polished,
            "joint": self.joint if self.is_joint else None,
            "fused": self.fused,
        }
        return {name: stage for name, stage in stages.items() if stage is not None}

    @property
    def uncertainty(self) -> Uncertainty | None:
        """Uncertainty of the last pose; None if it was not assessed or the data do not determine it."""
        return None if self.assessment is None else self.assessment.uncertainty

    @property
    def T_camera_lidar(self) -> Pose:
        """Pose (4, 4) of the last stage, metres."""
        return list(self.poses.values())[-1].T_camera_lidar


def findings_of(stages: Stages, config: RefinementConfig) -> tuple[Finding, ...]:
    """List all that speaks against the pose of the last stage."""
    *_, last = stages.poses.values()
    # Other methods have no limit of the distance in their search, and check the distance themselves.
    limit_m = config.max_baseline_m if isinstance(stages.refined, Refinement) else math.inf
    return (*stages.findings, *check_pose(last.T_camera_lidar, last.agreement, limit_m))


def settings_of(
    data: LoadedDrive,
    stages: Stages,
    config: CalibrationConfig,
    initial_pose: InitialPose | None,
    priors: Sequence[Prior],
) -> dict[str, object]:
    """Collect the options that changed the answer, in the order of the stages."""
    settings: dict[str, object] = {"max_frames": data.max_frames}
    if data.cues != LABELS:
        settings["cues"] = describe_cues(data.cues)
    if initial_pose is not None and initial_pose.source is None:
        settings["given"] = initial_pose.name
    if initial_pose is not None and initial_pose.direction is not None:
        settings["init_direction"] = initial_pose.direction
    for name, stage in stages.poses.items():
        settings |= stage.settings
        if name == "refined" and priors:
            settings["priors"] = [prior.describe() for prior in priors]
    if stages.joint is not None:  # One that is not kept gives no pose, but widens the interval.
        settings |= stages.joint.settings
    if stages.repeatability is not None:
        settings["num_seeds"] = config.num_seeds
    return settings
