"""Files of a data set's tree: what there is, and complaints that say so."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from semcal_cli.documents import read_text
from semcal_cli.errors import InputError
from semcal_cli.poses import Vector

MAX_LISTED = 8


def need(path: Path) -> Path:
    """Give the path of a file or folder that is there.

    Raises:
        InputError: it is not, or its name is none that a file may have.
    """
    try:
        there = path.exists()
    except OSError as error:
        raise InputError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    if not there:
        raise InputError(f"{path}: no such file or folder")
    return path


def folders(root: Path) -> list[str]:
    """Names of the folders in a folder, sorted."""
    return sorted(path.name for path in need(root).iterdir() if path.is_dir())


def files_by_stem(folder: Path, *suffixes: str) -> dict[str, Path]:
    """Files of a folder by their names without the suffix, sorted; of two with the same stem the first suffix wins.

    Raises:
        InputError: there is no such folder.
    """
    found: dict[str, Path] = {}
    for suffix in suffixes:
        for path in sorted(need(folder).glob(f"*{suffix}")):
            found.setdefault(path.name.removesuffix(suffix), path)
    return dict(sorted(found.items()))


def pick(kind: str, wanted: str | None, known: Sequence[str], where: Path) -> str:
    """Choose one of what there is: the one that is wanted, or the only one.

    Raises:
        InputError: it is not there, or there are several and none is wanted.
    """
    if wanted in known:
        return str(wanted)
    if wanted is None and len(known) == 1:
        return known[0]
    found = "none given" if wanted is None else f"found {wanted!r}"
    raise InputError(f"{where}: {kind}: {found}, needed {_one_of(wanted or '', known)}")


def read_keyed(path: Path) -> dict[str, str]:
    """Read `key: values` lines, as KITTI's calibration files have them.

    Raises:
        InputError: there is no such file, or it is no text.
    """
    lines = (line.partition(":") for line in read_text(path).splitlines())
    return {key.strip(): values.strip() for key, colon, values in lines if colon}


def numbers(path: Path, keyed: dict[str, str], key: str, *counts: int) -> Vector:
    """Give the finite numbers (count,) under a key of a file that `read_keyed` read.

    Raises:
        InputError: the key is missing, or holds something else.
    """
    if key not in keyed:
        raise InputError(f"{path}: found no key {key!r}, needed {_one_of(key, list(keyed))}")
    return parse_numbers(path, key, keyed[key], *counts)


def parse_numbers(path: Path, key: str, text: str, *counts: int) -> Vector:
    """Parse the finite numbers (count,) of a text.

    Raises:
        InputError: the text holds something else.
    """
    needed = " or ".join(map(str, counts))
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        raise InputError(f"{path}: {key}: found {text[:40]!r}, needed {needed} numbers") from None
    if len(values) not in counts or not np.isfinite(values).all():
        raise InputError(f"{path}: {key}: found {len(values)} numbers, needed {needed}, all finite")
    return values


def _one_of(wanted: str, known: Iterable[str]) -> str:
    """List what there is, the nearest first, if it is much."""
    names = list(known)
    if not names:
        return "one, but there is none"
    if len(names) > MAX_LISTED:
        near = difflib.get_close_matches(wanted, names, n=MAX_LISTED, cutoff=0.0)
        return f"one of {len(names)}, nearest: {', '.join(near)}"
    return f"one of: {', '.join(names)}" if len(names) > 1 else names[0]
