"""The drives of a fleet: results of batches and single calibrations, and whether each can be used."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from semcal_cli.config.file_limits import MAX_FLEET_DRIVES
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.files.documents import read_json_lines
from semcal_cli.files.input_files import is_folder
from semcal_cli.files.validation import validate
from semcal_cli.geometry.arrays import Pose
from semcal_cli.many.batch.records import JSONL, RecordedOutcome
from semcal_cli.result.calibration_document import read_calibration
from semcal_cli.result.provenance import camera_hash
from semcal_cli.result.uncertainty import CovarianceEntries

SIGMAS_M, SIGMAS_RAD = (1e-5, 100.0), (1e-6, 3.0)
"""Range of plausible standard errors of the camera's position, and of its rotation."""
MIN_EIGENVALUE = 1e-9
"""Minimum eigenvalue of a correlation matrix; data cannot determine a combination of axes that much better than each
axis."""


class _Line(RecordedOutcome):
    """A line of the summary of a batch of calibrations."""

    status: Literal["trusted", "not_trusted", "not_assessed", "failed"]


@dataclass(frozen=True)
class FleetDrive:
    """The calibration of one drive of the rig."""

    name: str
    stamp: float | None
    """Stamp of the drive's first frame, seconds."""
    T_camera_lidar: Pose | None
    covariance: npt.NDArray[np.float64] | None
    """(6, 6) covariance of a twist on the left of the pose, (rho, phi), metres and radians."""
    left_out: str | None
    """Why the drive cannot be used; None if it can."""
    camera: str | None = None
    """Hash of the camera, given or estimated, that the transform belongs to; see `provenance.camera_hash`."""
    topic: str | None = None
    """Entry of `left_out` in docs/troubleshooting.md, if it has one."""
    covariance_of_intrinsics: npt.NDArray[np.float64] | None = None
    """(6, 6) part of the covariance from errors of K, which all drives of a camera share; None if it is not stated."""


def read_fleet_drives(paths: Sequence[Path]) -> list[FleetDrive]:
    """Read drives, from folders that `semcal batch` wrote and from single calibrations.

    Drives of several batches may have the same name; the names of their batches then distinguish them.

    Raises:
        InputError: a file is missing or wrong, or a result is listed twice.
    """
    results: list[tuple[Path, FleetDrive]] = []
    for path in paths:
        results += _read_batch(path) if is_folder(path) else [(path, _read_single(path))]
        if len(results) > MAX_FLEET_DRIVES:
            raise InputError(
                f"{path}: found more than {MAX_FLEET_DRIVES:,} drives, needed at most so many in a fleet"
            )
    names = Counter(drive.name for _, drive in results)
    drives: list[FleetDrive] = []
    owners: dict[tuple[bytes, bytes], str] = {}
    folders: set[str] = set()
    for result, drive in results:
        name = drive.name if names[drive.name] == 1 else str(result)
        drives.append(replace(drive, name=name))
        if (folder := os.path.realpath(result)) in folders and drive.T_camera_lidar is None:
            raise InputError(f"{name}: found the same failed drive twice, expected each drive once")
        folders.add(folder)
        if drive.T_camera_lidar is not None and drive.covariance is not None:
            # Calibrations of two drives never agree to the last bit: one is a copy of the other, or listed twice.
            key = drive.T_camera_lidar.tobytes(), drive.covariance.tobytes()
            if key in owners:
                raise InputError(
                    f"{owners[key]}, {name}: found results that agree to the last bit, expected each drive once"
                )
            owners[key] = name
    return drives


def _read_batch(folder: Path) -> list[tuple[Path, FleetDrive]]:
    """Read the result of each drive of a batch, with the folder that identifies the drive."""
    path, drives = folder / JSONL, []
    for number, document in enumerate(islice(read_json_lines(path), MAX_FLEET_DRIVES + 1), start=1):
        where = Path(f"{path}: line {number}")
        if isinstance(document, dict) and document.get("status") in ("pass", "fail", "inconclusive"):
            raise InputError(
                f"{where}: status: found {document['status']!r} from verify, expected calibrations: run semcal batch "
                "without --command verify"
            )
        line = validate(_Line, document, where)
        drive_folder = folder / (line.drive if line.result is None else Path(line.result).parent)
        drives.append((drive_folder, _drive_of_line(line, where)))
    return drives


def _drive_of_line(line: _Line, where: Path) -> FleetDrive:
    T = None if line.T_camera_lidar is None else np.array(line.T_camera_lidar)
    if T is None and line.status != "failed":
        raise InputError(f"{where}: T_camera_lidar: found none, expected one where status is {line.status}")
    left_out, topic = _why_left_out(line.status, line.reasons, line.topics, line.covariance)
    covariance = None if left_out else _check_covariance(line.covariance, f"{where}: covariance")
    covariance_of_intrinsics = _as_array(line.covariance_of_intrinsics)
    return FleetDrive(
        line.drive, line.stamp, T, covariance, left_out, line.camera, topic, covariance_of_intrinsics
    )


def _read_single(path: Path) -> FleetDrive:
    calibration = read_calibration(path)
    uncertainty = calibration.uncertainty
    stated_covariance = None if uncertainty is None else uncertainty.covariance
    left_out, topic = _why_left_out(
        calibration.status, calibration.reasons, calibration.topics, stated_covariance
    )
    covariance = None if left_out else _check_covariance(stated_covariance, f"{path}: uncertainty.covariance")
    covariance_of_intrinsics = (
        None if uncertainty is None or left_out else _as_array(uncertainty.covariance_of_intrinsics)
    )
    stamp = None
    with suppress(InputError):  # The drive may have been moved or deleted.
        stamp = read_drive(path.parent / calibration.input.drive).first_stamp
    camera = camera_hash(calibration.used_camera)
    return FleetDrive(
        str(path), stamp, calibration.pose, covariance, left_out, camera, topic, covariance_of_intrinsics
    )


def _why_left_out(
    status: str, reasons: Sequence[str], topics: Sequence[str], covariance: CovarianceEntries | None
) -> tuple[str | None, str | None]:
    """Return why a drive cannot be used, if so, and the entry in the documentation."""
    if status in ("failed", "not_trusted"):
        topic = topics[0] if status == "not_trusted" and topics else None
        return "; ".join([status.replace("_", " "), *reasons[:1]]), topic
    return "its error is unknown" if covariance is None else None, None


def _as_array(covariance: CovarianceEntries | None) -> npt.NDArray[np.float64] | None:
    return None if covariance is None else np.array(covariance)


def _check_covariance(entries: CovarianceEntries | None, where: str) -> npt.NDArray[np.float64]:
    """Make a covariance exactly symmetric, and check that it is plausible and invertible.

    Raises:
        InputError: it is not.
    """
    covariance = np.array(entries)
    symmetric: npt.NDArray[np.float64] = 0.5 * (covariance + covariance.T)
    sigmas = np.sqrt(np.diag(covariance))
    for unit, deviations, (minimum, maximum) in (
        ("m", sigmas[:3], SIGMAS_M),
        ("rad", sigmas[3:], SIGMAS_RAD),
    ):
        low, high = deviations.min(), deviations.max()
        if not minimum <= low <= high <= maximum:
            raise InputError(
                f"{where}: found standard errors of {low:.3g} to {high:.3g} {unit}, needed {minimum:g} to {maximum:g}"
            )
    scale = np.outer(sigmas, sigmas)
    eigenvalue = float(np.linalg.eigvalsh(symmetric / scale)[0])
    if eigenvalue <= MIN_EIGENVALUE:
        raise InputError(
            f"{where}: found a correlation matrix with an eigenvalue of {eigenvalue:.3g}, expected one above "
            f"{MIN_EIGENVALUE:g}"
        )
    return symmetric
