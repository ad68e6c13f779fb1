"""Whether a transform is verified with the drive that it was calibrated on."""

from __future__ import annotations

from semcal_cli.drive.document import Drive
from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.provenance import hash_named

OWN_DRIVE = Check(
    topic="own-drive",
    advice=(
        "check it on another drive, because a transform always agrees with the drive that it was calibrated on"
    ),
    entry=Entry(
        title="Verified with its own drive",
        section=PageSection.FILES,
        quotes=(
            (
                "the transform was calibrated from 20 of these 20 sweeps: check it on another drive, "
                "because a transform always agrees with the drive that it was calibrated on"
            ),
        ),
        meaning=(
            "The transform was calibrated from this drive, so the two agree whatever is wrong. "
            "`semcal verify` does not accept that as evidence."
        ),
        cause="`verify` was given the same drive as `calibrate`, or a copy of it.",
        remedy="Record another drive, preferably on another day.",
    ),
)


def check_own_drive(drive: Drive, record: CalibrationDocument) -> tuple[Finding, ...]:
    """Report a calibration that was made from most of these sweeps, by their contents: it agrees with itself."""
    known = set(record.input.sha256.values())
    num_own = sum(hash_named(drive, frame.points) in known for frame in drive.frames)
    if 2 * num_own <= min(len(record.input.frames), len(drive.frames)):
        return ()
    sentence = f"the transform was calibrated from {num_own} of these {len(drive.frames)} sweeps"
    return (OWN_DRIVE.finding(sentence),)
