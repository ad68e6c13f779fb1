"""Reading of a rig's result: the rig_calibration.yaml and the calibrations next to it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, NamedTuple

from semcal_cli.config import MAX_POINTS
from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError, listed
from semcal_cli.files.documents import read_document
from semcal_cli.files.input_files import is_folder
from semcal_cli.files.validation import FileName, StatedTransform, StrictModel, Version, validate
from semcal_cli.many.rig.adjustment import Adjustment
from semcal_cli.many.rig.rig_calibration import RigCalibration, combine
from semcal_cli.many.rig.rig_document import RESULT, Rig
from semcal_cli.result.applied import apply_result
from semcal_cli.result.calibration_document import read_calibration

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
    num_sweeps: int
    """Number of different clouds that were read."""
    adjustment: Adjustment | None = None
    """What all cameras and the constraints between them say together; absent without constraints."""
    input: dict[str, Any]
    """The rig.yaml, and the hashes of the files that were read."""
    versions: dict[str, str]
    """Versions of semcal and of its dependencies."""


class RigFiles(NamedTuple):
    """The result of a rig, and what it was computed from."""

    rig_calibration: RigCalibration
    drives: dict[str, Drive]
    """Drive of each camera, with the camera and clock of its result."""
    paths: list[Path]
    """All files of the rig and of its result, with the document of the result last."""


def read_rig_files(rig: Rig, result: Path, max_points: int = MAX_POINTS) -> RigFiles:
    """Read the drives of a rig, and its result.

    Args:
        rig: The rig.
        result: Document of the result, or the folder that `semcal calibrate` wrote.
        max_points: Points of the largest sweep that is read.

    Raises:
        InputError: a file is missing or wrong, or the result is from another rig.
    """
    file = result / f"{RESULT}.yaml" if is_folder(result) else result
    drives = rig.read_drives(max_points)
    rig_calibration = read_rig_result(rig, drives, file)
    for name, record in rig_calibration.cameras.items():
        drives[name] = apply_result(record, drives[name], name).drive
    paths = [path for drive in drives.values() for path in (drive.path, *map(drive.resolve, drive.files()))]
    paths += [rig.path, *(file.with_name(f"{name}.yaml") for name in rig_calibration.cameras)]
    return RigFiles(rig_calibration, drives, [*paths, file])


def read_rig_result(rig: Rig, drives: dict[str, Drive], path: Path) -> RigCalibration:
    """Read the result of a rig with the calibrations of its cameras.

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
    if result.cameras.keys() != drives.keys():
        raise InputError(
            f"{path}: cameras: found {listed(result.cameras)}, expected those of {rig.path}: {listed(drives)}"
        )
    if result.adjustment is not None and not {*result.adjustment.cameras} <= drives.keys():
        raise InputError(
            f"{path}: adjustment.cameras: found {listed(result.adjustment.cameras)}, expected some of {listed(drives)}"
        )
    cameras, failures = {}, {}
    for name in drives:
        camera = result.cameras[name]
        if camera.calibration is None:
            failures[name] = "; ".join(camera.reasons)
            continue
        file = path.parent / camera.calibration
        cameras[name] = read_calibration(file)
        if cameras[name].rows_camera_lidar != camera.T_camera_lidar:
            raise InputError(
                f"{file}: found a T_camera_lidar that differs from that in {path}, expected files of one run"
            )
    return combine(rig, drives, cameras, failures, result.num_sweeps, result.adjustment)
