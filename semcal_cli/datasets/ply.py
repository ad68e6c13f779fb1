"""Columns of a PLY's vertices, for the data sets whose clouds have to be converted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy.typing as npt

from semcal_cli.errors import InputError


def read_vertices(path: Path) -> npt.NDArray[Any]:
    """Read the vertices, a structured array (N,).

    Raises:
        InputError: there is no such file, it is no PLY, or has no vertices.
    """
    from plyfile import PlyData, PlyParseError  # type: ignore[import-untyped]

    try:
        vertices: npt.NDArray[Any] = PlyData.read(path)["vertex"].data
    except OSError as error:
        raise InputError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    except KeyError:
        raise InputError(f"{path}: found no vertices, needed some") from None
    except (PlyParseError, ValueError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: found no PLY that can be read: {error}") from None
    return vertices


def vertex_column(path: Path, vertices: npt.NDArray[Any], name: str, dtype: type) -> npt.NDArray[Any]:
    """Give one property of all vertices (N,).

    Raises:
        InputError: there is no such property.
    """
    names = vertices.dtype.names or ()
    if name not in names:
        raise InputError(f"{path}: found properties {', '.join(names)}, needed {name}")
    return vertices[name].astype(dtype)
