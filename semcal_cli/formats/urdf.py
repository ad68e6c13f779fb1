"""URDF: fixed joints between the LiDAR's link and the camera's, p_parent = T p_child of each, `<origin xyz rpy>`."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from semcal_cli.errors import InputError, listed
from semcal_cli.formats.format import FRAMES, Format, FormatOptions, Source
from semcal_cli.formats.frames import camera_and_lidar, named, optical_axes
from semcal_cli.formats.node import parse_numbers
from semcal_cli.formats.pose import ANGLES, PLACE, numbers_of, pose_of
from semcal_cli.formats.xml import looks_like_xml, parse_xml
from semcal_cli.geometry.poses import Pose, inverse


def _links(joint: ET.Element) -> tuple[str, str]:
    ends = (joint.find(name) for name in ("parent", "child"))
    parent, child = ("" if end is None else end.get("link", "") for end in ends)
    return parent, child


def _read(source: Source, options: FormatOptions) -> Pose:
    where, root = str(source.path), parse_xml(source.text, source.path)
    joints = [joint for joint in root.iter("joint") if all(_links(joint))]
    links = list(dict.fromkeys(link for joint in joints for link in _links(joint)))
    camera, lidar = camera_and_lidar(where, "links", links, options, prefers_optical=True)
    T_lidar_camera = np.eye(4)
    for joint, link in _path(where, joints, lidar, camera):
        T = _origin(source, joint)
        T_lidar_camera = T_lidar_camera @ (T if link == _links(joint)[1] else inverse(T))
    return inverse(T_lidar_camera @ optical_axes(where, camera, options))


def _path(where: str, joints: list[ET.Element], start: str, end: str) -> list[tuple[ET.Element, str]]:
    """The joints from one link to another, each with the link at its end."""
    ends = [frozenset(_links(joint)) for joint in joints]
    if len(set(ends)) < len(ends):
        twice = next(pair for pair in ends if ends.count(pair) > 1)
        raise InputError(f"{where}: found several joints between {listed(sorted(twice))}, needed one")
    came: dict[str, tuple[str, ET.Element] | None] = {start: None}
    waiting = [start]
    for link in waiting:
        for joint in joints:
            for here, there in (_links(joint), _links(joint)[::-1]):
                if here == link and there not in came:
                    came[there] = (link, joint)
                    waiting.append(there)
    if end not in came:
        raise InputError(f"{where}: found no joints from {start!r} to {end!r}, needed some")
    path: list[tuple[ET.Element, str]] = []
    link = end
    while (step := came[link]) is not None:
        before, joint = step
        if joint.get("type", "fixed") != "fixed":
            name, kind = joint.get("name", ""), joint.get("type")
            raise InputError(f"{where}: joint {name!r}: found type {kind!r} between them, needed 'fixed'")
        path.insert(0, (joint, link))
        link = before
    return path


def _origin(source: Source, joint: ET.Element) -> Pose:
    """Read T_parent_child of a joint."""
    origin, key = joint.find("origin"), f"joint {joint.get('name', '')!r}"
    attributes = {} if origin is None else origin.attrib
    values: dict[str, float] = {}
    for name, names in (("xyz", PLACE), ("rpy", ANGLES)):
        found = parse_numbers(source.path, f"{key}: {name}", attributes.get(name, "0 0 0"), 3)
        values.update(zip(names, found.tolist(), strict=True))
    return pose_of(f"{source.path}: {key}", values, FormatOptions())


def _make(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
    T, lidar, camera = named(T_camera_lidar, options)
    values = numbers_of(T)
    place, angles = (" ".join(repr(values[name]) for name in names) for names in (PLACE, ANGLES))
    joint = ET.Element("joint", name=f"{camera}_joint", type="fixed")
    ET.SubElement(joint, "parent", link=lidar)
    ET.SubElement(joint, "child", link=camera)
    ET.SubElement(joint, "origin", xyz=place, rpy=angles)
    ET.indent(joint)
    return (ET.tostring(joint, encoding="unicode") + "\n").encode()


FORMAT = Format(
    "urdf",
    "p_parent = T p_child: <origin xyz rpy> of a <joint>; of several, those between the two links",
    lambda source: looks_like_xml(source, "joint"),
    _read,
    _make,
    asks=FRAMES,
)
