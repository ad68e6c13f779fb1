"""Provenance of a calibration: its input files with their hashes, and versions."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from semcal_cli.drive.camera import Camera, without_last_zeros
from semcal_cli.drive.document import Drive
from semcal_cli.drive.networks import LabelNetworks
from semcal_cli.files.array_forms import hash_array
from semcal_cli.files.input_files import hash_file
from semcal_cli.observations.cues.cue_table import files_of
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.sections import Input, InputFrame

LIBRARIES = ("semcal", "numpy", "opencv-python-headless", "torch")
"""Packages whose versions may affect the result, if they are installed."""


def describe_input(drive: Drive, keys: Sequence[str]) -> Input:
    """Describe the drive, its camera and its frames, without the hashes of its files: see `with_provenance`.

    Args:
        drive: The drive, with the used frames.
        keys: Keys of a frame's files that were read.
    """
    return Input(
        drive=str(drive.path),
        camera=drive.camera,
        frame_ids=drive.frame_ids,
        frames=tuple(InputFrame(**{key: getattr(frame, key) for key in keys}) for frame in drive.frames),
        sha256={},
        networks=_networks(drive, keys),
    )


def with_provenance(
    calibration: CalibrationDocument,
    data: LoadedDrive,
    *,
    start: Path | None = None,
    relative_to: Path = Path(),
    hashes: dict[str, str] | None = None,
) -> CalibrationDocument:
    """Add the hashes of the files that a calibration was computed from, and name the drive relative to the result.

    Args:
        calibration: The calibration.
        data: The drive that it was computed from.
        start: File of the initial pose, if any.
        relative_to: Folder of the result. Paths are relative to it, except those of the drive's own files.
        hashes: SHA-256 by the real paths of files; new ones are added.

    Raises:
        InputError: a file cannot be read.
    """
    drive, hashes = data.drive, {} if hashes is None else hashes
    sha256 = hash_input(drive, files_of(data.cues), hashes)
    if start is not None:
        sha256 |= hash_files([start], relative_to, hashes)
    name = os.path.relpath(drive.path, relative_to) if drive.arrays is None else str(drive.path)
    input_section = calibration.input.model_copy(update={"drive": name, "sha256": sha256})
    return calibration.model_copy(update={"input": input_section})


def hash_input(drive: Drive, keys: Sequence[str], cache: dict[str, str] | None = None) -> dict[str, str]:
    """Compute the SHA-256 of each file or array of a drive that was read, by its name in the drive.

    Args:
        drive: The drive, with the used frames.
        keys: Keys of a frame's files that were read.
        cache: SHA-256 by the real paths of files; new ones are added.

    Raises:
        InputError: a file cannot be read.
    """
    cache, arrays = {} if cache is None else cache, drive.arrays
    names = [getattr(frame, key) for frame in drive.frames for key in keys]
    if drive.motion is not None:
        names.append(drive.motion.poses)
    if arrays is None and isinstance(drive.camera.mask, str):
        names.append(drive.camera.mask)
    hashes = dict[str, str]()
    if arrays is None:
        hashes[drive.path.name] = _sha256(drive.path, cache)
    else:
        names += [name for frame in drive.frames for name in arrays.times_of(frame.points)]
    return hashes | {name: hash_named(drive, name, cache) for name in names if name is not None}


def hash_named(drive: Drive, name: str, cache: dict[str, str] | None = None) -> str:
    """Compute the SHA-256 of a file of a drive, or of the array in its place.

    Args:
        drive: The drive.
        name: Name of the file or of the array.
        cache: SHA-256 by the real paths of files; new ones are added.

    Raises:
        InputError: the file cannot be read.
    """
    if drive.arrays is not None:
        return hash_array(drive.arrays.by_name[name])
    return _sha256(drive.resolve(name), {} if cache is None else cache)


def _networks(drive: Drive, keys: Sequence[str]) -> LabelNetworks | None:
    """List the networks of a drive that made the labels among the files that were read."""
    made = drive.networks or LabelNetworks()
    sides = {"image": "image_labels", "points": "point_labels"}
    read = {side: getattr(made, side) for side, key in sides.items() if key in keys}
    if read.get("image") is not None:
        read["second"] = made.second
    return LabelNetworks(**read) if any(read.values()) else None


def hash_files(
    paths: Iterable[Path], relative_to: Path, cache: dict[str, str] | None = None
) -> dict[str, str]:
    """Compute the SHA-256 of files, by their paths relative to a folder.

    Args:
        paths: The files.
        relative_to: The folder.
        cache: SHA-256 by the real paths of files; new ones are added.

    Raises:
        InputError: a file cannot be read.
    """
    cache = {} if cache is None else cache
    return {os.path.relpath(path, relative_to): _sha256(path, cache) for path in paths}


def _sha256(path: Path, cache: dict[str, str]) -> str:
    real = os.path.realpath(path)
    if real not in cache:
        cache[real] = hash_file(path)
    return cache[real]


def camera_hash(camera: Camera) -> str:
    """Hash the image size, intrinsics and lens of a camera, without trailing zeros, to 16 digits.

    How well the intrinsics are known, and which pixels are masked, does not matter.
    """
    camera = camera.model_copy(update={"intrinsics_sigma": None})
    document = without_last_zeros(camera).model_dump_json(exclude={"mask"})
    return hashlib.sha256(document.encode()).hexdigest()[:16]


def versions() -> dict[str, str]:
    """Read the versions of semcal and its numerical libraries."""
    installed = {}
    for name in LIBRARIES:
        with suppress(PackageNotFoundError):
            installed[name] = version(name)
    return installed
