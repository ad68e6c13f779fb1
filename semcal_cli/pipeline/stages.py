"""Results of the stages of one calibration, and what speaks against the pose of the last one."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace

import numpy as np
import numpy.typing as npt

from semcal_cli.checks.families import check_data, check_pose, check_stages
from semcal_cli.estimation.adjust.deskewed import Deskewed
from semcal_cli.estimation.adjust.joint import JointEstimate
from semcal_cli.estimation.adjust.priors import Fused
from semcal_cli.estimation.refine.polish import Polish
from semcal_cli.estimation.refine.pyramid import Refinement
from semcal_cli.estimation.search.mounting_search import Initialization
from semcal_cli.estimation.stage import StageResult
from semcal_cli.findings.check import Measured, findings_among
from semcal_cli.findings.finding import Finding
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.observations import Observations
from semcal_cli.result.refined_camera import CheckedIntrinsics
from semcal_cli.result.sections import (
    CrossValidation,
    DrivePart,
    MeasuredSpeed,
    Quality,
    Repeatability,
    Stage,
)
from semcal_cli.result.uncertainty import Uncertainty


@dataclass(frozen=True)
class Assessment:
    """Uncertainty of a pose, and findings against it."""

    uncertainty: Uncertainty | None = None
    """Uncertainty of the pose; None if the data do not determine it."""
    findings: tuple[Finding, ...] = ()
    """Findings of the assessment against the pose."""
    notes: tuple[str, ...] = ()
    """Sentences that a person should read and that do not speak against the pose."""
    parts: tuple[DrivePart, ...] = ()
    """Parts of the drive, if its frames fit several poses."""
    measured: tuple[Measured, ...] = ()
    """What the checks measured, whether or not it is beyond their limits."""
    checked_intrinsics: CheckedIntrinsics | None = None
    """What the frames say of the intrinsics; None if they determine none."""
    motion_covariance: npt.NDArray[np.float64] | None = None
    """(6, 6) part of the covariance of the pose by the clock and the motion that stay as the drive says; None if there
    is none."""

    def with_measured(self, *measured: Measured) -> Assessment:
        """Add the measurements of more checks, with their findings."""
        findings = (*self.findings, *findings_among(measured))
        return replace(self, findings=findings, measured=(*self.measured, *measured))


@dataclass(frozen=True)
class Stages:
    """Results of the stages of one calibration; None for stages that were not run."""

    initial: StageResult
    refined: Refinement | None = None
    deskewed: Deskewed | None = None
    """Pose with sweeps deskewed by the speed that they show; None where there is nothing to deskew."""
    polished: Polish | None = None
    joint: JointEstimate | None = None
    """Joint estimate of the pose with intrinsics or the time offset."""
    fused: Fused | None = None
    assessment: Assessment | None = None
    repeatability: Repeatability | None = None
    cross_validation: CrossValidation | None = None
    seen_refined: Observations | None = None
    """Observations that all stages after the refinement saw: with gradients along the scan lines, and line by line if
    the shutter rolls. None if they saw those of the drive."""
    of_data: tuple[Finding, ...] = ()
    """Findings against the data."""
    notes_on_data: tuple[str, ...] = ()
    """Sentences about the data that do not speak against the pose."""
    of_comparison: tuple[Finding, ...] = ()
    """Findings of a comparison of the last pose with something else, such as the poses of other seeds."""
    _: KW_ONLY
    max_baseline_m: float
    """Distance between camera and LiDAR at which the last pose was held; infinite where it was not."""
    of_search: tuple[Finding, ...] = ()
    """Findings of the search for the mounting."""

    @classmethod
    def from_refined(
        cls,
        data: LoadedDrive,
        initial: StageResult,
        refined: Refinement | None,
        *,
        is_compensated: bool,
        of_comparison: tuple[Finding, ...] = (),
        of_search: tuple[Finding, ...] = (),
    ) -> Stages:
        """Start from a refined pose, and check the data that it was found from.

        Args:
            data: The drive, as `load` returns it.
            initial: Result of the initial calibration.
            refined: Result of the refinement; None if it was not run.
            is_compensated: Whether the method compensates a rolling shutter where the motion is known.
            of_comparison: Findings of a comparison of the pose with something else.
            of_search: Findings of the search for the mounting.
        """
        of_data, notes = check_data(data.drive, data.observations, is_compensated=is_compensated)
        return cls(
            initial,
            refined,
            of_data=of_data,
            notes_on_data=(*data.notes_on_networks, *notes),
            of_comparison=of_comparison,
            max_baseline_m=data.observations.max_baseline_m,
            of_search=of_search,
        )

    @property
    def poses(self) -> dict[str, StageResult]:
        """Results of the stages that give a pose, by name, in order."""
        stages = {
            "initial": self.initial,
            "refined": self.refined,
            "deskewed": self.deskewed if self.is_deskewed else None,
            "polished": self.polished,
            "joint": self.joint if self.is_joint else None,
            "fused": self.fused,
        }
        return {name: stage for name, stage in stages.items() if stage is not None}

    @property
    def last(self) -> StageResult:
        """Result of the last stage that gives a pose."""
        return list(self.poses.values())[-1]

    @property
    def T_camera_lidar(self) -> Pose:
        """Pose (4, 4) of the last stage, metres."""
        return self.last.T_camera_lidar

    @property
    def searched(self) -> Initialization | None:
        """The search for the initial pose; None where the pose was given."""
        return self.initial if isinstance(self.initial, Initialization) else None

    @property
    def records(self) -> dict[str, Stage]:
        """What a result says of each stage that gives a pose, by name."""
        return {
            name: Stage(
                T_camera_lidar=stage.T_camera_lidar.tolist(),
                mutual_information_nats=stage.agreement.mutual_information,
                bound_nats=stage.bound_nats,
            )
            for name, stage in self.poses.items()
        }

    def quality(self, observations: Observations) -> Quality:
        """Measure how well points and images agree at the last pose.

        Args:
            observations: Those of the drive, by the cues that refined the pose.
        """
        seen = self.seen or observations
        return Quality.of(
            self.last.agreement,
            turn_loss=seen.turn_loss(self.T_camera_lidar),
            num_frames=observations.num_frames,
            runner_up_margin=None if self.searched is None else self.searched.runner_up_margin,
        )

    @property
    def is_joint(self) -> bool:
        """Whether the pose is that of a joint estimate with intrinsics or the clock."""
        return self.joint is not None and self.joint.is_kept

    @property
    def is_deskewed(self) -> bool:
        """Whether sweeps were deskewed by the speed that they show."""
        return self.measured_speed is not None and self.measured_speed.is_used

    @property
    def measured_speed(self) -> MeasuredSpeed | None:
        """What a result says of the speed that the sweeps show; None if they show none."""
        return None if self.deskewed is None else self.deskewed.speed

    @property
    def is_rejected(self) -> bool:
        """Whether the last pose is the refined one, since the polish was rejected and nothing else took its place."""
        was_rejected = self.polished is not None and not self.polished.is_accepted
        return was_rejected and self.fused is None and not self.is_joint

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Everything that speaks against the pose of the last stage."""
        return (
            *self.of_search,
            *self.of_data,
            *check_stages(self.refined, self.polished, self.fused, self.joint),
            *(() if self.assessment is None else self.assessment.findings),
            *self.of_comparison,
            *check_pose(self.T_camera_lidar, self.last.agreement, self.max_baseline_m),
        )

    @property
    def seen(self) -> Observations | None:
        """Observations as seen by the camera of the last pose; None if they are those of the drive."""
        if self.joint is not None and self.joint.is_kept:
            return self.joint.observations
        return self.seen_refined if self.deskewed is None else self.deskewed.observations

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences that a person should read and that do not speak against the pose."""
        joint_notes = () if self.joint is None else self.joint.notes
        assessment_notes = () if self.assessment is None else self.assessment.notes
        return self.notes_on_data + joint_notes + assessment_notes

    @property
    def uncertainty(self) -> Uncertainty | None:
        """Uncertainty of the last pose; None if it was not assessed or the data do not determine it."""
        return None if self.assessment is None else self.assessment.uncertainty

    @property
    def settings(self) -> dict[str, object]:
        """Options of the stages that changed the answer, in the order of the stages."""
        # A joint estimate that is not kept gives no pose, but widens the interval.
        stages = [*self.poses.values(), *([] if self.joint is None else [self.joint])]
        return {name: value for stage in stages for name, value in stage.settings.items()}
