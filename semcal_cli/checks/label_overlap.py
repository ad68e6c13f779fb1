"""Whether visible points with classes cover enough of the image."""

from __future__ import annotations

from semcal_cli.config import MIN_OVERLAP
from semcal_cli.errors import format_against_limit
from semcal_cli.findings.check import Check, Limit
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding

OVERLAP = Check(
    topic="overlap",
    advice="label more points, or check which ids the drive ignores",
    entry=Entry(
        title="Little of the image is covered",
        section=PageSection.DETERMINATION,
        quotes=(
            (
                "visible points with classes cover 2.1% of the image (limit 3%): label more "
                "points, or check which ids the drive ignores"
            ),
        ),
        meaning="Too few points with a class land in the image.",
        cause="LiDAR and camera see little in common, most points are ignored, or the pose is wrong.",
        remedy=(
            "Look at an overlay. Label more points, or mount the sensors so that they see the same things."
        ),
        figure="Share of the image that visible points with classes cover.",
    ),
    settings={
        "": Limit(
            at_least=MIN_OVERLAP,
            unit="%",
            source="a choice, since points on so little of an image hardly constrain a pose; it was not measured",
        )
    },
)


def check_overlap(overlap: float) -> tuple[Finding, ...]:
    """Check the share of the image that visible points with classes cover."""
    covered, least = format_against_limit(overlap, OVERLAP.limit(), 1, "%")
    sentence = f"visible points with classes cover {covered} of the image (limit {least})"
    return OVERLAP.measured(overlap, sentence).findings
