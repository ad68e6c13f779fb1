"""CARLA's sensors, saved by `save_to_disk` as ROOT/ID/000001.ply and ROOT/ID/000001.png, named by frame.

The rig is in ROOT/sensors.json, the list that a leaderboard agent's `sensors()` returns: `id`, `type`, `x y z` in
metres, `roll pitch yaw` in degrees, and for a camera `width height fov`. Everything, clouds included, is in Unreal's
left-handed frame (x forward, y right, z up), so the import writes copies of the clouds with y negated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from semcal_cli.errors import InputError, describe
from semcal_cli.files.documents import read_list
from semcal_cli.files.point_clouds import read_point_clouds
from semcal_cli.formats.frame_names import T_BODY_OPTICAL
from semcal_cli.formats.lenses import intrinsic_matrix
from semcal_cli.formats.node import MAX_MOUNT_M, Node, pick
from semcal_cli.formats.pose import RPY, XYZ, transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse
from semcal_cli.importing.dataset_tree import inside, need_file, numbered_files
from semcal_cli.importing.ontologies import read_ontology
from semcal_cli.importing.recording import (
    Cloud,
    Conversion,
    Recording,
    Request,
    SourceFrame,
    join_frames,
)
from semcal_cli.observations.frame_selection import evenly_spaced

FOV_DEG = 0.1, 179.9
SEGMENTATION, IMAGE = "sensor.camera.semantic_segmentation", "sensor.camera.rgb"
LIDAR, SEMANTIC_LIDAR = "sensor.lidar.ray_cast", "sensor.lidar.ray_cast_semantic"
KINDS = (SEGMENTATION, IMAGE, LIDAR, SEMANTIC_LIDAR)
"""Types of sensors that are read; others, such as a speedometer, have no pose."""
OLD_TAGS, NEW_TAGS = (0, 9, 10), (0, 9, 14)
"""First releases of the two class tables. The second table has Cityscapes' train order. Earlier tags differ from
both."""
NUM_PROBED = 5
"""Number of label images that are read to distinguish tags in red from colours. A single black image fits both."""


@dataclass(frozen=True)
class Sensor:
    """A sensor of sensors.json."""

    name: str
    type: str
    T_vehicle_sensor: Pose
    """(4, 4), metres, between right-handed frames: x forward, y left, z up."""
    settings: Node


def read(request: Request) -> Recording:
    """Find the frames that a segmentation camera and a LiDAR share.

    Raises:
        InputError: the release, a sensor or a file is missing or wrong, or no frame is shared.
    """
    ontology = read_ontology(_table(request.version))
    rig = _read_rig(request.root / "sensors.json")
    names = {kind: [name for name, sensor in rig.items() if sensor.type == kind] for kind in KINDS}
    camera = rig[pick("camera", request.camera, names[SEGMENTATION], request.root)]
    lidar = rig[pick("LiDAR", None, names[SEMANTIC_LIDAR] or names[LIDAR], request.root)]
    frames = _frames(request.root, rig, camera, lidar)
    return Recording(
        camera=_pinhole(camera.settings),
        frames=frames,
        T_camera_lidar=inverse(camera.T_vehicle_sensor @ T_BODY_OPTICAL) @ lidar.T_vehicle_sensor,
        point_classes=ontology if lidar.type == SEMANTIC_LIDAR else None,
        image_classes=ontology,
        synchronization="hardware",  # files of one number are of one tick of the simulation
        ids_in_red=_are_raw([frame.image_labels for frame in frames if frame.image_labels]),
        remarks=("CARLA's clouds are mirrored: copies with y negated are written",),
    )


def pose_from_unreal(x: float, y: float, z: float, roll: float, pitch: float, yaw: float) -> Pose:
    """Convert a CARLA transform to right-handed frames (`GetMatrix` in LibCarla/source/carla/geom/Transform.h).

    Mirroring y on both sides keeps roll and negates pitch and yaw.

    Args:
        x: Metres forward.
        y: Metres to the right.
        z: Metres up.
        roll: Degrees.
        pitch: Degrees.
        yaw: Degrees.

    Returns:
        T_parent_sensor (4, 4), metres; both frames have x forward, y left, z up.
    """
    from scipy.spatial.transform import Rotation

    R = Rotation.from_euler("xyz", [roll, -pitch, -yaw], degrees=True).as_matrix()
    return transform(R, [x, -y, z])


def _table(version: str | None) -> str:
    try:
        release = tuple(int(part) for part in str(version).split("."))
    except ValueError:
        problem = "none given" if version is None else f"found {version!r}"
        raise InputError(
            f"--version: {problem}, expected CARLA's release, such as 0.9.15: its tags changed in 0.9.14"
        ) from None
    if release < OLD_TAGS:
        raise InputError(
            f"--version: found {version!r}, needed 0.9.10 or later: earlier tags are not supported"
        )
    return "carla" if release >= NEW_TAGS else "carla-0.9.13"


def _read_rig(path: Path) -> dict[str, Sensor]:
    """Read the cameras and LiDARs of a rig by name. If a name occurs twice, the first one is used."""
    rig: dict[str, Sensor] = {}
    for index, row in enumerate(read_list(path)):
        if row.get("type") not in KINDS:
            continue
        name = row.get("id")
        inside(path.parent, name, f"{path}: [{index}].id")
        settings = Node(str(path), row, f"sensor {describe(name)}")
        position = [settings.at(key).number(-MAX_MOUNT_M, MAX_MOUNT_M) for key in XYZ]
        angles = [settings.at(key).number() for key in RPY]
        sensor = Sensor(str(name), row["type"], pose_from_unreal(*position, *angles), settings)
        rig.setdefault(sensor.name, sensor)
    return rig


def _pinhole(settings: Node) -> dict[str, Any]:
    """Make the camera block of the renderer's pinhole camera.

    The optical axis passes through the middle of the image, which lies between pixel centres.
    """
    width, height = (settings.at(key).side() for key in ("width", "height"))
    fov_deg = settings.at("fov").number(*FOV_DEG)
    focal = 0.5 * width / float(np.tan(np.radians(0.5 * fov_deg)))
    K = intrinsic_matrix(focal, focal, 0.5 * (width - 1), 0.5 * (height - 1))
    return {"model": "plumb_bob", "width": width, "height": height, "K": K}


def _frames(root: Path, rig: dict[str, Sensor], camera: Sensor, lidar: Sensor) -> list[SourceFrame]:
    def looks_alike(other: Sensor) -> bool:
        """Return whether a colour camera has the pose and the lens of the segmentation camera."""
        keys = ("width", "height", "fov")
        same_lens = all(other.settings.value.get(key) == camera.settings.value.get(key) for key in keys)
        return (
            other.type == IMAGE and same_lens and np.allclose(other.T_vehicle_sensor, camera.T_vehicle_sensor)
        )

    def by_number(sensor: Sensor, *suffixes: str) -> dict[int, Path]:
        return {int(stem): path for stem, path in numbered_files(root / sensor.name, *suffixes).items()}

    has_labels = lidar.type == SEMANTIC_LIDAR
    clouds = {
        name: Conversion(partial(_convert, cloud), has_labels=has_labels, file=cloud, in_order=True)
        for name, cloud in numbered_files(root / lidar.name, ".ply").items()
    }
    colour = next(filter(looks_alike, rig.values()), None)
    return join_frames(
        clouds,
        needs=("image_labels",),
        image_labels=by_number(camera, ".png"),
        image={} if colour is None else by_number(colour, ".png", ".jpg"),
        missing=f"{root}: found no frame that {camera.name} and {lidar.name} share",
    )


def _convert(path: Path) -> Cloud:
    """Mirror a cloud into a right-handed frame; `ObjTag` becomes the label of a point."""
    (cloud,) = read_point_clouds([(need_file(path), None)])
    points = np.zeros((len(cloud.points), 4), dtype=np.float32)
    points[:, :3] = cloud.points * np.array([1.0, -1.0, 1.0], np.float32)
    if cloud.intensity is not None:
        points[:, 3] = cloud.intensity
    return Cloud(points, None if cloud.labels is None else cloud.labels.astype(np.uint32))


def _are_raw(label_images: list[Path]) -> bool:
    """Return whether label images hold tags in the red channel rather than the colours of CityScapesPalette."""
    from semcal_cli.files.image_files import read_image

    return not any(read_image(path)[..., :2].any() for path in evenly_spaced(label_images, NUM_PROBED))
