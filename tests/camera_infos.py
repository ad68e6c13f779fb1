"""Intrinsics of one camera, in the files of ROS, Kalibr and OpenCV."""

K = [[50.0, 0.0, 31.5], [0.0, 51.0, 15.5], [0.0, 0.0, 1.0]]

ROS = """
image_width: 64
image_height: 32
camera_name: front
camera_matrix: {rows: 3, cols: 3, data: [50, 0, 31.5, 0, 51, 15.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 0.2, 0.001, 0.002, 0.3]}
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix: {rows: 3, cols: 4, data: [40, 0, 30, 0, 0, 40, 15, 0, 0, 0, 1, 0]}
"""
ROS_MESSAGE = """
header: {frame_id: front}
height: 32
width: 64
distortion_model: rational_polynomial
d: [1, 2, 3, 4, 5, 6, 7, 8]
k: [50, 0, 31.5, 0, 51, 15.5, 0, 0, 1]
"""
ROS_ECHO = """
header:
  stamp: {sec: 1581624663, nanosec: 149000000}
  frame_id: front
height: 32
width: 64
distortion_model: plumb_bob
d:
- -0.1
- 0.2
- 0.001
- 0.002
- 0.3
k: [50.0, 0.0, 31.5, 0.0, 51.0, 15.5, 0.0, 0.0, 1.0]
p: [40.0, 0.0, 30.0, 0.0, 0.0, 40.0, 15.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 1
roi:
  x_offset: 0
  y_offset: 0
  height: 32
  width: 64
  do_rectify: false
---
"""
KALIBR = """
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.1, 0.2, 0.001, 0.002]
  distortion_model: radtan
  intrinsics: [50, 51, 31.5, 15.5]
  resolution: [64, 32]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
  camera_model: pinhole
  distortion_coeffs: [0.1, 0.2, 0.3, 0.4]
  distortion_model: equidistant
  intrinsics: [50, 51, 31.5, 15.5]
  resolution: [64, 32]
cam2:
  camera_model: omni
  distortion_coeffs: [-0.1, 0.2, 0.001, 0.002]
  distortion_model: radtan
  intrinsics: [1.5, 50, 51, 31.5, 15.5]
  resolution: [64, 32]
"""
OPENCV = """%YAML:1.0
---
calibration_time: "Mon 01 Jan 2024"
image_width: 64
image_height: 32
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 50., 0., 31.5, 0., 51., 15.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.1, 0.2, 0.001, 0.002, 0.3 ]
"""
OPENCV_XML = """<?xml version="1.0"?>
<opencv_storage>
<calibration_time>"Mon 01 Jan 2024"</calibration_time>
<image_width>64</image_width>
<image_height>32</image_height>
<!-- flags: +fix_aspectRatio -->
<flags>2</flags>
<fisheye_model>0</fisheye_model>
<camera_matrix type_id="opencv-matrix">
  <rows>3</rows>
  <cols>3</cols>
  <dt>d</dt>
  <data>
    50. 0. 3.15000000e+01 0. 51.
    1.55e+01 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix">
  <rows>5</rows>
  <cols>1</cols>
  <dt>d</dt>
  <data>
    -0.1 0.2 1.0e-03 2.0e-03 .3</data></distortion_coefficients>
<size><_>64</_><_>32</_></size>
</opencv_storage>
"""
LENS = {"width": 64, "height": 32, "K": K}
