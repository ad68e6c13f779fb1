"""Names of cameras and LiDARs, as rigs have them and as they only look like."""

import pytest
from format_files import T_ANY

from semcal_cli.errors import InputError
from semcal_cli.formats.format import FormatOptions
from semcal_cli.formats.frame_names import CAMERA_WORDS, LIDAR_WORDS, from_frames, has_word, name_frames

NAMES = {
    (True, False): (
        "camera0/camera_link camera1/camera_optical_link CAM_FRONT CAM_BACK_LEFT frontCamera cam0 front_optical "
        "camera_color_optical_frame RGBCamera CamFront pylon_camera_node usb-cam.2 /cam/left tier4_camera"
    ),
    (False, True): (
        "LIDAR_TOP velodyne_top_base_link velodyne os1_lidar os_sensor os0 OS1-128 pandar40p livox_front hesai_top "
        "PandarQT vlp16 VLP-16 hdl64e robosense_helios rslidar laser LiDAR_top topLiDAR base_scan ouster/points lidar "
        "front-lidar.1 OSLidar"
    ),
    # Parts of words say nothing.
    (False, False): "base_link imu gnss oscar position scandium camber solidarity",
    (True, True): "hesai_cam velodyne_camera os_cam_optical lidarCamera livox/cam0",
}
"""Names, by whether they have a word of a camera and of a LiDAR."""


@pytest.mark.parametrize("told", NAMES)
def test_sensors_are_told_by_words(told: tuple[bool, bool]) -> None:
    names = [*NAMES[told].split(), *(["left camera"] if told == (True, False) else [])]
    assert {
        name: (has_word(name, CAMERA_WORDS), has_word(name, LIDAR_WORDS)) for name in names
    } == dict.fromkeys(names, told)


@pytest.mark.parametrize("name", NAMES[True, True].split())
def test_a_camera_beside_a_lidar_is_ambiguous(name: str) -> None:
    with pytest.raises(InputError, match=f"found frames velodyne, {name}; add camera to name"):
        from_frames("a", T_ANY, "velodyne", name, FormatOptions(frame="optical"))
    from_frames("a", T_ANY, "velodyne", name, FormatOptions(frame="optical", camera=name))
    with pytest.raises(InputError, match=f"found frames cam0, {name}; add lidar to name the LiDAR's own"):
        from_frames("a", T_ANY, "cam0", name, FormatOptions(frame="optical", camera="cam0"))
    from_frames("a", T_ANY, "cam0", name, FormatOptions(frame="optical", lidar=name))


def test_a_camera_whose_name_holds_a_lidars_letters_is_told() -> None:
    from_frames("a", T_ANY, "pos_camera_optical", "velodyne", FormatOptions())
    with pytest.raises(InputError, match="found frames gnss_pos, cam_optical; add lidar to name"):
        from_frames("a", T_ANY, "gnss_pos", "cam_optical", FormatOptions())


def test_one_frame_is_never_both() -> None:
    with pytest.raises(InputError, match="found frames cam0, cam0, expected two frames"):
        from_frames("a", T_ANY, "cam0", "cam0", FormatOptions(frame="optical", camera="cam0"))
    with pytest.raises(InputError, match="found 'camera_optical_frame' for both, expected two names"):
        name_frames(T_ANY, FormatOptions(lidar="camera_optical_frame"))
