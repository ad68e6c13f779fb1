"""Files and folders of a data set's tree, and the errors for missing ones."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from semcal_cli.errors import InputError, describe, os_reason
from semcal_cli.files.images import read_size
from semcal_cli.files.reading import is_folder, read_start
from semcal_cli.formats.node import image_side


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
        InputError: the folder does not exist, or no folder can have this name.
    """
    if is_folder(path):
        return path
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{path}: no such file or folder") from None
    except OSError as error:
        raise InputError(f"{path}: {os_reason(error)}") from None
    raise InputError(f"{path}: found a file, needed a folder")


def inside(root: Path, name: object, where: str) -> Path:
    """Locate a file that a data set's own table names inside its folder; the file need not exist.

    Raises:
        InputError: no file inside `root` can have this name.
    """
    path = Path(name) if isinstance(name, str) else Path()
    if path == Path() or path.is_absolute() or ".." in path.parts or not _is_writable(str(name)):
        raise InputError(f"{where}: found {describe(name)}, needed a name inside {root}")
    return root / path


def writable_name(path: Path, name: str) -> str:
    """Check that a drive.yaml can hold the name of a file, and return the name.

    Raises:
        InputError: the name is not valid UTF-8.
    """
    if not _is_writable(name):
        raise InputError(f"{str(path)!a}: found name {name!a}, needed UTF-8")
    return name


def image_size(path: Path) -> tuple[int, int]:
    """Read the width and height of an image from its header, in pixels.

    Raises:
        InputError: the file does not exist, or is no image, or has no pixels.
    """
    width, height = read_size(path)
    return image_side(f"{path}: width", width), image_side(f"{path}: height", height)


def folders(root: Path) -> list[str]:
    """List the names of the folders in a folder, sorted."""
    return [path.name for path in _content(root) if is_folder(path)]


def files_by_stem(folder: Path, *suffixes: str) -> dict[str, Path]:
    """List the files of a folder by their names without the suffix, sorted.

    Of two files with the same stem, the one with the earlier suffix is kept.

    Raises:
        InputError: the folder does not exist.
    """
    found: dict[str, Path] = {}
    content = _content(folder)
    for suffix in suffixes:
        for path in content:
            if path.name.endswith(suffix):
                found.setdefault(path.name.removesuffix(suffix), path)
    return dict(sorted(found.items()))


def numbered_files(folder: Path, *suffixes: str) -> dict[str, Path]:
    """List the files of a folder whose stems are numbers in plain digits, as `files_by_stem` does, by number."""
    files = files_by_stem(folder, *suffixes)
    numbered = [stem for stem in files if stem.isascii() and stem.isdecimal()]
    return {stem: files[stem] for stem in sorted(numbered, key=int)}


def _content(folder: Path) -> list[Path]:
    try:
        return sorted(need_folder(folder).iterdir())
    except OSError as error:
        raise InputError(f"{folder}: {os_reason(error)}") from None


def _is_writable(name: str) -> bool:
    """Whether a drive.yaml, which is UTF-8, can hold a name."""
    with suppress(UnicodeEncodeError):
        return b"\0" not in name.encode("utf-8")
    return False
