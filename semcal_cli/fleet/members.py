"""The drives of a fleet: what batches and single calibrations found, and which of them can be used."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt

from semcal_cli.calibration import read_calibration
from semcal_cli.documents import is_folder, read_json_lines
from semcal_cli.drive import Stamp, first_stamp, read_drive
from semcal_cli.errors import InputError
from semcal_cli.poses import Pose
from semcal_cli.provenance import camera_hash
from semcal_cli.validation import FileName, StrictModel, Transform, Vector6, length, validate

SUMMARY = "summary.jsonl"
LEAST_EIGENVALUE = 1e-12
"""Of correlations: below that their inverse has no digits left."""


class _Line(StrictModel):
    """A line of a batch's summary."""

    drive: str
    status: Literal["trusted", "not_trusted", "not_assessed", "failed"]
    exit_code: int
    reasons: Annotated[tuple[str, ...], length(0)]
    stamp: Stamp | None
    T_camera_lidar: Transform | None
    covariance: Annotated[tuple[Vector6, ...], length(6, 6)] | None
    mutual_information_nats: float | None
    camera: str | None
    result: FileName | None


@dataclass(frozen=True)
class Member:
    """What one drive says of the rig."""

    drive: str
    stamp: float | None
    """Seconds, of its first frame."""
    T_camera_lidar: Pose | None
    covariance: npt.NDArray[np.float64] | None
    """(6, 6) of a twist on the left, (rho, phi), metres and radians."""
    left_out: str | None
    """Why it cannot be used; None if it can."""
    camera: str | None = None
    """Tells lens and picture size from others: see `provenance.camera_hash`."""


def read_members(paths: Sequence[Path]) -> list[Member]:
    """Read drives, from folders that `semcal batch` wrote and from single calibrations.

    Drives of several batches may have the same name; they are then told apart by their batches.

    Raises:
        InputError: a file is missing or wrong, or a result is there twice.
    """
    found = [
        found for path in paths for found in (_read_batch(path) if is_folder(path) else [_read_single(path)])
    ]
    names = Counter(member.drive for _, member in found)
    members: dict[str, Member] = {}
    for result, member in found:
        if os.path.realpath(result) in members:
            raise InputError(f"{result}: found twice among what was given, needed each drive once")
        name = member.drive if names[member.drive] == 1 else str(result)
        members[os.path.realpath(result)] = replace(member, drive=name)
    return list(members.values())


def _read_batch(folder: Path) -> list[tuple[Path, Member]]:
    """Give the folder of each drive's results, by which it is known, and what it says."""
    path, found = folder / SUMMARY, []
    for number, document in enumerate(read_json_lines(path), start=1):
        where = Path(f"{path}: line {number}")
        if isinstance(document, dict) and document.get("status") in ("pass", "fail", "inconclusive"):
            raise InputError(
                f"{where}: status: found {document['status']!r}, of verify; needed calibrations: run semcal batch "
                "without --command verify"
            )
        line = validate(_Line, document, where)
        place = folder / (line.drive if line.result is None else Path(line.result).parent)
        found.append((place, _member(line, where)))
    return found


def _member(line: _Line, where: Path) -> Member:
    T = None if line.T_camera_lidar is None else np.array(line.T_camera_lidar)
    if T is None and line.status != "failed":
        raise InputError(f"{where}: T_camera_lidar: found nothing, needed one where status is {line.status}")
    stated = None if line.covariance is None else np.array(line.covariance)
    left_out = _left_out(line.status, line.reasons, stated)
    covariance = None if stated is None or left_out else _checked(stated, where)
    return Member(line.drive, line.stamp, T, covariance, left_out, line.camera)


def _read_single(path: Path) -> tuple[Path, Member]:
    found = read_calibration(path)
    stated = None if found.uncertainty is None else np.array(found.uncertainty.covariance)
    left_out = _left_out(found.status, found.reasons, stated)
    covariance = None if stated is None or left_out else _checked(stated, path)
    stamp = None
    with suppress(InputError):  # The drive may be elsewhere by now.
        stamp = first_stamp(read_drive(path.parent / found.input.drive))
    camera = camera_hash(found.input.camera)
    return path, Member(str(path), stamp, found.pose, covariance, left_out, camera)


def _left_out(status: str, reasons: Sequence[str], covariance: npt.NDArray[np.float64] | None) -> str | None:
    if status in ("failed", "not_trusted"):
        return "; ".join([status.replace("_", " "), *reasons[:1]])
    return "nothing is known of its error" if covariance is None else None


def _checked(covariance: npt.NDArray[np.float64], where: Path) -> npt.NDArray[np.float64]:
    """Give a covariance, without round-off that makes it unsymmetric.

    Raises:
        InputError: it is none.
    """
    symmetric: npt.NDArray[np.float64] = 0.5 * (covariance + covariance.T)
    sigmas = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    correlations = symmetric / np.outer(sigmas, sigmas) if sigmas.all() else np.zeros((6, 6))
    is_symmetric = bool((np.abs(covariance - symmetric) <= 1e-6 * np.outer(sigmas, sigmas)).all())
    if not is_symmetric or np.linalg.eigvalsh(correlations)[0] <= LEAST_EIGENVALUE:
        raise InputError(f"{where}: covariance: found no covariance, needed symmetric and positive numbers")
    return symmetric
