"""Files and folders of a data set's tree, the rows of its tables, and the errors for what is missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np

from semcal_cli.config.file_limits import MAX_TABLE_BYTES
from semcal_cli.errors import InputError, describe, os_reason
from semcal_cli.files.image_files import read_size
from semcal_cli.files.input_files import is_folder, read_start, read_text
from semcal_cli.formats.node import MAX_WORLD_M, image_side, number, parse_numbers
from semcal_cli.geometry.arrays import Numbers, Vector, Vectors

KITTI_PERIOD_S = 0.1
"""Time between two sweeps of the LiDARs of KITTI, KITTI-360 and RELLIS-3D."""


def need_file(path: Path) -> Path:
    """Check that a regular file exists, and return its path.

    Raises:
        InputError: the file does not exist or cannot be read.
    """
    read_start(path, 0)
    return path


def need_folder(path: Path) -> Path:
    """Check that a folder exists, and return its path.

    Raises:
        InputError: the folder does not exist, or its name is not valid.
    """
    if is_folder(path):
        return path
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{path}: no such file or folder") from None
    except OSError as error:
        raise InputError(f"{path}: {os_reason(error)}") from None
    raise InputError(f"{path}: found a file, expected a folder")


def inside(root: Path, name: object, where: str) -> Path:
    """Locate a file of a data set by its name in one of the data set's tables; the file need not exist.

    Raises:
        InputError: the name does not lead to a file inside `root`.
    """
    path = Path(name) if isinstance(name, str) else Path()
    if path == Path() or path.is_absolute() or ".." in path.parts or not _is_writable(str(name)):
        raise InputError(f"{where}: found {describe(name)}, expected a name inside {root}")
    return root / path


def writable_name(path: Path, name: str) -> str:
    """Check that a drive.yaml can hold the name of a file, and return the name.

    Raises:
        InputError: the name is not valid UTF-8.
    """
    if not _is_writable(name):
        raise InputError(f"{str(path)!a}: found name {name!a}, expected UTF-8")
    return name


def _is_writable(name: str) -> bool:
    """Return whether a drive.yaml, which is UTF-8, can hold a name."""
    with suppress(UnicodeEncodeError):
        return b"\0" not in name.encode("utf-8")
    return False


def image_size(path: Path) -> tuple[int, int]:
    """Read the width and height of an image from its header, in pixels.

    Raises:
        InputError: the file does not exist, is not an image or has no pixels.
    """
    width, height = read_size(path)
    return image_side(f"{path}: width", width), image_side(f"{path}: height", height)


def _content(folder: Path) -> list[Path]:
    try:
        return sorted(need_folder(folder).iterdir())
    except OSError as error:
        raise InputError(f"{folder}: {os_reason(error)}") from None


def folders(root: Path) -> list[str]:
    """List the names of the folders in a folder, sorted."""
    return [path.name for path in _content(root) if is_folder(path)]


def files_by_stem(folder: Path, *suffixes: str, is_needed: bool = True) -> dict[str, Path]:
    """List the files of a folder by their stems, sorted; none if the folder is neither there nor needed.

    Of two files with the same stem, the one with the earlier suffix is kept.

    Raises:
        InputError: the folder is needed and does not exist.
    """
    content = _content(folder) if is_needed or folder.is_dir() else []
    files: dict[str, Path] = {}
    for suffix in suffixes:
        for path in content:
            if path.name.endswith(suffix):
                files.setdefault(path.name.removesuffix(suffix), path)
    return dict(sorted(files.items()))


def numbered_files(folder: Path, *suffixes: str) -> dict[str, Path]:
    """List the files of a folder whose stems are plain digits, as `files_by_stem` does, in order of their numbers."""
    files = files_by_stem(folder, *suffixes)
    stems = [stem for stem in files if stem.isascii() and stem.isdecimal()]
    return {stem: files[stem] for stem in sorted(stems, key=int)}


def read_number_rows(path: Path, count: int, *, is_needed: bool = False) -> Iterator[tuple[str, Vector]]:
    """Read the finite numbers (count,) of each line, with the name of the file and line for messages.

    Raises:
        InputError: the file is needed and does not exist, or a line does not hold `count` numbers.
    """
    if not is_needed and not path.exists():
        return
    for index, line in enumerate(read_text(path, limit=MAX_TABLE_BYTES).splitlines(), start=1):
        if line.strip():
            yield f"{path}: line {index}", parse_numbers(path, f"line {index}", line, count)


def read_speeds(path: Path) -> list[float]:
    """Derive speeds, in metres per second, from a file with a pose of 12 numbers per line, one for each KITTI period.

    Returns:
        A speed for each line; none if the file does not exist.

    Raises:
        InputError: a line does not hold 12 numbers, or a position is farther away than anything on Earth.
    """
    positions = [
        [number(where, value, -MAX_WORLD_M, MAX_WORLD_M) for value in row[3::4].tolist()]
        for where, row in read_number_rows(path, 12)
    ]
    speeds: list[float] = speeds_mps(np.reshape(positions, (-1, 3)), KITTI_PERIOD_S).tolist()
    return speeds


def speeds_mps(positions: Vectors, period_s: float | Numbers) -> Numbers:
    """Compute the speed at each position by central differences.

    Args:
        positions: (N, 3) metres.
        period_s: Seconds from each position to the next, one value or (N - 1,).

    Returns:
        (N,) metres per second.
    """
    if len(positions) < 2:
        return np.zeros(len(positions))
    # Two positions at one time give an infinite speed, so they do not count as slow.
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = np.linalg.norm(np.diff(positions, axis=0), axis=1) / period_s
    speeds: Numbers = 0.5 * (np.append(steps, steps[-1]) + np.insert(steps, 0, steps[0]))
    return speeds
