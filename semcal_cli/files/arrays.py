"""Arrays of `.npy` files, mapped into memory."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt
from numpy.lib import format as npy

from semcal_cli.errors import InputError
from semcal_cli.files.reading import check_size, open_file, size_of

READERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
"""Readers of the headers of each version. The third is that of records with names beyond Latin-1."""


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
            return _mapped(file)
        except Exception:  # The header of the file is Python, so it can fail in many ways.
            raise InputError(f"{path}: found no NumPy array, needed one") from None


def _mapped(file: BinaryIO) -> npt.NDArray[Any]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        shape, is_fortran, dtype = READERS[npy.read_magic(file)](file)
        if dtype.hasobject:
            raise ValueError("Python objects are not read")
        order = "F" if is_fortran else "C"
        found: npt.NDArray[Any] = np.memmap(file, dtype, "r", file.tell(), shape, order)  # type: ignore[call-overload]
        return found
