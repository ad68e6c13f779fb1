"""`semcal fleet`: the combined result of many drives of one rig."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.ci import (
    Case,
    CiReport,
    Inconclusive,
    errors_reported,
    inconclusive_option,
)
from semcal_cli.cli.options import (
    KNOWN_TRANSFORMS,
    junit_option,
    limit_options,
    output_option,
    quiet_option,
    report_option,
)
from semcal_cli.cli.rules import CheckedCommand
from semcal_cli.cli.settings import OUTPUT_FILE, PATH

if TYPE_CHECKING:
    from semcal_cli.files.documents import Format
    from semcal_cli.fleet.fleet import Fleet

PLOTS = (".png", ".svg")


@click.command(
    cls=CheckedCommand,
    help=f"""Put the drives of one rig together: what they agree on, which do not, whether the rig moved.

    RESULTS are folders that semcal batch wrote, and single calibrations of semcal. Drives are ordered by the stamps
    of their first frames if these are seconds since 1970, else by their names. Those that are not trusted are left
    out, and named. Exit code 0: no change, no drift and no drive is beyond what is allowed, and what they agree on is
    known that well. 3: one lies beyond with its whole 95 % interval. 4: the drives cannot decide. The transform of the
    result is the one that holds at the last drive: other commands read it.

    FILE of --reference is {KNOWN_TRANSFORMS}.
    """,
)
@click.argument("results", nargs=-1, required=True, type=PATH)
@output_option
@click.option(
    "--reference", type=PATH, metavar="FILE", help="Also judge the offset of the rig from this transform."
)
@limit_options(may_be_zero=False)
@report_option("the result")
@click.option(
    "--plot", type=OUTPUT_FILE, metavar="FILE", help="Also write the page's plot on its own: .png or .svg."
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@junit_option
@inconclusive_option
@quiet_option
def fleet(
    results: tuple[Path, ...],
    output: Path | None,
    reference: Path | None,
    page: Path | None,
    plot: Path | None,
    as_json: bool,
    junit: Path | None,
    inconclusive: Inconclusive,
    quiet: bool,
    **limits: float,
) -> None:
    """Combine the drives of a rig."""
    from semcal_cli.batch.records import JSONL
    from semcal_cli.cli.fleet_summary import print_fleet
    from semcal_cli.cli.outputs import check_outputs
    from semcal_cli.cli.terminal import make_console
    from semcal_cli.drive.document import drive_file
    from semcal_cli.files.documents import document_text, output_format
    from semcal_cli.files.reading import is_folder
    from semcal_cli.files.writing import write_bytes

    read = [path / JSONL if is_folder(path) else path for path in results]
    read += [drive_file(reference)] if reference is not None else []
    outputs = [path for path in (output, page, plot, junit) if path is not None]
    subject = ", ".join(map(str, results))
    with errors_reported("fleet", subject, junit, read):
        check_outputs(read, outputs)
        form = ("json" if as_json else "yaml") if output is None else output_format(output)
        _check_suffixes(page, plot)
        found = _combine(results, reference, **limits)
    report = CiReport(
        "fleet", subject, found.verdict, _cases(found), found.reasons, inconclusive=inconclusive
    )
    document = _document(found, read, output, reference)
    text = _result_text(document, form, output)
    # All content is made before anything is written, and the result is written last.
    contents = _pictured(found, subject, page, plot)
    if junit is not None:
        contents[junit] = report.junit().encode()
    if output is not None:
        contents[output] = text.encode()
    for path, content in contents.items():
        write_bytes(content, path)
    if output is None or as_json:
        click.echo(document_text(document, "json") if as_json else text, nl=False)
    print_fleet(found, outputs, make_console(quiet))
    report.tell_github()
    sys.exit(report.exit_code)


def _check_suffixes(page: Path | None, plot: Path | None) -> None:
    """Check the suffixes of the page and of the plot.

    Raises:
        InputError: a suffix does not match the file's format.
    """
    from semcal_cli.cli.outputs import check_page
    from semcal_cli.errors import InputError

    if page is not None:
        check_page(page)
    if plot is not None and plot.suffix.lower() not in PLOTS:
        raise InputError(f"{plot}: found suffix {plot.suffix!r}, needed {' or '.join(PLOTS)}")


def _combine(
    results: Sequence[Path], reference: Path | None, max_rotation_deg: float, max_translation_m: float
) -> Fleet:
    from semcal_cli.config import Limits
    from semcal_cli.fleet.combination import combine_drives
    from semcal_cli.fleet.members import read_members
    from semcal_cli.formats import read_transform

    T_reference = None if reference is None else read_transform(reference)
    limits = Limits(max_rotation_deg, max_translation_m)
    return combine_drives(read_members(results), limits, T_reference)


def _document(
    found: Fleet, read: Sequence[Path], output: Path | None, reference: Path | None
) -> dict[str, Any]:
    """Describe the result, whose paths are relative to its folder."""
    from semcal_cli.cli.outputs import folder_of
    from semcal_cli.drive.document import drive_file
    from semcal_cli.fleet.fleet import describe_fleet
    from semcal_cli.result.provenance import hash_files

    place = folder_of(output)
    name = None if reference is None else os.path.relpath(drive_file(reference), place)
    return describe_fleet(found, hash_files(read, place), name)


def _result_text(document: Mapping[str, Any], form: Format, output: Path | None) -> str:
    """Format the result as YAML or JSON.

    Raises:
        InputError: the YAML is larger than other commands read.
    """
    from semcal_cli.errors import InputError
    from semcal_cli.files.documents import document_text
    from semcal_cli.formats.format import MAX_YAML_BYTES

    text = document_text(document, form)
    if output is not None and form == "yaml" and len(text) > MAX_YAML_BYTES:
        raise InputError(
            f"{output}: found {len(text):,} bytes of YAML, which other commands would not read, needed .json"
        )
    return text


def _pictured(found: Fleet, given: str, page: Path | None, plot: Path | None) -> dict[Path, bytes]:
    """Make the page, which names what was given, and the plot, where they are wanted."""
    from semcal_cli.fleet.course import plot_fleet
    from semcal_cli.fleet.page import page_html

    contents: dict[Path, bytes] = {}
    if page is not None:
        contents[page] = page_html(found, given).encode()
    if plot is not None:
        contents[plot] = plot_fleet(found, "svg" if plot.suffix.lower() == ".svg" else "png")
    return contents


def _cases(found: Fleet) -> list[Case]:
    """Make a test case of each check, of each drive, and of the verdict on all."""
    from semcal_cli.fleet.verdict import total

    cases = [Case.of_check(check) for check in found.checks]
    for drive in found.drives:
        # A drive whose pose is uncertain is no reason to distrust the rig; a drive that seems far off is.
        verdict = drive.verdict if drive.is_far else "pass"
        cases.append(Case(f"drive {drive.member.drive}", verdict, f"{total(drive.offset)} off"))
    # The file has the same verdict as the exit code, whatever decides it.
    return [*cases, Case("all together", found.verdict, f"{len(found.drives):,} drives")]
