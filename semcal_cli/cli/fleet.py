"""`semcal fleet`: the combined result of many drives of one rig."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.ci import Case, CiReport, Inconclusive, errors_reported
from semcal_cli.cli.options import LimitSettings, QuietSettings, inconclusive_choice, result_file
from semcal_cli.cli.settings import argument, option, output_file
from semcal_cli.cli.settings_command import command
from semcal_cli.errors import InputError, counted

if TYPE_CHECKING:
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.fleet.fleet_drives import FleetDrive
    from semcal_cli.fleet.fleet_result import ComparedDrive, Fleet
    from semcal_cli.pipeline.verdict import AxisVerdict

MAX_LINES = 20
"""Largest number of drives or checks of one kind that the terminal names; the files list all."""


@dataclass(frozen=True, kw_only=True)
class FleetSettings(LimitSettings, QuietSettings):
    """Settings of `fleet`."""

    results: tuple[Path, ...] = argument()
    output: Path | None = result_file()
    reference: Path | None = option("Also judge the offset of the rig from this transform.", metavar="FILE")
    page: Path | None = output_file("Also write a report of the result: .html.", "--report")
    plot: Path | None = output_file("Also write the plot of the report to a separate file: .png or .svg.")
    as_json: bool = option("Print the result as JSON.", "--json", default=False)
    junit: Path | None = output_file("Also write a JUnit XML file.")
    inconclusive: Inconclusive = inconclusive_choice()

    def check_suffixes(self) -> None:
        """Check the suffixes of the page and of the plot.

        Raises:
            InputError: a suffix does not match the file's format.
        """
        from semcal_cli.cli.output_checks import PLOTS, check_page
        from semcal_cli.files.output_files import check_suffix

        check_page(self.page)
        check_suffix(self.plot, *PLOTS)


@command(FleetSettings)
def fleet(settings: FleetSettings) -> None:
    """Combine the drives of one rig: what they agree on, which disagree, and whether the rig moved.

    RESULTS are folders written by semcal batch, or single calibrations. Drives are ordered by the stamps of
    their first frames if these are seconds since 1970, otherwise by name. Drives that are not trusted are named and
    left out. The transform of the result is the one that holds at the last drive, and other commands can read it.

    Exit code 0: no change, no drift and no drive is beyond the limits, and the uncertainty of the transform is within
    them. 3: the whole 95 % interval of one of these is beyond its limit. 4: the drives are inconclusive.

    --reference accepts {KNOWN_TRANSFORMS}.
    """
    from semcal_cli.cli.output_checks import check_outputs
    from semcal_cli.config import Limits
    from semcal_cli.drive.document import drive_file
    from semcal_cli.files.documents import document_text, output_format
    from semcal_cli.files.input_files import is_folder
    from semcal_cli.fleet.combination import combine_drives
    from semcal_cli.fleet.fleet_drives import read_fleet_drives
    from semcal_cli.formats import WITHOUT_OPTIONS, read_transform
    from semcal_cli.formats.format import MAX_YAML_BYTES
    from semcal_cli.many.batch.records import JSONL

    output, page, plot, junit = settings.output, settings.page, settings.plot, settings.junit
    results, reference = settings.results, settings.reference
    read = [path / JSONL if is_folder(path) else path for path in results]
    read += [drive_file(reference)] if reference is not None else []
    subject = ", ".join(map(str, results))
    with errors_reported("fleet", subject, junit, read):
        check_outputs(read, output, page, plot, junit)
        form = ("json" if settings.as_json else "yaml") if output is None else output_format(output)
        settings.check_suffixes()
        T_reference = None if reference is None else read_transform(reference, options=WITHOUT_OPTIONS)
        limits = Limits(settings.max_rotation_deg, settings.max_translation_m)
        combined = combine_drives(read_fleet_drives(results), limits, T_reference)
    report = CiReport(
        "fleet",
        subject,
        combined.verdict,
        _cases(combined),
        combined.reasons,
        inconclusive=settings.inconclusive,
    )
    document = _document(combined, read, output, reference)
    text = document_text(document, form)
    if output is not None and form == "yaml" and len(text) > MAX_YAML_BYTES:
        size = f"{len(text):,} bytes of YAML, too many for other commands to read"
        raise InputError(f"{output}: found {size}, expected .json")
    _write(combined, report, text, settings)
    if output is None or settings.as_json:
        click.echo(document_text(document, "json") if settings.as_json else text, nl=False)
    written = [path for path in (output, page, plot, junit) if path is not None]
    _print(combined, written, settings.terminal())
    report.tell_github()
    sys.exit(report.exit_code)


def _write(combined: Fleet, report: CiReport, text: str, settings: FleetSettings) -> None:
    """Write all outputs. Their content is complete before anything is written; the result is written last."""
    from semcal_cli.cli.output_checks import PLOTS
    from semcal_cli.files.output_files import write_bytes
    from semcal_cli.fleet.fleet_page import page_html
    from semcal_cli.fleet.timeline import plot_fleet

    page, plot = settings.page, settings.plot
    contents: dict[Path, bytes] = {}
    if page is not None:
        contents[page] = page_html(combined, report.subject).encode()
    if plot is not None:
        contents[plot] = plot_fleet(combined, PLOTS[plot.suffix.lower()])
    if settings.junit is not None:
        contents[settings.junit] = report.junit().encode()
    if settings.output is not None:
        contents[settings.output] = text.encode()
    for path, content in contents.items():
        write_bytes(content, path)


def _document(
    combined: Fleet, read: Sequence[Path], output: Path | None, reference: Path | None
) -> dict[str, Any]:
    """Describe the result, with paths relative to its folder."""
    from semcal_cli.cli.output_checks import folder_of
    from semcal_cli.drive.document import drive_file
    from semcal_cli.fleet.fleet_result import describe_fleet
    from semcal_cli.result.provenance import hash_files

    place = folder_of(output)
    name = None if reference is None else os.path.relpath(drive_file(reference), place)
    return describe_fleet(combined, hash_files(read, place), name)


def _cases(combined: Fleet) -> list[Case]:
    """Make a test case of each check, of each drive, and of the overall verdict."""
    from semcal_cli.fleet.fleet_verdict import total

    cases = [Case.of_check(check) for check in combined.checks]
    for drive in combined.drives:
        # An uncertain drive is no reason to distrust the rig; a drive that seems far off is.
        verdict = drive.verdict if drive.is_far else "pass"
        cases.append(Case(f"drive {drive.drive.name}", verdict, f"{total(drive.offset)} off"))
    # The file has the same verdict as the exit code, whatever decides it.
    return [*cases, Case("all together", combined.verdict, counted(len(combined.drives), "drive"))]


def _print(combined: Fleet, written: Sequence[Path], terminal: Terminal) -> None:
    """Print the summary of a fleet: what is wrong, what holds now, the files, and the verdict last."""
    from semcal_cli.cli.tables import group_rows, matrix_lines, verdict_line, wrapped
    from semcal_cli.errors import first_of
    from semcal_cli.fleet.fleet_verdict import title
    from semcal_cli.readable import for_people
    from semcal_cli.result.uncertainty import intervals

    def show(label: str, lines: Iterable[str]) -> None:
        terminal.print(*_rows(label, lines))

    groups = _groups_apart(combined)
    terminal.print(*(line for row in group_rows(groups) for line in wrapped(*row)) if groups else ())
    num_used, num_all = len(combined.drives), len(combined.drives) + len(combined.left_out)
    order = "in the order of their stamps" if combined.order == "stamp" else "in the order of their names"
    last = combined.parts[-1]
    show("drives", [f"{num_used:,} of {num_all:,} used, {order}"])
    left_out = [f"{drive.name}: {drive.left_out}" for drive in combined.left_out]
    show("left out", first_of(left_out, MAX_LINES))
    show("note", combined.notes)
    apart = [drive for drive in combined.drives if drive.disagrees or drive.is_far]
    apart.sort(key=lambda drive: (drive.verdict != "fail", not drive.is_far))
    show("apart", first_of([*map(_apart, apart)], MAX_LINES))
    terminal.print(*map(for_people, _check_lines(combined.checks)))
    show("reasons", combined.reasons)
    if not groups:
        show("T_camera_lidar", matrix_lines(combined.T_camera_lidar))
        show("holds", [f"at {last.last}" if combined.drift is not None else f"from {last.first} on"])
        show("95 % interval", intervals(last.half_widths.tolist()))
    show("written to", map(str, written))
    what = f"{title(combined)[0].lower()}{title(combined)[1:]}"
    terminal.print_verdict(verdict_line(combined.verdict, what), combined.verdict)


def _groups_apart(combined: Fleet) -> list[list[FleetDrive]]:
    """Group drives that agree, if no pose is that of most of them and no change or drift of the rig explains it."""
    from semcal_cli.fleet.fleet_verdict import MIN_USED
    from semcal_cli.fleet.groups import groups_that_agree

    if combined.drift is not None or len(combined.parts) > 1:
        return []
    groups = groups_that_agree([compared.drive for compared in combined.drives], combined.limits)
    return [] if len(groups[0]) > MIN_USED * len(combined.drives) else groups


def _apart(drive: ComparedDrive) -> str:
    from semcal_cli.fleet.fleet_verdict import total

    verdict = "disagrees, but is within the limits"
    if drive.is_far:
        verdict = "clearly beyond the limits" if drive.verdict == "fail" else "possibly beyond the limits"
    return f"{drive.drive.name}: {total(drive.offset)} off, {verdict}"


def _check_lines(checks: Sequence[AxisVerdict]) -> Iterator[str]:
    """List the totals and the checks that do not pass, by subject."""
    from semcal_cli.cli.tables import COLUMNS, wrapped_lines
    from semcal_cli.fleet.fleet_verdict import check_words
    from semcal_cli.pipeline.verdict import OVERALL

    shown = [check for check in checks if check.name.endswith(OVERALL) or check.verdict != "pass"]
    last = None
    for check in shown[:MAX_LINES]:
        words = check_words(check)
        if words.subject != last:
            yield from wrapped_lines(words.subject, COLUMNS)
        last, unit = words.subject, words.unit[:3]
        line = f"  {words.quantity:<26}{words.offset:>9} +- {words.half_width:<8} {unit:<3}"
        yield f"{line} allowed {words.allowed:<7}{check.verdict}"
    if len(shown) > MAX_LINES:
        yield f"  and {len(shown) - MAX_LINES:,} more"


def _rows(label: str, lines: Iterable[str]) -> Iterator[str]:
    """Label the first of some lines, and wrap each to the width of a terminal; names stay whole."""
    from semcal_cli.cli.tables import COLUMNS, LABEL_WIDTH, labelled, wrapped_lines

    for line in lines:
        is_text = len(line) > COLUMNS - LABEL_WIDTH
        for piece in wrapped_lines(line, COLUMNS - LABEL_WIDTH) if is_text else [line]:
            yield labelled(label, piece)
            label = ""
