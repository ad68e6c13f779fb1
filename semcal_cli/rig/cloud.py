"""A sweep with all cameras of a rig around it, for the 3-D view, and the picture that each camera took of it."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from semcal_cli.drive.document import Drive
from semcal_cli.drive.motion import unrolled
from semcal_cli.drive.observations import Observations
from semcal_cli.drive.reading import load_points, read_frame_image
from semcal_cli.geometry.poses import Pose
from semcal_cli.report.cloud import (
    MAX_SEEN,
    CameraInView,
    Cloud,
    Rgb,
    make_cloud,
    thinned,
)
from semcal_cli.report.colors import QUALITATIVE_COLORS
from semcal_cli.report.points import at_pixels, points_in_image

BY_CAMERA, BY_PICTURE = "camera that sees them", "pictures"


@dataclass(frozen=True)
class CameraView:
    """One frame of a camera, with its points."""

    name: str
    color: Rgb
    T_camera_lidar: Pose
    drive: Drive
    """Drive of the one frame."""
    observations: Observations
    """Points of the frame, without labels."""
    is_of_sweep: bool
    """Whether the frame is of the sweep that the 3-D view shows."""


def camera_views(drives: Mapping[str, Drive], poses: Mapping[str, Pose]) -> list[CameraView]:
    """Read one frame of each camera that has a pose: that of the sweep that most cameras have, or else its first.

    Args:
        drives: Drive of each camera.
        poses: T_camera_lidar (4, 4) of each camera that has one.

    Raises:
        InputError: a file is missing or wrong.
    """
    sweeps = {name: [_sweep(drives[name], frame.points) for frame in drives[name].frames] for name in poses}
    counts = Counter(sweep for found in sweeps.values() for sweep in dict.fromkeys(found))
    ((common, _),) = counts.most_common(1)
    views = []
    for number, (name, T) in enumerate(poses.items()):
        index = sweeps[name].index(common) if common in sweeps[name] else 0
        drive = drives[name].model_copy(update={"frames": (drives[name].frames[index],)})
        color = QUALITATIVE_COLORS[number % len(QUALITATIVE_COLORS)]
        observations = unrolled(load_points(drive), T)
        views.append(CameraView(name, color, T, drive, observations, common in sweeps[name]))
    return views


def _sweep(drive: Drive, name: str) -> Path:
    return Path(os.path.realpath(drive.resolve(name)))


def rig_cloud(views: list[CameraView]) -> Cloud:
    """Colour the points of the sweep by the camera that sees them, and by the cameras' pictures.

    Raises:
        InputError: a picture is wrong.
    """
    shown = next(view for view in views if view.is_of_sweep)
    points = shown.observations.clouds[0].points
    is_seen = np.zeros(len(points), np.bool_)
    found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {BY_CAMERA: [], BY_PICTURE: []}
    # Where views overlap, the first camera has the points: its colours are put on last.
    for view in reversed(views):
        # Each camera sees the sweep at the moment of its own picture.
        own = view.observations.clouds[0].points if view.is_of_sweep else points
        seen = points_in_image(own, view.T_camera_lidar, view.observations.camera)
        is_seen[seen.indices[~seen.is_hidden]] = True
        chosen = thinned(~seen.is_hidden, MAX_SEEN // len(views))
        indices = seen.indices[chosen]
        found[BY_CAMERA].append((indices, np.full((len(indices), 3), view.color, np.uint8)))
        image = read_frame_image(view.drive, view.drive.frames[0]) if view.is_of_sweep else None
        if image is not None:
            found[BY_PICTURE].append((indices, at_pixels(image, seen.pixels[chosen])[:, ::-1]))
    colored = {}
    for name, parts in found.items():
        if parts:
            colored[name] = np.concatenate([i for i, _ in parts]), np.concatenate([rgb for _, rgb in parts])
    cameras = [
        CameraInView.placed(view.name, view.color, view.observations.camera, view.T_camera_lidar)
        for view in views
    ]
    return make_cloud(shown.drive.frames[0].points, points, is_seen, colored, cameras)
