"""`semcal import` and intrinsics on values that nothing has: one line names file and key, and nothing is written."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import camera_infos
import pytest
import yaml
from camera_infos import KALIBR
from dataset_imports import Import, complaint
from dataset_trees import write

from semcal_cli.errors import InputError
from semcal_cli.formats.camera_block import read_intrinsics
from semcal_cli.importing.ontologies import ontology_names

TABLES = Path(__file__).parent / "hostile"
WORDS = {
    "huge": "9" * 400,
    "cut": "9" * 57 + "...",
    "digits": "9" * 5000,
    "deep": "[" * 100_000,
    "nested": "[" + '{"a": ' * 100 + r'"\\"' + "}" * 100 + "]",
    "keys": "\n".join(f"{'k' * 99}{i}: 1" for i in range(3000)),
    "eight keys": ", ".join(f"...{'k' * 8}{i}" for i in range(8)),
    "storage keys": "\n---\n" + "".join(f"key{i}: 1\n" for i in range(3000)),
    "side": "expected a whole number from 1 to 65535",
    "no rotation": "found determinant 2 and R R^T off the identity by 3, expected a rotation: determinant 1 and R R^T "
    "within 0.001 of the identity",
}
"""What stands for the words in braces of the tables."""


def fill_words(text: str) -> str:
    for word, meaning in WORDS.items():
        text = text.replace(f"{{{word}}}", meaning)
    return text


def swapped(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, fill_words(new))


def line(text: str, key: str, values: str) -> str:
    """Put other values under a key."""
    lines = [f"{key}: {values}" if one.startswith(f"{key}:") else one for one in text.splitlines()]
    assert lines != text.splitlines()
    return "\n".join(lines)


def row(text: str, index: int, values: dict[str, Any]) -> str:
    """Put other values into a row of a table."""
    rows = json.loads(text)
    rows[index] |= values
    return json.dumps(rows)


def without(text: str, index: int, key: str) -> str:
    rows = json.loads(text)
    del rows[index][key]
    return json.dumps(rows)


EDITS: dict[str, Callable[..., str]] = {"swap": swapped, "line": line, "row": row, "without": without}
IMPORTS = [
    (name, file, case)
    for name, files in yaml.safe_load((TABLES / "imports.yaml").read_text()).items()
    for file, cases in files.items()
    for case in cases
]


@pytest.mark.parametrize(("name", "file", "case"), IMPORTS)
def test_a_hostile_value_is_named(tmp_path: Path, name: str, file: str, case: dict[str, Any]) -> None:
    """A file of a data set is edited or taken away, and an import names it; nothing is written."""
    of = Import(name, tmp_path)
    path = of.root / file
    if "whole" not in case:
        (edit,) = case.keys() & EDITS.keys()
        path.write_text(EDITS[edit](path.read_text(), *case[edit]))
    elif case["whole"] is not None:
        write(path, fill_words(case["whole"]))
    else:
        path.unlink()
    assert of.complaint(*case.get("with", "").split()) == f"{{root}}/{file}: {fill_words(case['says'])}"


@pytest.mark.parametrize("case", yaml.safe_load((TABLES / "options.yaml").read_text()))
def test_hostile_options_are_named(tmp_path: Path, case: dict[str, Any]) -> None:
    of = Import(case["of"], tmp_path)
    write(of.root / "twice.yaml", "a: {ids: [1], color: [1, 2, 3]}\nb: {ids: [2], color: [1, 2, 3]}\n")
    options = case.get("with", "").replace("{root}", str(of.root)).split()
    if case.get("is_bare"):
        found = complaint(of.name, of.root, *options, "-o", of.out)
        found = found.replace(str(of.root), "{root}").replace(str(of.out), "{out}")
    else:
        found = of.complaint(*options)
    assert found == case["says"].replace("{tables}", ", ".join(ontology_names()))


@pytest.mark.parametrize("case", yaml.safe_load((TABLES / "intrinsics.yaml").read_text()))
def test_hostile_intrinsics(tmp_path: Path, case: dict[str, Any]) -> None:
    path, name = tmp_path / "camera.yaml", case.get("of", "")
    text: str = getattr(camera_infos, name, fill_words(case.get("text", "")))
    for old, new in case.get("swap", []):
        text = text.split(new)[0] if old == "cut" else swapped(text, old, new)
    write(path, case.get("before", "") + text + fill_words(case.get("add", "")))
    with pytest.raises(InputError) as error:
        read_intrinsics(path, case.get("camera"), case.get("model"))
    says = fill_words(case["says"])
    assert str(error.value) == (says if says.startswith("--") else f"{path}: {says}")


def test_a_camera_of_a_camchain_may_be_named_by_a_number(tmp_path: Path) -> None:
    write(tmp_path / "camera.yaml", KALIBR.split("cam1")[0].replace("cam0", "0"))
    assert read_intrinsics(tmp_path / "camera.yaml", "0")["width"] == 64
