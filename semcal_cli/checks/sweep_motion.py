"""Whether the motion during a sweep, or during the readout of an image, displaces points before a calibration."""

from __future__ import annotations

from collections.abc import Sequence

from semcal_cli.drive.document import Drive
from semcal_cli.findings.check import Check, Limit
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.geometry.arrays import Points
from semcal_cli.observations.motion import shutter_error_px

SWEEP_MOTION = Check(
    topic="sweep-motion",
    entry=Entry(
        title="Sweeps are smeared",
        section=PageSection.INSPECTION,
        quotes=("motion during a sweep displaces half of the points by 2.4 pixels or more",),
        meaning="The rig moves during a sweep, and the drive gives only its speed, which does not deskew points.",
        cause="`motion:` has only `speed_m_s:`.",
        remedy="Give poses or a twist ([drive.md](drive.md#a-lidar-that-moves-while-it-turns)), or record more slowly.",
        figure="Median displacement of the points.",
    ),
    settings={
        "": Limit(
            at_most=1.0,
            unit="pixels",
            source="a choice, one pixel of the label images; it was not measured",
        )
    },
)
OPEN_SHUTTER = Check(
    topic="open-shutter",
    entry=Entry(
        title="The shutter rolls and the motion is unknown",
        section=PageSection.INSPECTION,
        quotes=(
            (
                "the rolling shutter cannot be compensated without poses or a twist in motion: it displaces half "
                "of the points by 2.4 pixels or more"
            ),
        ),
        meaning="The rows of an image are exposed one after another, and the drive gives no direction of motion.",
        cause="The camera has a `readout_s:`, but the drive has only `speed_m_s:` or no `motion:` at all.",
        remedy="Give poses or a twist, or record while stationary.",
    ),
)


def check_sweep_motion(error_px: float | None) -> tuple[Finding, ...]:
    """Check the median displacement of the points by motion during a sweep; None if it is unknown."""
    if error_px is None:
        return ()
    sentence = f"motion during a sweep {_displacement(error_px)}"
    return SWEEP_MOTION.measured(error_px, sentence).findings


def check_readout(drive: Drive, points: Sequence[Points]) -> tuple[Finding, ...]:
    """Check that a rolling shutter can be compensated."""
    if drive.camera.readout_s == 0.0 or has_direction(drive):
        return ()
    error_px = shutter_error_px(drive, points)
    cost = "" if error_px is None else f": it {_displacement(error_px)}"
    sentence = f"the rolling shutter cannot be compensated without poses or a twist in motion{cost}"
    return (OPEN_SHUTTER.finding(sentence),)


def has_direction(drive: Drive) -> bool:
    """Whether the drive gives a motion with a direction, which moves the points to the time of the image."""
    return drive.motion is not None and drive.motion.speed_m_s is None


def _displacement(error_px: float) -> str:
    return f"displaces half of the points by {error_px:.1f} pixels or more"
