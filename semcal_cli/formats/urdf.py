"""URDF: fixed joints between the LiDAR's link and the camera's, each p_parent = T p_child by `<origin xyz rpy>`."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from functools import reduce

import numpy as np

from semcal_cli.errors import InputError, listed
from semcal_cli.formats.format import FRAMES, Format, FormatOptions, Source
from semcal_cli.formats.frame_names import camera_and_lidar, name_frames, optical_axes
from semcal_cli.formats.node import parse_numbers
from semcal_cli.formats.pose import RPY, XYZ, numbers_of, pose_of
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse


def _links(joint: ET.Element) -> tuple[str, str]:
    """Read the names of the parent and the child of a joint."""
    parent, child = (
        "" if end is None else end.get("link", "") for end in map(joint.find, ("parent", "child"))
    )
    return parent, child


def _read(source: Source, options: FormatOptions) -> Pose:
    where = str(source.path)
    joints = [joint for joint in source.xml.iter("joint") if all(_links(joint))]
    for pair, count in Counter(frozenset(_links(joint)) for joint in joints).items():
        if count > 1:
            raise InputError(f"{where}: found several joints between {listed(sorted(pair))}, expected one")
    links = list(dict.fromkeys(link for joint in joints for link in _links(joint)))
    camera, lidar = camera_and_lidar(where, "links", links, options, prefers_optical=True)
    return inverse(_between(source, joints, lidar, camera) @ optical_axes(where, camera, options))


def _between(source: Source, joints: list[ET.Element], start: str, end: str) -> Pose:
    """Chain the joints from one link to another: T_start_end (4, 4)."""
    neighbours: dict[str, list[tuple[str, ET.Element]]] = {}
    for joint in joints:
        parent, child = _links(joint)
        neighbours.setdefault(parent, []).append((child, joint))
        neighbours.setdefault(child, []).append((parent, joint))
    predecessors: dict[str, tuple[str, ET.Element]] = {}
    for link in (queue := [start]):
        for other, joint in neighbours.get(link, ()):
            if other != start and other not in predecessors:
                queue.append(other)
                predecessors[other] = link, joint
    if end not in predecessors:
        raise InputError(f"{source.path}: found no chain of joints from {start!r} to {end!r}")
    steps, link = [], end
    while link != start:
        before, joint = predecessors[link]
        if (kind := joint.get("type", "fixed")) != "fixed":
            name = joint.get("name", "")
            raise InputError(
                f"{source.path}: joint {name!r}: found type {kind!r} between camera and LiDAR, expected 'fixed'"
            )
        T = _origin(source, joint)
        steps.append(T if link == _links(joint)[1] else inverse(T))
        link = before
    return reduce(np.matmul, reversed(steps), np.eye(4))


def _origin(source: Source, joint: ET.Element) -> Pose:
    """Read T_parent_child of a joint."""
    origin, key = joint.find("origin"), f"joint {joint.get('name', '')!r}"
    attributes = {} if origin is None else origin.attrib
    values: dict[str, float] = {}
    for name, names in (("xyz", XYZ), ("rpy", RPY)):
        numbers = parse_numbers(source.path, f"{key}: {name}", attributes.get(name, "0 0 0"), 3)
        values.update(zip(names, numbers.tolist(), strict=True))
    return pose_of(f"{source.path}: {key}", values, FormatOptions())


def _make(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
    T, lidar, camera = name_frames(T_camera_lidar, options)
    values = numbers_of(T)
    translation, angles = (" ".join(repr(values[name]) for name in names) for names in (XYZ, RPY))
    joint = ET.Element("joint", name=f"{camera}_joint", type="fixed")
    ET.SubElement(joint, "parent", link=lidar)
    ET.SubElement(joint, "child", link=camera)
    ET.SubElement(joint, "origin", xyz=translation, rpy=angles)
    ET.indent(joint)
    return (ET.tostring(joint, encoding="unicode") + "\n").encode()


FORMAT = Format(
    "urdf",
    "p_parent = T p_child: <origin xyz rpy> of a <joint>, or of the chain of joints between the two links",
    lambda source: source.looks_like_xml("joint"),
    _read,
    _make,
    asks=FRAMES,
)
