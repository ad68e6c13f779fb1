"""Tables are written into their places of a page, with where and when they were measured."""

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import gradient
import pytest
from benchmark import script
from documentation import ROOT
from laboratory import page_tables
from laboratory.page_tables import command_line, find_place, read_measured

from semcal_cli.errors import InputError
from semcal_cli.experiments import experiment_run, measured
from semcal_cli.experiments.experiment_run import Experiment, Report
from semcal_cli.many.batch.pace import Pace

BEFORE = "# Figures\n\n`<!-- table: ours -->` begins a place.\n\n<!-- table: ours -->\n"
AFTER = "<!-- end of table -->\n\nMore \u00e9, without a line break at the end"
THEIRS = "<!-- table: theirs -->\n<!-- end of table -->\n"
PRINTED = "2 cores\n| a |\n|---|\n| 1 |\n\nwords | between\n| b |\n|---|\nwritten to FILE\n"


@pytest.fixture
def page(tmp_path: Path) -> Path:
    page = tmp_path / "page.md"
    page.write_text(f"{BEFORE}\n| old |\n\nMeasured long ago.\n\n{AFTER}")
    return page


def test_only_the_place_is_written(page: Path) -> None:
    for _ in range(2):
        find_place(str(page), "ours").write(PRINTED, "a command", ["one machine", "another"])
        content = "\n| a |\n|---|\n| 1 |\n\n| b |\n|---|\n\n"
        measured = "Measured by `a command` on one machine; on another.\n\n"
        assert page.read_bytes().decode() == f"{BEFORE}{content}{measured}{AFTER}"


def test_a_place_may_have_another_name(page: Path) -> None:
    page.write_text(page.read_text() + f"\n{THEIRS}")
    assert find_place(f"{page}#theirs", "ours").split()[1] == "<!-- end of table -->\n"


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("", 0),
        (THEIRS, 0),
        (2 * (BEFORE + AFTER + "\n"), 2),
        (BEFORE, 0),
        (BEFORE + THEIRS, 0),
        (f"{BEFORE}no <!-- end of table -->\n", 0),
        ((BEFORE + AFTER).replace("\n", "\r\n"), 0),
    ],
)
def test_a_page_without_one_such_place_is_refused(page: Path, text: str, number: int) -> None:
    page.write_bytes(text.encode())
    with pytest.raises(InputError) as refused:
        find_place(str(page), "ours")
    assert str(refused.value) == (
        f"{page}: found {number} places from a line '<!-- table: ours -->' to a line '<!-- end of table -->', "
        "expected one"
    )
    assert page.read_bytes() == text.encode()


def test_a_place_may_end_the_page(page: Path) -> None:
    page.write_text(f"{BEFORE}<!-- end of table -->")
    assert find_place(str(page), "ours").split() == (BEFORE.rstrip("\n"), "<!-- end of table -->")


def test_a_page_that_cannot_be_replaced_is_refused(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    link = page.with_name("link.md")
    (page.parent / "far").mkdir()
    link.symlink_to(page.rename(page.parent / "far/page.md"))
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) == page.parent)
    with pytest.raises(InputError) as refused:
        find_place(str(link), "ours")
    assert str(refused.value) == f"{link}: found a link, expected a file or nothing"


@pytest.mark.parametrize("name", ["c#/page.md", "my#page.md"])
def test_a_page_may_have_the_sign_of_a_place_in_its_name(name: str, page: Path) -> None:
    other = page.parent / name
    other.parent.mkdir(exist_ok=True)
    page.rename(other)
    assert find_place(str(other), "ours") == find_place(f"{other}#ours", "theirs") == (other, "ours")


def test_an_experiment_refuses_before_it_measures(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    monkeypatch.setattr(sys, "argv", ["gradient.py", "-o", str(out), "--into", str(page)])
    with pytest.raises(SystemExit) as ended:
        script(gradient.main)
    assert f"{page}: found 0 places from a line '<!-- table: gradient -->'" in str(ended.value.code)
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (
            ["/a/tests/benchmarks/accuracy.py", "--row", "16 channels", "--into=b.md", "-o", "/c/d/"],
            "python tests/benchmarks/accuracy.py --row '16 channels' -o d",
        ),
        (
            ["tests/benchmarks/cues.py", "--seeds", "2", "--pool=/a/b", "-o/c/d", "../shared/data", "x/y"],
            "python tests/benchmarks/cues.py --seeds 2 --pool=b -od data x/y",
        ),
    ],
)
def test_a_command_is_told_without_this_machine(arguments: list[str], line: str) -> None:
    assert command_line(arguments) == line


def test_a_clone_tells_its_commit_and_whether_it_has_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def git(*words: str) -> str:
        who = ["-c", "user.name=a", "-c", "user.email=a@b"]
        return subprocess.check_output(["git", "-C", str(tmp_path), *who, *words], text=True).strip()

    monkeypatch.setattr(measured, "ROOT", tmp_path)
    assert measured.commit().startswith("semcal ")
    git("init", "-q")
    for name in ("code.py", "page.md"):
        (tmp_path / name).write_text("1")
    git("add", ".")
    git("commit", "-qm", "first")
    commit = f"commit {git('rev-parse', '--short', 'HEAD')}"
    # A table that was just written is no change of what is measured.
    (tmp_path / "page.md").write_text("2")
    assert measured.commit() == commit
    (tmp_path / "code.py").write_text("2")
    assert measured.commit() == f"{commit} and changes"


def test_this_machine_is_told() -> None:
    description = (
        r".+, \d+ cores?, (no NVIDIA GPU|.+), \d{4}-\d\d-\d\d, (commit [0-9a-f]+( and changes)?|semcal \S+)"
    )
    assert re.fullmatch(description, measured.measured_here())


@dataclass(frozen=True)
class Case:
    seed: int


def run(case: Case) -> list[Case]:
    return [case]


def test_results_that_are_kept_say_where_they_were_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for place, seeds, expected in (
        ("first", (1, 2), ["first"]),
        ("second", (2, 3), ["first", "second"]),
        ("third", (1,), ["first"]),
    ):
        monkeypatch.setattr(experiment_run, "measured_here", lambda place=place: place)
        cases = [Case(seed) for seed in seeds]
        experiment = Experiment("ours", tmp_path, cases, run, Case, lambda results: Report([], ""))
        experiment.run_cases(1, Pace(len(cases), 1))
        assert read_measured(tmp_path) == expected


def whole() -> Iterator[str]:
    """Its last line has no line break."""
    yield from ("| a |", "|---|", "| 1 |")


def refused() -> Iterator[str]:
    yield "| half |"
    raise InputError("drive.yaml: found nothing, expected a drive")


def test_a_script_writes_its_table_into_the_page(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["ours.py", "--into", str(page)])
    with pytest.raises(SystemExit) as ended:
        script(whole)
    assert ended.value.code == 0
    assert "\n| a |\n|---|\n| 1 |\n\nMeasured by `python tests/benchmarks/ours.py` on" in page.read_text()


@pytest.mark.parametrize(
    ("main", "options", "ending"),
    [
        (refused, [], "drive.yaml: found nothing, expected a drive"),
        (lambda: ["none"], [], "PAGE: found no table to write below '<!-- table: ours -->'"),
        (whole, ["--help"], 0),
    ],
)
def test_a_script_without_a_whole_table_leaves_the_page(
    main: Callable[[], Iterable[str]],
    options: list[str],
    ending: int | str,
    page: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = page.read_bytes()
    monkeypatch.setattr(sys, "argv", ["ours.py", "--into", str(page), *options])
    with pytest.raises(SystemExit) as ended:
        script(main)
    assert ended.value.code == (ending.replace("PAGE", str(page)) if isinstance(ending, str) else ending)
    assert page.read_bytes() == before


UNMARKED = {
    ("rivals.md", "| points count | right labels | 10 % wrong on both sides |"): "an experiment that is gone",
    ("rivals.md", "| pairs | SOIC | PMI |"): "of an earlier version, beside the place `pairs`",
    (
        "benchmarks_trust.md",
        "| objective of the polish | KITTI object | KITTI raw, right | KITTI-360 street | VLP-16 | OS1, narrow |",
    ): "prototypes, of which one is built",
}
"""Tables that no command writes, by their headers, and why."""


def test_every_table_of_figures_has_its_command() -> None:
    pages = [*sorted((ROOT / "docs").glob("benchmarks*.md")), ROOT / "docs/rivals.md"]
    unmarked = set()
    for page in pages:
        rest = re.sub(r"<!-- table: .*?<!-- end of table -->", "", page.read_text(), flags=re.DOTALL)
        tables = [table for table in page_tables.TABLE.findall(rest) if re.search(r"\d", table)]
        unmarked |= {(page.name, table.splitlines()[0]) for table in tables}
    assert unmarked == set(UNMARKED)


def test_every_marked_table_tells_its_command() -> None:
    for page in (ROOT / "docs").glob("*.md"):
        places = re.findall(r"^<!-- table: (\w+) -->\n\n(.*?)^<!-- end", page.read_text(), re.M | re.DOTALL)
        for name, content in places:
            assert find_place(str(page), name)
            note = re.fullmatch(r"(?:(?:\|.*\n)+\n)+(Measured by `(?:semcal|python) .*)\n\n", content)
            assert note, (page.name, name)


def test_the_figures_of_the_readme_are_those_of_the_pages() -> None:
    """Rows of several tables stand there side by side."""
    section = (ROOT / "README.md").read_text().partition("## How good it is")[2].partition("\n## ")[0]
    rows = [line.strip("| ").split(" | ") for line in section.splitlines() if line.startswith("| ")]
    pages = [(ROOT / f"docs/{name}.md").read_text() for name in ("benchmarks", "benchmarks_cues", "rivals")]
    measured = [line for page in pages for line in page.splitlines() if line.startswith("| ")]
    figures = [[cell for cell in row if re.fullmatch(r"[\d., ]*\d", cell)] for row in rows]
    assert sum(map(bool, figures)) == 5
    for cells in filter(None, figures):
        # Between the median and the worst some tables have a quantile.
        patterns = [rf"\b{cell.replace('.', '[.]').replace(', ', ', (?:[0-9.]+, )?')}\b" for cell in cells]
        assert [row for row in measured if all(re.search(pattern, row) for pattern in patterns)], cells
