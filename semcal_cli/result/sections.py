"""Sections of the calibration document: its input and settings, what each stage found, and parts of the drive."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field, JsonValue, field_validator

from semcal_cli import core
from semcal_cli.config import AUTO, LABELS
from semcal_cli.drive.camera import Camera
from semcal_cli.drive.frame_ids import FrameIds
from semcal_cli.drive.networks import LabelNetworks
from semcal_cli.errors import describe, mismatch
from semcal_cli.files.validation import (
    Count,
    Figure,
    FileName,
    RigidTransform,
    Share,
    StrictModel,
    Vector3,
    Width,
    Widths,
    length,
)
from semcal_cli.geometry.arrays import Pose
from semcal_cli.result.uncertainty import AXES, ROTATIONS

Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class InputFrame(StrictModel):
    """Files of a frame that was used, as named in the drive."""

    points: FileName
    """File of the point cloud."""
    point_labels: FileName | None = None
    """File of the ids or class probabilities of the points."""
    image_labels: FileName | None = None
    """File of the ids or class probabilities of the pixels."""
    image: FileName | None = None
    """File of the camera's image, if it was used."""
    mask: FileName | None = None
    """File of the pixels of the image that do not show the scene."""
    point_features: FileName | None = None
    """File of the features of the points, if they were used."""
    image_features: FileName | None = None
    """File of the features of the pixels, if they were used."""


class Input(StrictModel):
    """Input of the calibration."""

    drive: FileName
    """Relative path of the drive.yaml, or the name of the arrays of a program."""
    camera: Camera
    """Camera of the drive."""
    frame_ids: FrameIds | None = None
    """Names of the coordinate frames, as the drive states them."""
    frames: Annotated[tuple[InputFrame, ...], length(0)]
    """Frames that were used."""
    sha256: dict[str, Sha256]
    """SHA-256 of each file that the pose was computed from, by its name in the drive. The file of an initial pose is
    named by its relative path. Images used only to check labels are left out. An array has the hash of the .npy file
    that `numpy.save` writes, under a name such as points[3]."""
    networks: LabelNetworks | None = None
    """Networks that made the labels that were read, as named in the drive."""


class Settings(StrictModel):
    """Settings that affect the result."""

    options: dict[str, JsonValue]
    """Options by name."""
    seed: int
    """Seed of every random choice."""
    versions: dict[str, str]
    """Versions of semcal and its numerical libraries."""

    @field_validator("options")
    @classmethod
    def _check_cues(cls, options: dict[str, JsonValue]) -> dict[str, JsonValue]:
        # A result is read where the plugin of its cue is not installed, too.
        cues = options.get("cues", dict.fromkeys(LABELS))
        if not isinstance(cues, dict) or not cues or AUTO[0] in cues:
            found = (
                f"cues {', '.join(cues)}" if isinstance(cues, dict) and cues else f"cues: {describe(cues)}"
            )
            raise mismatch(found, "settings of cues by their names, such as labels or edges")
        return options


class Quality(StrictModel):
    """Agreement of the labels under the transform, over all frames."""

    mutual_information_nats: Figure
    """Mutual information of point labels and image labels, as the plug-in estimate."""
    bias_nats: Figure
    """Miller and Madow's estimate of the bias by which the mutual information is too high."""
    label_agreement: Share
    """Share of visible point-pixel pairs with positive pointwise mutual information. By edges and intensity, it may
    rise where the pose is wrong."""
    turn_loss: Figure | None = None
    """Share of the mutual information, minus its bias, that the camera loses on average if it is turned by 5 degrees
    about any of its axes: it falls where the pose is wrong. Absent in older files."""
    overlap: Share
    """Share of the image's area that visible points cover."""
    num_points: Count
    """Number of visible points."""
    num_frames: Count
    """Number of frames used."""
    runner_up_margin: Figure | None = None
    """Difference between the mutual information of the initial calibration and that of the runner-up, in its standard
    errors; null if no other mounting direction was compared."""

    @classmethod
    def of(
        cls, agreement: core.Agreement, *, turn_loss: float, num_frames: int, runner_up_margin: float | None
    ) -> Quality:
        """Take the figures of an agreement, with what it does not know."""
        return cls(
            mutual_information_nats=agreement.mutual_information,
            bias_nats=agreement.bias,
            label_agreement=agreement.label_agreement,
            overlap=agreement.overlap,
            num_points=agreement.num_inside - agreement.num_hidden,
            turn_loss=turn_loss,
            num_frames=num_frames,
            runner_up_margin=runner_up_margin,
        )


class Stage(StrictModel):
    """Result of one stage of the pipeline."""

    T_camera_lidar: RigidTransform
    """Transform after the stage, p_camera = T_camera_lidar * p_lidar, in metres."""
    mutual_information_nats: Figure
    """Mutual information at this transform, as the plug-in estimate."""
    bound_nats: float | None = None
    """Final Donsker-Varadhan bound of MINE on the mutual information, as the mean over its last steps; null for stages
    without MINE."""


class HeldOut(StrictModel):
    """Test of the polish on data that it did not use."""

    accepted: bool
    """Whether held-out data agree no worse after the polish, within three standard errors, or five where the
    information has many maxima. If not, the previous pose is kept."""
    held_out_gain_nats: Figure
    """Mutual information of the held-out data after the polish minus before it; adjusted MI for segments."""
    held_out_sigma_nats: Width | None
    """Standard error of the gain; null if all points lie in one part of the images."""


class Hypothesis(StrictModel):
    """Pose that the initial calibration found."""

    T_camera_lidar: RigidTransform
    """Transform of the hypothesis, p_camera = T_camera_lidar * p_lidar, in metres."""
    mutual_information_nats: Figure
    """Mutual information at this transform over all frames in full resolution, as the plug-in estimate."""
    bias_nats: Figure
    """Miller and Madow's estimate of the bias by which the mutual information is too high. Hypotheses are ranked by the
    mutual information minus the bias."""
    sigma_nats: Width | None
    """Standard error of the mutual information, over parts of the images; null if all points lie in one part."""
    overlap: Share
    """Share of the image's area that visible points cover."""
    num_pairs: Count | None
    """Number of labelled returns that the registration placed on labelled pixels, among those it used; null without a
    registration."""
    num_inliers: Count | None
    """Number of inliers of PnP among the pairs of a point and a pixel; null without PnP."""
    rotation_from_best_deg: Width
    """Angle of the rotation between this hypothesis and the first, in degrees."""

    @property
    def pose(self) -> Pose:
        """T_camera_lidar as an array (4, 4) of float64, in metres."""
        return np.array(self.T_camera_lidar)


class MeasuredSpeed(StrictModel):
    """Speed of the rig that skewed sweeps show, where the drive gives no motion."""

    along_view_m_s: Figure
    """Mean speed along the view of the camera, in metres per second; negative backwards."""
    sigma_m_s: Width
    """Standard error of the speed."""
    is_used: bool
    """Whether sweeps were deskewed by it. If not, the rig was not seen to move."""

    @property
    def used_m_s(self) -> float:
        """Speed by which sweeps were deskewed, metres per second: 0 if they were not."""
        return self.along_view_m_s if self.is_used else 0.0


class Repeatability(StrictModel):
    """Results with other seeds on the same data, which show the influence of chance."""

    num_seeds: Annotated[int, Field(ge=2)]
    """Number of consecutive seeds, including that of this calibration."""
    num_failed: Count
    """Number of seeds that gave no result."""
    spread_camera_center_m: Widths | None
    """Standard deviations of the camera's position along its axes, in metres; null if all other seeds failed."""
    spread_rotation_deg: Widths | None
    """Standard deviations of the rotation about the camera's axes, in degrees; null if all other seeds failed."""
    farthest_camera_center_m: Width
    """Largest distance of the camera from its position in this calibration, in metres."""
    farthest_rotation_deg: Width
    """Largest angle of the rotation to that of this calibration, in degrees."""


class CrossValidation(StrictModel):
    """Poses by parts of the drive alone, which show whether the intervals are right."""

    num_folds: Annotated[int, Field(ge=2)]
    """Number of parts, which share no scene."""
    num_failed: Count
    """Number of parts that do not determine a pose."""
    spread_camera_center_m: Widths | None = None
    """Standard deviations of the camera's position by the parts, along its axes, in metres; null if fewer than two
    parts determine a pose."""
    spread_rotation_deg: Widths | None = None
    """Standard deviations of the rotation by the parts about the camera's axes, in degrees; null likewise."""
    predicted_camera_center_m: Widths | None = None
    """Standard errors of a part's position by the scatter within its images, in metres, root mean square; null
    likewise."""
    predicted_rotation_deg: Widths | None = None
    """Standard errors of a part's rotation, in degrees, root mean square; null likewise."""
    pulls: Annotated[tuple[Width, ...], length(6, 6)] | None = None
    """Scatter of the parts relative to what the scatter within their images predicts, along and about the camera's
    axes: about one if the intervals are right but for errors that all parts share; null likewise."""

    @staticmethod
    def axis_name(index: int) -> str:
        """Name an axis of `pulls`."""
        return (*AXES, *ROTATIONS)[index]


class Movement(StrictModel):
    """Movement of the camera itself, along and about its axes before the movement.

    The intervals hold for all six axes together.
    """

    camera_center_m: Vector3
    """Movement of the camera's position, in metres."""
    rotation_deg: Vector3
    """Turn of the camera, in degrees."""
    half_width_95_camera_center_m: Widths
    """Half widths of the joint 95 % intervals of the position, in metres."""
    half_width_95_rotation_deg: Widths
    """Half widths of the joint 95 % intervals of the turn, in degrees."""

    @property
    def words(self) -> str:
        """Describe how far the camera turned and moved, where either is more than chance."""
        rotation = _words(self.rotation_deg, self.half_width_95_rotation_deg)
        translation = _words(self.camera_center_m, self.half_width_95_camera_center_m)
        movements = []
        if rotation:
            movements.append(f"turned by {rotation[0]:.2f} +- {rotation[1]:.2f} degrees about {rotation[2]}")
        if translation:
            movements.append(
                f"moved by {100 * translation[0]:.1f} +- {100 * translation[1]:.1f} cm along {translation[2]}"
            )
        return " and ".join(movements) or "turned or moved"


class DrivePart(StrictModel):
    """Frames that fit one pose."""

    first_frame: FileName
    """Point cloud of the first frame."""
    last_frame: FileName
    """Point cloud of the last frame."""
    num_frames: Annotated[int, Field(ge=1)]
    """Number of frames."""
    T_camera_lidar: RigidTransform
    """Transform that these frames fit, p_camera = T_camera_lidar * p_lidar, in metres."""
    moved: Movement | None = None
    """Movement of the camera since the previous part; null in the first part."""


def _words(offset: Sequence[float], half_widths: Sequence[float]) -> tuple[float, float, str] | None:
    """Compute length, half width and axis of an offset (3,); None if no axis is off by more than its interval."""
    if not any(abs(by) > half for by, half in zip(offset, half_widths, strict=True)):
        return None
    vector = np.array(offset)
    length = float(np.linalg.norm(vector))
    along = vector / length
    axis = int(np.argmax(np.abs(along)))
    is_along_axis = abs(along[axis]) > 0.95
    sign = "-" if along[axis] < 0.0 else ""
    name = f"{sign}{'xyz'[axis]}" if is_along_axis else "(" + " ".join(f"{x:.2f}" for x in along) + ")"
    return length, float(np.linalg.norm(along * half_widths)), name
