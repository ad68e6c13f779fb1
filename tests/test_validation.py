"""Versions of documents: newer ones are refused by name, whatever else is in them."""

import importlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from semcal_cli.errors import InputError
from semcal_cli.files.validation import NEWEST_VERSION, StrictModel, validate

MODULES = [
    importlib.import_module(f"semcal_cli.{name}")
    for name in (
        "drive.document",
        "rig.document",
        "rig.result",
        "labelling.card",
        "formats.semcal",
        "batch.records",
    )
]


def models(base: type[StrictModel] = StrictModel) -> Iterator[type[StrictModel]]:
    for model in base.__subclasses__():
        yield model
        yield from models(model)


VERSIONED = {key: model for model in models() for key in model.model_fields if key.startswith("semcal_")}


def test_every_document_states_its_version() -> None:
    assert sorted(VERSIONED) == [
        "semcal_calibration",
        "semcal_drive",
        "semcal_fleet",
        "semcal_picture_model",
        "semcal_point_model",
        "semcal_record",
        "semcal_rig",
        "semcal_rig_calibration",
        "semcal_transform",
    ]


@pytest.mark.parametrize(
    ("document", "found"),
    [
        ({"version": NEWEST_VERSION + 1, "new_key": 1}, "2, which a newer semcal wrote"),
        ({"new_key": 1, "version": 10**100}, f"1{'0' * 56}..., which a newer semcal wrote"),
    ],
)
@pytest.mark.parametrize("key", VERSIONED)
def test_a_newer_version_is_refused_before_its_new_keys(
    key: str, document: dict[str, int], found: str
) -> None:
    document = {key if name == "version" else name: value for name, value in document.items()}
    with pytest.raises(InputError) as caught:
        validate(VERSIONED[key], document, Path("a.yaml"))
    assert str(caught.value) == f"a.yaml: {key}: found {found}, needed 1"
