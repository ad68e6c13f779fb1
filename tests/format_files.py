"""One transform in the file of every format, as scipy turns an asymmetric pose into it."""

import json
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from semcal_cli.formats.format import FormatOptions

RELLIS3D_KEY = "os1_cloud_node-pylon_camera_node"

# A camera 1 m down the LiDAR's -x axis that looks along it: x right = y, y down = -z, z forward = -x.
T_CAMERA_LIDAR = np.array([[0, 1, 0, 0], [0, 0, -1, 0], [-1, 0, 0, -1], [0, 0, 0, 1.0]])
RELLIS3D = {RELLIS3D_KEY: {"q": {"w": -0.5, "x": 0.5, "y": 0.5, "z": -0.5}, "t": {"x": -1, "y": 0, "z": 0}}}


# Every format, against what scipy makes of an asymmetric pose.

T_ANY = np.eye(4)
T_ANY[:3, :3] = Rotation.from_euler("xyz", [73.0, -21.0, 38.0], degrees=True).as_matrix()
T_ANY[:3, 3] = [0.31, -0.52, 0.17]
T_LIDAR_CAMERA = np.linalg.inv(T_ANY)
BODY_OF_OPTICAL = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
T_KIT_LIDAR = np.eye(4)
T_KIT_LIDAR[:3, :3] = Rotation.from_euler("xyz", [2.0, 3.0, 91.0], degrees=True).as_matrix()
T_KIT_LIDAR[:3, 3] = [0.1, 0.2, 1.3]


def xyzw(T: np.ndarray) -> list[float]:
    return Rotation.from_matrix(T[:3, :3]).as_quat().tolist()


def wxyz(T: np.ndarray) -> list[float]:
    return [xyzw(T)[3], *xyzw(T)[:3]]


def rpy(T: np.ndarray) -> list[float]:
    return Rotation.from_matrix(T[:3, :3]).as_euler("xyz").tolist()


def words(values: Any) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(values))


def named(keys: str, values: Any) -> dict[str, float]:
    return {key: float(value) for key, value in zip(keys, values, strict=True)}


def sensor(T: np.ndarray) -> dict[str, float]:
    return dict(zip(("x", "y", "z", "roll", "pitch", "yaw"), [*T[:3, 3].tolist(), *rpy(T)], strict=True))


T_LIDAR_BODY = T_LIDAR_CAMERA @ np.linalg.inv(BODY_OF_OPTICAL)
R0 = Rotation.from_euler("xyz", [0.4, -0.3, 0.9], degrees=True).as_matrix()
ARGUMENTS = " ".join(
    f"--{k} {v!r}" for k, v in zip("xyz", T_LIDAR_CAMERA[:3, 3].tolist(), strict=True)
) + " ".join(["", *(f"--q{k} {v!r}" for k, v in zip("xyzw", xyzw(T_LIDAR_CAMERA), strict=True))])
STAMPED = {
    "header": {"frame_id": "os_sensor", "stamp": {"secs": 0, "nsecs": 0}},
    "child_frame_id": "front_optical",
    "transform": {
        "translation": named("xyz", T_LIDAR_CAMERA[:3, 3]),
        "rotation": named("xyzw", xyzw(T_LIDAR_CAMERA)),
    },
}
KIT = {
    "sensor_kit_base_link": {
        "camera0/camera_link": sensor(T_KIT_LIDAR @ T_LIDAR_BODY),
        "camera1/camera_optical_link": sensor(T_KIT_LIDAR @ T_LIDAR_CAMERA),
        "velodyne_top_base_link": sensor(T_KIT_LIDAR),
    }
}
SENSORS = [
    {"token": token, "sensor_token": "s", "translation": T[:3, 3].tolist(), "rotation": wxyz(T)}
    for token, T in (("a", T_KIT_LIDAR @ T_LIDAR_CAMERA), ("b", T_KIT_LIDAR))
]
T_R0 = np.eye(4)
T_R0[:3, :3] = R0
OPENCV = (
    "%YAML:1.0\n---\nCameraExtrinsicMat: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n   data: [{}]\n"
)
L2C, C2L = FormatOptions(direction="lidar-to-camera"), FormatOptions(direction="camera-to-lidar")

# A robot whose camera and LiDAR stand on its base, and a part that hangs in the air.
ROBOT = (
    "<robot><joint name='up' type='fixed'><origin xyz='0 0 1.5' rpy='0 0 0.3'/><parent link='base_link'/>"
    "<child link='velodyne'/></joint><joint name='out' type='fixed'><origin xyz='0.7 0.1 0.4' rpy='0 0.2 0'/>"
    "<parent link='base_link'/><child link='camera_link'/></joint><joint name='in' type='fixed'>"
    "<origin rpy='-1.5707963267948966 0 -1.5707963267948966'/><parent link='camera_link'/>"
    "<child link='camera_optical_frame'/></joint><joint name='loose' type='fixed'><parent link='head'/>"
    "<child link='nose'/></joint></robot>"
)

# A rig of DriveWorks whose camera was corrected by a turn and a shift.
T_TURN = np.eye(4)
T_TURN[:3, :3] = Rotation.from_euler("xyz", [1.0, -2.0, 3.0], degrees=True).as_matrix()
T_RIG_NOMINAL = T_KIT_LIDAR @ T_LIDAR_BODY @ np.linalg.inv(T_TURN)
RIG = {
    "rig": {
        "sensors": [
            {
                "name": "camera:front:wide:120fov",
                "nominalSensor2Rig_FLU": {
                    "roll-pitch-yaw": np.degrees(rpy(T_RIG_NOMINAL)).tolist(),
                    "t": (T_RIG_NOMINAL[:3, 3] - [0.1, 0.2, -0.3]).tolist(),
                },
                "correction_sensor_R_FLU": {"roll-pitch-yaw": [1.0, -2.0, 3.0]},
                "correction_rig_T": [0.1, 0.2, -0.3],
            },
            {
                "name": "lidar:top",
                "nominalSensor2Rig_FLU": {
                    "roll-pitch-yaw": np.degrees(rpy(T_KIT_LIDAR)).tolist(),
                    "t": T_KIT_LIDAR[:3, 3].tolist(),
                },
            },
            {"name": "vehicle:can"},
        ]
    },
    "version": 2,
}

FILES: dict[str, tuple[str, str, FormatOptions]] = {
    "ros2-static-transform": (
        "a.sh",
        f"ros2 run tf2_ros static_transform_publisher {ARGUMENTS} --frame-id os_sensor --child-frame-id cam_optical",
        FormatOptions(),
    ),
    "ros2-static-transform, parent is the camera, body": (
        "a.sh",
        f"static_transform_publisher {words(np.linalg.inv(T_LIDAR_BODY)[:3, 3])} "
        f"{words(rpy(np.linalg.inv(T_LIDAR_BODY))[::-1])} camera_link lidar 100",
        FormatOptions(frame="body"),
    ),
    "ros2-launch": (
        "a.launch.xml",
        "<launch><node pkg='tf2_ros' exec='static_transform_publisher' args='0 0 0 0 0 0 base imu'/>"
        f"<node pkg='tf2_ros' exec='static_transform_publisher' args='{ARGUMENTS} --frame-id l --child-frame-id "
        "cam0_optical'/></launch>",
        FormatOptions(lidar="l"),
    ),
    "tf2": ("a.yaml", yaml.dump(STAMPED), FormatOptions()),
    "pose-with-covariance": (
        "a.yaml",
        yaml.dump(
            {
                "pose": {
                    "position": named("xyz", T_LIDAR_CAMERA[:3, 3]),
                    "orientation": named("xyzw", xyzw(T_LIDAR_CAMERA)),
                },
                "covariance": [0.0] * 36,
            }
        ),
        FormatOptions(),
    ),
    "gtsam": (
        "a.json",
        json.dumps({"T_lidar_camera": T_LIDAR_CAMERA.tolist(), "tangent": "", "covariance": []}),
        FormatOptions(),
    ),
    "apollo": ("a.yaml", yaml.dump(STAMPED | {"child_frame_id": "front_6mm"}), FormatOptions()),
    "autoware": ("a.yaml", yaml.dump(KIT), FormatOptions(camera="camera0/camera_link")),
    "autoware, optical": ("a.yaml", yaml.dump(KIT), FormatOptions(camera="camera1/camera_optical_link")),
    "urdf": (
        "a.urdf",
        "<robot><joint name='i' type='fixed'><parent link='base'/><child link='imu'/></joint>"
        f"<joint name='j' type='fixed'><origin xyz='{words(T_LIDAR_BODY[:3, 3])}' rpy='{words(rpy(T_LIDAR_BODY))}'/>"
        "<parent link='os_sensor'/><child link='camera_link'/></joint></robot>",
        FormatOptions(frame="body"),
    ),
    "kitti-odometry": ("calib.txt", f"P0: {words(np.eye(3, 4))}\nTr: {words(T_ANY[:3])}\n", FormatOptions()),
    "kitti-object": (
        "000000.txt",
        f"R0_rect: {words(R0)}\nTr_velo_to_cam: {words((np.linalg.inv(T_R0) @ T_ANY)[:3])}\nTr_imu_to_velo: 1\n",
        FormatOptions(),
    ),
    "kitti-raw": (
        "calib_velo_to_cam.txt",
        f"calib_time: 15-Mar-2012 11:37:16\nR: {words(T_ANY[:3, :3])}\nT: {words(T_ANY[:3, 3])}\ndelta_f: 0 0\n",
        FormatOptions(),
    ),
    "kitti-360": ("calib_cam_to_velo.txt", words(T_LIDAR_CAMERA[:3]), FormatOptions()),
    "rellis-3d": (
        "transforms.yaml",
        yaml.dump(
            {
                RELLIS3D_KEY: {
                    "q": named("wxyz", wxyz(T_LIDAR_CAMERA)),
                    "t": named("xyz", T_LIDAR_CAMERA[:3, 3]),
                }
            }
        ),
        FormatOptions(),
    ),
    "nuscenes": ("calibrated_sensor.json", json.dumps(SENSORS), FormatOptions(camera="a", lidar="b")),
    "kalibr": ("chain.yaml", f"cam0: {{T_cam_lidar: {T_ANY.tolist()}, rostopic: /a}}\n", FormatOptions()),
    "lidar2cam": (
        "calib.json",
        json.dumps(
            {key: {"lidar2cam": T.tolist()} for key, T in (("CAM_FRONT", T_ANY), ("CAM_BACK", np.eye(4)))}
        ),
        FormatOptions(camera="CAM_FRONT"),
    ),
    "opencv": ("e.yml", OPENCV.format(", ".join(words(T_LIDAR_CAMERA).split())), C2L),
    "direct-visual-lidar": (
        "calib.json",
        json.dumps({"results": {"T_lidar_camera": [*T_LIDAR_CAMERA[:3, 3].tolist(), *xyzw(T_LIDAR_CAMERA)]}}),
        FormatOptions(),
    ),
    "opencalib": ("calib.txt", f"K: 1 0 0 0 1 0 0 0 1\nD: 0 0 0 0\nT: {words(T_ANY[:3])}\n", FormatOptions()),
    "fast-livo2": (
        "avia.yaml",
        f"/**:\n  ros__parameters:\n    extrin_calib:\n      Rcl: {T_ANY[:3, :3].ravel().tolist()}\n"
        f"      Pcl: {T_ANY[:3, 3].tolist()}\n",
        FormatOptions(),
    ),
    "colmap": (
        "rig_config.json",
        '[{"cameras": [{"image_prefix": "left/"}, {"image_prefix": "right/", '
        f'"cam_from_rig_rotation": {wxyz(T_ANY)}, "cam_from_rig_translation": {T_ANY[:3, 3].tolist()}}}]}}]',
        FormatOptions(),
    ),
    "ros2-launch-py": (
        "a.launch.py",
        "from launch_ros.actions import Node\nnode = Node(executable='static_transform_publisher', arguments="
        f"{[*ARGUMENTS.split(), '--frame-id', 'os_sensor', '--child-frame-id', 'cam_optical']})\n",
        FormatOptions(),
    ),
    "calibration-anywhere": (
        "extrinsics.yaml",
        "# Position xyz; Quaternions xyzw\n"
        + "".join(
            f'{name}:\n  parent: "base_link"\n  child: "{name}"\n  value: {[*T[:3, 3].tolist(), *xyzw(T)]}\n'
            for name, T in (
                ("front_3d_lidar", T_KIT_LIDAR),
                ("chassis_imu", np.eye(4)),
                ("front_stereo_camera", T_KIT_LIDAR @ T_LIDAR_BODY),
            )
        ),
        FormatOptions(frame="body"),
    ),
    "driveworks": ("rig.json", json.dumps(RIG), FormatOptions(camera="camera:front:wide:120fov")),
    "opencalib-json": (
        "top_center_lidar-to-center_camera-extrinsic.json",
        json.dumps(
            {
                "top_center_lidar-to-center_camera-extrinsic": {
                    **{"sensor_name": "top_center_lidar", "target_sensor_name": "center_camera"},
                    **{"device_type": "relational", "param_type": "extrinsic"},
                    "param": {"time_lag": 0, "sensor_calib": {"rows": 4, "cols": 4, "data": T_ANY.tolist()}},
                }
            }
        ),
        FormatOptions(),
    ),
    "r3live": (
        "r3live_config.yaml",
        f"r3live_vio:\n  camera_ext_R: {T_LIDAR_CAMERA[:3, :3].ravel().tolist()}\n"
        f"  camera_ext_t: {T_LIDAR_CAMERA[:3, 3].tolist()}\n",
        FormatOptions(),
    ),
    "odin": (
        "cam_in_ex.txt",
        "Tcl_0: [\n"
        + "".join(f"  {', '.join(words(row).split())},\n" for row in T_ANY)
        + "]\ncam_0:\n  A11: 1\n",
        FormatOptions(),
    ),
    "extrinsic-matrix": ("extrinsics.yaml", yaml.dump({"extrinsic_matrix": T_LIDAR_CAMERA.tolist()}), C2L),
    "extrinsic-matrix, data": (
        "extrinsics.yaml",
        yaml.dump({"extrinsic_matrix": {"rows": 4, "cols": 4, "data": T_ANY.ravel().tolist()}}),
        L2C,
    ),
    "tum": ("pose.txt", f"# stamp x y z qx qy qz qw\n1.5 {words(T_ANY[:3, 3])} {words(xyzw(T_ANY))}\n", L2C),
    "text": ("T.txt", "\n".join(words(row) for row in T_LIDAR_CAMERA[:3]), C2L),
    "text, brackets": ("T.txt", str(T_ANY.tolist()), L2C),
}
