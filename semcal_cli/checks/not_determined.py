"""Findings where the data determine no pose."""

from __future__ import annotations

from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection

NOT_DETERMINED = Check(
    topic="not-determined",
    advice=(
        "record frames with near and far objects on both sides of the image, or give a measured position with "
        "--prior-translation-m"
    ),
    entry=Entry(
        title="Some motions do not reduce the agreement",
        section=PageSection.DETERMINATION,
        quotes=(
            (
                "points and images do not determine the pose, since moving the camera in some direction "
                "does not reduce their agreement: record frames with near and far objects on both sides "
                "of the image, or give a measured position with --prior-translation-m"
            ),
        ),
        meaning=(
            "Along at least one axis the pose can move without reducing the agreement, so there is no "
            "interval."
        ),
        cause=(
            "There is one frame through a narrow lens; everything is far away; labels are wrong near borders."
        ),
        remedy=(
            "Add frames with near and far objects throughout the image. A position measured with a "
            "tape measure helps, too: `--prior-translation-m X Y Z SIGMA`."
        ),
    ),
)
NOT_DETERMINED_TOGETHER = Check(
    topic="not-determined-together",
    advice=(
        "record frames with near and far objects, or give more with --prior-translation-m and --prior-rotation-deg"
    ),
    entry=Entry(
        title="Data and priors together do not determine it",
        section=PageSection.DETERMINATION,
        quotes=(
            (
                "data and priors together do not determine the pose: record frames with near and far "
                "objects, or give more with --prior-translation-m and --prior-rotation-deg"
            ),
        ),
        meaning="The same, despite a prior: neither the prior nor the data determine one of the axes.",
        cause="The prior states the position and the data leave a rotation open, or vice versa.",
        remedy="Give a prior for the other half as well, or add frames.",
    ),
)
UNDETERMINED = NOT_DETERMINED.finding(
    "points and images do not determine the pose, since moving the camera in some direction does not reduce their "
    "agreement"
)
UNDETERMINED_WITH_PRIORS = NOT_DETERMINED_TOGETHER.finding(
    "data and priors together do not determine the pose"
)
