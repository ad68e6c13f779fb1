"""A drive and its poses as a file of the Rerun viewer: sweeps, images and cameras along time.

The world is the LiDAR frame. Each pose is a separate camera in it, which can be switched on and off; the image and its
labels belong to the last one. Lenses other than a pinhole are drawn as a pinhole with the same K.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from semcal_cli.config.file_limits import MAX_TABLE_BYTES
from semcal_cli.drive.camera import Camera
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.errors import InputError
from semcal_cli.files.image_files import read_size
from semcal_cli.files.input_files import read_bytes
from semcal_cli.files.output_files import check_suffix, write_bytes
from semcal_cli.formats import Extrinsic
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.motion import unrolled
from semcal_cli.observations.observations import NO_CLASS
from semcal_cli.observations.reading import load_points, read_needed_image, read_observations
from semcal_cli.report.colors import palettes

LIDAR, CAMERAS = "lidar", "lidar/cameras"
"""Entities of the LiDAR frame, the root of all others, and of the cameras in it."""
FRAME, TIME = "frame", "time"
"""Timelines: the index of the frame, and the stamp of its sweep if there is one."""
FRUSTUM_M = 1.0
"""Distance of the image plane from the camera."""
MEDIA_TYPES = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}
UNKNOWN_COLOR = (128, 128, 128)
POINT_RADIUS_PX = 1.5


def cameras_of(
    extrinsic: Extrinsic, initial_camera: Camera, result_camera: Camera
) -> dict[str, tuple[Pose, Camera]]:
    """List the poses of a calibration by name, with the cameras that they belong to.

    They are its hypotheses, its stages in order, and its result. A transform in another format is the only one.

    Args:
        extrinsic: The calibration.
        initial_camera: Camera that the calibration started with.
        result_camera: Camera that the result belongs to, the stage that estimated it, and those after it.
    """
    calibration, result = extrinsic.record, {"result": (extrinsic.T_camera_lidar, result_camera)}
    if calibration is None:
        return result
    cameras = {
        f"hypothesis_{index}": (hypothesis.pose, initial_camera)
        for index, hypothesis in enumerate(calibration.hypotheses)
    }
    camera = initial_camera
    for name, stage in calibration.stages.items():
        camera = result_camera if name == "joint" else camera
        cameras[f"stage_{name}"] = np.array(stage.T_camera_lidar), camera
    return cameras | result


def write_rerun(drive: Drive, cameras: Mapping[str, tuple[Pose, Camera]], path: Path) -> None:
    """Write a `.rrd`, as a whole or not at all.

    Points are coloured by class if all frames have labels on both sides, else by height. With a rolling shutter, they
    are moved to the moment when their row at the last pose was exposed.

    Args:
        drive: The drive, whose frames are all written.
        cameras: T_camera_lidar (4, 4), metres, and camera by name; the image belongs to the last. May be empty.
        path: File to write; its suffix is .rrd.

    Raises:
        InputError: the suffix is another one, a file of the drive is missing or wrong, or nothing can be written.
    """
    if os.environ.get("RERUN", "").lower() in ("off", "0", "false"):
        raise InputError("RERUN: the viewer's library is switched off in the environment; switch it on")
    check_suffix(path, ".rrd")
    has_labels = all(frame.point_labels and frame.image_labels for frame in drive.frames)
    observations = read_observations(drive) if has_labels else load_points(drive)
    if cameras:
        observations = unrolled(observations, list(cameras.values())[-1][0])
    stream = rr.RecordingStream("semcal", recording_id=str(drive.path.absolute()))
    memory = stream.memory_recording()
    stream.log(LIDAR, rr.ViewCoordinates.FLU, static=True)
    for name, (T, camera) in cameras.items():
        _log_camera(stream, name, T, camera)
    # Without a pose, images are not placed in space.
    entity = f"{CAMERAS}/{list(cameras)[-1]}" if cameras else "camera"
    point_colors, pixel_colors = palettes(observations)
    _log_classes(stream, f"{LIDAR}/points", observations.point_class_names, point_colors)
    if observations.image_class_names:
        _log_classes(stream, f"{entity}/labels", observations.image_class_names, pixel_colors)
    for index, frame in enumerate(drive.frames):
        stream.reset_time()
        stream.set_time(FRAME, sequence=index)
        if frame.points_stamp is not None:
            stream.set_time(TIME, timestamp=frame.points_stamp)
        cloud, ids, colors = observations.clouds[index], None, None
        if observations.point_class_names:
            ids = cloud.classes
        else:
            colors = _height_colors(cloud.points)
        points = rr.Points3D(cloud.points, class_ids=ids, colors=colors, radii=-POINT_RADIUS_PX)
        stream.log(f"{LIDAR}/points", points)
        stream.log(f"{entity}/image", _frame_image(drive, frame))
        if observations.image_class_names:
            labels = rr.SegmentationImage(observations.images[index].classes, opacity=0.5)
            stream.log(f"{entity}/labels", labels)
    stream.flush()
    write_bytes(memory.drain_as_bytes(), path)


def _log_camera(stream: rr.RecordingStream, name: str, T_camera_lidar: Pose, camera: Camera) -> None:
    transform = rr.Transform3D(
        translation=T_camera_lidar[:3, 3],
        mat3x3=T_camera_lidar[:3, :3],
        relation=rr.TransformRelation.ChildFromParent,
    )
    pinhole = rr.Pinhole(
        image_from_camera=np.array(camera.K),
        resolution=[camera.width, camera.height],
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=FRUSTUM_M,
    )
    stream.log(f"{CAMERAS}/{name}", transform, static=True)
    stream.log(f"{CAMERAS}/{name}", pinhole, static=True)


def _log_classes(stream: rr.RecordingStream, entity: str, names: Sequence[str], bgr: np.ndarray) -> None:
    """Log the names and the colours of the classes of one side."""
    table = [(index, name, tuple(bgr[index][::-1].tolist())) for index, name in enumerate(names)]
    table.append((NO_CLASS, "no class", UNKNOWN_COLOR))
    stream.log(entity, rr.AnnotationContext(table), static=True)


def _frame_image(drive: Drive, frame: Frame) -> rr.Clear | rr.EncodedImage | rr.Image:
    """Return the image of a frame, in the bytes of its file where the viewer reads them."""
    if frame.image is None:
        return rr.Clear(recursive=False)  # otherwise the previous one would stay
    file = drive.resolve(frame.image)
    media_type = MEDIA_TYPES.get(file.suffix.lower())
    if media_type is not None and drive.image_levels is None:
        read_size(file)
        return rr.EncodedImage(contents=read_bytes(file, limit=MAX_TABLE_BYTES), media_type=media_type)
    return rr.Image(read_needed_image(drive, frame), color_model="BGR")


def _height_colors(points: np.ndarray) -> np.ndarray:
    """Return colours (N, 3) from dark to light by height, between the 2nd and the 98th percentile."""
    if len(points) == 0:
        return np.zeros((0, 3), np.uint8)
    low, high = np.percentile(points[:, 2], (2, 98))
    share = np.clip((points[:, 2] - low) / max(high - low, 1e-6), 0.0, 1.0)[:, None]
    colors: np.ndarray = np.rint(40 + share * np.array([120, 190, 215])).astype(np.uint8)
    return colors
