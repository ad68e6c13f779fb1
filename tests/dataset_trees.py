"""Tiny data sets in their real layouts and names, each with a transform that is known in closed form.

All rigs look alike: LiDAR x forward, y left, z up; the camera looks forward, and sits where each tree says.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from camera_infos import KITTI_360_FISHEYE, ROS

from semcal_cli.files.image_files import write_image
from semcal_cli.geometry.arrays import Pose

FORWARD = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])
"""T_camera_lidar of a camera at the LiDAR's origin: x right = -y, y down = -z, z forward = x."""
WIDTH, HEIGHT = 64, 32
POINTS = np.array([[10, 1, 0, 0.5], [10, -1, 1, 0.25], [5, 0, -1, 1]], dtype="<f4")


@dataclass(frozen=True)
class Tree:
    """What was made, and what an import of it has to find."""

    root: Path
    arguments: tuple[str, ...]
    """What `semcal import NAME ROOT` needs beyond `-o`."""
    T_camera_lidar: Pose
    points: dict[str, list[int]]
    """Some of the named classes of points."""
    image: dict[str, list[int]]
    """Some of the named classes of pixels."""
    ignored: tuple[list[int], list[int]]
    """Ids of points and of pixels that carry no information."""


def moved(T: Pose, *translation: float) -> Pose:
    """The transform with something added to its translation."""
    result = T.copy()
    result[:3, 3] += translation
    return result


def numbers(values: npt.ArrayLike) -> str:
    """As KITTI's files print them."""
    return " ".join(f"{value:.12e}" for value in np.ravel(values))


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def write_cloud(path: Path, columns: int = 4) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cloud = np.zeros((len(POINTS), columns), dtype="<f4")
    cloud[:, :4] = POINTS
    cloud.tofile(path)


def write_labels(path: Path, ids: Sequence[int], dtype: str = "<u4") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.array(ids, dtype=dtype).tofile(path)


def write_ids(path: Path, width: int = WIDTH, height: int = HEIGHT, value: int = 7) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_image(np.full((height, width), value, dtype=np.uint8), path)


def write_colors(path: Path, rgb: tuple[int, int, int]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_image(np.full((HEIGHT, WIDTH, 3), rgb[::-1], dtype=np.uint8), path)


def rellis3d(root: Path, num_frames: int = 3) -> Tree:
    """The camera looks along -x, one metre down it; the quaternion of the file is the inverse turn, w first by name."""
    folder = root / "00000"
    for number in range(104, 104 + num_frames):
        name = f"frame{number:06d}-15816246{number - 41:02d}_149"
        write_cloud(folder / f"os1_cloud_node_kitti_bin/{number:06d}.bin")
        write_labels(folder / f"os1_cloud_node_semantickitti_label_id/{number:06d}.label", [3, 4, 0])
        write_ids(folder / f"pylon_camera_node/{name}.png", 1920, 1200)
        (folder / f"pylon_camera_node/{name}.png").rename(folder / f"pylon_camera_node/{name}.jpg")
        write_ids(folder / f"pylon_camera_node_label_id/{name}.png", 1920, 1200)
    write(folder / "camera_info.txt", "2813.643275 2808.326079 969.285772 624.049972")
    transform = "{q: {w: -0.5, x: 0.5, y: 0.5, z: -0.5}, t: {x: -1, y: 0, z: 0}}"
    write(folder / "transforms.yaml", f"os1_cloud_node-pylon_camera_node: {transform}\n")
    T = np.array([[0, 1, 0, 0], [0, 0, -1, 0], [-1, 0, 0, -1], [0, 0, 0, 1.0]])
    classes = {"grass": [3], "tree": [4], "sky": [7]}
    return Tree(root, (), T, classes, classes, ([0], [0]))


def kitti_object(root: Path) -> Tree:
    """Two frames of one day, and one of another; camera 2 stands 0.1 m left of camera 0, and looks the same way."""
    folder = root / "training"
    for number, focal in enumerate((50, 50, 60)):
        lines = [
            f"P{camera}: {focal} 0 31.5 {camera * 0.05 * focal} 0 {focal} 15.5 0 0 0 1 0"
            for camera in range(4)
        ]
        lines += ["R0_rect: 1 0 0 0 1 0 0 0 1", f"Tr_velo_to_cam: {numbers(FORWARD[:3])}"]
        write(folder / f"calib/{number:06d}.txt", "\n".join(lines))
        write_cloud(folder / f"velodyne/{number:06d}.bin")
        write_ids(folder / f"image_2/{number:06d}.png")
    return Tree(root, (), moved(FORWARD, 0.1, 0.0, 0.0), {}, {}, ([], []))


def opencalib(root: Path) -> Tree:
    """T is LiDAR to camera."""
    T = moved(FORWARD, 0.1, 0.2, 0.3)
    for sequence, distortion in (("1", "-0.1 0.2 0.001 0.002"), ("3", "-0.1 0.2 0.001 0.002 0.4")):
        lines = f"K: 50 0 31.5 0 50 15.5 0 0 1\nD: {distortion}\nT: {numbers(T[:3])}\n"
        write(root / sequence / "calib.txt", lines)
        write(root / sequence / "calib.pcd", "# .PCD v0.7\n")
        write_ids(root / sequence / "calib.png")
    return Tree(root, ("--sequence", "1"), T, {}, {}, ([], []))


def nuscenes(root: Path) -> Tree:
    """The camera 1 m above the LiDAR, both turned in the vehicle; it drives 0.2 m on before the image is taken.

    The vehicle looks along the world's y axis, so a mistaken order of the quaternion or a forgotten pose shows.
    """
    half = np.sqrt(0.5)
    turned = [half, 0.0, 0.0, half]  # w x y z: 90 degrees about z
    optical = [0.5, -0.5, 0.5, -0.5]  # camera axes in a vehicle frame: right = -y, down = -z, forward = x
    K = [[50, 0, 31.5], [0, 50, 15.5], [0, 0, 1]]
    calibrated = ("token", "sensor_token", "translation", "rotation", "camera_intrinsic")
    keyframe = ("token", "calibrated_sensor_token", "ego_pose_token", "filename", "timestamp")
    others = {"sample_token": "sample", "is_key_frame": True, "width": WIDTH, "height": HEIGHT}
    sweep, image = "samples/LIDAR_TOP/a__LIDAR_TOP__1.pcd.bin", "samples/CAM_FRONT/a__CAM_FRONT__1.jpg"
    tables: dict[str, list[dict[str, object]]] = {
        "sensor": [{"token": "s0", "channel": "LIDAR_TOP"}, {"token": "s1", "channel": "CAM_FRONT"}],
        "calibrated_sensor": [
            dict(zip(calibrated, ("c0", "s0", [1.0, 0.0, 2.0], [1.0, 0.0, 0.0, 0.0], []), strict=True)),
            dict(zip(calibrated, ("c1", "s1", [1.0, 0.0, 3.0], optical, K), strict=True)),
        ],
        "ego_pose": [
            {"token": "e0", "translation": [100.0, 200.0, 0.0], "rotation": turned},
            {"token": "e1", "translation": [100.0, 200.2, 0.0], "rotation": turned},
        ],
        "scene": [{"token": "scene", "name": "scene-0061"}],
        "sample": [{"token": "sample", "scene_token": "scene"}],
        "sample_data": [
            dict(zip(keyframe, ("d0", "c0", "e0", sweep, 1_500_000), strict=True)) | others,
            dict(zip(keyframe, ("d1", "c1", "e1", image, 1_525_000), strict=True)) | others,
        ],
        "lidarseg": [
            {"token": "l", "sample_data_token": "d0", "filename": "lidarseg/v1.0-mini/d0_lidarseg.bin"}
        ],
    }
    for name, rows in tables.items():
        write(root / f"v1.0-mini/{name}.json", json.dumps(rows))
    write_cloud(root / sweep, columns=5)
    write(root / image, "no image")
    write_labels(root / "lidarseg/v1.0-mini/d0_lidarseg.bin", [24, 17, 0], "u1")
    T = moved(FORWARD, 0.0, 1.0, -0.2)
    return Tree(root, (), T, {"vehicle.car": [17], "flat.driveable_surface": [24]}, {}, ([0, 31], []))


P2 = np.array([[50, 0, 31.5, 3.0315], [0, 50, 15.5, 0.0155], [0, 0, 1, 0.001]])
"""KITTI's camera 2: inv(K) P[:, 3] is 6 cm to its right, nothing down and 1 mm ahead."""
BESIDE = (0.06, 0.0, 0.001)


def kitti_odometry(root: Path, num_frames: int = 3) -> Tree:
    """Tr is LiDAR to rectified camera 0; camera 2 is 6 cm beside it."""
    folder = root / "sequences/00"
    for number in range(num_frames):
        write_cloud(folder / f"velodyne/{number:06d}.bin")
        write_ids(folder / f"image_2/{number:06d}.png")
    T_camera0_lidar = moved(FORWARD, 0.1, 0.2, 0.3)
    projections = "".join(f"P{k}: {numbers(P2)}\n" for k in range(4))
    write(folder / "calib.txt", f"{projections}Tr: {numbers(T_camera0_lidar[:3])}\n")
    write(folder / "times.txt", "".join(f"{0.1 * number:e}\n" for number in range(num_frames)))
    return Tree(root, (), moved(T_camera0_lidar, *BESIDE), {}, {}, ([], []))


def semantickitti(root: Path) -> Tree:
    """The instance is in the upper 16 bits."""
    tree = kitti_odometry(root)
    for number in range(3):
        labels = [40, 5 << 16 | 252, 0]
        write_labels(root / f"sequences/00/labels/{number:06d}.label", labels)
    return Tree(root, (), tree.T_camera_lidar, {"road": [40], "car": [10, 252]}, {}, ([0, 1], []))


KITTI_RAW_DRIVE = "2011_09_26/2011_09_26_drive_0001_sync"


def kitti_raw(root: Path) -> Tree:
    """calib_velo_to_cam.txt is off by a quarter turn about the optical axis, which R_rect_00 takes back."""
    day, drive = root / "2011_09_26", root / KITTI_RAW_DRIVE
    for number in range(2):
        write_cloud(drive / f"velodyne_points/data/{number:010d}.bin")
        write_ids(drive / f"image_02/data/{number:010d}.png")
    stamps = "2011-09-26 13:02:25.500000000\n2011-09-26 13:02:25.750000000\n"
    write(drive / "velodyne_points/timestamps.txt", stamps)
    write(drive / "image_02/timestamps.txt", stamps)
    T_camera0_lidar = moved(FORWARD, 0.1, 0.2, 0.3)
    R_rect = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    unrectified = R_rect.T @ T_camera0_lidar[:3]
    header = "calib_time: 15-Mar-2012 11:37:16\n"
    lines = f"R: {numbers(unrectified[:, :3])}\nT: {numbers(unrectified[:, 3])}\ndelta_f: 0 0\n"
    write(day / "calib_velo_to_cam.txt", header + lines)
    lines = f"R_rect_00: {numbers(R_rect)}\nS_rect_02: 6.4e+01 3.2e+01\nP_rect_02: {numbers(P2)}\n"
    write(day / "calib_cam_to_cam.txt", header + "S_02: 1.392e+03 5.12e+02\n" + lines)
    return Tree(root, (), moved(T_camera0_lidar, *BESIDE), {}, {}, ([], []))


KITTI_360_DRIVE = "2013_05_28_drive_0000_sync"
QUARTER = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
"""A quarter turn about z."""


def kitti_360(root: Path) -> Tree:
    """Camera 1 is 0.6 m beside camera 0 and rolled by a quarter turn, which its R_rect takes back.

    The vehicle looks along the world's y axis at (1000, 2000, 100); the window is in world coordinates.
    """
    T_camera0_lidar = moved(FORWARD, 0.1, 0.2, 0.3)
    T_velo_camera0 = np.linalg.inv(T_camera0_lidar)
    T_pose_camera0 = moved(np.linalg.inv(FORWARD), 1.5, 0.0, 0.0)
    T_camera1_camera0 = np.linalg.inv(QUARTER) @ moved(np.eye(4), -0.6, 0.0, 0.0)
    cameras = {
        "image_00": T_pose_camera0,
        "image_01": T_pose_camera0 @ np.linalg.inv(T_camera1_camera0),
        "image_02": T_pose_camera0,
        "image_03": T_pose_camera0,
    }
    folder = root / "calibration"
    write(folder / "calib_cam_to_pose.txt", "".join(f"{k}: {numbers(T[:3])}\n" for k, T in cameras.items()))
    write(folder / "calib_cam_to_velo.txt", numbers(T_velo_camera0[:3]) + "\n")
    write(folder / "perspective.txt", kitti_360_perspective())
    write(folder / "image_02.yaml", KITTI_360_FISHEYE)
    T_world_pose = moved(QUARTER, 1000.0, 2000.0, 100.0)
    for camera, image in (("image_00", "data_rect"), ("image_01", "data_rect"), ("image_02", "data_rgb")):
        write_ids(root / f"data_2d_raw/{KITTI_360_DRIVE}/{camera}/{image}/0000000250.png")
    for camera in ("image_00", "image_01"):
        write_ids(root / f"data_2d_raw/{KITTI_360_DRIVE}/{camera}/data_rgb/0000000250.png", *RAW_SIZE)
    for camera in ("image_00", "image_01", "image_02"):
        write_ids(root / f"data_2d_semantics/train/{KITTI_360_DRIVE}/{camera}/semantic/0000000250.png")
    write(root / f"data_poses/{KITTI_360_DRIVE}/poses.txt", f"250 {numbers(T_world_pose[:3])}\n")
    T_world_lidar = T_world_pose @ T_pose_camera0 @ T_camera0_lidar
    windows = root / f"data_3d_semantics/train/{KITTI_360_DRIVE}/static"
    kitti_360_window(windows / "0000000002_0000000385.ply", T_world_lidar)
    kitti_360_window(windows / "0000000372_0000000610.ply", moved(T_world_lidar, 500.0, 0.0, 0.0))
    T = moved(T_camera0_lidar, -0.6, 0.0, 0.0)
    classes = {"road": [7], "car": [26], "pole": [17, 18, 37]}
    return Tree(root, ("--camera", "image_01"), T, classes, classes, ([0, 1, 2, 3], [0, 1, 2, 3]))


RAW_SIZE = (WIDTH + 4, HEIGHT + 6)
RAW_D = (-0.344441, 0.141678, 0.000414, -0.000222, -0.029608)
"""Distortion of camera 0 in the real file: k1 k2 p1 p2 k3."""


def kitti_360_perspective() -> str:
    """P_rect_01 has the baseline in its last column, and K ends in 0 0 0, as in the real file."""
    baseline = np.array([[50, 0, 31.5, -30.0], [0, 50, 15.5, 0], [0, 0, 1, 0]])
    rows = {"00": (np.eye(3), np.c_[baseline[:, :3], np.zeros(3)]), "01": (QUARTER[:3, :3], baseline)}
    lines = "calib_time: 2019-10-29\ncorner_dist: 0.0\n"
    for camera, (R_rect, P_rect) in rows.items():
        lines += f"S_{camera}: {RAW_SIZE[0]}.0 {RAW_SIZE[1]}.0\nK_{camera}: 70 0 33 0 69 17 0 0 0\n"
        lines += f"D_{camera}: {numbers(RAW_D)}\n"
        lines += f"S_rect_{camera}: {WIDTH}.0 {HEIGHT}.0\nR_rect_{camera}: {numbers(R_rect)}\n"
        lines += f"P_rect_{camera}: {numbers(P_rect)}\n"
    return lines


def kitti_360_window(path: Path, T_world_lidar: Pose) -> None:
    """Three points near the LiDAR, the last of them seen by no image; one far away, and one behind the first."""
    properties = ["float x", "float y", "float z", "uchar red", "uchar green", "uchar blue", "int semantic"]
    properties += ["int instance", "uchar visible", "float confidence"]
    vertices = np.zeros(5, dtype="<f4,<f4,<f4,u1,u1,u1,<i4,<i4,u1,<f4")
    lidar = np.vstack([POINTS[:, :3], [900.0, 0.0, 0.0], 2.0 * POINTS[0, :3]]).astype(float)
    world = lidar @ T_world_lidar[:3, :3].T + T_world_lidar[:3, 3]
    vertices["f0"], vertices["f1"], vertices["f2"] = world.T
    vertices["f6"], vertices["f8"] = [7, 26, 26, 11, 11], [1, 1, 0, 1, 1]
    header = "".join(f"property {name}\n" for name in properties)
    path.parent.mkdir(parents=True, exist_ok=True)
    content = f"ply\nformat binary_little_endian 1.0\nelement vertex 5\n{header}end_header\n"
    path.write_bytes(content.encode() + vertices.tobytes())


CARLA_PLY_HEAD = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(
    f"property float32 {axis}\n" for axis in "xyz"
)
CARLA_PLY = f"""{CARLA_PLY_HEAD}property float32 CosAngle
property uint32 ObjIdx
property uint32 ObjTag
end_header
10.0 -1.0 0.0 0.5 0 1
10.0 1.0 1.0 0.5 77 14
5.0 0.0 -1.0 0.5 0 24
"""
CARLA_PLAIN_PLY = f"""{CARLA_PLY_HEAD}property float32 I
end_header
10.0 -1.0 0.0 0.5
10.0 1.0 1.0 0.25
5.0 0.0 -1.0 1.0
"""


def carla(root: Path, *, semantic: bool = True) -> Tree:
    """Unreal: x forward, y right, z up, left-handed. The camera is 0.4 m right of the LiDAR and 0.5 m below it."""
    placed = {"x": 0.0, "y": 0.0, "z": 2.0, "roll": 0.0, "pitch": 0.0, "yaw": 0.0}
    lens = {"width": WIDTH, "height": HEIGHT, "fov": 90.0}
    at = placed | {"y": 0.4, "z": 1.5}
    rig = [
        {"id": "lidar", "type": "sensor.lidar.ray_cast" + "_semantic" * semantic} | placed,
        {"id": "labels", "type": "sensor.camera.semantic_segmentation"} | at | lens,
        {"id": "rgb", "type": "sensor.camera.rgb"} | at | lens,
    ]
    write(root / "sensors.json", json.dumps(rig))
    for number in (17, 18):
        write(root / f"lidar/{number:06d}.ply", CARLA_PLY if semantic else CARLA_PLAIN_PLY)
        write_colors(root / f"labels/{number:06d}.png", (14, 0, 0))
        write_colors(root / f"rgb/{number:06d}.png", (90, 80, 70))
    # right of the LiDAR is -y there: the LiDAR is 0.4 m left of the camera, and 0.5 m above it
    T = moved(FORWARD, -0.4, -0.5, 0.0)
    points, ignored = ({"Road": [1], "Car": [14]}, [0]) if semantic else ({}, [])
    return Tree(root, ("--version", "0.9.15"), T, points, {}, (ignored, []))


TREES: dict[str, Callable[[Path], Tree]] = {
    "rellis-3d": rellis3d,
    "opencalib": opencalib,
    "nuscenes": nuscenes,
    "kitti-odometry": kitti_odometry,
    "semantickitti": semantickitti,
    "kitti-raw": kitti_raw,
    "kitti-object": kitti_object,
    "kitti-360": kitti_360,
    "carla": carla,
}


def own_data(root: Path) -> list[object]:
    for number in (1, 2, 3):
        write_cloud(root / f"clouds/{number:06d}.bin")
        write_labels(root / f"clouds/{number:06d}.label", [1, 2, 3])
    for number in (2, 3, 4):
        write_ids(root / f"labels/{number:06d}.png")
    write(root / "camera.yaml", ROS)
    return [
        "--points",
        root / "clouds/*.bin",
        "--point-labels",
        root / "clouds/*.label",
        "--image-labels",
        root / "labels/*.png",
        "--camera-info",
        root / "camera.yaml",
    ]
