"""A fleet as one page that needs no network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from semcal_cli.assessment.limits import IN_ALL, VERDICTS, Check
from semcal_cli.documentation import entry_address
from semcal_cli.fleet.course import Kind, course_of, kind_of
from semcal_cli.fleet.fleet import ComparedDrive, Fleet, Part
from semcal_cli.fleet.members import Member
from semcal_cli.fleet.plot import course_plots
from semcal_cli.fleet.words import SIGNS, figures, sentences, subject_of, title
from semcal_cli.geometry.poses import camera_center
from semcal_cli.report.notations import Notation, notations
from semcal_cli.report.template import ENVIRONMENT, source
from semcal_cli.report.words import Reason, Verdict
from semcal_cli.result.intervals import intervals, widest
from semcal_cli.result.provenance import versions

KINDS: dict[Kind, str] = {
    "beyond": "drive surely beyond what is allowed",
    "disagrees": "drive that disagrees, or is perhaps beyond what is allowed",
    "agrees": "drive",
}
"""Meaning of the dots, the worst first."""
ROWS: dict[Kind, str] = {"beyond": "surely beyond", "disagrees": "disagrees", "agrees": "agrees"}
"""Verdicts in the table of drives."""
MAX_ROWS = 1000
"""Largest number of rows of a table; the result file has all."""
MAX_PARTS = 100
"""Largest number of parts of the history that the page shows, the last ones."""
MAX_LETTERS = 200
"""Largest number of letters of a name or a sentence; with more of them the page would not stay small."""


@dataclass(frozen=True)
class CheckRow:
    """A row of the table of checks, as text."""

    subject: str
    quantity: str
    found: str
    half_width: str
    allowed: str
    unit: str
    verdict: str


@dataclass(frozen=True)
class DriveRow:
    """A row of the table of drives, as text."""

    drive: str
    time: str
    center: str
    center_half: str
    rotation: str
    rotation_half: str
    kind: Kind
    verdict: str


@dataclass(frozen=True)
class PartRow:
    """A stretch of time, what held in it, and how well that is known."""

    first: str
    last: str
    num_drives: int
    intervals: tuple[str, str]
    notation: Notation


def page_html(fleet: Fleet, given: Sequence[str]) -> str:
    """Make the page.

    Args:
        fleet: Combined result that the page shows.
        given: Names of the inputs that it was computed from.
    """
    course, scatter = course_of(fleet), intervals(fleet.scatter.tolist())
    known = fleet.parts[-1].half_widths.tolist()
    checks = sorted(fleet.checks, key=lambda check: VERDICTS.index(check.verdict))
    rows = sorted(_drive_rows(fleet), key=lambda row: list(KINDS).index(row.kind))
    return ENVIRONMENT.get_template(
        "fleet/page.html"
    ).render(
        style=source("page.css"),
        own_style=Markup((Path(__file__).parent / "fleet.css").read_text()),
        script=source("copy.js"),
        version=versions()["semcal"],
        fleet=fleet,
        given=given,
        verdict=Verdict(
            fleet.verdict,
            title(fleet),
            " ".join(map(_cut, sentences(fleet))),
            f"known to {widest(known)}",
            reasons=tuple(Reason(_cut(reason)) for reason in fleet.reasons),
        ),
        notices=fleet.notes,
        camera_center=camera_center(fleet.T_camera_lidar).tolist(),
        known=intervals(known),
        scatter=scatter,
        is_scattered=scatter != intervals([0.0] * 6),  # as it reads
        course=course,
        plots=course_plots(course),
        kinds=KINDS,
        signs=SIGNS,
        notations=notations(fleet.T_camera_lidar),
        parts=[_part_row(part) for part in fleet.parts[-MAX_PARTS:]],
        checks=[_check_row(check) for check in checks[:MAX_ROWS]],
        num_checks=len(checks),
        rows=rows[:MAX_ROWS],
        left_out=[_left_out(member) for member in fleet.left_out[:MAX_ROWS]],
        num_hidden=max(len(rows) - MAX_ROWS, 0) + max(len(fleet.left_out) - MAX_ROWS, 0),
    )


def _left_out(member: Member) -> tuple[str, Reason]:
    """Name a drive, and say why it was left out."""
    address = None if member.topic is None else entry_address(member.topic)
    return _cut(member.drive), Reason(_cut(member.left_out or ""), address)


def _part_row(part: Part) -> PartRow:
    notation = notations(part.T_camera_lidar)[0]
    return PartRow(
        _cut(part.first), _cut(part.last), part.num_drives, intervals(part.half_widths.tolist()), notation
    )


def _check_row(check: Check) -> CheckRow:
    subject, quantity = subject_of(check.name)
    scale, unit, least = (10.0, "mm", 1) if check.unit == "cm" else (1.0, "degrees", 3)
    assert check.half_width is not None
    found, half_width = figures(scale * check.offset, scale * check.half_width, least)
    return CheckRow(
        _cut(subject), quantity, found, half_width, f"{scale * check.allowed:g}", unit, check.verdict
    )


def _drive_rows(fleet: Fleet) -> list[DriveRow]:
    return [_drive_row(drive, label, fleet) for drive, label in zip(fleet.drives, _times(fleet), strict=True)]


def _times(fleet: Fleet) -> list[str]:
    """Times of all drives as text: days since the first, or numbers."""
    if fleet.order == "stamp":
        return [f"{drive.time:.2f}" for drive in fleet.drives]
    return [str(number) for number in range(1, len(fleet.drives) + 1)]


def _drive_row(compared: ComparedDrive, time: str, fleet: Fleet) -> DriveRow:
    center, rotation = (check for check in compared.offset.judge(fleet.limits) if check.name.endswith(IN_ALL))
    assert center.half_width is not None
    assert rotation.half_width is not None
    kind = kind_of(compared)
    verdict = "perhaps beyond" if compared.is_suspect else ROWS[kind]
    return DriveRow(
        _cut(compared.member.drive),
        time,
        *figures(10.0 * center.offset, 10.0 * center.half_width, 1),
        *figures(rotation.offset, rotation.half_width, 3),
        kind,
        verdict,
    )


def _cut(text: str) -> str:
    return text if len(text) <= MAX_LETTERS else f"{text[: MAX_LETTERS - 3]}..."
