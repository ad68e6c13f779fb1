"""ROS's transforms between two named frames, p_parent = T p_child: a publisher's arguments, or a stamped message.

`static_transform_publisher` is on a command line or in an XML launch file. Its `--frame-id` is the parent,
`--child-frame-id` the child. Positional arguments, as in ROS 1, are x y z yaw pitch roll, or x y z qx qy qz qw, then
parent and child (geometry2, tf2_ros/src/static_transform_broadcaster_program.cpp).

In tf2's TransformStamped as YAML, `header.frame_id` is the parent. Apollo's extrinsics have the same layout; their
child is a camera's optical frame (apollo, modules/drivers/camera/params).
"""

from __future__ import annotations

import ast
import itertools
import re
import shlex
from dataclasses import replace
from typing import Any, NamedTuple

from semcal_cli.config.file_limits import MAX_COMMAND
from semcal_cli.errors import InputError, counted, listed
from semcal_cli.formats.format import FRAMES, Edits, Format, FormatOptions, Source
from semcal_cli.formats.frame_names import (
    CAMERA_WORDS,
    between_frames,
    from_frames,
    has_word,
    name_frames,
    with_recorded,
)
from semcal_cli.formats.node import NUMBER, Node, parse_number
from semcal_cli.formats.pose import RPY, XYZ, XYZW, NumbersNotation, number_text, numbers_of, pose_of
from semcal_cli.formats.xml_tags import start_tags
from semcal_cli.geometry.arrays import Pose

PUBLISHER = "static_transform_publisher"
DEFAULTS = dict.fromkeys((*XYZ, *XYZW, *RPY), 0.0) | {"qw": 1.0}
"""Defaults of the arguments."""
FRAME_NAMES = ("frame-id", "child-frame-id")


SUBSTITUTION = re.compile(r"\$\([^)]*\)?")
"""What a launch file computes, such as `$(var x)`."""


class Word(NamedTuple):
    """A word of a publisher's arguments, and its place in the text of the file."""

    text: str
    start: int
    end: int


def _read_command(source: Source, options: FormatOptions) -> Pose:
    where = str(source.path)
    lines = source.text.replace("\\\n", " ").splitlines()
    commands = [words for line in lines if PUBLISHER in line and PUBLISHER in (words := _words(where, line))]
    return _one_of(where, [words[words.index(PUBLISHER) + 1 :] for words in commands], options)


def _read_launch(source: Source, options: FormatOptions) -> Pose:
    nodes = [node for node in source.xml.iter("node") if PUBLISHER in (node.get("exec"), node.get("type"))]
    where = f"{source.path}: {PUBLISHER}"
    return _one_of(where, [_words(where, node.get("args", "")) for node in nodes], options)


def _one_of(where: str, publishers: list[list[str]], options: FormatOptions) -> Pose:
    """Read the transform of the only publisher, or of the only one between the requested frames."""
    return _transform(where, _choose(where, publishers, options), options)


def _choose(where: str, publishers: list[list[str]], options: FormatOptions) -> list[str]:
    if not publishers:
        raise InputError(f"{where}: found no {PUBLISHER}")
    pairs = [with_recorded(options, _frames(words)) for words in publishers]
    options = next(
        (
            pair
            for pair, words in zip(pairs, publishers, strict=True)
            if pair.camera != pair.lidar and {pair.camera, pair.lidar} <= set(_frames(words))
        ),
        options,
    )
    frame_names = {name for name in (options.camera, options.lidar) if name is not None}
    candidates = [words for words in publishers if frame_names <= set(_frames(words))]
    if not frame_names and len(publishers) > 1:
        candidates = [
            words for words in publishers if any(has_word(name, CAMERA_WORDS) for name in _frames(words))
        ]
    if len(publishers) == 1:
        candidates = publishers
    if len(candidates) != 1:
        frames = listed(" to ".join(_frames(words)) for words in publishers)
        raise InputError(
            f"{where}: found transforms {frames}; add {options.option('camera')} and {options.option('lidar')} to name "
            f"the two frames of one of them{options.hint('camera', 'lidar')}"
        )
    return candidates[0]


def _words(where: str, text: str) -> list[str]:
    if len(text) > MAX_COMMAND:
        raise InputError(
            f"{where}: found a command of {len(text):,} characters, needed at most {MAX_COMMAND:,}"
        )
    try:
        return shlex.split(text)
    except ValueError as error:
        raise InputError(f"{where}: {str(error).lower()}, expected a command line") from None


def _frames(words: list[str]) -> list[str]:
    """Find the parent and child frame, if they are given."""
    arguments = dict(zip(words[::2], words[1::2], strict=False))
    if "--frame-id" in arguments:
        return [arguments["--frame-id"], arguments.get("--child-frame-id", "")]
    return [word for word in words if not NUMBER.fullmatch(word)][:2]


def _transform(where: str, words: list[str], options: FormatOptions) -> Pose:
    arguments = _in_order(where, words) if words and NUMBER.fullmatch(words[0]) else _by_name(where, words)
    parent, child = (arguments.pop(name) for name in FRAME_NAMES)
    rotation_names = RPY if any(name in arguments for name in RPY) else XYZW
    if rotation_names is RPY and any(name in arguments for name in XYZW):
        raise InputError(f"{where}: found a quaternion and angles, expected one of them")
    values = {
        name: parse_number(f"{where}: --{name}", arguments[name]) if name in arguments else DEFAULTS[name]
        for name in (*XYZ, *rotation_names)
    }
    return from_frames(where, pose_of(where, values, options), parent, child, options)


def _in_order(where: str, words: list[str]) -> dict[str, str]:
    """Name the positional arguments of ROS 1."""
    count = next((i for i, word in enumerate(words) if not NUMBER.fullmatch(word)), len(words))
    names = {6: (*XYZ, *reversed(RPY)), 7: (*XYZ, *XYZW)}.get(count)
    if names is None or len(words) < count + 2:
        raise InputError(f"{where}: found {counted(count, 'number')}, needed 6 or 7, then parent and child")
    return dict(zip((*names, *FRAME_NAMES), words, strict=False))


def _by_name(where: str, words: list[str]) -> dict[str, str]:
    """Read the named arguments."""
    arguments: dict[str, str] = {}
    for name, value in zip(words[::2], words[1::2], strict=False):
        if name == "--ros-args":
            break
        if name.removeprefix("--") in arguments:
            raise InputError(f"{where}: {name}: found two values, expected one")
        arguments[name.removeprefix("--")] = value
    names = {*DEFAULTS, *FRAME_NAMES}
    if unknown := [name for name in arguments if name not in names]:
        needed = f"expected some of: {', '.join(sorted(names))}"
        raise InputError(f"{where}: found argument {unknown[0]!r}, {needed}")
    if missing := [name for name in FRAME_NAMES if name not in arguments]:
        raise InputError(f"{where}: found no --{missing[0]}")
    return arguments


def _new_words(where: str, words: list[str], T_camera_lidar: Pose, options: FormatOptions) -> dict[int, str]:
    """Write the numbers of a transform for a publisher, by their positions among its words."""
    is_in_order = bool(words) and NUMBER.fullmatch(words[0]) is not None
    arguments = _in_order(where, words) if is_in_order else _by_name(where, words)
    parent, child = (arguments[name] for name in FRAME_NAMES)
    T = between_frames(where, T_camera_lidar, parent, child, options)
    names = XYZ + (RPY if any(name in arguments for name in RPY) else XYZW)
    if missing := [name for name in names if name not in arguments]:
        raise InputError(f"{where}: found no --{missing[0]}, expected one, so that it can be set")
    positions = {name: index if is_in_order else 2 * index + 1 for index, name in enumerate(arguments)}
    values = numbers_of(T)
    return {positions[name]: number_text(values[name]) for name in names}


def _set_words(
    where: str, publishers: list[list[Word]], T_camera_lidar: Pose, options: FormatOptions
) -> Edits:
    """Set the transform of the only publisher, or of the only one between the requested frames."""
    texts = [[word.text for word in words] for words in publishers]
    chosen = _choose(where, texts, options)
    if computed := SUBSTITUTION.search(" ".join(chosen)):
        raise InputError(
            f"{where}: found {computed[0]}, which the launch file computes; state numbers and names in its place"
        )
    words = publishers[texts.index(chosen)]
    new = _new_words(where, chosen, T_camera_lidar, options)
    return [(words[index].start, words[index].end, text) for index, text in new.items()]


def _words_at(text: str, start: int, end: int) -> list[Word]:
    """Find the words of a part of a text, without quotes and the backslashes at the ends of lines."""
    matches = re.compile(r"\"[^\"]*\"|'[^']*'|(?:(?!\\\n)[^\s\"'])+").finditer(text, start, end)
    return [
        Word(match[0].strip("\"'"), match.start() + quotes, match.end() - quotes)
        for match in matches
        for quotes in [int(match[0][0] in "\"'")]
    ]


def _edit_command(source: Source, T_camera_lidar: Pose, _: str | None, options: FormatOptions) -> Edits:
    publishers = []
    for line in re.finditer(r"(?:[^\n]|(?<=\\)\n)+", source.text):
        words = _words_at(source.text, *line.span())
        names = [word.text for word in words]
        if PUBLISHER in names:
            publishers.append(words[names.index(PUBLISHER) + 1 :])
    return _set_words(str(source.path), publishers, T_camera_lidar, options)


def _edit_launch(source: Source, T_camera_lidar: Pose, _: str | None, options: FormatOptions) -> Edits:
    places = [
        tag.attribute("args")
        for tag in start_tags(source)
        if tag.name == "node" and PUBLISHER in (tag.attributes.get("exec"), tag.attributes.get("type"))
    ]
    publishers = [_words_at(source.text, *place) for place in places if place is not None]
    return _set_words(f"{source.path}: {PUBLISHER}", publishers, T_camera_lidar, options)


def _launch_words(source: Source) -> list[list[Word]]:
    """Find the arguments of the publishers of a launch file in Python, which is parsed and not run."""
    where = f"{source.path}: {PUBLISHER}"
    try:
        tree = ast.parse(source.text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise InputError(f"{source.path}: is not well-formed Python, expected a launch file") from None
    content = source.text.encode()
    # Bytes are split into lines where Python splits them; a text is split at more characters.
    begins = [0, *itertools.accumulate(map(len, content.splitlines(keepends=True)))]
    publishers = []
    for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        fields = {keyword.arg: keyword.value for keyword in call.keywords}
        name = fields.get("executable", fields.get("node_executable"))
        if not isinstance(name, ast.Constant) or name.value != PUBLISHER:
            continue
        listed_words = fields.get("arguments")
        words = []
        for item in listed_words.elts if isinstance(listed_words, ast.List) else [None]:
            if not isinstance(item, ast.Constant) or not isinstance(item.value, str):
                raise InputError(f"{where}: found arguments that are computed, expected a list of texts")
            start, end = (
                len(content[: begins[line - 1] + column].decode())
                for line, column in (
                    (item.lineno, item.col_offset),
                    (item.end_lineno or 0, item.end_col_offset or 0),
                )
            )
            words.append(Word(item.value, start + 1, end - 1))
        publishers.append(words)
    return publishers


def _read_launch_py(source: Source, options: FormatOptions) -> Pose:
    publishers = [[word.text for word in words] for words in _launch_words(source)]
    return _one_of(f"{source.path}: {PUBLISHER}", publishers, options)


def _edit_launch_py(source: Source, T_camera_lidar: Pose, _: str | None, options: FormatOptions) -> Edits:
    return _set_words(f"{source.path}: {PUBLISHER}", _launch_words(source), T_camera_lidar, options)


def _is_launch_py(source: Source) -> bool:
    return (
        PUBLISHER in source.start
        and re.search(r"^\s*(import|from)\s+\w", source.start, re.MULTILINE) is not None
    )


def _arguments(T_camera_lidar: Pose, options: FormatOptions) -> str:
    T, parent, camera = name_frames(T_camera_lidar, options)
    values = numbers_of(T)
    arguments = [f"--{name} {number_text(values[name])}" for name in (*XYZ, *XYZW)]
    return " ".join([*arguments, f"--frame-id {shlex.quote(parent)} --child-frame-id {shlex.quote(camera)}"])


def _make_command(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
    return f"ros2 run tf2_ros {PUBLISHER} {_arguments(T_camera_lidar, options)}\n".encode()


def _make_launch(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
    from xml.sax.saxutils import quoteattr  # imports HTTP and TLS, which takes 6 ms

    arguments = quoteattr(_arguments(T_camera_lidar, options))
    node = f'<node pkg="tf2_ros" exec="{PUBLISHER}" args={arguments}/>'
    return f"<launch>\n  {node}\n</launch>\n".encode()


COMMAND = Format(
    "ros2-static-transform",
    "p_parent = T p_child: --x --y --z --qx --qy --qz --qw --frame-id LIDAR --child-frame-id CAMERA",
    lambda source: (
        PUBLISHER in source.start and not source.start.startswith("<") and not _is_launch_py(source)
    ),
    _read_command,
    _make_command,
    asks=FRAMES,
    edit=_edit_command,
)
LAUNCH = Format(
    "ros2-launch",
    "p_parent = T p_child: a node of static_transform_publisher in an XML launch file",
    lambda source: source.looks_like_xml("launch"),
    _read_launch,
    _make_launch,
    asks=FRAMES,
    edit=_edit_launch,
)
LAUNCH_PY = Format(
    "ros2-launch-py",
    "p_parent = T p_child: a Node of static_transform_publisher in a Python launch file, which is read and set",
    _is_launch_py,
    _read_launch_py,
    asks=FRAMES,
    edit=_edit_launch_py,
)

STAMPED_POSE = NumbersNotation({"translation": XYZ, "rotation": XYZW}, are_named=True)


def _stamped_frames(document: Node) -> tuple[str, str]:
    """Read the names of the parent and the child."""
    return document.at("header").at("frame_id").text(), document.at("child_frame_id").text()


def _read_stamped(source: Source, options: FormatOptions) -> Pose:
    document = source.node
    T_parent_child = STAMPED_POSE.read(document.at("transform"), options)
    return from_frames(document.where, T_parent_child, *_stamped_frames(document), options)


def _read_apollo(source: Source, options: FormatOptions) -> Pose:
    _, child = _stamped_frames(source.node)
    frame = options.frame or "optical"
    return _read_stamped(source, replace(options, camera=options.camera or child, frame=frame))


def _make_stamped(T_camera_lidar: Pose, options: FormatOptions) -> dict[str, Any]:
    T, parent, camera = name_frames(T_camera_lidar, options)
    transform: dict[str, Any] = {}
    STAMPED_POSE.put(transform, T)
    return {"header": {"frame_id": parent}, "child_frame_id": camera, "transform": transform}


TF2 = Format(
    "tf2",
    "p_parent = T p_child: header.frame_id, child_frame_id, transform.translation, transform.rotation (x y z w)",
    lambda source: {"header", "child_frame_id", "transform"} <= source.mapping.keys(),
    _read_stamped,
    _make_stamped,
    asks=FRAMES,
)
APOLLO = replace(
    TF2,
    name="apollo",
    equation="p_parent = T p_child as in tf2; the child is a camera's optical frame",
    # The layout is that of tf2, which reads the file wherever the names show which frame is the camera's.
    recognises=lambda source: False,
    read=_read_apollo,
)
