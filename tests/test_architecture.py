"""ARCHITECTURE.md has a line for each room that there is, and all pages name files that there are."""

import re
from pathlib import Path

import pytest
from documentation import PAGES, ROOT
from house import FLOORS, PACKAGE

PAGE = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
PATH = re.compile(
    r"(?<![\w/.])(?:rust|tests|semcal_cli)/[\w/.-]*[\w/](?![\w<])|(?<=`)(?:\w+/)+\w+\.(?:py|rs|json)(?=`)"
)
"""A path below a folder of sources, or a file in quotes that is named from there."""
OF_A_RECIPE = re.compile(r"^\d\. Write[^`]*`([^`]+)`", re.MULTILINE)
OF_OTHER_PROJECTS = {"tools/custom.py"}


def rooms_of_page(head: str) -> set[str]:
    """Names in the first column of the table with this head."""
    table = PAGE.partition(f"| room of `{head}` |")[2].partition("\n\n")[0]
    return {name for line in table.splitlines() for name in re.findall(r"`([^`]+)`", line.split("|")[1:2][0])}


def rooms_of_package() -> set[str]:
    names = set()
    for path in PACKAGE.iterdir():
        if path.name in FLOORS:
            names |= {f"{path.name}/{inner.stem}" for inner in path.iterdir() if inner.stem[0] != "_"}
        elif path.suffix == ".py" or any(path.glob("*.py")):
            names.add(path.stem)
    return names


def test_the_page_names_each_room_of_the_package() -> None:
    assert rooms_of_page("semcal_cli/") == rooms_of_package()


def test_the_page_names_each_folder_of_the_core() -> None:
    assert rooms_of_page("rust/") == {path.name for path in (ROOT / "rust").iterdir() if path.is_dir()}


def missing(names: set[str]) -> set[str]:
    """List the paths that are neither in the repository nor in the package."""
    return {name for name in names if not any((folder / name).exists() for folder in (ROOT, PACKAGE))}


def test_the_files_that_the_page_names_are_there() -> None:
    named = re.findall(r"`((?:rust|tests|semcal_cli)?/?[\w/]+(?:\.py|\.rs|\.json|/))`", PAGE)
    assert missing(set(named)) == set()


@pytest.mark.parametrize("path", [*PAGES, ROOT / "CONTRIBUTING.md"], ids=lambda path: path.name)
def test_the_files_that_other_pages_name_are_there(path: Path) -> None:
    page = path.read_text(encoding="utf-8")
    assert missing({*PATH.findall(page)} - {*OF_A_RECIPE.findall(page)} - OF_OTHER_PROJECTS) == set()


@pytest.mark.parametrize(
    "text",
    ["`assessment/clock_error.py`", "in semcal_cli/findings/limits.yaml.", "see `semcal_cli/assessment/`"],
)
def test_a_file_that_is_not_there_is_found(text: str) -> None:
    assert len(missing({*PATH.findall(text)})) == 1
