"""Files of a data set's tree: what there is, and complaints that say so."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from semcal_cli.errors import InputError
from semcal_cli.files.messages import describe, one_of, os_reason
from semcal_cli.files.reading import is_folder, read_bytes


def need_file(path: Path) -> Path:
    """Give the path of a regular file that is there.

    Raises:
        InputError: it is not, or it cannot be read.
    """
    read_bytes(path, 0)
    return path


def need_folder(path: Path) -> Path:
    """Give the path of a folder that is there.

    Raises:
        InputError: it is not, or its name is none that a folder may have.
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
    """Locate what a data set's own table names, which lies inside its folder; it need not be there.

    Raises:
        InputError: the name is none that a file inside `root` may have.
    """
    path = Path(name) if isinstance(name, str) else Path()
    if path == Path() or path.is_absolute() or ".." in path.parts or not _is_writable(str(name)):
        raise InputError(f"{where}: found {describe(name)}, needed a name inside {root}")
    return root / path


def writable_name(path: Path, name: str) -> str:
    """Give the name that a drive.yaml shall have for a file.

    Raises:
        InputError: it is not text.
    """
    if not _is_writable(name):
        raise InputError(f"{str(path)!a}: found name {name!a}, needed UTF-8")
    return name


def folders(root: Path) -> list[str]:
    """Names of the folders in a folder, sorted."""
    return [path.name for path in _content(root) if is_folder(path)]


def files_by_stem(folder: Path, *suffixes: str) -> dict[str, Path]:
    """Files of a folder by their names without the suffix, sorted; of two with the same stem the first suffix wins.

    Raises:
        InputError: there is no such folder.
    """
    found: dict[str, Path] = {}
    content = _content(folder)
    for suffix in suffixes:
        for path in content:
            if path.name.endswith(suffix):
                found.setdefault(path.name.removesuffix(suffix), path)
    return dict(sorted(found.items()))


def numbered_files(folder: Path, *suffixes: str) -> dict[str, Path]:
    """Those of `files_by_stem` that are named by a number in plain digits."""
    files = files_by_stem(folder, *suffixes)
    return {stem: path for stem, path in files.items() if stem.isascii() and stem.isdecimal()}


def pick(
    kind: str, wanted: str | None, known: Sequence[str], where: Path, *, usual: str | None = None
) -> str:
    """Choose one of what there is: the one that is wanted; if none is, the usual one, or the only one.

    Raises:
        InputError: it is not there, or there are several and none is wanted.
    """
    choice = usual if wanted is None else wanted
    if choice in known:
        return str(choice)
    if choice is None and len(known) == 1:
        return known[0]
    found = "none given" + (f", and no {usual}" if usual else "") if wanted is None else f"found {wanted!r}"
    raise InputError(f"{where}: {kind}: {found}, needed {one_of(choice or '', known)}")


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
