"""A transform set in a file that is there already. Only its numbers change: comments, order and layout stay.

A document gets it under a key, in the notation that the value has. URDF, launch files and KITTI's calibrations know
their own place. What is written is read again: the transform must be the same, and the rest of a document as it was.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from semcal_cli.drive.frame_ids import FrameIds
from semcal_cli.errors import InputError, describe, listed
from semcal_cli.files.documents import FORMATS as DOCUMENTS, parse_any
from semcal_cli.files.validation import key_part
from semcal_cli.formats import urdf
from semcal_cli.formats.format import Format, FormatOptions, Source, edited
from semcal_cli.formats.frame_names import apply_direction, optical_axes
from semcal_cli.formats.node import Node
from semcal_cli.formats.opencv import blank_storage, is_storage
from semcal_cli.formats.pose import RPY, XYZ, XYZW, number_text, numbers_of
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse

TOLERANCE = 1e-6
"""Largest difference of a number that is read again: numbers are written with nine decimals."""
TRANSLATIONS = (
    "translation",
    "position",
    "xyz",
    "t",
    "T",
    "trans",
    "origin",
    "Pcl",
    "extrinsic_T",
    "extrinsic_t",
)
ROTATIONS = ("rotation", "orientation", "quaternion", "rpy", "R", "rot", "Rcl", "extrinsic_R", "extrinsic_r")
"""Names of the two parts of a transform."""
MATRIX = "data"
"""Key of the numbers in a matrix of OpenCV or ROS."""
NEEDED = (
    "needed 3 x 4 or 4 x 4 numbers, x y z with roll pitch yaw or qx qy qz qw, or a translation and a rotation"
)


LOADERS = (*((yaml.CSafeLoader,) if yaml.__with_libyaml__ else ()), yaml.SafeLoader)
"""libyaml's loader, which takes a tenth of the time, and PyYAML's own, which also reads surrogates in JSON."""
DEGREES = {"deg", "degs", "degree", "degrees"}
"""Words for the unit of angles that are not written."""


class _Number(NamedTuple):
    """A number in a document."""

    node: Any
    """The scalar of YAML that holds it."""
    value: float
    """The value that it gets."""
    is_angle: bool = False


def format_of(source: Source, key: str | None, formats: Sequence[Format]) -> Format | None:
    """Choose the format as which a file is edited; None for a document that gets the transform under a key."""
    if source.path.suffix.lower() in DOCUMENTS:
        on_base = [
            format for format in formats if format.set_camera is not None and format.recognises(source)
        ]
        return on_base[0] if on_base else None
    # Only the joints of a URDF have names; elsewhere a key leads into a document.
    editable = [format for format in formats if format.edit is not None and format.recognises(source)]
    return editable[0] if editable and (key is None or editable[0] is urdf.FORMAT) else None


def set_transform(
    T_camera_lidar: Pose, source: Source, format: Format | None, key: str | None, options: FormatOptions
) -> bytes:
    """Set a transform in a file, and return the content of the new file.

    Args:
        T_camera_lidar: (4, 4), p_camera = T_camera_lidar @ p_lidar, metres.
        source: The file.
        format: Its format, if it is known and files of it are edited; None for a document.
        key: Keys that lead to the transform in a document, such as `sensors.front.T`, or the name of a joint of a URDF.
        options: What the file leaves open: the names of the frames, or the direction under the key.

    Raises:
        InputError: the file has no place for a transform, or leaves something open.
    """
    if format is not None and format.edit is not None:
        content = edited(source, format.edit(source, T_camera_lidar, key, options))
    elif format is not None and format.set_camera is not None:
        entry, T = format.set_camera(source, T_camera_lidar, options)
        if key is not None:
            raise InputError(f"{source.path}: found {format.name}, whose entries have names; leave out --key")
        content = _set_in_document(T, source, next(_paths_to(entry, source.document)), options)
    else:
        if key is None:
            raise InputError(f"{source.path}: add --key with the keys of the transform, such as a.b.T")
        path = _resolve(Node(str(source.path), parse_any(_standard(source), source.path)), key)
        T = T_camera_lidar
        if options.frame is not None:
            T = optical_axes(str(source.path), "", options) @ T
        return _set_in_document(apply_direction(f"{source.path}: {key}", T, options), source, path, options)
    again = format.read(Source(source.path, content), replace(options, is_written=False))
    if not np.allclose(again, T_camera_lidar, rtol=0.0, atol=TOLERANCE):
        raise InputError(
            f"{source.path}: the transform cannot be set; add {options.option('to')} {format.name} and a new file"
        )
    return content


def set_on_base(
    T_camera_lidar: Pose, source: Source, format: Format | None, key: str | None, options: FormatOptions
) -> bytes:
    """Set the transform from the vehicle's frame, `options.base`, as `set_transform` sets that from the LiDAR.

    Raises:
        InputError: the file holds the pose of the LiDAR itself or knows no other frame, or see `set_transform`.
    """
    base = options.base
    assert base is not None
    if format is not None and (format.edit is None or "lidar" not in format.asks):
        why = "in which no frame is the vehicle's"
        if format.set_camera is not None:
            why = "whose file states the pose of the LiDAR itself"
        raise InputError(f"{source.path}: found {format.name}, {why}; leave out {options.option('base')}")
    frames = FrameIds(camera=None if options.frame_ids is None else options.frame_ids.camera)
    named = replace(options, base=None, lidar=base.name, frame_ids=frames)
    try:
        return set_transform(T_camera_lidar @ inverse(base.T_base_lidar), source, format, key, named)
    except InputError as error:
        own, vehicle = options.option("lidar"), options.option("base_frame")
        line = str(error).replace(f"{own} to name the LiDAR's own", f"{vehicle} to name the vehicle's")
        raise type(error)(line) from None


def _set_in_document(T: Pose, source: Source, path: list[Any], options: FormatOptions) -> bytes:
    """Write a transform as it is under a path of keys."""
    where = f"{source.path}: {''.join(map(key_part, path)).removeprefix('.')}"
    numbers = _numbers(where, _place(where, source, path), T)
    has_angles = any(number.is_angle for number in numbers)
    if has_angles:
        _refuse_degrees(Node(str(source.path), parse_any(_standard(source), source.path)), path)
    content = edited(
        source,
        [(node.start_mark.index, node.end_mark.index, number_text(value)) for node, value, _ in numbers],
    )
    before, after = (
        parse_any(_standard(each), source.path) for each in (source, Source(source.path, content))
    )
    if _without(before, path) != _without(after, path):
        raise InputError(f"{where}: the transform cannot be set without changing more than it")
    again = _numbers(where, _place(where, Source(source.path, content), path), T)
    if not all(abs(float(node.value) - value) <= TOLERANCE for node, value, _ in again):
        raise InputError(f"{where}: the transform cannot be set; other numbers are read back")
    if has_angles:
        options.note(f"{where}: angles are written in radians")
    return content


def _place(where: str, source: Source, path: list[Any]) -> Any:
    """Find the YAML node under a path of keys, which are compared by what they stand for, such as true or 1.5."""
    node = _composed(source)
    for key in path:
        if isinstance(node, yaml.SequenceNode):
            node = node.value[key]
        else:
            # What a key stands for is parsed, which takes long: a text stands for itself or for something else.
            named = [entry for entry in node.value if not isinstance(key, str) or entry[0].value == key]
            values = [value for name, value in named if _value(name) == key]
            if len(values) != 1:
                raise InputError(f"{where}: found no such key in the text, expected it without escapes")
            node = values[0]
    return node


def _composed(source: Source) -> Any:
    """Compose the YAML nodes of a document, which have places in its text, by libyaml or at least by PyYAML itself."""
    for loader in LOADERS:
        with suppress(yaml.YAMLError):
            return yaml.compose(_standard(source), Loader=loader)
    # A document of JSON may break the line between a key and its colon.
    needed = "expected each key and its colon on one line"
    raise InputError(f"{source.path}: found JSON that is no YAML, {needed}")


def _refuse_degrees(document: Node, path: list[Any]) -> None:
    """Refuse a place for angles if an entry of it, or beside what holds it, says that angles are in degrees."""
    for key, entry in _entries_around(document, path):
        is_unit = isinstance(entry.value, str) and entry.value.lower() in DEGREES
        is_switch = entry.value is True and not DEGREES.isdisjoint(re.split(r"[^a-z]+", str(key).lower()))
        if is_unit or is_switch:
            raise entry.mismatch("radians, in which angles are written")


def _entries_around(node: Node, path: list[Any]) -> Iterator[tuple[Any, Node]]:
    """Go through the entries of all mappings that lead to a place, and of those in it."""
    if isinstance(node.value, dict):
        entries = {key: node.child(key, value) for key, value in node.value.items()}
        yield from entries.items()
        if not path:
            for entry in entries.values():
                yield from _entries_around(entry, path)
    if path:
        yield from _entries_around(node.child(path[0], node.value[path[0]]), path[1:])


def _paths_to(value: Any, document: Any) -> Iterator[list[Any]]:
    """Find the keys that lead to a value of a document, which is the same object."""
    if document is value:
        yield []
    elif isinstance(document, dict | list):
        items = document.items() if isinstance(document, dict) else enumerate(document)
        for key, part in items:
            yield from ([key, *path] for path in _paths_to(value, part))


def _standard(source: Source) -> str:
    """Return the text of a document as the YAML parser takes it, with all numbers in their places."""
    text = blank_storage(source.text) if is_storage(source.text) else source.text
    return text.replace("\t", " ") if source.path.suffix.lower() == ".json" else text


def _resolve(node: Node, key: str) -> list[Any]:
    """Find the keys and indices that a text such as `a.b[0].c` means; keys may hold dots themselves."""
    path: list[Any] = []
    rest = key
    while rest:
        choices: Mapping[Any, Any] = {}
        if isinstance(node.value, dict):
            choices = node.value
        elif isinstance(node.value, list):
            choices = dict(enumerate(node.value))
        is_list = isinstance(node.value, list)
        names = {f"[{name}]" if is_list else _key_text(name): name for name in choices}
        matching = [name for name in names if rest == name or rest.startswith((f"{name}.", f"{name}["))]
        if not matching:
            found = f"keys {listed(names)}" if names else describe(node.value)
            raise InputError(f"{node.where}: found {found}, expected the key {rest!r}")
        name = max(matching, key=len)
        path.append(names[name])
        node = node.child(names[name], choices[names[name]])
        rest = rest[len(name) :].removeprefix(".")
    return path


def _key_text(key: Any) -> str:
    """Write a key as it is written in YAML, such as true or null."""
    return key if isinstance(key, str) else json.dumps(key)


def _without(document: Any, path: list[Any]) -> Any:
    """Empty the value under a path of keys, in a document that nothing else uses."""
    container = document
    for key in path[:-1]:
        container = container[key]
    container[path[-1]] = None
    return document


def _numbers(where: str, node: Any, T: Pose) -> list[_Number]:
    """Pair the scalars of a value with the numbers of a transform, in the notation of the value."""
    if isinstance(node, yaml.MappingNode):
        entries = {name.value: value for name, value in node.value}
        if MATRIX in entries:
            _check_columns(where, entries, 4)
            return _numbers(where, entries[MATRIX], T)
        # Beside w, x y z are those of a quaternion, and the translation is elsewhere.
        is_quaternion = entries.keys() >= {*XYZ, "w"}
        if XYZ[0] in entries and not is_quaternion:
            return [*_named(where, entries, T, XYZ), *_rotation(where, node, T)]
        translations, rotations = (
            [(f"{where}{key_part(name)}", entries[name]) for name in names if name in entries]
            for names in (TRANSLATIONS, ROTATIONS)
        )
        if is_quaternion:
            rotations.append((where, node))
        if len(translations) == len(rotations) == 1:
            if other := next((name for name in entries if len(_scalars(entries[name])) in (12, 16)), None):
                raise InputError(
                    f"{where}: found {other!r} beside the transform; remove it, since it would not be set"
                )
            return [*_translation(*translations[0], T), *_rotation(*rotations[0], T)]
        raise InputError(f"{where}: found {listed(entries)}, {NEEDED}")
    scalars = _scalars(node)
    if len(scalars) in (12, 16) and _is_matrix(node, 4):
        if any(float(number.value) for number in scalars[12:15]):
            last = " ".join(number.value for number in scalars[12:])
            raise InputError(f"{where}: found the last row {last}, needed 0 0 0 1")
        return list(map(_Number, scalars, T.ravel().tolist()))
    raise InputError(f"{where}: found {describe(_value(node))}, {NEEDED}")


def _check_columns(where: str, entries: Mapping[str, Any], columns: int) -> None:
    """Check the number of columns that a matrix states."""
    if "cols" in entries and _value(entries["cols"]) != columns:
        raise InputError(f"{where}: found {entries['cols'].value} columns, needed {columns}")


def _translation(where: str, node: Any, T: Pose) -> list[_Number]:
    if isinstance(node, yaml.MappingNode):
        return _named(where, {name.value: value for name, value in node.value}, T, XYZ)
    scalars = _scalars(node)
    if len(scalars) != 3:
        raise InputError(f"{where}: found {describe(_value(node))}, expected three numbers")
    return list(map(_Number, scalars, T[:3, 3].tolist()))


def _rotation(where: str, node: Any, T: Pose) -> list[_Number]:
    """Pair the numbers of a rotation: nine by rows, named angles, or a quaternion whose parts have names."""
    if isinstance(node, yaml.MappingNode):
        entries = {name.value: value for name, value in node.value}
        if MATRIX in entries:
            _check_columns(where, entries, 3)
            return _rotation(where, entries[MATRIX], T)
        stated = [names for names in (RPY, XYZW) if all(name in entries for name in names)]
        if len(stated) > 1:
            raise InputError(f"{where}: found angles and a quaternion; remove one, which would not be set")
        if stated:
            return _named(where, entries, T, stated[0])
        if "w" in entries:
            return _named(where, {f"q{name}": value for name, value in entries.items()}, T, XYZW)
        raise InputError(f"{where}: found {listed(entries)}, expected {' '.join(RPY)}, or {' '.join(XYZW)}")
    scalars = _scalars(node)
    if len(scalars) == 9:
        return list(map(_Number, scalars, T[:3, :3].ravel().tolist()))
    if len(scalars) == 3 and where.endswith("rpy"):
        return _named(where, dict(zip(RPY, scalars, strict=True)), T, RPY)
    needed = "expected nine numbers, or roll pitch yaw or the parts of a quaternion by their names"
    raise InputError(f"{where}: found {describe(_value(node))}, {needed}")


def _named(where: str, entries: Mapping[str, Any], T: Pose, names: tuple[str, ...]) -> list[_Number]:
    values = numbers_of(T)
    if missing := [name for name in names if name not in entries]:
        raise InputError(f"{where}: found {listed(entries)}, expected {missing[0]!r}, too")
    for name in names:
        if _scalars(entries[name]) != [entries[name]]:
            raise InputError(f"{where}: {name}: found {describe(_value(entries[name]))}, expected a number")
        if name in RPY and abs(float(entries[name].value)) > 2.0 * np.pi:
            raise InputError(f"{where}: {name}: found {entries[name].value}, expected radians")
    return [_Number(entries[name], values[name], name in RPY) for name in names]


def _scalars(node: Any) -> list[Any]:
    """List the numbers of a value in their order; nothing if it holds anything else."""
    if isinstance(node, yaml.ScalarNode):
        return [node] if isinstance(_value(node), int | float) else []
    items = [_scalars(item) for item in node.value] if isinstance(node, yaml.SequenceNode) else []
    return [*chain(*items)] if all(items) else []


def _is_matrix(node: Any, columns: int) -> bool:
    rows = node.value
    return all(isinstance(row, yaml.ScalarNode) for row in rows) or all(
        isinstance(row, yaml.SequenceNode) and len(_scalars(row)) == columns for row in rows
    )


def _value(node: Any) -> Any:
    """Return what a node stands for, as semcal reads YAML."""
    if isinstance(node, yaml.ScalarNode):
        is_plain = not node.style  # libyaml has an empty style, PyYAML none
        return parse_any(node.value, Path("value.yaml")) if is_plain else node.value
    if isinstance(node, yaml.SequenceNode):
        return [_value(item) for item in node.value]
    return {name.value: _value(value) for name, value in node.value}
