"""The calibration: what semcal writes, as YAML or JSON with the same content."""

from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, JsonValue, model_validator

from semcal_cli.drive.document import Camera
from semcal_cli.errors import CalibrationError
from semcal_cli.files.dialect import Format, document_text
from semcal_cli.files.documents import output_format, read_document
from semcal_cli.files.messages import mismatch
from semcal_cli.files.validation import (
    Count,
    FileName,
    Share,
    StrictModel,
    Transform,
    Vector3,
    Vector4,
    Version,
    Width,
    Widths,
    length,
    validate,
)
from semcal_cli.files.writing import write_text
from semcal_cli.geometry.poses import Pose, check_rigid, inverse, nearest_rigid, quaternion_xyzw
from semcal_cli.result.hypothesis import Hypothesis
from semcal_cli.result.uncertainty import Uncertainty

AGREEMENT_TOLERANCE = 1e-6
"""Largest difference, metres or matrix entries, between the forms in which a file states one pose."""

Status: TypeAlias = Literal["trusted", "not_trusted", "not_assessed"]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class Quality(StrictModel):
    """How well the labels agree under the transform, over all frames."""

    mutual_information_nats: float
    """Mutual information of point labels and pixel labels, the plug-in estimate."""
    bias_nats: float
    """Miller and Madow's estimate of how far it is too high."""
    label_agreement: Share
    """Share of visible point-pixel pairs with positive pointwise mutual information."""
    overlap: Share
    """Share of the picture's area that visible points cover."""
    num_points: Count
    """Visible points."""
    num_frames: Count
    """Frames used."""
    runner_up_margin: float | None = None
    """How far the runner-up's mutual information lies below that of the initial calibration, in standard errors of the
    difference; null where no other mounting direction was compared."""


class Stage(StrictModel):
    """What one stage of the pipeline arrived at."""

    T_camera_lidar: Transform
    """p_camera = T_camera_lidar * p_lidar."""
    mutual_information_nats: float
    """Mutual information there."""


class HeldOut(StrictModel):
    """What held-out data said of the polish."""

    accepted: bool
    """Whether they did not get worse by more than three standard errors; otherwise the pose before was kept."""
    held_out_gain_nats: float
    """How much better they agree after it than before."""
    held_out_sigma_nats: Annotated[float, Field(ge=0.0)] | None
    """Standard error of that; null if all points lie in one part of the pictures."""


class Repeatability(StrictModel):
    """Where other seeds lead, with the same data: what chance in the search and the climbs is worth."""

    num_seeds: Annotated[int, Field(ge=2)]
    """Including this calibration's; they follow one another."""
    num_failed: Count
    """Seeds with which there was no answer."""
    spread_camera_center_m: Widths | None
    """Standard deviation of the camera's place, along its axes; null if all others failed."""
    spread_rotation_deg: Widths | None
    """Likewise of the rotation, about them."""
    farthest_camera_center_m: Width
    """Largest distance from this calibration."""
    farthest_rotation_deg: Width
    """Largest angle."""


class InputFrame(StrictModel):
    """A frame that was used, as named in the drive."""

    points: FileName
    """Point cloud."""
    point_labels: FileName | None = None
    """Ids or class probabilities of the points."""
    image_labels: FileName | None = None
    """Ids or class probabilities of the pixels."""
    image: FileName | None = None
    """The picture, where it was used."""
    point_features: FileName | None = None
    """Features of the points, where they were used."""
    image_features: FileName | None = None
    """Features of the pixels, where they were used."""


class Input(StrictModel):
    """What the calibration was computed from."""

    drive: FileName
    """The drive, as a relative path."""
    camera: Camera
    """As in the drive."""
    frames: Annotated[tuple[InputFrame, ...], length(0)]
    """Frames used."""
    sha256: dict[str, Sha256]
    """Of each file read, by its name in the drive; of the transform started at, by its relative path."""


class Settings(StrictModel):
    """Everything else that changes the answer."""

    options: dict[str, JsonValue]
    """Options by name."""
    seed: int
    """Seed of every random choice."""
    versions: dict[str, str]
    """Versions of semcal and of the libraries that compute."""


class Calibration(StrictModel):
    """The transform between a LiDAR and a camera, and what speaks for it."""

    semcal_calibration: Version
    """Version of this format."""
    status: Status
    """`trusted` if the pose was polished and nothing speaks against it; `not_assessed` without a polish."""
    reasons: Annotated[tuple[str, ...], length(0)]
    """Sentences, each with its figure."""
    T_camera_lidar: Transform
    """p_camera = T_camera_lidar * p_lidar, metres."""
    T_lidar_camera: Transform
    """Its inverse."""
    translation_m: Vector3
    """Translation of T_camera_lidar."""
    quaternion_xyzw: Vector4
    """Rotation of T_camera_lidar."""
    uncertainty: Uncertainty | None = None
    """Null if the pose was not polished, or the labels do not determine it."""
    repeatability: Repeatability | None = None
    """Null unless other seeds were asked for."""
    quality: Quality
    """How well the labels agree."""
    stages: dict[str, Stage]
    """Stages by name, in order."""
    polish: HeldOut | None = None
    """Null if there was none."""
    hypotheses: Annotated[tuple[Hypothesis, ...], length(0)] = ()
    """Of the initial calibration, best first; the first is that of its stage."""
    input: Input
    """What was read."""
    settings: Settings
    """What was asked."""

    @model_validator(mode="after")
    def _check_agreement(self) -> "Calibration":
        check_forms(self.pose, self.T_lidar_camera, self.translation_m, self.quaternion_xyzw)
        return self

    @property
    def pose(self) -> Pose:
        """T_camera_lidar as (4, 4) float64."""
        return np.array(self.T_camera_lidar)

    @classmethod
    def from_pose(
        cls,
        T_camera_lidar: Pose,
        **parts: Any,
    ) -> "Calibration":
        """Make a calibration, deriving the other forms of its pose.

        Args:
            T_camera_lidar: (4, 4), p_camera = T_camera_lidar @ p_lidar; round-off in its rotation is removed.
            parts: All other fields, by name.

        Raises:
            CalibrationError: the pose is not finite or not rigid.
        """
        T = _finite_rigid(T_camera_lidar)
        return cls(
            semcal_calibration=1,
            T_camera_lidar=T.tolist(),
            T_lidar_camera=inverse(T).tolist(),
            translation_m=T[:3, 3].tolist(),
            quaternion_xyzw=quaternion_xyzw(T).tolist(),
            **parts,
        )


def calibration_text(calibration: Calibration, format: Format) -> str:
    """Write a calibration as text, the same bytes for the same calibration."""
    return document_text(calibration.model_dump(), format)


def write_calibration(calibration: Calibration, path: Path | str) -> None:
    """Write a calibration as YAML or JSON, by the suffix.

    Raises:
        InputError: another suffix, or the file cannot be written. An existing file is untouched then.
    """
    path = Path(path)
    write_text(calibration_text(calibration, output_format(path)), path)


def read_calibration(path: Path | str) -> Calibration:
    """Read and check a calibration.

    Raises:
        InputError: the first complaint: file, key, what was found, what was needed.
    """
    path = Path(path)
    return validate(Calibration, read_document(path), path)


def check_forms(
    T_camera_lidar: Pose, T_lidar_camera: ArrayLike, translation_m: ArrayLike, quaternion: ArrayLike
) -> None:
    """Check that the forms in which a file states one pose agree.

    Raises:
        ValueError: they do not.
    """
    q, q_stated = quaternion_xyzw(T_camera_lidar), np.asarray(quaternion)
    _agree("T_lidar_camera", "the inverse", T_lidar_camera, inverse(T_camera_lidar))
    _agree("translation_m", "the translation", translation_m, T_camera_lidar[:3, 3])
    _agree("quaternion_xyzw", "the rotation", -q_stated if q_stated @ q < 0.0 else q_stated, q)


def _agree(key: str, part: str, stated: ArrayLike, derived: NDArray[np.float64]) -> None:
    difference = np.abs(np.asarray(stated) - derived).max()
    if not difference <= AGREEMENT_TOLERANCE:
        needed = f"{part} of T_camera_lidar within {AGREEMENT_TOLERANCE:g}"
        raise mismatch(f"{key} off by {difference:.3g}", needed)


def _finite_rigid(T: Pose) -> Pose:
    if not np.isfinite(T).all():
        raise CalibrationError("T_camera_lidar is not finite")
    try:
        check_rigid(T)
    except ValueError as error:
        raise CalibrationError(f"T_camera_lidar: {error}") from None
    return nearest_rigid(T)
