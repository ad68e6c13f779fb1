"""JSON Schemas: up to date, at the address that written files name, and as strict as what semcal writes."""

import json
import re
from pathlib import Path

import pytest
import yaml
from click.testing import Result
from dataset_imports import run_import
from dataset_trees import own_data
from jsonschema import Draft202012Validator

from semcal_cli.documentation import ADDRESS, SCHEMA_KEYS, schema_address
from semcal_cli.files.documents import document_text
from semcal_cli.files.validation import NEWEST_VERSION
from semcal_cli.labelling.card import CARDS
from semcal_cli.result.calibration_document import read_calibration, write_calibration
from semcal_cli.schemas import FOLDER, MODELS, schema_file, schema_text

COMMENT = re.compile(r"# yaml-language-server: \$schema=(\S+)\n")
IDS = {json.loads(path.read_text())["$id"]: path for path in FOLDER.glob("*.schema.json")}
"""Files of the schemas by the addresses that they state."""


@pytest.mark.parametrize("key", MODELS)
def test_a_shipped_schema_is_up_to_date(key: str) -> None:
    assert schema_file(key).read_text(encoding="utf-8") == schema_text(key)


def test_each_schema_lies_where_its_id_says() -> None:
    assert tuple(MODELS) == SCHEMA_KEYS
    assert {schema_address(key, NEWEST_VERSION) for key in MODELS} <= set(IDS)
    for address, path in IDS.items():
        assert address == f"{ADDRESS}/schemas/{path.name}"


def check(path: Path) -> None:
    """Check that a file begins with the address of a schema, that of its first key, and is valid under it."""
    text = path.read_text()
    match = COMMENT.match(text)
    assert match is not None, text[:100]
    document = yaml.safe_load(text)
    key, version = next(iter(document.items()))
    assert match[1] == schema_address(key, version)
    errors = Draft202012Validator(json.loads(IDS[match[1]].read_text())).iter_errors(document)
    assert [error.message for error in errors] == []


def test_what_semcal_writes_is_valid(
    street: Path, made: Path, rig: Path, rig_results: tuple[Result, Path]
) -> None:
    check(street / "drive.yaml")
    check(made / "c.yaml")
    check(rig)
    check(rig.parent / "camera_0" / "drive.yaml")
    check(rig_results[1] / "rig_calibration.yaml")
    check(rig_results[1] / "camera_0.yaml")


def test_an_imported_drive_is_valid(tmp_path: Path) -> None:
    run_import("folder", *own_data(tmp_path / "own"), "-o", tmp_path)
    check(tmp_path / "drive.yaml")


@pytest.mark.parametrize("path", sorted(CARDS.glob("*.yaml")), ids=lambda path: path.stem)
def test_a_ready_card_is_valid(path: Path) -> None:
    check(path)


def test_a_schema_finds_a_wrong_key(street: Path) -> None:
    document = yaml.safe_load((street / "drive.yaml").read_text()) | {"frame": []}
    schema = json.loads(schema_file("semcal_drive").read_text())
    assert [error.message for error in Draft202012Validator(schema).iter_errors(document)] == [
        "Additional properties are not allowed ('frame' was unexpected)"
    ]


def test_json_and_documents_without_a_schema_have_no_comment(made: Path, tmp_path: Path) -> None:
    write_calibration(read_calibration(made / "c.yaml"), tmp_path / "c.json")
    assert (tmp_path / "c.json").read_text().startswith('{\n  "semcal_calibration": 1,')
    assert document_text({"semcal_transform": 1}, "yaml") == "semcal_transform: 1\n"
    assert document_text({}, "yaml") == "{}\n"
