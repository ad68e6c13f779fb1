"""Whether the polish found a direction in which moving the camera changes the agreement."""

from __future__ import annotations

import math

from semcal_cli.estimation.refine.polish import Polish
from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding

NO_DIRECTION = Check(
    topic="no-direction",
    advice="record frames with more classes, such as poles, cars and kerbs",
    entry=Entry(
        title="The polish found no direction",
        section=PageSection.DETERMINATION,
        quotes=(
            (
                "the polish found no direction in which moving the camera changes the agreement: record "
                "frames with more classes, such as poles, cars and kerbs"
            ),
        ),
        meaning="Moving the camera changes nothing: no points lie near borders between classes.",
        cause="The images show only road and sky, or classes were merged into one or two.",
        remedy="Record frames with objects in them, and keep classes apart.",
    ),
)


def check_directions(polished: Polish) -> tuple[Finding, ...]:
    """Check that an accepted polish could move the camera at all."""
    if not polished.is_accepted or polished.is_settled or math.isfinite(polished.moved_px):
        return ()
    sentence = "the polish found no direction in which moving the camera changes the agreement"
    return (NO_DIRECTION.finding(sentence),)
