"""ARCHITECTURE.md has a line for each room that there is, and names files that there are."""

import re

from documentation import ROOT
from house import FLOORS, PACKAGE

PAGE = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")


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


def test_the_files_that_the_page_names_are_there() -> None:
    named = re.findall(r"`((?:rust|tests|semcal_cli)?/?[\w/]+(?:\.py|\.rs|\.json|/))`", PAGE)
    places = [[ROOT / name, PACKAGE / name] for name in named]
    missing = [
        name for name, paths in zip(named, places, strict=True) if not any(path.exists() for path in paths)
    ]
    assert missing == []
