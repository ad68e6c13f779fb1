"""Descriptions of robots with several cameras, as URDF."""

from collections.abc import Mapping

from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse, rpy


def robot(lidar: str, cameras: Mapping[str, Pose]) -> str:
    """Describe a robot by T_camera_lidar of the optical frame of each camera."""
    joints = []
    for camera, T in cameras.items():
        T_lidar_camera = inverse(T)
        angles, xyz = (" ".join(map(str, values)) for values in (rpy(T_lidar_camera), T_lidar_camera[:3, 3]))
        links = f'<parent link="{lidar}"/><child link="{camera}"/><origin xyz="{xyz}" rpy="{angles}"/>'
        joints.append(f'<joint name="{camera}_joint" type="fixed">{links}</joint>')
    return f'<robot name="robot">{"".join(joints)}</robot>'
