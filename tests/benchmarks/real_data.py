"""The real drives that benchmarks measure on, each written as a `drive.yaml` with its published pose.

The folder holds frames of KITTI (object, raw, a jam), KITTI-360, OpenCalib, nuScenes, DDAD, SUSTechPOINTS, RELLIS-3D,
and of the repositories cam_lidar_calibration (VLP-16), lidar_camera_calib (OS1) and mlcc (Livox). What is missing is
left out.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from laboratory.portrait import write_portrait_drive

from semcal_cli.files.image_files import read_image
from semcal_cli.formats.kitti_files import raw_pose, read_keyed
from semcal_cli.importing import kitti
from semcal_cli.importing.kitti_motion import MOMENT_360_SIGMA_S, MOMENT_S, MOMENT_SIGMA_S, SPIN

CITYSCAPES = [
    *("road", "sidewalk", "building", "wall", "fence", "pole", "light", "sign", "vegetation", "terrain"),
    *("sky", "person", "rider", "car", "truck", "bus", "train", "motorcycle", "bicycle"),
]

TRIGGERED = {"synchronization": "hardware"}
KITTI = TRIGGERED | {
    "lidar": {"spin": SPIN},
    "time_offset_s": MOMENT_S,
    "time_offset_sigma_s": MOMENT_SIGMA_S,
}
"""What `import` states of KITTI: the LiDAR turns and triggers the cameras."""
KITTI_360 = KITTI | {"time_offset_sigma_s": MOMENT_360_SIGMA_S}
DDAD = TRIGGERED | {"lidar": {"origin_m": [1.38, 0.0, 1.63]}}
"""Points are in the frame of the vehicle, and rays start on its roof, where `ray_origin.py` finds it."""


class RealDrive(NamedTuple):
    """A real drive whose pose was published."""

    name: str
    path: Path
    """Folder of its drive.yaml."""
    sides: tuple[str, ...] = ("image", "image_labels")
    """Files of a frame, beside the points, that it has: with `point_labels` both sides have labels."""
    published: tuple[float, ...] = (*(3 * [0.05]), *(3 * [0.15]))
    """What the published pose may itself be off along the camera's axes, metres and degrees."""

    def files_allow(self, cues: Sequence[str]) -> bool:
        """Whether its files allow all of some cues."""
        needed = {"labels": {"point_labels", "image_labels"}, "segments": {"image_labels"}}
        return all(needed.get(cue, {"image"}) <= {*self.sides} for cue in cues)


def real_drives(data: Path, folder: Path) -> Iterator[RealDrive]:
    """Write the drives of a data folder into another folder."""
    for source, read in READERS.items():
        if (data / source).is_dir():
            yield from read(data / source, folder)


def with_fewer_rings(real: RealDrive, kept: int, folder: Path) -> Iterator[RealDrive]:
    """Write a drive of KITTI again with some of the 64 rings of its sweeps, once for each first ring."""
    document = yaml.safe_load((real.path / "drive.yaml").read_text())
    step = 64 // kept
    for first in range(step):
        path = folder / f"{real.path.name}_{kept}_rings_from_{first}"
        path.mkdir()
        frames = []
        for number, frame in enumerate(document["frames"]):
            points = np.fromfile(real.path / frame["points"], np.float32).reshape(-1, 4)
            cut = path / f"{number}.bin"
            points[_rings(points) % step == first].tofile(cut)
            frames.append(frame | {"points": str(cut)})
        (path / "drive.yaml").write_text(yaml.safe_dump(document | {"frames": frames}))
        yield real._replace(name=f"{real.name}, {kept} rings from {first}", path=path)


TURNED = {
    "upside down": np.diag([1.0, -1.0, -1.0]),
    "on its side": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "nose down": np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]),
}
"""Rotations (3, 3) of points from the frame of an upright LiDAR to one that is not."""


def with_turned_lidar(real: RealDrive, folder: Path) -> Iterator[RealDrive]:
    """Write a drive of KITTI again with points in a frame that is not upright, once for each rotation."""
    document = yaml.safe_load((real.path / "drive.yaml").read_text())
    # Its spin is about another axis.
    document.pop("lidar", None)
    for name, rotation in TURNED.items():
        path = folder / f"{real.path.name}_{name.replace(' ', '_')}"
        path.mkdir()
        frames = []
        for number, frame in enumerate(document["frames"]):
            points = np.fromfile(real.path / frame["points"], np.float32).reshape(-1, 4)
            points[:, :3] = points[:, :3] @ rotation.T
            points.tofile(path / f"{number}.bin")
            frames.append(frame | {"points": f"{number}.bin"})
        T = np.array(document["T_camera_lidar"])
        T[:3, :3] = T[:3, :3] @ rotation.T
        turned = document | {"frames": frames, "T_camera_lidar": T.tolist()}
        (path / "drive.yaml").write_text(yaml.safe_dump(turned))
        yield real._replace(name=f"{real.name}, {name}", path=path)


def with_portrait_camera(real: RealDrive, folder: Path) -> RealDrive:
    """Write a drive of KITTI again as its camera sees it on its side."""
    path = write_portrait_drive(real.path, folder / f"{real.path.name}_portrait")
    return real._replace(name=f"{real.name}, portrait", path=path)


PROCESSED: dict[str, Callable[[np.ndarray, np.random.Generator], np.ndarray]] = {
    "in random order": lambda cloud, rng: rng.permutation(cloud),
    "half of the points": lambda cloud, rng: cloud[rng.random(len(cloud)) < 0.5],
    "voxels of 5 cm": lambda cloud, _: _means_of_voxels(cloud, 0.05),
    "voxels of 10 cm": lambda cloud, _: _means_of_voxels(cloud, 0.1),
    "rounded to centimetres": lambda cloud, _: np.column_stack([cloud[:, :3].round(2), cloud[:, 3:]]),
    "without intensities": lambda cloud, _: cloud[:, :3],
    "up to 30 m": lambda cloud, _: cloud[np.linalg.norm(cloud[:, :3], axis=1) < 30.0],
}
"""What users do to clouds: points (N, 4), metres, with intensities, before and after."""


def with_processed_clouds(real: RealDrive, folder: Path) -> Iterator[RealDrive]:
    """Write a drive of KITTI again, once for each way in which its clouds are processed."""
    document = yaml.safe_load((real.path / "drive.yaml").read_text())
    for name, process in PROCESSED.items():
        path, rng = folder / f"{real.path.name}_{name.replace(' ', '_')}", np.random.default_rng(0)
        path.mkdir()
        frames = []
        for number, frame in enumerate(document["frames"]):
            points = np.fromfile(real.path / frame["points"], np.float32).reshape(-1, 4)
            np.save(path / f"{number}.npy", process(points, rng).astype(np.float32))
            frames.append(frame | {"points": f"{number}.npy"})
        (path / "drive.yaml").write_text(yaml.safe_dump(document | {"frames": frames}))
        yield real._replace(name=f"{real.name}, {name}", path=path)


def _means_of_voxels(cloud: np.ndarray, side_m: float) -> np.ndarray:
    """Average the points (N, 4) of each voxel, as a voxel grid filter does."""
    _, voxels, counts = np.unique(
        np.floor(cloud[:, :3] / side_m), axis=0, return_inverse=True, return_counts=True
    )
    sums = [np.bincount(voxels.ravel(), column) for column in cloud.T]
    return np.column_stack(sums) / counts[:, None]


def _rings(points: np.ndarray) -> np.ndarray:
    """Number the rings (N,) of a sweep of KITTI, whose file has one after the other, each from straight ahead."""
    turned = np.arctan2(points[:, 1], points[:, 0]) % (2.0 * np.pi)
    return np.cumsum(np.diff(turned, prepend=turned[0]) < -np.pi)


def _kitti_object(source: Path, folder: Path) -> Iterator[RealDrive]:
    images = sorted((source / "image_2").glob("*.png"))
    # Images of the set differ by a few pixels in size; those of one drive have one size.
    height, width = read_image(images[0]).shape[:2]
    camera, T = kitti.calibration(source / "calib.txt", 2, width, height)
    same = [path for path in images if read_image(path).shape[:2] == (height, width)]
    for labels in ("image_labels", "image_labels_dicenet"):
        frames = [
            _frame(source / f"velodyne/{path.stem}.bin", path, source / labels / path.name) for path in same
        ]
        network = "" if labels == "image_labels" else ", labels by DiCENet"
        yield _write(folder, f"KITTI object, {len(frames)} pairs{network}", camera, frames, T, **KITTI)


def _kitti_raw(source: Path, folder: Path) -> Iterator[RealDrive]:
    (day,) = (path for path in source.iterdir() if path.name.startswith("2011"))
    frames = []
    for sync in sorted(day.glob("*_sync")):
        (images,) = sync.glob("image_*")
        for path in sorted((images / "data").glob("*.png")):
            of_drive = source / "image_labels" / sync.name
            labels = (of_drive if of_drive.is_dir() else of_drive.parent) / path.name
            frames.append(_frame(sync / f"velodyne_points/data/{path.stem}.bin", path, labels))
    velo, cameras = (read_keyed(day / f"calib_{name}_to_cam.txt") for name in ("velo", "cam"))
    projection = cameras.at(f"P_rect_{images.name.removeprefix('image_')}")
    height, width = read_image(Path(frames[0]["image"])).shape[:2]
    lens, T = kitti.pinhole(projection, width, height), raw_pose(velo, cameras, images.name)
    name = "KITTI jam" if source.name.endswith("jam") else "KITTI raw, right camera"
    yield _write(folder, f"{name}, {len(frames)} pairs", lens, frames, T, **KITTI)


def _opencalib(source: Path, folder: Path) -> Iterator[RealDrive]:
    """The first two frames have one camera."""
    lenses, frames, poses = [], [], []
    for place, number in enumerate(sorted(path.name for path in source.glob("[0-9]*"))):
        path = source / number / "calib.txt"
        keyed = read_keyed(path)
        (image,) = (each for each in path.parent.glob("calib.*") if each.suffix in (".jpg", ".png"))
        lenses.append(_lens(keyed.at("K").matrix(3, 3), (1920, 1200), keyed.at("D").numbers()))
        frames.append(_frame(path.parent / "calib.pcd", image, source / f"image_labels/{number}.png"))
        poses.append(np.vstack([keyed.at("T").matrix(3, 4), [0.0, 0.0, 0.0, 1.0]]))
        yield _write(folder, f"OpenCalib {number}", lenses[place], frames[place:], poses[place])
    yield _write(folder, "OpenCalib 1 and 2", lenses[0], frames[:2], poses[0])


def _nuscenes(source: Path, folder: Path) -> Iterator[RealDrive]:
    (points,) = source.glob("*.pcd.bin")
    for name, camera in json.loads((source / "calib.json").read_text()).items():
        if name.startswith("CAM_"):
            labels = source / "image_labels" / f"{Path(camera['img']).stem}.png"
            frame, lens = _frame(points, source / camera["img"], labels), _lens(camera["K"], (1600, 900))
            place = name[4:].lower().replace("_", " ")
            yield _write(
                folder, f"nuScenes {place}", lens, [frame], np.array(camera["lidar2cam"]), **TRIGGERED
            )


def _ddad(source: Path, folder: Path) -> Iterator[RealDrive]:
    clouds = sorted((source / "lidar").glob("*.bin"))
    for name, camera in json.loads((source / "calib.json").read_text()).items():
        frames = [_frame(cloud, source / name / f"{cloud.stem}.jpg") for cloud in clouds]
        lens, T = _lens(camera["K"], camera["size"]), np.array(camera["T_cam_lidar"])
        yield _write(folder, f"DDAD {name[7:]}, {len(frames)} pairs", lens, frames, T, **DDAD)


def _sustech(source: Path, folder: Path) -> Iterator[RealDrive]:
    camera = json.loads((source / "calib.json").read_text())
    frames = [_frame(cloud, cloud.with_suffix(".jpg")) for cloud in sorted(source.glob("*.pcd"))]
    lens, T = _lens(camera["K"], camera["size"]), np.array(camera["T_cam_lidar"])
    yield _write(folder, f"SUSTechPOINTS, {len(frames)} pairs", lens, frames, T)


def _rellis3d(source: Path, _: Path) -> Iterator[RealDrive]:
    """Its published pose is not true to better than about 1 degree: labels agree better half a degree away."""
    published = (*(3 * [0.3]), *(3 * [1.0]))
    yield RealDrive("RELLIS-3D 000104", source, ("image", "image_labels", "point_labels"), published)


def _listed(name: str, source: Path, folder: Path, **others: object) -> Iterator[RealDrive]:
    """A set whose calib.json lists cameras, with their lenses and poses, and frames."""
    document = json.loads((source / "calib.json").read_text())
    for camera, lens in document["cameras"].items():
        is_pinhole = lens["model"] == "pinhole"
        block = {key: lens[key] for key in ("width", "height", "K", "distortion")}
        frames = [
            _frame(source / frame["lidar"], source / frame["images"][camera]) for frame in document["frames"]
        ]
        yield _write(
            folder,
            f"{name} {camera}, {len(frames)} pairs",
            {"model": "plumb_bob" if is_pinhole else lens["model"]} | block,
            frames,
            np.array(lens["T_camera_lidar"]),
            **others,
        )


READERS: dict[str, Callable[[Path, Path], Iterator[RealDrive]]] = {
    "kitti_object": _kitti_object,
    "kitti_raw_right": _kitti_raw,
    "kitti_raw_jam": _kitti_raw,
    "opencalib_road": _opencalib,
    "nuscenes_keyframe": _nuscenes,
    "ddad_scene": _ddad,
    "sustech_front": _sustech,
    "rellis3d_000104": _rellis3d,
    "kitti360_street": partial(_listed, "KITTI-360 street", **KITTI_360),
    "acfr_vlp16": partial(_listed, "ACFR VLP-16"),
    "tamu_basler_os1": partial(_listed, "TAMU OS1"),
    "mlcc_livox_mid100": partial(_listed, "Livox MID-100"),
}


def _lens(K: object, size: Sequence[int], distortion: Sequence[float] = ()) -> dict[str, object]:
    lens = {"model": "plumb_bob", "width": size[0], "height": size[1], "K": np.array(K).tolist()}
    return lens | ({"distortion": list(distortion)} if distortion else {})


def _frame(points: Path, image: Path, labels: Path | None = None) -> dict[str, str]:
    frame = {"points": str(points), "image": str(image)}
    return frame if labels is None else frame | {"image_labels": str(labels)}


def _write(
    folder: Path,
    name: str,
    lens: object,
    frames: Sequence[dict[str, str]],
    T: np.ndarray,
    **others: object,
) -> RealDrive:
    """Write a drive with other keys of its drive.yaml, such as `KITTI`."""
    path = folder / name.replace(",", "").replace(" ", "_")
    path.mkdir()
    has_labels = all("image_labels" in frame for frame in frames)
    document = {
        "semcal_drive": 1,
        "camera": lens,
        "frames": list(frames),
        "T_camera_lidar": T.tolist(),
        **others,
    }
    if has_labels:
        document["classes"] = {"image": {name: [index] for index, name in enumerate(CITYSCAPES)}}
    (path / "drive.yaml").write_text(yaml.safe_dump(document))
    return RealDrive(name, path, ("image", "image_labels") if has_labels else ("image",))
