"""Directions of transforms and of the lines of images, by the names that files have. Nothing heavy is imported here."""

from __future__ import annotations

from typing import Literal, TypeAlias

Direction: TypeAlias = Literal["lidar-to-camera", "camera-to-lidar"]
"""Direction of a matrix: p_camera = T p_lidar, or p_lidar = T p_camera."""
BaseDirection: TypeAlias = Literal["lidar-to-base", "base-to-lidar"]
"""Direction of a matrix of a LiDAR on its vehicle: p_base = T p_lidar, or p_lidar = T p_base."""
CameraFrame: TypeAlias = Literal["optical", "body"]
"""Axes of a camera frame. Optical: x right, y down, z forward. Body: x forward, y left, z up (ROS REP 103)."""
ReadoutDirection: TypeAlias = Literal["down", "up", "right", "left"]
"""Direction in which a rolling shutter reads the lines of an image."""
