"""Mutations of a document: of its values, of the words of its text, and of its bytes.

Bytes that are changed blindly seldom stay a document. These mutations change one to three places of it and write it
again, so that it gets past the parser to the checks of values.
"""

from __future__ import annotations

import json
import math
import random
import re
from collections.abc import Callable
from typing import Any

import yaml

Node = dict[Any, Any] | list[Any]
WORD = re.compile(rb"[-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?|[A-Za-z_]+")
VALUES: tuple[Any, ...] = (
    *(None, True, 0, -1, 2, 256, 65536, 2**63, -(2**63), 10**400),
    *(0.0, -0.0, 0.5, 1e-320, 1.0000001, 1e10, 1e154, 1e308, -1e308, math.nan, math.inf),
    *("", "\0", "\n", "\x1b[31m", "\U0001f600", "\ud800", "no", "1:30", "1e5", "~", "..", "/", "../../etc"),
    *("camera", "velodyne", "points/a.bin", "a" * 300, "../" * 100),
    *([], {}, [[]], {"": {}}, [0] * 3, [0.0] * 4, [[0.0] * 4] * 4, {"data": [1, 2]}),
)
WORDS = (
    *b"nan -inf 1e308 1e400 1e-320 0 -1 1_0 0x10 99999999999999999999 : ' \" < & # camera lidar".split(),
    *(b"9" * 400, b"\xff", b"\0", b"\n", b"\r", b"\x1b[0m"),
    *(character.encode() for character in "\u0665\u2028\x85\ufeff"),
)


def mutate(data: bytes, max_size: int, seed: int, mutate_bytes: Callable[[bytes, int], bytes]) -> bytes:
    """Change a document somewhere."""
    random_ = random.Random(seed)
    way = random_.random()
    changed = None
    if way < 0.5:
        changed = _change_document(data, random_)
    if changed is None and way < 0.8:
        changed = _change_words(data, random_)
    if changed is None or len(changed) > max_size:
        changed = mutate_bytes(data, max_size)
    return changed


def _change_document(data: bytes, random_: random.Random) -> bytes | None:
    """Change values; None if the bytes are no document of several values."""
    lines = data.splitlines()
    if len(lines) > 1 and all(line.startswith(b"{") for line in lines):
        chosen = random_.randrange(len(lines))
        changed = _change_document(lines[chosen], random_)
        return None if changed is None else b"\n".join([*lines[:chosen], changed, *lines[chosen + 1 :], b""])
    try:
        is_json = data.startswith((b"{", b"["))
        document = json.loads(data) if is_json else yaml.load(data, yaml.CSafeLoader)
    except (ValueError, RecursionError, yaml.YAMLError, AttributeError, TypeError):
        return None
    if not isinstance(document, dict | list):
        return None
    for _ in range(random_.randint(1, 3)):
        _change(document, random_)
    try:
        way = 0.0 if is_json else random_.random()
        if way < 0.7:  # JSON is read much faster than YAML; with a blank before it, it is read as YAML.
            return (" " if way > 0.6 else "").encode() + json.dumps(document).encode()
        return yaml.dump(document, Dumper=yaml.CSafeDumper, default_flow_style=None, sort_keys=False).encode()
    except (ValueError, TypeError, RecursionError, yaml.YAMLError):
        return None


def _change(document: Node, random_: random.Random) -> None:
    nodes = _nodes(document)
    node = random_.choices(nodes, [len(node) + 1 for node in nodes])[0]
    places = list(node) if isinstance(node, dict) else list(range(len(node)))
    value = _copy(random_.choice(VALUES))
    if not places:
        if isinstance(node, dict):
            node[random_.choice(("", "x", "camera"))] = value
        else:
            node.append(value)
        return
    place, other = random_.choice(places), random_.choice(places)
    match random_.randrange(7):
        case 0 | 1:
            node[place] = value
        case 2:
            node[place] = _nearby(node[place], random_)
        case 3:
            del node[place]
        case 4:
            node[place], node[other] = _copy(random_.choice(nodes)), node[place]
        case 5:
            for _ in range(random_.choice((1, 2, 100))):
                node[place] = [node[place]] if random_.random() < 0.5 else {"a": node[place]}
        case _ if isinstance(node, dict):
            keys = [str(key) for each in nodes if isinstance(each, dict) for key in each]
            node[random_.choice((*keys, f"{place}x", str(place)[:-1], "", 1, None, "\x1b"))] = node.pop(place)
        case _:
            node.insert(place, _copy(node[place]))


def _nodes(document: Node) -> list[Node]:
    """All mappings and lists of a document."""
    found: list[Node] = [document]
    for node in found:
        children = node.values() if isinstance(node, dict) else node
        found.extend(child for child in children if isinstance(child, dict | list))
        if len(found) > 10_000:
            break
    return found


def _copy(value: Any) -> Any:
    return json.loads(json.dumps(value, default=str)) if isinstance(value, dict | list) else value


def _nearby(value: Any, random_: random.Random) -> Any:
    """A number a little off, or in another unit; of a text another one."""
    if isinstance(value, str):
        return random_.choice((value + value, value[:-1], value + "\n", value.upper(), value + "\0", [value]))
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300:
        return random_.choice(
            (value + 1, value + 5e-4, round(value, 3), -value, value * 1000, value * 1.0001)
        )
    return not value


def _change_words(data: bytes, random_: random.Random) -> bytes:
    """Change words, or repeat, drop or swap lines."""
    for _ in range(random_.randint(1, 3)):
        if random_.random() < 0.3:
            lines = data.splitlines(keepends=True) or [b""]
            chosen, other = random_.randrange(len(lines)), random_.randrange(len(lines))
            lines[chosen : chosen + 1] = random_.choice(
                ([], [lines[chosen]] * 2, [lines[other]], [lines[chosen].rstrip()], [lines[chosen], b"\r\n"])
            )
            data = b"".join(lines)
            continue
        words = list(WORD.finditer(data))
        if not words:
            return data + random_.choice(WORDS)
        word = random_.choice(words)
        new = random_.choice((*WORDS, random_.choice(words).group(), word.group() + b" " + word.group(), b""))
        data = data[: word.start()] + new + data[word.end() :]
    return data
