"""Checks of what the user stated."""

from semcal_cli.result.checks.check import Check

PRIOR = Check(
    topic="prior",
    title="A prior contradicts the labels",
    measures=(
        "distance of a prior from the labels' pose, as its probability by chance, and from the last "
        "pose along one axis"
    ),
    needs="a prior",
    advice="measure it again, or state it less exactly",
    examples=(
        (
            "--prior-translation-m 1.2 0 0.4 0.02 is 12.3 cm from where labels alone lead, chi-square "
            "88 of 3, needed at most 31"
        ),
        (
            "--prior-rotation-deg 0 0 90 0.3 is 2.10 degrees from the pose that all else leads to, 6.3 "
            "standard deviations, needed at most 4"
        ),
    ),
    means="What was stated and what the labels say lie farther apart than both standard deviations explain.",
    why=(
        "A frame was mixed up (body or optical, LiDAR or base of the robot), a sign, or a SIGMA that is "
        "too small."
    ),
    to_do="Calibrate without the prior and compare: `semcal compare` shows which axis differs.",
)
