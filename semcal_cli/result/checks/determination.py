"""Checks of what labels tell: whether they determine a pose at all, and how well."""

from semcal_cli.config import MIN_OVERLAP
from semcal_cli.result.checks.check import Check, Limit

NOT_DETERMINED = Check(
    topic="not-determined",
    title="Agreement does not fall in every direction",
    advice=(
        "record frames with objects near and far, at the left and at the right, or state what is known "
        "with --prior-translation-m"
    ),
    examples=(
        "points and pictures do not determine the pose, their agreement does not fall in every direction",
    ),
    means=(
        "Along at least one axis the pose can move without making the labels agree less, so there is no "
        "interval."
    ),
    why="One frame through a narrow lens; everything far away; labels that are wrong near borders.",
    to_do=(
        "Add frames with near and far objects all over the picture. A tape measure helps: "
        "`--prior-translation-m X Y Z SIGMA`."
    ),
)
NOT_DETERMINED_TOGETHER = Check(
    topic="not-determined-together",
    title="Labels and what is known do not determine it together",
    advice=(
        "record frames with objects near and far, or state more with --prior-translation-m and "
        "--prior-rotation-deg"
    ),
    examples=("labels and what is known do not determine the pose together",),
    means="The same, although something was stated beforehand: an axis is left that neither knows.",
    why="The prior states the place, and the labels leave a rotation open, or the other way round.",
    to_do="State the other half, too, or add frames.",
)
WIDE_INTERVAL = Check(
    topic="wide-interval",
    title="The interval is too wide",
    measures="half width of the 95 % interval along any axis",
    needs="a pose that is determined",
    advice="add frames with objects near and far, from a moving car",
    examples=(
        "the pose is determined only along the optical axis to 0.41 m (95 %), needed 0.25 m and 1 degree",
    ),
    means="There is an interval, wider than a trusted pose may have.",
    why=(
        "Only near objects show the place along the optical axis; or K or a clock that was asked for is left open; "
        "or all frames move alike, so that nothing tells [an offset of the clock](trust.md#the-interval), which may "
        "cost as much."
    ),
    to_do=(
        "Add frames with near objects, or a prior; for the clock, give `motion.poses` of a drive at different "
        "speeds. If the axis does not matter to you, the others are in `uncertainty:`."
    ),
)
NO_DIRECTION = Check(
    topic="no-direction",
    title="The polish found no direction",
    advice="record frames with more classes, such as poles, cars and kerbs",
    examples=("the polish found no direction in which the pose changes the agreement",),
    means="Moving the camera changes nothing: there are no borders between classes where points lie.",
    why="Pictures of road and sky only, or classes merged to one or two.",
    to_do="Record frames with things in them, and keep classes apart.",
)
ONE_CLASS = Check(
    topic="one-class",
    title="Nearly all of one class",
    measures=(
        "number of equally frequent classes that vary like those of the points in the picture, or of "
        "its pixels"
    ),
    advice="record frames with more kinds of things, or label more classes",
    examples=(
        "points in the picture are nearly all of one class, they vary like 1.05 equally frequent "
        "classes, needed at least 1.2",
    ),
    means="One side, points in the picture or pixels, is nearly uniform and tells next to nothing.",
    why=(
        "A network of the wrong domain, ids that the `classes:` of the drive merge or leave out, or an "
        "empty scene."
    ),
    to_do="`semcal inspect DRIVE --frames` counts the classes of each frame; mend the labels or the `classes:`.",
)
NOTHING_LABELLED = Check(
    topic="nothing-labelled",
    title="Nothing is labelled",
    advice="label them, or check which ids the drive ignores",
    examples=("none of the points in the picture are labelled",),
    means="All points in the picture, or all pixels, have an id that carries no information.",
    why="`ignore:` or `classes:` in the drive do not fit the ids in the files.",
    to_do=(
        "Compare the ids of `semcal inspect DRIVE` with the drive. Without labels of points, leave "
        "`--cue` out."
    ),
)
OVERLAP = Check(
    topic="overlap",
    title="The picture is hardly covered",
    measures="share of the picture that visible points with classes cover",
    settings={"": Limit(at_least=MIN_OVERLAP, unit="%", source="a setting")},
    advice="label more of the points, or check which ids the drive ignores",
    examples=("visible points with classes cover 2.1% of the picture, needed at least 3%",),
    means="Too few points that carry information land where the camera sees.",
    why="LiDAR and camera hardly look at the same things, most points are ignored, or the pose is wrong.",
    to_do="Look at an overlay. Label more of the points, or mount the sensors so that they see the same.",
)
CHANCE = Check(
    topic="chance",
    title="No better than chance",
    measures="mutual information, as a share of that of unrelated labels",
    advice="check that the labels are those of these sweeps and pictures",
    examples=("points and pictures agree 80% as well as unrelated ones do by chance, needed at least 100%",),
    means="At this pose the labels of points tell nothing about those of pixels.",
    why="Labels of another drive, shuffled labels, or a pose that is entirely wrong.",
    to_do="Check the names in the drive, frame by frame, with `semcal overlay`.",
)
