"""The calibration, written as YAML or JSON with the same content."""

from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import ConfigDict, Field, model_validator
from typing_extensions import Self

from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.drive.document import Drive
from semcal_cli.errors import CalibrationError, mismatch
from semcal_cli.files.array_forms import POINTS, check_array
from semcal_cli.files.documents import DocumentFormat, document_text, output_format, read_document
from semcal_cli.files.output_files import write_text
from semcal_cli.files.validation import (
    StatedTransform,
    StrictModel,
    Vector3,
    Vector4,
    Version,
    length,
    validate,
)
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.poses import check_rigid, inverse, nearest_rigid, orthonormal, quaternion_xyzw
from semcal_cli.result.refined_camera import CheckedIntrinsics, Clock, RefinedCamera
from semcal_cli.result.sections import (
    CrossValidation,
    DrivePart,
    HeldOut,
    Hypothesis,
    Input,
    MeasuredSpeed,
    Quality,
    Repeatability,
    Settings,
    Stage,
)
from semcal_cli.result.uncertainty import Uncertainty

AGREEMENT_TOLERANCE = 1e-6
"""Largest difference between the forms of one pose in a file, in metres or matrix entries."""

Status: TypeAlias = Literal["trusted", "not_trusted", "not_assessed"]
Topic = Annotated[str, Field(pattern=r"^[a-z]+(-[a-z]+)*$")]
"""Name of an entry in docs/troubleshooting.md."""


class Projection(NamedTuple):
    """Points on the image of a camera."""

    pixels: NDArray[np.float64]
    """(N, 2), (u, v), an integer is a pixel centre; NaN where the lens model does not hold."""
    is_in_front: NDArray[np.bool_]
    """(N,) whether the point lies before the camera: z > 0 in its frame."""
    is_in_image: NDArray[np.bool_]
    """(N,) whether the point lies on a pixel of the image; nearer points may hide it."""


class CalibrationDocument(StrictModel):
    """Transform between a LiDAR and a camera, with its uncertainty and quality."""

    model_config = ConfigDict(serialize_by_alias=True, title="Calibration")

    semcal_calibration: Version
    """Version of this format."""
    status: Status
    """Verdict: `trusted` if the pose was assessed and nothing speaks against it, `not_trusted` if something does,
    `not_assessed` if the pose was not assessed."""
    reasons: Annotated[tuple[str, ...], length(0)]
    """Findings against the pose, as sentences with figures."""
    topics: Annotated[tuple[Topic, ...], length(0)] = ()
    """Topic of each reason: its entry in docs/troubleshooting.md. Absent in older files."""
    notes: Annotated[tuple[str, ...], length(0)] = ()
    """Sentences that the user should know but that do not speak against the pose."""
    rows_camera_lidar: StatedTransform = Field(alias="T_camera_lidar")
    """Transform from the LiDAR to the camera, p_camera = T_camera_lidar * p_lidar, in metres."""
    rows_lidar_camera: StatedTransform = Field(alias="T_lidar_camera")
    """Inverse of T_camera_lidar."""
    translation_m: Vector3
    """Translation of T_camera_lidar, in metres."""
    quaternion_xyzw: Vector4
    """Rotation of T_camera_lidar, as a unit quaternion."""
    uncertainty: Uncertainty | None = None
    """Uncertainty of the pose; null if the pose was not assessed or the data do not determine it."""
    camera: RefinedCamera | None = None
    """Camera that was estimated together with the pose; null if its intrinsics were assumed to be right."""
    checked_intrinsics: CheckedIntrinsics | None = None
    """What the frames say of the intrinsics; null if the frames determine none, or the pose was not assessed."""
    clock: Clock | None = None
    """Time offset of the camera; null if it was not estimated."""
    speed: MeasuredSpeed | None = None
    """Speed of the rig that the sweeps show; null if the drive gives the motion, or the sweeps show none. Absent in
    older files."""
    repeatability: Repeatability | None = None
    """Results with other seeds; null if there was only one seed."""
    cross_validation: CrossValidation | None = None
    """Results by parts of the drive; null if it was not divided. Absent in older files."""
    quality: Quality
    """Agreement of the labels under the transform."""
    stages: dict[str, Stage]
    """Results of the stages by name, in order."""
    polish: HeldOut | None = None
    """Test of the polish on held-out data; null if the pose was not polished."""
    hypotheses: Annotated[tuple[Hypothesis, ...], length(0)] = ()
    """Hypotheses of the initial calibration, best first. The first is the result of the stage `initial`."""
    parts: Annotated[tuple[DrivePart, ...], length(0)] = ()
    """Parts of the drive whose frames fit different poses; empty if all frames fit the transform."""
    input: Input
    """Files that were read, with their hashes."""
    settings: Settings
    """Settings that affect the result."""

    @model_validator(mode="after")
    def _check_agreement(self) -> "CalibrationDocument":
        if self.topics and len(self.topics) != len(self.reasons):
            raise mismatch(
                f"topics: {len(self.topics)} of them", f"one for each of {len(self.reasons)} reasons"
            )
        self._check_camera()
        stated = self.pose
        check_forms(stated, self.rows_lidar_camera, self.translation_m, self.quaternion_xyzw)
        if (T := orthonormal(stated)) is not stated:
            forms = pose_forms(T)
            fields = type(self).model_fields.items()
            vars(self).update(
                {name: forms[key] for name, field in fields if (key := field.alias or name) in forms}
            )
        return self

    def _check_camera(self) -> None:
        """Check that the estimated camera belongs to the input, and that the sizes match."""
        if self.camera is None:
            return
        estimated, stated = (
            f"{camera.model} of {camera.width} x {camera.height} pixels"
            for camera in (self.camera.found, self.input.camera)
        )
        if estimated != stated:
            raise ValueError(f"camera.found: {mismatch(estimated, f'{stated}, as in input.camera')}")
        with_clock = self.clock is not None and self.clock.is_determined
        rows, count = self.camera.joint_covariance, 6 + len(self.camera.intrinsics) + with_clock
        if rows is not None and len(rows) != count:
            needed = f"{count}: six of the pose, one for each intrinsic{', one of the clock' if with_clock else ''}"
            raise ValueError(f"camera.joint_covariance: {mismatch(f'{len(rows)} rows', needed)}")

    @property
    def T_camera_lidar(self) -> Pose:
        """Transform (4, 4) of float64 from the LiDAR to the camera, p_camera = T_camera_lidar @ p_lidar, in metres."""
        return np.array(self.rows_camera_lidar)

    @property
    def deskewed_m_s(self) -> float:
        """Speed along the view of the camera by which sweeps were deskewed, metres per second; 0 if they were not."""
        return 0.0 if self.speed is None else self.speed.used_m_s

    @property
    def T_lidar_camera(self) -> Pose:
        """Inverse (4, 4) of `T_camera_lidar`, in metres."""
        return np.array(self.rows_lidar_camera)

    @property
    def pose(self) -> Pose:
        """The same as `T_camera_lidar`, under the name that hypotheses use."""
        return self.T_camera_lidar

    @property
    def trusted(self) -> bool:
        """Whether the pose was assessed, and nothing speaks against it."""
        return self.status == "trusted"

    @property
    def is_camera_confirmed(self) -> bool:
        """Whether the frames confirm the intrinsics well enough for the interval to hold without trusting K."""
        checked = self.checked_intrinsics
        return self.input.camera.is_exact or (checked is not None and checked.is_confirmed)

    @property
    def covariance(self) -> NDArray[np.float64] | None:
        """Covariance (6, 6) of xi = (rho, phi), in metres and radians, camera frame, left perturbation.

        None if it is unknown. For a pose that is not trusted, it covers chance alone.
        """
        return None if self.uncertainty is None else np.array(self.uncertainty.covariance)

    def project(self, points: ArrayLike) -> Projection:
        """Project points into the image of the camera that the transform belongs to.

        Args:
            points: (N, 3) or (N, 4) metres, LiDAR frame; a fourth column is ignored.

        Raises:
            InputError: the points are not such an array of numbers.
        """
        array = np.asarray(points)
        check_array("points", array, POINTS)
        T, camera = self.T_camera_lidar, self.used_camera
        points_camera = np.ascontiguousarray(array[:, :3] @ T[:3, :3].T + T[:3, 3])
        pixels = core_camera(camera).project(points_camera)
        with np.errstate(invalid="ignore"):  # NaN is not inside.
            is_inside = (pixels >= -0.5) & (pixels < np.array(camera.size) - 0.5)
        return Projection(pixels, points_camera[:, 2] > 0.0, np.asarray(is_inside.all(axis=1)))

    @property
    def believed_uncertainty(self) -> Uncertainty | None:
        """Uncertainty to show; None for a transform that is not trusted, which may be off by far more."""
        return self.uncertainty if self.is_believed else None

    @property
    def believed_covariance(self) -> Matrix | None:
        """Covariance (6, 6) of xi as a normal distribution, see `Uncertainty`; None if it is not believed."""
        uncertainty = self.believed_uncertainty
        return None if uncertainty is None else uncertainty.widened_covariance

    @property
    def is_believed(self) -> bool:
        """Whether intervals are shown: nothing speaks against the transform."""
        return self.status != "not_trusted"

    @property
    def has_found_camera(self) -> bool:
        """Whether the transform belongs to a camera that was estimated together with it."""
        return self.camera is not None and self.camera.is_kept

    @property
    def has_found_clock(self) -> bool:
        """Whether the transform belongs to a time offset that was estimated together with it."""
        return self.clock is not None and self.clock.is_kept

    @property
    def used_camera(self) -> Camera:
        """Camera that the transform belongs to: the estimate, or that of the drive."""
        return self.input.camera if self.camera is None or not self.camera.is_kept else self.camera.found

    @property
    def used_offset_s(self) -> float | None:
        """Time offset that the transform belongs to: the estimate, or that of the drive; None if unknown."""
        if self.clock is None:
            return None
        return self.clock.time_offset_s if self.clock.is_kept else self.clock.given_s

    def applied_to(self, drive: Drive) -> Drive:
        """Return a drive with the camera and the clock that were estimated together with the transform."""
        camera = self.used_camera if self.has_found_camera else None
        return with_estimates(drive, camera, self.used_offset_s if self.has_found_clock else None)

    @classmethod
    def from_pose(cls, T_camera_lidar: Pose, **parts: Any) -> Self:
        """Make a calibration and derive the other forms of its pose.

        Args:
            T_camera_lidar: (4, 4), p_camera = T_camera_lidar @ p_lidar, metres; round-off in its rotation is removed.
            parts: All other fields by name.

        Raises:
            CalibrationError: the pose is not finite or not rigid.
        """
        if not np.isfinite(T_camera_lidar).all():
            raise CalibrationError("T_camera_lidar is not finite")
        try:
            check_rigid(T_camera_lidar)
        except ValueError as error:
            raise CalibrationError(f"T_camera_lidar: {error}") from None
        return cls(semcal_calibration=1, **pose_forms(nearest_rigid(T_camera_lidar)), **parts)


def with_estimates(drive: Drive, camera: Camera | None, time_offset_s: float | None) -> Drive:
    """Return a drive with another camera, but its own shutter and mask, and another time offset, unless one is None."""
    changes: dict[str, object] = {}
    if camera is not None:
        own = {name: getattr(drive.camera, name) for name in ("readout_s", "direction", "mask")}
        changes["camera"] = camera.model_copy(update=own)
    if time_offset_s is not None:
        changes["time_offset_s"] = time_offset_s
    return drive.model_copy(update=changes)


def calibration_text(calibration: CalibrationDocument, format: DocumentFormat) -> str:
    """Format a calibration as YAML or JSON; the same calibration gives the same bytes."""
    return document_text(calibration.model_dump(), format)


def write_calibration(calibration: CalibrationDocument, path: Path | str) -> None:
    """Write a calibration as YAML or JSON, by the suffix.

    Raises:
        InputError: the suffix is another one, or the file cannot be written. An existing file then stays unchanged.
    """
    path = Path(path)
    write_text(calibration_text(calibration, output_format(path)), path)


def read_calibration(path: Path | str) -> CalibrationDocument:
    """Read and check a calibration.

    Raises:
        InputError: the file is wrong; the message names the file, the key, what was found and what was needed.
    """
    path = Path(path)
    return validate(CalibrationDocument, read_document(path), path)


def pose_forms(T_camera_lidar: Pose) -> dict[str, Any]:
    """Derive all forms of one pose in a file, by key."""
    return {
        "T_camera_lidar": tuple(map(tuple, T_camera_lidar.tolist())),
        "T_lidar_camera": tuple(map(tuple, inverse(T_camera_lidar).tolist())),
        "translation_m": tuple(T_camera_lidar[:3, 3].tolist()),
        "quaternion_xyzw": tuple(quaternion_xyzw(T_camera_lidar).tolist()),
    }


def check_forms(
    T_camera_lidar: Pose, T_lidar_camera: ArrayLike, translation_m: ArrayLike, quaternion: ArrayLike
) -> None:
    """Check that the forms of one pose in a file agree within `AGREEMENT_TOLERANCE`.

    They are compared as stated; rounding is removed only afterwards.

    Args:
        T_camera_lidar: (4, 4), metres.
        T_lidar_camera: (4, 4), its inverse.
        translation_m: (3,), its translation.
        quaternion: (4,) x y z w, its rotation.

    Raises:
        ValueError: two forms differ.
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
