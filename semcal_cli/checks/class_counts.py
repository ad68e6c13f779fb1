"""Whether the labels of points and pixels have usable classes, in each frame and in all frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from semcal_cli.findings.check import Check, Limit, findings_among
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding

NO_IMAGE_LABELS = Check(
    topic="no-image-labels",
    advice="`semcal label` makes them with a network; without them a calibration needs a start (`--init`)",
    entry=Entry(
        title="Images have no labels",
        section=PageSection.INSPECTION,
        quotes=(
            (
                "no image labels: `semcal label` makes them with a network; without them a calibration needs a "
                "start (`--init`)"
            ),
        ),
        meaning="No frame has a label image, so that labels cannot find the mounting.",
        cause="The images have not been labelled yet, or `frames:` does not name the label images.",
        remedy=(
            "Label the images with `semcal label` or `--image-model`, or give a start and calibrate by edges: "
            "[labels.md](labels.md)."
        ),
    ),
)
SINGLE_CLASS = Check(
    topic="single-class",
    entry=Entry(
        title="Labels have one class",
        section=PageSection.INSPECTION,
        quotes=("points have only the class road", "pixels have only the class sky in all frames"),
        meaning="The points or the pixels of a frame, or of all frames, have at most one class.",
        cause="The network was trained for another domain, or `classes:` and `ignore:` do not match the ids.",
        remedy="Compare the ids that `semcal inspect` lists with those in the drive.",
    ),
)
MANY_CLASSES = Check(
    topic="many-classes",
    entry=Entry(
        title="Labels have very many classes",
        section=PageSection.INSPECTION,
        quotes=("112 classes of pixels: perhaps they are instance ids or colours",),
        meaning="The labels have more classes than a segmentation has.",
        cause="The files hold ids of instances, or a picture of the labels in colours.",
        remedy="Convert the files to ids of classes, or map the ids in `classes:`.",
        figure="Number of classes over all frames.",
    ),
    settings={"": Limit(at_most=64, unit="classes", source="more are instances or colours")},
)
IGNORED_LABELS = Check(
    topic="ignored-labels",
    entry=Entry(
        title="Most labels carry no information",
        section=PageSection.INSPECTION,
        quotes=("95% of the points carry no information",),
        meaning="Nearly all points or pixels of a frame are unlabelled or ignored.",
        cause="`ignore:` or `classes:` in the drive does not match the ids in the files.",
        remedy="Compare the ids that `semcal inspect` lists with those in the drive.",
        figure="Share of the points, or of the pixels, that carry no information.",
    ),
    settings={
        "": Limit(
            at_most=0.9,
            unit="%",
            source="a choice, since some ignored labels are usual, and so many are not; it was not measured",
        )
    },
)


def check_frame_classes(side: str, counts: Mapping[str, int] | None, num_ignored: int) -> tuple[Finding, ...]:
    """Check the classes of the points or the pixels of a frame; None without labels.

    Args:
        side: "points" or "pixels".
        counts: Number of points or pixels of each class.
        num_ignored: Number of those that carry no information.
    """
    if counts is None:
        return ()
    single = [SINGLE_CLASS.finding(f"{side} have {_one_class(counts)}")] if len(counts) < 2 else []
    ignored = num_ignored / max(num_ignored + sum(counts.values()), 1)
    sentence = f"{ignored:.0%} of the {side} carry no information"
    return (*single, *IGNORED_LABELS.measured(ignored, sentence).findings)


def check_class_names(points: Sequence[str] | None, pixels: Sequence[str] | None) -> tuple[Finding, ...]:
    """Check the names of the classes of points and pixels over all frames; None without labels."""
    findings = list[Finding]()
    for side, names in (("points", points), ("pixels", pixels)):
        if names is None:
            # Segments and edges replace point labels.
            findings += [NO_IMAGE_LABELS.finding("no image labels")] * (side == "pixels")
        elif len(names) < 2:
            findings.append(SINGLE_CLASS.finding(f"{side} have {_one_class(names)} in all frames"))
        else:
            sentence = f"{len(names)} classes of {side}: perhaps they are instance ids or colours"
            findings += findings_among([MANY_CLASSES.measured(len(names), sentence)])
    return tuple(findings)


def _one_class(names: Iterable[str]) -> str:
    """Name the class that is the only one, if there is one."""
    (name, *_) = (*names, "")
    return f"only the class {name}" if name else "no class"
