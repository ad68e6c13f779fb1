"""Checks of the files: whether sweeps, pictures and labels belong together."""

from semcal_cli.result.checks.check import Check

WRONG_PAIRING = Check(
    topic="wrong-pairing",
    title="Pictures of other frames fit as well",
    measures="information of clouds with the pictures of other frames, as a share of that with their own",
    needs="two frames that show different scenes",
    advice="check that sweeps and pictures belong together, by their times and names",
    examples=("pictures of other frames fit the clouds 80% as well, needed at most 55%",),
    means="Exchanging the pictures among the frames costs too little: the pairing is probably wrong.",
    why="Files that were paired by number although one side lost some; two clocks.",
    to_do="Look at the stamps and at one overlay. `semcal import` pairs by time.",
)
ODD_FRAMES = Check(
    topic="odd-frames",
    title="Points and pixels of single frames",
    measures=(
        "information of the worst frame, as a share of that of the best quarter of frames, and that "
        "with pictures of other frames"
    ),
    needs="two frames",
    advice="check the times and the names of their files, or take these frames out",
    examples=(
        "points and pixels of 000003 may not belong together, 000003 agrees 9% as well as others, "
        "needed at least 35% or more than with pictures of other frames",
    ),
    means="Most frames fit, and these do not.",
    why="A picture of another moment, a mirrored picture, or labels of another file.",
    to_do="Look at the overlays of these frames; take them out of the drive or mend them.",
)
SHIFTED_POINT_LABELS = Check(
    topic="shifted-point-labels",
    title="Labels of points are shifted",
    measures="gain of the fit where labels of points are shifted along the file",
    needs="labels of points in the order of a scan",
    advice="check that what wrote them left no point out, and label these sweeps again",
    examples=(
        "labels of points fit the clouds better shifted by 3 entries towards the end of the file, "
        "by 9.1 standard errors, needed at most 4",
    ),
    means="Borders of labels lie some entries beside borders of ranges.",
    why="The labels were written for a cloud without its no-returns, or after another order.",
    to_do="Label the sweeps again, one label for each point of the file, in its order.",
)
SHIFTED_LABEL_IMAGES = Check(
    topic="shifted-label-images",
    title="Label images are shifted",
    measures="gain of the fit where label images are shifted or scaled",
    needs="pictures",
    advice="check that they were made from these pictures, in their size, and label them again",
    examples=(
        "label images fit their pictures better shifted by 3 pixels right, by 6.3 standard errors, "
        "needed at most 4",
    ),
    means="Borders of labels lie beside the edges of the pictures, shifted or scaled.",
    why="Labels of rectified pictures beside a raw K, a resize that is off by half a stride, or padding.",
    to_do="Label the very pictures that the drive names, in their size. `semcal label` does.",
)
LEAKED_LABELS = Check(
    topic="leaked-labels",
    title="Labels of points come from the pictures",
    measures="ratio of what pixels tell of the classes of hidden points to what they tell of those of visible points",
    needs="labels of both sides, and at least 200 hidden points of several classes",
    advice="label the points without the pictures, or calibrate with --cue segments,edges",
    examples=(
        "labels of points seem to be made from those of the pictures, pixels tell 98% as much of points "
        "that are hidden behind what they show as of visible points, needed at most 88%",
    ),
    means=(
        "Points behind a thing have the thing's class. Such labels agree best at the transform that "
        "made them, right or wrong."
    ),
    why="The clouds were painted by projecting label images through an older transform.",
    to_do="Label the points by a network for sweeps, or leave their labels out.",
)
OWN_DRIVE = Check(
    topic="own-drive",
    title="Verified with its own drive",
    advice="check it on another drive, for it agrees with its own",
    examples=("20 of the 20 sweeps are those that the transform was calibrated from",),
    means=(
        "The drive gave the transform, so that it agrees with it whatever is wrong. `semcal verify` "
        "does not count that."
    ),
    why="`verify` was given the drive of `calibrate`, or a copy of it.",
    to_do="Record another drive, best on another day.",
)
FRAMES_DISAGREE = Check(
    topic="frames-disagree",
    title="Frames disagree",
    measures="scatter of the frames' scores (Cochran's Q), as a multiple of what chance exceeds",
    needs="two frames",
    advice="check the times of sweeps and pictures, the motion and the labels, or take these frames out",
    examples=(
        "frames disagree about the camera, they scatter 1.62 times as widely as their labels "
        "explain, needed at most 1.20",
    ),
    means="Each frame pulls the pose its own way, farther than its labels explain, and no few poses fit.",
    why=(
        "Clocks that drift, motion that is not compensated, a loose camera, or labels that are wrong on "
        "some frames."
    ),
    to_do="The report shows where each frame alone puts the camera. Check the times first, then `motion:`.",
)
MOVED_CAMERA = Check(
    topic="moved-camera",
    title="The camera was moved",
    measures="probability that two parts of the drive lie so far apart by chance",
    needs="two frames",
    advice="calibrate each part with `semcal calibrate --split`, or record again",
    examples=(
        "frames 000005 to 000009 fit a camera turned by 1.01 +- 0.06 degrees about (0.34 -0.89 "
        "-0.29), as if it was knocked at 000005",
    ),
    means="The drive has two poses or more, one before and one after this frame.",
    why="Somebody knocked or adjusted a sensor, or two drives were joined.",
    to_do=(
        "`semcal calibrate DRIVE --split -o out.yaml` calibrates each part: "
        "[calibrating.md](calibrating.md#a-camera-that-was-knocked)."
    ),
)
