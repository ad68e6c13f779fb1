"""Tables in Apache Feather files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from pyarrow import feather

from semcal_cli.errors import InputError, listed
from semcal_cli.files.input_files import read_bytes

MAX_BYTES = 256 << 20
"""Largest size of a file. A sweep has about 1 MB."""


def read_columns(path: Path, *names: str) -> list[npt.NDArray[Any]]:
    """Read columns of finite numbers (N,), of the types in the file.

    Raises:
        InputError: the file is missing or damaged, or a column is missing or holds anything else than finite numbers.
    """
    table = _read(path, names)
    return [_numbers(path, table, name) for name in names]


def read_sensors(path: Path, *names: str) -> dict[str, dict[str, float]]:
    """Read the finite numbers in the row of each sensor, which the column `sensor_name` names.

    Raises:
        InputError: the file is missing or damaged, or a column is missing or holds anything else.
    """
    table = _read(path, ("sensor_name", *names))
    columns = [_numbers(path, table, name).tolist() for name in names]
    rows = [dict(zip(names, map(float, row), strict=True)) for row in zip(*columns, strict=True)]
    return dict(zip(map(str, table.column("sensor_name").to_pylist()), rows, strict=True))


def _read(path: Path, names: tuple[str, ...]) -> pa.Table:
    try:
        table = feather.read_table(pa.BufferReader(read_bytes(path, limit=MAX_BYTES)))
    except pa.ArrowException as error:
        raise InputError(
            f"{path}: found no Feather table, expected one: {str(error).splitlines()[0]}"
        ) from None
    if missing := [name for name in names if table.column_names.count(name) != 1]:
        raise InputError(f"{path}: found columns {listed(table.column_names)}, expected one {missing[0]}")
    return table


def _numbers(path: Path, table: pa.Table, name: str) -> npt.NDArray[Any]:
    column = table.column(name)
    is_number = pa.types.is_integer(column.type) or pa.types.is_floating(column.type)
    if is_number and not column.null_count:
        numbers: npt.NDArray[Any] = column.to_numpy()
        if np.isfinite(numbers).all():
            return numbers
    raise InputError(f"{path}: {name}: found values that are not finite numbers, expected only those")
