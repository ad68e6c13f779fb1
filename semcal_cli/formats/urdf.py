"""URDF's `<joint>` between the LiDAR's link and the camera's: p_parent = T p_child, `<origin xyz rpy>`."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from contextlib import suppress

from semcal_cli.documents import listed
from semcal_cli.errors import InputError
from semcal_cli.formats.format import CAMERA_NAME, Asked, Format, Source, between, from_rpy, named, rpy, xyz
from semcal_cli.formats.values import parse_numbers
from semcal_cli.formats.xml import parse_xml
from semcal_cli.poses import Pose


def _links(joint: ET.Element) -> tuple[str, str]:
    ends = (joint.find(name) for name in ("parent", "child"))
    parent, child = ("" if end is None else end.get("link", "") for end in ends)
    return parent, child


def _read(source: Source, asked: Asked) -> Pose:
    root = parse_xml(source.text, source.path)
    joints = [joint for joint in root.iter("joint") if all(_links(joint))]
    wanted = {name for name in (asked.camera, asked.lidar) if name is not None}
    chosen = [joint for joint in joints if wanted <= set(_links(joint))]
    if not wanted and len(chosen) > 1:
        chosen = [
            joint for joint in chosen if sum(bool(CAMERA_NAME.search(link)) for link in _links(joint)) == 1
        ]
    if len(chosen) != 1:
        found = listed(" to ".join(_links(joint)) for joint in joints)
        raise InputError(
            f"{source.path}: found joints {found}, needed --camera and --lidar to name the two links of one of them"
        )
    (joint,) = chosen
    origin = joint.find("origin")
    attributes = {} if origin is None else origin.attrib
    where = f"{source.path}: joint {joint.get('name', '')!r}"
    place, angles = (
        parse_numbers(source.path, f"joint {joint.get('name', '')!r}: {key}", attributes.get(key, "0 0 0"), 3)
        for key in ("xyz", "rpy")
    )
    parent, child = _links(joint)
    return between(where, from_rpy(where, angles.tolist(), place.tolist()), parent, child, asked)


def _write(T_camera_lidar: Pose, asked: Asked) -> bytes:
    T, lidar, camera = named(T_camera_lidar, asked)
    joint = ET.Element("joint", name=f"{camera}_joint", type="fixed")
    ET.SubElement(joint, "parent", link=lidar)
    ET.SubElement(joint, "child", link=camera)
    ET.SubElement(joint, "origin", xyz=" ".join(map(repr, xyz(T))), rpy=" ".join(map(repr, rpy(T))))
    ET.indent(joint)
    return (ET.tostring(joint, encoding="unicode") + "\n").encode()


def _recognises(source: Source) -> bool:
    with suppress(InputError):
        return source.text.lstrip().startswith("<") and "<joint" in source.text
    return False


FORMAT = Format("urdf", "p_parent = T p_child: <origin xyz rpy> of a <joint>", _recognises, _read, _write)
