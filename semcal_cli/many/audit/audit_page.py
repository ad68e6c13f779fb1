"""An audit as a single page that needs no network."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import datetime, timezone

from semcal_cli.config import CalibrationConfig, Limits
from semcal_cli.drive.document import Drive
from semcal_cli.errors import SemcalError
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.formats import read_transform
from semcal_cli.many.audit.audited_drives import AXES_OF, NOT_VERIFIED, PARTS, Audit, AuditedDrive
from semcal_cli.many.chronology import has_date
from semcal_cli.observations.frame_selection import with_frames
from semcal_cli.pipeline.verdict import AxisVerdict
from semcal_cli.pipeline.verification import Verification, load_as_stated
from semcal_cli.readable import figure
from semcal_cli.report import page
from semcal_cli.report.template import PageVerdict, link_reasons, render_page
from semcal_cli.result.uncertainty import CHECK_NAMES

MAX_PICTURES = 20
"""Largest number of drives whose images are shown."""
DELIVERED = "delivered"
"""Caption of the calibration that a drive states."""


def audit_page_html(
    audit: Audit,
    documents: dict[str, Drive],
    limits: Limits,
    config: CalibrationConfig,
    progress: Callable[[str], None] = lambda doing: None,
) -> str:
    """Make the page.

    Args:
        audit: What was found.
        documents: What is written in each drive, by its name.
        limits: Largest errors that were allowed.
        config: Cues by which the drives were verified.
        progress: Called with a description of each step.

    Returns:
        The page. A line says why the image of a drive is missing.
    """
    failed = [drive for drive in audit.drives if drive.verdict == "fail"]
    pictures, errors = list[page.DrivePicture](), dict[str, str]()
    for drive in failed[:MAX_PICTURES]:
        progress(f"drawing points on an image of {drive.name}")
        try:
            pictures.append(_draw(drive, documents[drive.name], config, len(pictures)))
        except SemcalError as error:
            errors[drive.name] = str(error)
    return render_page(
        "many/audit/page.html",
        ("report/image.js", "report/images.js") if pictures else (),
        "many/audit/audit.css",
        verdict=PageVerdict(audit.verdict, _capitalised(audit.title), _sentence(audit)),
        notices=(),
        audit=audit,
        limits=limits,
        counts=_counts(audit),
        columns=[*_columns()],
        capitalised=_capitalised,
        date=_date,
        shown=_shown_from,
        link_reasons=link_reasons,
        pictures=pictures,
        errors=errors,
        num_undrawn=len(failed[MAX_PICTURES:]),
        colors=page.common_colors(pictures) if pictures else None,
    )


def _draw(drive: AuditedDrive, document: Drive, config: CalibrationConfig, number: int) -> page.DrivePicture:
    """Draw one frame of a drive, from the middle of it."""
    assert drive.verification is not None
    stated = InitialPose(read_transform(document.path), DELIVERED)
    data = load_as_stated(with_frames(document, [len(document.frames) // 2]), stated, config)
    return page.draw_verification(drive.verification, data, stated, drive.name, number)


def _columns() -> Iterator[tuple[str, str]]:
    """Head the columns of the checks, in the order of `judge`, each with its class."""
    for part, axes, unit in zip(PARTS, AXES_OF.values(), ("cm", "degrees"), strict=True):
        for axis in axes:
            meaning = CHECK_NAMES[axis].partition(" (")[0]
            yield f"{axis}: {meaning}, {unit}", "n"
        yield f"{part}, {unit}", "n"


def _sentence(audit: Audit) -> str:
    """Name the cameras by what is known of them."""
    return " ".join(f"{words}: {cameras}." for words, cameras in audit.groups.items())


def _counts(audit: Audit) -> dict[str, int]:
    """Count the drives by verdict."""
    words = [drive.word for drive in audit.drives]
    return {
        word: words.count(word) for word in ("fail", NOT_VERIFIED, "inconclusive", "pass") if word in words
    }


def _date(drive: AuditedDrive) -> str:
    """Write when a drive was recorded; empty if its stamp counts from no known time."""
    if not has_date(drive):
        return ""
    return f"{datetime.fromtimestamp(drive.stamp or 0.0, timezone.utc):%Y-%m-%d %H:%M} UTC"


def _shown_from(verification: Verification, check: AxisVerdict) -> str:
    """Write the displacement on an axis from which on the drive would have shown it; empty for a total."""
    smallest, axes = verification.smallest_visible, [*CHECK_NAMES]
    if smallest is None or check.name not in axes[:6]:
        return ""
    return figure(
        [*(100.0 * m for m in smallest.camera_center_m), *smallest.rotation_deg][axes.index(check.name)]
    )


def _capitalised(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]
