"""Formats of YAML and JSON documents: an entry that holds one pose, or two entries with poses on one base."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from semcal_cli.drive.camera import Camera
from semcal_cli.errors import InputError
from semcal_cli.formats.format import Format, FormatOptions, Source
from semcal_cli.formats.node import Node
from semcal_cli.formats.pose import Notation
from semcal_cli.geometry.poses import Pose, inverse

Find: TypeAlias = Callable[[Node, FormatOptions], Node]
"""Finds the entry of a document that holds the pose, and adds it to a document that is written anew."""
SetLens: TypeAlias = Callable[[dict[str, Any], Camera, FormatOptions, bool], None]
"""Sets the intrinsics in the entry of a camera, which may be of a new file."""


def document_of(source: Source) -> Node:
    """Make the node of a file's document."""
    return Node(str(source.path), source.document)


def under(*keys: str) -> Find:
    """Find the entry under some keys."""

    def find(document: Node, options: FormatOptions) -> Node:
        for key in keys:
            if options.is_written:
                document.mapping.setdefault(key, {})
            document = document.at(key)
        return document

    return find


def entry_format(
    name: str,
    equation: str,
    recognises: Callable[[Source], bool],
    find: Find,
    notation: Notation,
    *,
    maps_camera: bool = False,
    set_lens: SetLens | None = None,
    **others: Any,
) -> Format:
    """Make the format of documents with one entry that holds T_camera_lidar or, if it maps the camera, its inverse.

    Intrinsics are set by `set_lens` in the same entry. The others are fields of `Format`.
    """

    def read(source: Source, options: FormatOptions) -> Pose:
        T = notation.read(find(document_of(source), options), options)
        return inverse(T) if maps_camera else T

    def put(document: Any, T_camera_lidar: Pose, options: FormatOptions) -> None:
        is_new = not document
        entry = find(Node(str(options.file), document), options).mapping
        notation.put(entry, inverse(T_camera_lidar) if maps_camera else T_camera_lidar)
        if set_lens is not None and options.intrinsics is not None:
            set_lens(entry, options.intrinsics, options, is_new)

    return Format(name, equation, recognises, read, put=put, **others)


class Pair(NamedTuple):
    """The entries of a camera and a LiDAR."""

    camera: Node
    lidar: Node
    T_frame_optical: Pose = np.eye(4)
    """(4, 4) from the camera's optical frame to the frame of its entry."""


def base_format(
    name: str,
    equation: str,
    recognises: Callable[[Source], bool],
    find: Callable[[Node, FormatOptions], Pair],
    notation: Notation,
    *,
    base: str,
    file: str,
    asks: tuple[str, ...],
) -> Format:
    """Make the format of documents with the poses of sensors on a base, p_base = T p_sensor.

    A new file cannot be made, since poses of camera and LiDAR mean something only beside each other: the complaint
    names the base, and the files that a transform can be put into.
    """

    def read(source: Source, options: FormatOptions) -> Pose:
        pair = find(document_of(source), options)
        T_base_optical = notation.read(pair.camera, options) @ pair.T_frame_optical
        return inverse(T_base_optical) @ notation.read(pair.lidar, options)

    def make(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
        needed = f"needed --into a {file} with the LiDAR's own entry"
        raise InputError(f"--to {name}: poses are relative to the {base}, {needed}")

    def put(document: Any, T_camera_lidar: Pose, options: FormatOptions) -> None:
        pair = find(Node(str(options.file), document), options)
        T_base_optical = notation.read(pair.lidar, options) @ inverse(T_camera_lidar)
        notation.put(pair.camera.mapping, T_base_optical @ inverse(pair.T_frame_optical))

    return Format(name, equation, recognises, read, make, put, asks)
