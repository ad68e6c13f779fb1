"""Intrinsics of one camera, in the files of ROS, Kalibr and OpenCV, and of a fisheye of KITTI-360."""

from pathlib import Path

K = [[50.0, 0.0, 31.5], [0.0, 51.0, 15.5], [0.0, 0.0, 1.0]]
LENS = {"width": 64, "height": 32, "K": K}


def text(name: str) -> str:
    return (Path(__file__).parent / "cameras" / name).read_text()


ROS, ROS_MESSAGE, ROS_ECHO = text("ros.yaml"), text("ros_message.yaml"), text("ros_echo.yaml")
KALIBR, OPENCV, OPENCV_XML = text("kalibr.yaml"), text("opencv.yaml"), text("opencv.xml")
KITTI_360_FISHEYE = text("kitti_360_fisheye.yaml")
