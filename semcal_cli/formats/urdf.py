"""URDF: fixed joints between the LiDAR's link and the camera's, each p_parent = T p_child by `<origin xyz rpy>`."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from functools import reduce

import numpy as np

from semcal_cli.errors import InputError, listed
from semcal_cli.formats.format import FRAMES, Edits, Format, FormatOptions, Source
from semcal_cli.formats.frame_names import camera_and_lidar, name_frames, optical_axes
from semcal_cli.formats.node import parse_numbers
from semcal_cli.formats.pose import RPY, XYZ, number_text, numbers_of, pose_of
from semcal_cli.formats.xml_tags import Tag, start_tags
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse


def _links(joint: ET.Element) -> tuple[str, str]:
    """Read the names of the parent and the child of a joint."""
    parent, child = (
        "" if end is None else end.get("link", "") for end in map(joint.find, ("parent", "child"))
    )
    return parent, child


def _read(source: Source, options: FormatOptions) -> Pose:
    joints, camera, lidar = _sensors(source, options)
    T_lidar_frame = _between(source, joints, lidar, camera)
    return inverse(T_lidar_frame @ optical_axes(str(source.path), camera, options))


def _sensors(source: Source, options: FormatOptions) -> tuple[list[ET.Element], str, str]:
    """List the joints, and name the links of the camera and the LiDAR."""
    where = str(source.path)
    joints = [joint for joint in source.xml.iter("joint") if all(_links(joint))]
    for pair, count in Counter(frozenset(_links(joint)) for joint in joints).items():
        if count > 1:
            raise InputError(f"{where}: found several joints between {listed(sorted(pair))}, expected one")
    links = list(dict.fromkeys(link for joint in joints for link in _links(joint)))
    camera, lidar = camera_and_lidar(where, "links", links, options, prefers_optical=True)
    return joints, camera, lidar


def _between(source: Source, joints: list[ET.Element], start: str, end: str) -> Pose:
    """Chain the joints from one link to another: T_start_end (4, 4)."""
    steps = (_along(source, *step) for step in _chain(source, joints, start, end))
    return reduce(np.matmul, steps, np.eye(4))


def _along(source: Source, joint: ET.Element, is_forward: bool) -> Pose:
    """Read the transform of a joint, from the child or, if not forward, from the parent."""
    T_parent_child = _origin(source, joint)
    return T_parent_child if is_forward else inverse(T_parent_child)


def _chain(source: Source, joints: list[ET.Element], start: str, end: str) -> list[tuple[ET.Element, bool]]:
    """List the joints from one link to another, each with whether it leads from its parent to its child."""
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
        steps.append((joint, link == _links(joint)[1]))
        link = before
    return steps[::-1]


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
    T, parent, camera = name_frames(T_camera_lidar, options)
    values = numbers_of(T)
    translation, angles = (" ".join(number_text(values[name]) for name in names) for names in (XYZ, RPY))
    joint = ET.Element("joint", name=f"{camera}_joint", type="fixed")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=camera)
    ET.SubElement(joint, "origin", xyz=translation, rpy=angles)
    ET.indent(joint)
    options.note("this is a joint alone; --into robot.urdf --key JOINT sets one in a copy of a whole robot")
    return (ET.tostring(joint, encoding="unicode") + "\n").encode()


def _edit(source: Source, T_camera_lidar: Pose, name: str | None, options: FormatOptions) -> Edits:
    """Set the origin of one joint so that the chain from the LiDAR to the camera is the transform."""
    joints, camera, lidar = _sensors(source, options)
    chain = _chain(source, joints, lidar, camera)
    names = [joint.get("name", "") for joint, _ in chain]
    if name not in names and not (name is None and len(names) == 1):
        between = f"found the joints {listed(names)} between {lidar!r} and {camera!r}"
        raise InputError(f"{source.path}: {between}; add --key to name the one to set")
    chosen = 0 if name is None else names.index(name)
    T = inverse(optical_axes(str(source.path), camera, options) @ T_camera_lidar)
    for step in chain[:chosen]:
        T = inverse(_along(source, *step)) @ T
    for step in reversed(chain[chosen + 1 :]):
        T = T @ inverse(_along(source, *step))
    joint, is_forward = chain[chosen]
    tag = next(
        tag
        for tag in start_tags(source)
        if tag.name == "joint"
        and tag.attributes.get("name", "") == joint.get("name", "")
        and any(child.attributes.get("link") == _links(joint)[1] for child in tag.children)
    )
    values = numbers_of(T if is_forward else inverse(T))
    texts = {
        key: " ".join(number_text(values[name]) for name in names)
        for key, names in (("xyz", XYZ), ("rpy", RPY))
    }
    origin = next((child for child in tag.children if child.name == "origin"), None)
    _check_uncomputed(f"{source.path}: joint {joint.get('name', '')!r}", tag, origin)
    if origin is None:
        return [(tag.end, tag.end, f'<origin xyz="{texts["xyz"]}" rpy="{texts["rpy"]}"/>')]
    return [edit for key, text in texts.items() for edit in origin.replaced(key, text)]


def _check_uncomputed(where: str, joint: Tag, origin: Tag | None) -> None:
    """Check that xacro neither inserts the origin of a joint nor computes its numbers, which other places state."""
    inserted = next((child for child in joint.children if child.name.startswith("xacro:")), None)
    if origin is None and inserted is not None:
        needed = "state an <origin> of numbers in its place, or set the one that it inserts by hand"
        raise InputError(f"{where}: found {inserted.text}, which may insert an origin; {needed}")
    for name, value in () if origin is None else origin.attributes.items():
        if name in ("xyz", "rpy") and "$" in value:
            needed = "state numbers in its place, or change what it is computed from"
            raise InputError(f"{where}: found {name} {value!r}, which xacro computes; {needed}")


FORMAT = Format(
    "urdf",
    "p_parent = T p_child: <origin xyz rpy> of a <joint>, or of the chain of joints between the two links",
    lambda source: source.looks_like_xml("joint"),
    _read,
    _make,
    asks=FRAMES,
    edit=_edit,
)
