"""URDF: fixed joints between the LiDAR's link and the camera's, p_parent = T p_child of each, `<origin xyz rpy>`."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from semcal_cli.errors import InputError
from semcal_cli.files.messages import listed
from semcal_cli.formats.format import (
    FRAMES,
    Format,
    FormatOptions,
    Source,
    from_rpy,
    named,
    optical_axes,
    xyz,
)
from semcal_cli.formats.names import cameras_among, check_two, choose, has_optical_word, lidars_among
from semcal_cli.formats.values import parse_numbers
from semcal_cli.formats.xml import looks_like_xml, parse_xml
from semcal_cli.geometry.poses import Pose, inverse, rpy


def _links(joint: ET.Element) -> tuple[str, str]:
    ends = (joint.find(name) for name in ("parent", "child"))
    parent, child = ("" if end is None else end.get("link", "") for end in ends)
    return parent, child


def _read(source: Source, options: FormatOptions) -> Pose:
    where, root = str(source.path), parse_xml(source.text, source.path)
    joints = [joint for joint in root.iter("joint") if all(_links(joint))]
    links = list(dict.fromkeys(link for joint in joints for link in _links(joint)))
    cameras, lidars = cameras_among(links, options.lidar), lidars_among(links, options.camera)
    optical = [link for link in cameras if has_optical_word(link)]
    cameras = optical if len(optical) == 1 else cameras
    camera = choose(where, "links", links, cameras, options.camera, "--camera")
    lidar = choose(where, "links", links, lidars, options.lidar, "--lidar")
    check_two(where, camera, lidar, "two links")
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
    origin, name = joint.find("origin"), joint.get("name", "")
    attributes = {} if origin is None else origin.attrib
    place, angles = (
        parse_numbers(source.path, f"joint {name!r}: {key}", attributes.get(key, "0 0 0"), 3)
        for key in ("xyz", "rpy")
    )
    return from_rpy(f"{source.path}: joint {name!r}", angles.tolist(), place.tolist())


def _write(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
    T, lidar, camera = named(T_camera_lidar, options)
    joint = ET.Element("joint", name=f"{camera}_joint", type="fixed")
    ET.SubElement(joint, "parent", link=lidar)
    ET.SubElement(joint, "child", link=camera)
    ET.SubElement(joint, "origin", xyz=" ".join(map(repr, xyz(T))), rpy=" ".join(map(repr, rpy(T))))
    ET.indent(joint)
    return (ET.tostring(joint, encoding="unicode") + "\n").encode()


FORMAT = Format(
    "urdf",
    "p_parent = T p_child: <origin xyz rpy> of a <joint>; of several, those between the two links",
    lambda source: looks_like_xml(source, "joint"),
    _read,
    _write,
    asks=FRAMES,
)
