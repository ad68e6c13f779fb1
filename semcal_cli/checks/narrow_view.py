"""Whether the lens of a drive sees anything."""

from __future__ import annotations

from collections.abc import Sequence

from semcal_cli.findings.check import Check, Limit, Measured
from semcal_cli.findings.entry import Entry, PageSection

NARROW_VIEW = Check(
    topic="narrow-view",
    entry=Entry(
        title="The lens sees almost nothing",
        section=PageSection.INSPECTION,
        quotes=("the lens sees almost nothing: K, distortion or parameters are wrong",),
        meaning="The field of view through the principal point is hardly more than nothing.",
        cause="Focal lengths are in another unit, or the distortion belongs to another lens model.",
        remedy="Compare the `camera:` block of the drive with the file of the lens calibration.",
        figure="Smaller one of the angles across and down the image.",
    ),
    settings={
        "": Limit(
            at_least=1.0,
            unit="degrees",
            source="a choice, far below the view of any camera on a vehicle; it was not measured",
        )
    },
)


def check_view(field_of_view_deg: Sequence[float]) -> Measured:
    """Check the angles across and down the image."""
    sentence = "the lens sees almost nothing: K, distortion or parameters are wrong"
    return NARROW_VIEW.measured(min(field_of_view_deg), sentence)
