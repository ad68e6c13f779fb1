"""Checks of the camera, the clocks and the motion."""

from semcal_cli.result.checks.check import Check

WRONG_FOCAL_LENGTH = Check(
    topic="focal-length",
    title="The focal length looks wrong",
    measures="gain of information with fx and fy 7 % longer or shorter",
    advice="check fx and fy of K, and that K is of pictures of this size",
    examples=(
        "the focal length looks wrong, points and pictures agree 4.2% better with fx and fy 7% shorter",
    ),
    advices=(
        (
            "calibrate with --refine-intrinsics fx,fy,cx,cy,k1, which finds fx 704.0 -> 640.1, fy 704.0 "
            "-> 639.5, cx 639.50 -> 639.38"
        ),
        (
            "check fx and fy of K, and that K is of pictures of this size, or calibrate more frames "
            "with --refine-intrinsics fx,fy,cx,cy,k1"
        ),
    ),
    means=(
        "Refined with another focal length, the labels agree better. Where these frames determine the "
        "intrinsics, the advice says what they find, each intrinsic as it is and as it was found; where "
        "they do not, it names the option alone."
    ),
    why="K is of pictures of another size or crop, or of another camera. With one frame it may be chance.",
    to_do=(
        "Compare K with `camera_info` and the size of the pictures. If they agree, calibrate with the "
        "option that is named: [when K or the clock is "
        "wrong](calibrating.md#when-k-or-the-clock-is-wrong)."
    ),
)
WRONG_INTRINSICS = Check(
    topic="intrinsics",
    title="The intrinsics look wrong",
    measures=(
        "score of the freed intrinsics (chi-square of 5, of many frames), and movement of the points as "
        "a share of the width of the picture"
    ),
    needs="a pose that is determined",
    advice="check K and the distortion, and that K is of pictures of this size, or calibrate the lens again",
    examples=(
        "the intrinsics look wrong (cx by 6.1 standard errors), freed they would move the points by "
        "14 pixels or more, chi-square 61 of 5, needed at most 12",
    ),
    advices=(
        (
            "calibrate with --refine-intrinsics fx,fy,cx,cy,k1, which finds fx 640.00 -> 639.88, cx "
            "647.50 -> 639.41"
        ),
        (
            "check K and the distortion, and that K is of pictures of this size, or calibrate the lens "
            "again, or calibrate more frames with --refine-intrinsics fx,fy,cx,cy,k1"
        ),
    ),
    means="If fx, fy, cx, cy and k1 were free beside the pose, the labels would change them by much.",
    why="A wrong principal point, distortion that is missing or stated twice (rectified pictures), or a crop.",
    to_do=(
        "Check whether the pictures are raw or rectified, and that K and `distortion` are for the same. "
        "If they are, calibrate with the option that is named: [when K or the clock is "
        "wrong](calibrating.md#when-k-or-the-clock-is-wrong)."
    ),
)
WRONG_CLOCKS = Check(
    topic="clocks",
    title="The clocks look wrong",
    measures="gain of information with pictures 15 or 50 ms earlier or later",
    needs="`motion:` that differs between frames",
    advice="check the clocks of camera and LiDAR, and correct image_stamp",
    examples=(
        "the clocks look wrong, points and pictures agree better by 2.4 standard errors if pictures "
        "are 15 ms later than image_stamp says",
    ),
    advices=(
        (
            "calibrate with --estimate-delay, which finds that pictures are 20.2 ms later than their "
            "stamps say"
        ),
        (
            "check the clocks of camera and LiDAR, and correct image_stamp, or calibrate more frames "
            "with --estimate-delay"
        ),
    ),
    means=(
        "With `motion:` known, another time of the pictures fits better. Where these frames determine "
        "the offset, the advice says it; where they do not, it names the option alone."
    ),
    why="The stamp is that of the reception, of the start or of the end of the exposure or the sweep.",
    to_do=(
        "Calibrate with `--estimate-delay`, or correct the stamps by the delay and calibrate again: "
        "[when K or the clock is wrong](calibrating.md#when-k-or-the-clock-is-wrong). `semcal verify "
        "--max-delay-ms` watches it from then on."
    ),
)
MOTION = Check(
    topic="motion",
    title="Motion is not compensated",
    measures="median displacement of the points by motion that is not compensated",
    needs="a drive that states its speed",
    advice="give motion.poses or motion.twist in the drive, or record at lower speed",
    examples=(
        "the LiDAR's motion is not compensated, half of the points are 5.2 pixels off or more, "
        "needed at most 3",
    ),
    means="At the stated speed the sweep is smeared by more pixels than a calibration bears.",
    why="The drive has only `speed_m_s:`, which moves no points.",
    to_do=(
        "Give poses or a twist ([drive.md](drive.md#a-lidar-that-moves-while-it-turns)), or record "
        "while standing or creeping."
    ),
)
SHUTTER = Check(
    topic="shutter",
    title="The rolling shutter is not compensated",
    measures="median displacement of the points by the rolling shutter",
    needs="a camera with `readout_s:`, and a drive that states its speed",
    advice="give motion.poses or motion.twist in the drive, or record at lower speed",
    examples=(
        "the rolling shutter is not compensated, since the drive gives no direction of its motion, "
        "half of the points are 3.8 pixels off or more, needed at most 3",
    ),
    means=(
        "The lines of a picture are exposed one after another, and at the stated speed points lie "
        "beside their pixels."
    ),
    why="The camera has a `readout_s:`, and the drive has only `speed_m_s:`, which moves no points.",
    to_do=(
        "Give poses or a twist ([drive.md](drive.md#a-lidar-that-moves-while-it-turns)), or record "
        "while standing or creeping."
    ),
)
FAR_CAMERA = Check(
    topic="baseline",
    title="The camera is at the limit of its distance",
    advice="give a larger --max-baseline-m if it is farther away",
    examples=(
        "the camera is held at 3 m from the LiDAR, the limit of --max-baseline-m",
        "the camera is 4.2 m from the LiDAR, --max-baseline-m allows 3 m",
    ),
    means="The labels pull the camera farther away than is allowed.",
    why="It is farther away (a lorry), the clouds have another unit, or the place is not determined.",
    to_do="Give a larger `--max-baseline-m` if that is true; else check the unit of the clouds, and add frames.",
)
