"""Checks of the mounting: whether another pose explains the data as well."""

from semcal_cli.result.checks.check import Check

OTHER_MOUNTING = Check(
    topic="other-mounting",
    title="Another mounting explains the labels",
    measures="information by which the best mounting in another direction is behind",
    advice="add frames from other places, or give --init with a mounting measured by hand",
    examples=(
        "a mounting 31 degrees away explains the labels almost as well, 1.62 standard errors apart, "
        "needed 2.00",
    ),
    means="The search over all directions found a second one that cannot be told from the best.",
    why="There are one or two frames, the lens is narrow, or all frames show the same scene.",
    to_do=(
        "Use four frames or more from different places. If you know the mounting to some degrees, give "
        "it with `--init-rpy-xyz` and `--search-deg 30`, and nothing farther away is considered."
    ),
)
NOTHING_TO_COMPARE = Check(
    topic="nothing-to-compare",
    title="Nothing to compare with",
    advice="add frames from other places, or give --init with a mounting measured by hand",
    examples=("no other mounting was left to compare with, needed one that is worse",),
    means="Only one mounting came out of the search, so that nobody can say how far ahead it is.",
    why="Sweeps and pictures overlap in few directions, or few points carry labels.",
    to_do="Add frames from other places, or give a start that you measured.",
)
OTHER_AZIMUTH = Check(
    topic="other-azimuth",
    title="Labels fit another azimuth",
    measures=(
        "information with the camera turned about the LiDAR's z axis in steps of 30 degrees, as a share "
        "of that at the pose"
    ),
    advice="add frames from other places, or give --init with a mounting measured by hand",
    examples=(
        "with the camera turned by 90 degrees points and pictures fit 71% as well, needed at most 65%",
    ),
    means="The labels look nearly the same all round the LiDAR.",
    why="The scene repeats itself (an open field, a straight canyon of houses), or there are few classes.",
    to_do="Record at crossings and among poles, cars and trees, or give a start that you measured.",
)
OTHER_POSE = Check(
    topic="other-pose",
    title="Another pose nearby explains the data",
    measures="information by which the best other top is behind",
    needs="edges, segments or intensity, or labels of fewer than four scenes",
    advice="add frames from other places, or labels of points",
    examples=(
        "a pose 2.1 degrees and 24 cm away explains the data almost as well, 1.4 standard errors "
        "behind, needed 3 behind",
    ),
    means="The score has several tops, and another one, outside the interval or far away, is about as high.",
    why="There are few frames; on single real pairs it comes up nearly always, with labels of both sides, too.",
    to_do="Add frames from other scenes, use edges if the frames name pictures, or label the points.",
)
FEW_SCENES = Check(
    topic="few-scenes",
    title="Edges of few scenes",
    measures="number of scenes whose edges are compared",
    needs="edges",
    advice="add frames from other places",
    examples=("edges of 2 scenes were compared, needed at least 4",),
    means="Edges of one scene fit many poses, and which of them is best is partly chance.",
    why="The drive has one to three frames, or its frames show the same scene.",
    to_do="Add frames from other places: ten are better than four.",
)
CUES_DISAGREE = Check(
    topic="cues-disagree",
    title="Segments prefer another pose",
    measures="information by which segments prefer another pose",
    needs="edges with labels of the pictures",
    advice="add frames from other places, or check with `semcal overlay --by edge` whether edges coincide",
    examples=(
        "segments and labels of the pictures prefer a pose 3.0 degrees and 30 cm away from that of "
        "edges, by 3.1 standard errors, needed at most 2",
    ),
    means="Segments are too coarse to make a pose exact, but they tell a right one from one that is degrees off.",
    why="Edges have found a wrong top, or the labels of the pictures do not belong to them.",
    to_do=(
        "Look at the edges: if poles and cars coincide, check the labels of the pictures; if not, add "
        "frames or give `--init`."
    ),
)
