"""Bare numbers, which need --direction: a 3 x 4 or 4 x 4 array or text, or a line of TUM's format."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from semcal_cli.errors import InputError, counted
from semcal_cli.formats.format import Format, FormatOptions, Source
from semcal_cli.formats.frame_names import apply_direction
from semcal_cli.formats.kitti_files import KITTI_360_FILE
from semcal_cli.formats.node import parse_numbers
from semcal_cli.formats.pose import XYZ, XYZW, from_rows, number_text, numbers_of, pose_of
from semcal_cli.geometry.arrays import Pose

SHAPES = ((3, 4), (4, 4))
NPY = b"\x93NUMPY"
TUM_NUMBERS = (*XYZ, *XYZW)
SEPARATORS = re.compile(r"[,;\[\]()]")


def directed_format(
    name: str,
    equation: str,
    recognises: Callable[[Source], bool],
    read: Callable[[Source, FormatOptions], Pose],
    make: Callable[[Pose, FormatOptions], bytes | dict[str, Any]],
    may_ask: tuple[str, ...] = (),
    **others: Any,
) -> Format:
    """Make a format whose files do not state the direction of their transform, so that the user must.

    `may_ask` names other options that a file may leave open; `others` are fields of `Format`.
    """
    return Format(
        name,
        f"either direction, set by --direction: {equation}",
        recognises,
        lambda source, options: apply_direction(str(source.path), read(source, options), options),
        lambda T_camera_lidar, options: make(
            apply_direction(f"{options.option('to')} {name}", T_camera_lidar, options), options
        ),
        asks=("direction", *may_ask),
        **others,
    )


def _read_array(source: Source, options: FormatOptions) -> Pose:
    if not source.content.startswith(NPY):
        raise InputError(f"{source.path}: found no NumPy array")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            array = np.load(io.BytesIO(source.content), allow_pickle=False)
    except Exception:  # NumPy parses the header as Python, which can fail in many ways.
        raise InputError(f"{source.path}: found a damaged NumPy array, expected an intact one") from None
    if not isinstance(array, np.ndarray) or array.shape not in SHAPES or array.dtype.kind not in "fiu":
        description = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else "several arrays"
        raise InputError(f"{source.path}: found {description}, expected numbers of shape (4, 4) or (3, 4)")
    if not np.isfinite(array).all():
        raise InputError(f"{source.path}: found a number that is not finite, expected a transform")
    return from_rows(str(source.path), array.astype(np.float64), options)


def _make_array(T: Pose, options: FormatOptions) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, T)
    return buffer.getvalue()


def _lines(source: Source) -> list[str]:
    """List the lines of numbers, without comments and brackets."""
    lines = (SEPARATORS.sub(" ", line.split("#")[0]) for line in source.text.splitlines())
    return [line for line in lines if line.strip()]


def _counts(source: Source) -> list[int]:
    """Count the numbers on each line; empty if the text holds anything else."""
    with suppress(InputError):
        lines = _lines(source)
        counts = [len(line.split()) for line in lines]
        parse_numbers(source.path, "", " ".join(lines), sum(counts))
        return counts
    return []


def _read_text(source: Source, options: FormatOptions) -> Pose:
    values = parse_numbers(source.path, "matrix", " ".join(_lines(source)), 12, 16)
    return from_rows(str(source.path), values, options)


def _make_text(T: Pose, options: FormatOptions) -> bytes:
    return "".join(" ".join(map(number_text, row)) + "\n" for row in T.tolist()).encode()


def _read_tum(source: Source, options: FormatOptions) -> Pose:
    lines = _lines(source)
    if len(lines) != 1:
        raise InputError(
            f"{source.path}: found {counted(len(lines), 'line')}, expected one: stamp x y z qx qy qz qw"
        )
    _, *values = parse_numbers(source.path, "line 1", lines[0], 8).tolist()
    return pose_of(str(source.path), dict(zip(TUM_NUMBERS, values, strict=True)), options)


def _make_tum(T: Pose, options: FormatOptions) -> bytes:
    values = numbers_of(T)
    return f"0.0 {' '.join(number_text(values[name]) for name in TUM_NUMBERS)}\n".encode()


ARRAY = directed_format(
    "npy",
    "a NumPy array, 4 x 4 or 3 x 4",
    lambda source: source.content.startswith(NPY),
    _read_array,
    _make_array,
)
TEXT = directed_format(
    "text",
    "4 x 4 or 3 x 4 numbers",
    lambda source: source.path.name != KITTI_360_FILE and sum(_counts(source)) in (12, 16),
    _read_text,
    _make_text,
)
TUM = directed_format(
    "tum",
    "a line, stamp x y z qx qy qz qw",
    lambda source: _counts(source) == [8],
    _read_tum,
    _make_tum,
)
