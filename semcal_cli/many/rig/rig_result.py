"""Reading of a rig's result: the rig_calibration.yaml and the calibrations next to it."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from semcal_cli.config import MAX_POINTS
from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError, listed, shell
from semcal_cli.files.documents import FORMATS as DOCUMENTS, read_document
from semcal_cli.files.input_files import is_folder
from semcal_cli.files.validation import (
    FileName,
    StatedTransform,
    StrictModel,
    Vector3,
    Vector4,
    Version,
    length,
    validate,
)
from semcal_cli.geometry.arrays import Pose
from semcal_cli.many.rig.adjustment_document import Adjustment
from semcal_cli.many.rig.further_lidar import LidarCalibration, LidarStatus, reference_of
from semcal_cli.many.rig.matched_images import MAX_IMAGE_PAIRS, ComparedImages
from semcal_cli.many.rig.rig_calibration import RigCalibration, combine
from semcal_cli.many.rig.rig_document import RESULT, Rig, view_name
from semcal_cli.many.rig.rig_pair import Reference, RigPair
from semcal_cli.many.rig.sweep_registration import Registration
from semcal_cli.result.applied import apply_result
from semcal_cli.result.calibration_document import read_calibration
from semcal_cli.result.uncertainty import Uncertainty

KEY = "semcal_rig_calibration"


class CameraResult(StrictModel):
    """Result of one camera in the document of a rig's calibration."""

    status: Literal["failed", "trusted", "not_trusted", "not_assessed"]
    """Status of its calibration; `failed` without one."""
    reasons: list[str]
    """Findings of its calibration, or the error."""
    calibration: FileName | None = None
    """File of its calibration, relative to the document; absent if it failed."""
    T_camera_lidar: StatedTransform | None = None
    """Its transform; absent if it failed."""


class PairResult(StrictModel):
    """Transform between two sensors in the document of a rig's calibration."""

    a: str
    """Sensor to whose frame the transform leads."""
    b: str
    """Sensor from whose frame it leads."""
    T_a_b: StatedTransform
    """The transform in metres, p_a = T_a_b * p_b."""
    translation_m: Vector3
    """Its translation, in metres."""
    quaternion_xyzw: Vector4
    """Its rotation, as a unit quaternion."""
    uncertainty: Uncertainty | None
    """Its uncertainty, for a twist on its left in the frame of a; null if it is unknown."""
    reference: dict[str, Any] | None
    """Difference from the reference; it is recomputed when needed."""

    def pair(self, reference: Reference | None, *, is_doubted: bool) -> RigPair:
        """Return the pair, compared with a reference."""
        return RigPair(self.a, self.b, np.array(self.T_a_b), self.uncertainty, reference, is_doubted)


class LidarResult(StrictModel):
    """Result of a further LiDAR in the document of a rig's calibration."""

    status: LidarStatus
    """Verdict, by its loops and by its interval."""
    reasons: list[str]
    """What speaks against its transform."""
    notes: list[str]
    """Sentences that do not affect the verdict."""
    pair: PairResult | None
    """Transform from this LiDAR, b, to the first one, a; null if nothing that is trusted ties the two."""
    cameras: dict[str, CameraResult]
    """Result of each camera with this LiDAR, whose `T_camera_lidar` is that of this LiDAR."""
    own_cameras: list[PairResult]
    """Transforms from the first LiDAR, b, to the cameras, a, that have no calibration with it."""
    registration: Registration | None
    """Registration of its sweeps with those of the first LiDAR; null without one."""

    def calibration(
        self, name: str, rig: Rig, drives: Mapping[str, Drive], adjustment: Adjustment | None
    ) -> LidarCalibration:
        """Return what the document says of the LiDAR, compared with the reference of the rig or the drives."""
        doubted = () if adjustment is None else adjustment.doubted
        views, is_doubted = (
            {camera: view_name(camera, name) for camera in self.cameras},
            self.status == "not_trusted",
        )
        reference = reference_of(name, views, rig, drives)
        return LidarCalibration(
            name,
            views,
            self.status,
            tuple(self.reasons),
            tuple(self.notes),
            None if self.pair is None else self.pair.pair(reference, is_doubted=is_doubted),
            tuple(
                camera.pair(None, is_doubted=is_doubted or camera.a in doubted) for camera in self.own_cameras
            ),
            self.registration,
        )


class RigResult(StrictModel):
    """Content of a rig_calibration.yaml."""

    semcal_rig_calibration: Version
    """Version of this format."""
    status: str
    """The worst status of all cameras."""
    reasons: list[str]
    """Findings and errors of all cameras."""
    notes: list[str]
    """Sentences that do not affect the verdict."""
    cameras: dict[str, CameraResult]
    """Result of each camera."""
    pairs: list[dict[str, Any]]
    """Transform between each pair of cameras; it is recomputed when needed."""
    images: Annotated[tuple[ComparedImages, ...], length(0, MAX_IMAGE_PAIRS)] | None = None
    """What overlapping images show of two cameras; absent unless the rig asks for it."""
    image_notes: Annotated[tuple[str, ...], length(0, MAX_IMAGE_PAIRS)] = ()
    """Images that could not be matched; absent if all could."""
    lidars: dict[str, LidarResult] = {}
    """Result of each further LiDAR; absent for a rig of one LiDAR."""
    num_sweeps: int
    """Number of different clouds that were read."""
    adjustment: Adjustment | None = None
    """What all sensors and the ties between them say together; absent without constraints and further LiDARs."""
    input: dict[str, Any]
    """The rig.yaml, and the hashes of the files that were read."""
    versions: dict[str, str]
    """Versions of semcal and of its dependencies."""

    @property
    def views(self) -> dict[str, CameraResult]:
        """Result of each camera with each LiDAR, by the names of the results."""
        return self.cameras | {
            view_name(camera, name): result
            for name, lidar in self.lidars.items()
            for camera, result in lidar.cameras.items()
        }


class RigFiles(NamedTuple):
    """The result of a rig, and what it was computed from."""

    rig_calibration: RigCalibration
    drives: dict[str, Drive]
    """Drive of each camera, with the camera and clock of its result."""
    paths: list[Path]
    """All files of the rig and of its result, with the document of the result last."""


class RigTransforms(NamedTuple):
    """Where the transforms of a rig are stated."""

    files: dict[str, Path]
    """File of the transform of each camera with each LiDAR, by the names of the results."""
    failures: dict[str, str]
    """Why the others have none."""
    paths: list[Path]
    """All files of the rig and of its transforms."""


def transforms_of(rig: Rig, drives: Mapping[str, Drive], result: Path | None) -> RigTransforms:
    """Find the file that states the transform of each camera with each LiDAR.

    Args:
        rig: The rig.
        drives: Drive of each of its cameras.
        result: Document of its result, the folder that `semcal calibrate` wrote, or another file that names the frames
            of all sensors, such as a URDF; None takes what the drives state.

    Raises:
        InputError: a file is missing or wrong, the result is from another rig, or a drive states no transform.
    """
    paths = [rig.path, *_files_of(drives)]
    if result is None:
        missing = [name for name, drive in drives.items() if drive.T_camera_lidar is None]
        if missing:
            command = shell("verify", rig.path, "RESULTS")
            raise InputError(
                f"{rig.path}: found no transform of {listed(missing)} to verify; `{command}` takes those that "
                "`semcal calibrate` wrote"
            )
        return RigTransforms({name: drive.path for name, drive in drives.items()}, {}, paths)
    file = _document_of(result)
    if is_folder(result) and not file.exists():
        needed = "expected the results of a rig, or a file that names the frames of all its sensors, such as a URDF"
        raise InputError(f"{result}: found no {file.name}, {needed}")
    if not is_folder(result) and not (file.suffix.lower() in DOCUMENTS and KEY in read_document(file)):
        return RigTransforms(dict.fromkeys(drives, file), {}, [*paths, file])
    rig_calibration, files = read_rig_result(rig, drives, file)
    failures = {
        name: f"its calibration failed, says {file}: {why}" for name, why in rig_calibration.failures.items()
    }
    return RigTransforms(files, failures, [*paths, *files.values(), file])


def check_one_each(rig: Rig, transforms: RigTransforms, poses: Mapping[str, Pose]) -> None:
    """Check that one file states another transform for each camera of a LiDAR.

    Raises:
        InputError: it states one for two of them.
    """
    views = rig.views
    for a, b in combinations(poses, 2):
        file = transforms.files[a]
        is_one = file == transforms.files[b] and views[a].lidar == views[b].lidar
        if is_one and np.array_equal(poses[a], poses[b]):
            needed = "expected one for each, by the `frame_ids` of its drive, or the results of a rig"
            raise InputError(f"{file}: found one transform for {a} and {b}, {needed}")


def _document_of(result: Path) -> Path:
    return result / f"{RESULT}.yaml" if is_folder(result) else result


def _files_of(drives: Mapping[str, Drive]) -> list[Path]:
    return [path for drive in drives.values() for path in (drive.path, *map(drive.resolve, drive.files()))]


def read_rig_files(rig: Rig, result: Path, max_points: int = MAX_POINTS) -> RigFiles:
    """Read the drives of a rig, and its result.

    Args:
        rig: The rig.
        result: Document of the result, or the folder that `semcal calibrate` wrote.
        max_points: Points of the largest sweep that is read.

    Raises:
        InputError: a file is missing or wrong, or the result is from another rig.
    """
    file = _document_of(result)
    drives = rig.read_drives(max_points)
    rig_calibration, files = read_rig_result(rig, drives, file)
    for name, record in rig_calibration.cameras.items():
        drives[name] = apply_result(record, drives[name], name).drive
    paths = [*_files_of(drives), rig.path, *files.values(), file]
    return RigFiles(rig_calibration, drives, paths)


def read_rig_result(
    rig: Rig, drives: Mapping[str, Drive], path: Path
) -> tuple[RigCalibration, dict[str, Path]]:
    """Read the result of a rig with the calibrations of its cameras, and name the files of these.

    Args:
        rig: The rig.
        drives: Drive of each of its cameras.
        path: File of the result.

    Raises:
        InputError: a file is missing, wrong or for other cameras, or the files do not belong together.
    """
    document = read_document(path)
    if KEY not in document:
        raise InputError(
            f"{path}: found no key {KEY}, expected the {RESULT}.yaml that `semcal calibrate` wrote for {rig.path}"
        )
    result = validate(RigResult, document, path)
    views, named = rig.views, result.views
    if named.keys() != views.keys():
        raise InputError(
            f"{path}: cameras: found {listed(named)}, expected those of {rig.path}: {listed(views)}"
        )
    if result.adjustment is not None and not {*result.adjustment.cameras} <= {*rig.sensors}:
        raise InputError(
            f"{path}: adjustment.cameras: found {listed(result.adjustment.cameras)}, expected some of "
            f"{listed(rig.sensors)}"
        )
    _check_images(result, path)
    cameras, failures, files = {}, {}, dict[str, Path]()
    for name in drives:
        camera = named[name]
        if camera.calibration is None:
            failures[name] = "; ".join(camera.reasons)
            continue
        file = files[name] = path.parent / camera.calibration
        cameras[name] = read_calibration(file)
        if cameras[name].rows_camera_lidar != camera.T_camera_lidar:
            raise InputError(
                f"{file}: found a T_camera_lidar that differs from that in {path}, expected files of one run"
            )
    lidars = tuple(
        lidar.calibration(name, rig, drives, result.adjustment) for name, lidar in result.lidars.items()
    )
    calibration = combine(
        rig,
        drives,
        cameras,
        failures,
        result.num_sweeps,
        result.adjustment,
        lidars,
        result.images,
        result.image_notes,
    )
    return calibration, files


def _check_images(result: RigResult, path: Path) -> None:
    """Check that images show transforms between two cameras with a calibration, each pair once."""
    calibrated = [name for name, camera in result.cameras.items() if camera.calibration is not None]
    pairs = [frozenset({shown.to, shown.source}) for shown in result.images or ()]
    for index, pair in enumerate(pairs):
        if len(pair) < 2 or not pair <= {*calibrated} or pair in pairs[:index]:
            raise InputError(
                f"{path}: images[{index}]: found {listed(sorted(pair))}, expected two cameras with a calibration, each "
                "pair once"
            )
