"""All checks, in the order of their entries in docs/troubleshooting.md, which quote and explain their findings."""

from semcal_cli.config import MIN_OVERLAP, PolishConfig, PyramidConfig
from semcal_cli.result.checks.check import Check, Limit

# The mounting is not clear.
OTHER_MOUNTING = Check(
    topic="other-mounting",
    advice="add frames from other places, or give --init with a mounting measured by hand",
)
NOTHING_TO_COMPARE = Check(
    topic="nothing-to-compare",
    advice="add frames from other places, or give --init with a mounting measured by hand",
)
OTHER_AZIMUTH = Check(
    topic="other-azimuth",
    advice="add frames from other places, or give --init with a mounting measured by hand",
)
OTHER_POSE = Check(topic="other-pose", advice="add frames from other places, or labels of points")
FEW_SCENES = Check(topic="few-scenes", advice="add frames from other places")
CUES_DISAGREE = Check(
    topic="cues-disagree",
    advice="add frames from other places, or check with `semcal overlay --by edge` whether edges coincide",
)
# The labels do not determine the pose.
NOT_DETERMINED = Check(
    topic="not-determined",
    advice="record frames with objects near and far, at the left and at the right, or state what is "
    "known with --prior-translation-m",
)
NOT_DETERMINED_TOGETHER = Check(
    topic="not-determined-together",
    advice="record frames with objects near and far, or state more with --prior-translation-m and "
    "--prior-rotation-deg",
)
WIDE_INTERVAL = Check(topic="wide-interval", advice="add frames with objects near and far, from a moving car")
NO_DIRECTION = Check(
    topic="no-direction", advice="record frames with more classes, such as poles, cars and kerbs"
)
ONE_CLASS = Check(topic="one-class", advice="record frames with more kinds of things, or label more classes")
NOTHING_LABELLED = Check(topic="nothing-labelled", advice="label them, or check which ids the drive ignores")
OVERLAP = Check(
    topic="overlap",
    advice="label more of the points, or check which ids the drive ignores",
    settings={"": Limit(at_least=MIN_OVERLAP, unit="%", source="a setting")},
)
CHANCE = Check(topic="chance", advice="check that the labels are those of these sweeps and pictures")
# The search for the pose did not end well.
REFINEMENT_NOT_SETTLED = Check(
    topic="refinement-not-settled",
    advice="add frames, or start nearer with --init",
    settings={"": Limit(at_most=PyramidConfig.max_final_drift, unit="blocks", source="a setting")},
)
POLISH_NOT_SETTLED = Check(
    topic="polish-not-settled",
    advice="add frames, or start nearer with --init",
    settings={"": Limit(at_most=PolishConfig.settled_px, unit="pixels", source="a setting")},
)
POLISH_REJECTED = Check(
    topic="polish-rejected",
    advice="check with `semcal inspect` that sweeps, pictures and labels belong together, or add frames",
    settings={
        "": Limit(at_most=PolishConfig.max_loss, unit="standard errors", source="a setting"),
        "several starts": Limit(
            at_most=PolishConfig.max_loss_of_tops, unit="standard errors", source="a setting"
        ),
    },
)
POLISH_NOT_TESTED = Check(topic="polish-not-tested", advice="add frames, or label more of the pictures")
FUSION_NOT_SETTLED = Check(topic="fusion-not-settled", advice="add frames, or start nearer with --init")
SEEDS = Check(topic="seeds", advice="add frames from other places")
SOIC = Check(topic="soic", advice="start nearer with --init")
# Files do not belong together.
WRONG_PAIRING = Check(
    topic="wrong-pairing", advice="check that sweeps and pictures belong together, by their times and names"
)
ODD_FRAMES = Check(
    topic="odd-frames", advice="check the times and the names of their files, or take these frames out"
)
SHIFTED_POINT_LABELS = Check(
    topic="shifted-point-labels",
    advice="check that what wrote them left no point out, and label these sweeps again",
)
SHIFTED_LABEL_IMAGES = Check(
    topic="shifted-label-images",
    advice="check that they were made from these pictures, in their size, and label them again",
)
LEAKED_LABELS = Check(
    topic="leaked-labels",
    advice="label the points without the pictures, or calibrate with --cue segments,edges",
)
OWN_DRIVE = Check(topic="own-drive", advice="check it on another drive, for it agrees with its own")
FRAMES_DISAGREE = Check(
    topic="frames-disagree",
    advice="check the times of sweeps and pictures, the motion and the labels, or take these frames out",
)
MOVED_CAMERA = Check(
    topic="moved-camera", advice="calibrate each part with `semcal calibrate --split`, or record again"
)
# Camera, clocks and motion.
WRONG_FOCAL_LENGTH = Check(
    topic="focal-length", advice="check fx and fy of K, and that K is of pictures of this size"
)
WRONG_INTRINSICS = Check(
    topic="intrinsics",
    advice="check K and the distortion, and that K is of pictures of this size, or calibrate the lens again",
)
WRONG_CLOCKS = Check(topic="clocks", advice="check the clocks of camera and LiDAR, and correct image_stamp")
MOTION = Check(
    topic="motion", advice="give motion.poses or motion.twist in the drive, or record at lower speed"
)
SHUTTER = Check(
    topic="shutter", advice="give motion.poses or motion.twist in the drive, or record at lower speed"
)
FAR_CAMERA = Check(topic="baseline", advice="give a larger --max-baseline-m if it is farther away")
# What you stated contradicts the data.
PRIOR = Check(topic="prior", advice="measure it again, or state it less exactly")

CHECKS = {check.topic: check for check in vars().copy().values() if isinstance(check, Check)}
"""All checks by topic."""
