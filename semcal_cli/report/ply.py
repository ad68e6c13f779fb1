"""Sweeps whose points have the colours of the images, as PLY files of other programs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from semcal_cli.drive.document import Drive
from semcal_cli.files.output_files import make_folder, write_bytes
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.reading import read_needed_image
from semcal_cli.report.named_frames import frame_paths
from semcal_cli.report.points import View, at_pixels

PLY_POINT = np.dtype(
    [*((axis, "<f4") for axis in "xyz"), *((name, "u1") for name in ("red", "green", "blue"))]
)
HEADER = "ply\nformat binary_little_endian 1.0\ncomment {}\nelement vertex {}\n{}end_header\n"
COMMENT = "points in the LiDAR frame, metres, with the colours of the image"


def write_ply(drive: Drive, observations: Observations, T_camera_lidar: Pose, folder: Path) -> Iterator[Path]:
    """Write the points of each frame that the camera sees, with their colours, and yield each path.

    Args:
        drive: The drive, each frame of which has an image.
        observations: Points of the same frames.
        T_camera_lidar: (4, 4), metres.
        folder: Folder for the files, which is made.

    Raises:
        InputError: a frame has no image, an image is wrong, or a file cannot be written.
    """
    make_folder(folder)
    view = View(observations, T_camera_lidar)
    for index, (frame, path) in enumerate(zip(drive.frames, frame_paths(folder, drive, ".ply"), strict=True)):
        image = read_needed_image(drive, frame)
        projected = view.project_frame(index)
        is_visible = ~projected.is_hidden
        points = np.zeros(int(is_visible.sum()), PLY_POINT)
        positions = observations.clouds[index].points[projected.indices[is_visible]]
        colors = at_pixels(image, projected.pixels[is_visible])
        for axis, name in enumerate("xyz"):
            points[name] = positions[:, axis]
        for channel, name in enumerate(("blue", "green", "red")):
            points[name] = colors[:, channel]
        properties = "".join(
            f"property {'float' if PLY_POINT[name] == '<f4' else 'uchar'} {name}\n"
            for name in PLY_POINT.names or ()
        )
        header = HEADER.format(COMMENT, len(points), properties)
        write_bytes(header.encode() + points.tobytes(), path)
        yield path
