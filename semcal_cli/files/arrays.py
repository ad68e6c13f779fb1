"""Arrays of `.npy` files, mapped into memory."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy.typing as npt
from numpy.lib.format import open_memmap

from semcal_cli.errors import InputError
from semcal_cli.files.reading import check_size, open_file, size_of


def map_array(path: Path, max_bytes: int, needed_for: str = "") -> npt.NDArray[Any]:
    """Map the array of a `.npy` file of at most `max_bytes` bytes, which is read where it is used.

    Args:
        path: The file.
        max_bytes: Largest size.
        needed_for: Words that say what the limit applies to.

    Raises:
        InputError: the file is missing, is larger, or holds no array.
    """
    with open_file(path) as file:
        check_size(path, size_of(file), max_bytes, needed_for)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return open_memmap(path, mode="r")  # which refuses Python objects
    except Exception:  # The header of the file is Python, so it can fail in many ways.
        raise InputError(f"{path}: found no NumPy array, needed one") from None
