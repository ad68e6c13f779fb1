"""FAST-LIVO2's `extrin_calib`: p_camera = Rcl p_lidar + Pcl, also inside ROS 2's `/**: ros__parameters:`."""

from __future__ import annotations

from typing import Any

import numpy as np

from semcal_cli.errors import InputError
from semcal_cli.formats.documents import entry_format, under
from semcal_cli.formats.format import FormatOptions
from semcal_cli.formats.node import Node
from semcal_cli.formats.pose import checked, transform
from semcal_cli.geometry.poses import Pose

BLOCK, KEYS = "extrin_calib", {"Rcl", "Pcl"}


def _blocks(node: Node) -> list[Node]:
    """All blocks with the two keys, at any depth."""
    if not isinstance(node.value, dict):
        return []
    inner = [block for key, value in node.value.items() for block in _blocks(node.child(key, value))]
    return [node, *inner] if node.value.keys() >= KEYS else inner


def _find(document: Node, options: FormatOptions) -> Node:
    if options.is_written and not document.value:
        return under(BLOCK)(document, options)
    blocks = _blocks(document)
    if len(blocks) != 1:
        raise InputError(f"{document.where}: found {len(blocks)} blocks with Rcl and Pcl, needed one")
    return blocks[0]


class _RotationAndPlace:
    """The rotation by rows, and the translation."""

    def read(self, node: Node, options: FormatOptions) -> Pose:
        R = np.reshape(node.at("Rcl").numbers(9), (3, 3))
        return checked(node.at("Rcl").where, transform(R, node.at("Pcl").numbers(3)), options)

    def put(self, entry: dict[Any, Any], T: Pose) -> None:
        entry["Rcl"], entry["Pcl"] = T[:3, :3].ravel().tolist(), T[:3, 3].tolist()


FORMAT = entry_format(
    "fast-livo2",
    "p_camera = Rcl p_lidar + Pcl: extrin_calib",
    lambda source: bool(_blocks(Node("", source.mapping))),
    _find,
    _RotationAndPlace(),
)
