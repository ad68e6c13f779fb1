"""The drives of a fleet: results of batches and single calibrations, and whether each can be used."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from semcal_cli.drive.document import first_stamp, read_drive
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
LEAST_EIGENVALUE = 1e-9
"""Least eigenvalue of a correlation matrix; data cannot determine a combination of axes that much better than each
axis."""
EPOCH_S = 1e9
"""Least stamp that counts as seconds since 1970; smaller ones may start anywhere and cannot be compared."""


class _Line(RecordedOutcome):
    """A line of the summary of a batch of calibrations."""

    status: Literal["trusted", "not_trusted", "not_assessed", "failed"]


@dataclass(frozen=True)
class Member:
    """The calibration of one drive of the rig."""

    drive: str
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
    of_intrinsics: npt.NDArray[np.float64] | None = None
    """(6, 6) part of the covariance from errors of K, which all drives of a camera share; None if it is not stated."""

    @property
    def has_stamp(self) -> bool:
        """Whether the drive's stamp can be compared with those of other drives."""
        return self.stamp is not None and self.stamp >= EPOCH_S


def read_members(paths: Sequence[Path]) -> list[Member]:
    """Read drives, from folders that `semcal batch` wrote and from single calibrations.

    Drives of several batches may have the same name; the names of their batches then distinguish them.

    Raises:
        InputError: a file is missing or wrong, or a result is given twice.
    """
    found: list[tuple[Path, Member]] = []
    for path in paths:
        found += _read_batch(path) if is_folder(path) else [(path, _read_single(path))]
    names = Counter(member.drive for _, member in found)
    members: list[Member] = []
    owners: dict[tuple[bytes, bytes], str] = {}
    places: set[str] = set()
    for result, member in found:
        name = member.drive if names[member.drive] == 1 else str(result)
        members.append(replace(member, drive=name))
        if (place := os.path.realpath(result)) in places and member.T_camera_lidar is None:
            raise InputError(f"{name}: found the same failed drive twice, needed each drive once")
        places.add(place)
        if member.T_camera_lidar is not None and member.covariance is not None:
            # Calibrations of two drives never agree to the last bit: one is a copy of the other, or given twice.
            key = member.T_camera_lidar.tobytes(), member.covariance.tobytes()
            if key in owners:
                raise InputError(
                    f"{owners[key]}, {name}: found results that agree to the last bit, needed each drive once"
                )
            owners[key] = name
    return members


def _read_batch(folder: Path) -> list[tuple[Path, Member]]:
    """Read the result of each drive of a batch, with the folder that identifies the drive."""
    path, found = folder / JSONL, []
    for number, document in enumerate(read_json_lines(path), start=1):
        where = Path(f"{path}: line {number}")
        if isinstance(document, dict) and document.get("status") in ("pass", "fail", "inconclusive"):
            raise InputError(
                f"{where}: status: found {document['status']!r} from verify, needed calibrations: run semcal batch "
                "without --command verify"
            )
        line = validate(_Line, document, where)
        place = folder / (line.drive if line.result is None else Path(line.result).parent)
        found.append((place, _member(line, where)))
    return found


def _member(line: _Line, where: Path) -> Member:
    T = None if line.T_camera_lidar is None else np.array(line.T_camera_lidar)
    if T is None and line.status != "failed":
        raise InputError(f"{where}: T_camera_lidar: found none, needed one where status is {line.status}")
    left_out, topic = _left_out(line.status, line.reasons, line.topics, line.covariance)
    covariance = None if left_out else _checked(line.covariance, f"{where}: covariance")
    of_intrinsics = _entries(line.covariance_of_intrinsics)
    return Member(line.drive, line.stamp, T, covariance, left_out, line.camera, topic, of_intrinsics)


def _read_single(path: Path) -> Member:
    found = read_calibration(path)
    known = found.uncertainty
    stated = None if known is None else known.covariance
    left_out, topic = _left_out(found.status, found.reasons, found.topics, stated)
    covariance = None if left_out else _checked(stated, f"{path}: uncertainty.covariance")
    of_intrinsics = None if known is None or left_out else _entries(known.covariance_of_intrinsics)
    stamp = None
    with suppress(InputError):  # The drive may have been moved or deleted.
        stamp = first_stamp(read_drive(path.parent / found.input.drive))
    camera = camera_hash(found.used_camera)
    return Member(str(path), stamp, found.pose, covariance, left_out, camera, topic, of_intrinsics)


def _left_out(
    status: str, reasons: Sequence[str], topics: Sequence[str], covariance: CovarianceEntries | None
) -> tuple[str | None, str | None]:
    """Say why a drive cannot be used, if so, and name the entry in the documentation."""
    if status in ("failed", "not_trusted"):
        topic = topics[0] if status == "not_trusted" and topics else None
        return "; ".join([status.replace("_", " "), *reasons[:1]]), topic
    return "its error is unknown" if covariance is None else None, None


def _entries(covariance: CovarianceEntries | None) -> npt.NDArray[np.float64] | None:
    return None if covariance is None else np.array(covariance)


def _checked(stated: CovarianceEntries | None, where: str) -> npt.NDArray[np.float64]:
    """Make a covariance exactly symmetric, and check that it is plausible and invertible.

    Raises:
        InputError: it is not.
    """
    covariance = np.array(stated)
    symmetric: npt.NDArray[np.float64] = 0.5 * (covariance + covariance.T)
    sigmas = np.sqrt(np.diag(covariance))
    for unit, found, (least, most) in (("m", sigmas[:3], SIGMAS_M), ("rad", sigmas[3:], SIGMAS_RAD)):
        low, high = found.min(), found.max()
        if not least <= low <= high <= most:
            raise InputError(
                f"{where}: found standard errors of {low:.3g} to {high:.3g} {unit}, needed {least:g} to {most:g}"
            )
    scale = np.outer(sigmas, sigmas)
    eigenvalue = float(np.linalg.eigvalsh(symmetric / scale)[0])
    if eigenvalue <= LEAST_EIGENVALUE:
        raise InputError(
            f"{where}: found a correlation matrix with an eigenvalue of {eigenvalue:.3g}, needed one above "
            f"{LEAST_EIGENVALUE:g}"
        )
    return symmetric
