"""RELLIS-3D's transforms.yaml: p_lidar = R(q) * p_camera + t, the inverse of T_camera_lidar.

The file does not state its direction; labels and images agree only in this one.
"""

from __future__ import annotations

from semcal_cli.formats.documents import entry_format, under
from semcal_cli.formats.pose import PLACE, WXYZ, Numbers

KEY = "os1_cloud_node-pylon_camera_node"
"""Key of the LiDAR and camera; other files of the dataset have the same layout but relate two LiDARs."""

FORMAT = entry_format(
    "rellis-3d",
    f"p_lidar = T p_camera: transforms.yaml, {KEY}",
    lambda source: KEY in source.mapping,
    under(KEY),
    Numbers({"q": WXYZ, "t": PLACE}, are_named=True),
    maps_camera=True,
)
