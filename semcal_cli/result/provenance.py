"""Provenance of a calibration: its input files with their hashes, and versions."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from semcal_cli.drive.camera import Camera, without_last_zeros
from semcal_cli.drive.document import Drive, drive_file
from semcal_cli.drive.networks import LabelNetworks
from semcal_cli.files.array_forms import hash_array
from semcal_cli.files.input_files import hash_file
from semcal_cli.result.sections import Input, InputFrame

LIBRARIES = ("semcal", "numpy", "opencv-python-headless", "torch")
"""Packages whose versions may affect the result, if they are installed."""


def describe_input(
    drive: Drive,
    init: Path | None,
    relative_to: Path,
    keys: Sequence[str],
    known: dict[str, str] | None = None,
) -> Input:
    """Describe the drive, its camera and frames, and compute the SHA-256 of each file or array that was read.

    Args:
        drive: The drive.
        init: File or drive of the initial pose, if any.
        relative_to: Folder of the result. Paths are relative to it, except those of the drive's own files.
        keys: Keys of a frame's files that were read.
        known: SHA-256 by the real paths of files; new ones are added.

    Raises:
        InputError: a file cannot be read.
    """
    known, arrays = {} if known is None else known, drive.arrays
    names = [getattr(frame, key) for frame in drive.frames for key in keys]
    if drive.motion is not None:
        names.append(drive.motion.poses)
    if arrays is None:
        hashes = {drive.path.name: _sha256(drive.path, known)}
    else:
        hashes = dict[str, str]()
        names += [name for frame in drive.frames for name in arrays.times_of(frame.points)]
    hashes |= {name: hash_named(drive, name, known) for name in names if name is not None}
    if init is not None:
        hashes |= hash_files([drive_file(init)], relative_to, known)
    return Input(
        drive=os.path.relpath(drive.path, relative_to) if arrays is None else str(drive.path),
        camera=drive.camera,
        frames=tuple(InputFrame(**{key: getattr(frame, key) for key in keys}) for frame in drive.frames),
        sha256=hashes,
        networks=_networks(drive, keys),
    )


def hash_named(drive: Drive, name: str, known: dict[str, str] | None = None) -> str:
    """Compute the SHA-256 of a file of a drive, or of the array in its place.

    Args:
        drive: The drive.
        name: Name of the file or of the array.
        known: SHA-256 by the real paths of files; new ones are added.

    Raises:
        InputError: the file cannot be read.
    """
    if drive.arrays is not None:
        return hash_array(drive.arrays.by_name[name])
    return _sha256(drive.resolve(name), {} if known is None else known)


def _networks(drive: Drive, keys: Sequence[str]) -> LabelNetworks | None:
    """List the networks of a drive that made the labels among the files that were read."""
    made = drive.networks or LabelNetworks()
    sides = {"image": "image_labels", "points": "point_labels"}
    read = {side: getattr(made, side) for side, key in sides.items() if key in keys}
    if read.get("image") is not None:
        read["second"] = made.second
    return LabelNetworks(**read) if any(read.values()) else None


def hash_files(
    paths: Iterable[Path], relative_to: Path, known: dict[str, str] | None = None
) -> dict[str, str]:
    """Compute the SHA-256 of files, by their paths relative to a folder.

    Args:
        paths: The files.
        relative_to: The folder.
        known: SHA-256 by the real paths of files; new ones are added.

    Raises:
        InputError: a file cannot be read.
    """
    known = {} if known is None else known
    return {os.path.relpath(path, relative_to): _sha256(path, known) for path in paths}


def _sha256(path: Path, known: dict[str, str]) -> str:
    real = os.path.realpath(path)
    if real not in known:
        known[real] = hash_file(path)
    return known[real]


def camera_hash(camera: Camera) -> str:
    """Hash the image size, intrinsics and lens of a camera, without trailing zeros, to 16 digits.

    How well the intrinsics are known does not matter.
    """
    camera = camera.model_copy(update={"intrinsics_sigma": None})
    document = without_last_zeros(camera).model_dump_json()
    return hashlib.sha256(document.encode()).hexdigest()[:16]


def versions() -> dict[str, str]:
    """Read the versions of semcal and its numerical libraries."""
    found = {}
    for name in LIBRARIES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found
