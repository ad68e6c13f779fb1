"""Documents of each version: each is read and written again with the same content, newer ones are refused by name."""

import json
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from semcal_cli.documentation import entry_address
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.files.documents import (
    LONGEST_LINE,
    DocumentFormat,
    document_text,
    make_dumper,
    parse,
    read_document,
)
from semcal_cli.files.validation import NEWEST_VERSION, validate
from semcal_cli.fleet.fleet_drives import read_fleet_drives
from semcal_cli.formats import read_transform, write_transform
from semcal_cli.formats.base_link import read_base
from semcal_cli.formats.format import FormatOptions
from semcal_cli.labelling.card import read_card
from semcal_cli.many.batch.records import Record
from semcal_cli.many.rig.rig_calibration import RigCalibration, describe_rig
from semcal_cli.many.rig.rig_document import read_rig
from semcal_cli.many.rig.rig_result import read_rig_result
from semcal_cli.report.words import verdict_of
from semcal_cli.result.calibration_document import calibration_text, read_calibration

DOCUMENTS = Path(__file__).parent / "documents"
ROUNDING = 1e-12
"""Largest change of a number: the last bits of a drive's rotation are made orthonormal where it is read."""


def read_rig_of(path: Path) -> RigCalibration:
    """Read the result of the rig of the same version."""
    rig = read_rig(path.parents[1] / path.parent.name.replace("_calibration", "") / "rig.yaml")
    return read_rig_result(rig, rig.read_drives(), path)[0]


READERS: dict[str, Callable[[Path], Any]] = {
    "semcal_drive-1/drive.yaml": read_drive,
    "semcal_rig-1/rig.yaml": read_rig,
    "semcal_rig-1/camera_0/drive.yaml": read_drive,
    "semcal_rig-1/camera_1/drive.yaml": read_drive,
    "semcal_calibration-1/calibration.yaml": read_calibration,
    "semcal_calibration-1/calibration.json": read_calibration,
    "semcal_rig_calibration-1/rig_calibration.yaml": read_rig_of,
    "semcal_rig_calibration-1/camera_0.yaml": read_calibration,
    "semcal_rig_calibration-1/camera_1.yaml": read_calibration,
    "semcal_fleet-1/fleet.yaml": read_transform,
    "semcal_transform-1/transform.yaml": read_transform,
    "semcal_base-1/base.yaml": partial(read_base, direction=None, name=None, written=FormatOptions()),
    "semcal_image_model-1/card.yaml": read_card,
    "semcal_point_model-1/card.yaml": read_card,
}
"""Public reader of each document. Records and summaries of a batch have tests of their own."""


def test_each_kept_document_has_a_reader() -> None:
    kept = {path.relative_to(DOCUMENTS).as_posix() for path in DOCUMENTS.glob("*/**/*") if path.is_file()}
    assert kept == {*READERS, "semcal_record-1/record.json", "semcal_record-1/summary.jsonl"}


@pytest.mark.parametrize(
    ("newer", "found"), [(NEWEST_VERSION + 1, f"{NEWEST_VERSION + 1}"), (10**100, f"1{'0' * 56}...")]
)
@pytest.mark.parametrize("name", READERS)
def test_a_newer_version_is_refused_before_its_new_keys(
    name: str, newer: int, found: str, tmp_path: Path
) -> None:
    shutil.copytree(DOCUMENTS, tmp_path, dirs_exist_ok=True)
    path = tmp_path / name
    document = read_document(path)
    key = next(iter(document))
    path.write_text(json.dumps({"new_key": 1} | document | {key: newer}))  # is YAML as well
    with pytest.raises(InputError) as caught:
        READERS[name](path)
    assert str(caught.value) == f"{path}: {key}: found {found}, which a newer semcal wrote, needed 1"


def holds(written: object, kept: object) -> bool:
    """Tell whether all that a document says is said by another one, which may have more keys."""
    if isinstance(kept, dict):
        return isinstance(written, dict) and all(
            key in written and holds(written[key], value) for key, value in kept.items()
        )
    if isinstance(kept, list):
        return (
            isinstance(written, list)
            and len(written) == len(kept)
            and all(holds(*each) for each in zip(written, kept, strict=True))
        )
    if isinstance(kept, float):
        return isinstance(written, float) and abs(written - kept) <= ROUNDING
    return written == kept


def plain(document: dict[str, Any]) -> Any:
    """What is read of a document after it was written."""
    return parse(document_text(document, "yaml"), "yaml")


@pytest.mark.parametrize(
    "name", [name for name, reader in READERS.items() if reader in (read_drive, read_rig, read_card)]
)
def test_what_users_write_is_written_again(name: str) -> None:
    path = DOCUMENTS / name
    assert holds(plain(READERS[name](path).model_dump(mode="json")), read_document(path))


@pytest.mark.parametrize("name", [name for name, reader in READERS.items() if reader is read_calibration])
def test_a_calibration_is_written_again(name: str) -> None:
    path = DOCUMENTS / name
    form: DocumentFormat = "json" if path.suffix == ".json" else "yaml"
    assert holds(parse(calibration_text(read_calibration(path), form), form), read_document(path))


def test_the_drive() -> None:
    drive = read_drive(DOCUMENTS / "semcal_drive-1")
    assert (drive.camera.model, drive.camera.width, drive.camera.K[0][2]) == ("plumb_bob", 320, 159.5)
    assert [frame.points for frame in drive.frames] == ["points/000000.bin", "points/000001.bin"]
    assert drive.classes is not None
    assert drive.classes.points["car"] == (14,)
    assert drive.ignore.image == (0,)
    assert drive.T_camera_lidar is not None


def test_the_doubted_calibration() -> None:
    found = read_calibration(DOCUMENTS / "semcal_calibration-1/calibration.yaml")
    assert found.status == "not_trusted"
    assert found.pose[0].tolist() == [
        -0.5268456052103974,
        0.8488504905739049,
        -0.04343446699259468,
        0.7178954331071339,
    ]
    prior, seeds = verdict_of(found).reasons
    assert prior.sentence.startswith("--prior-translation-m 0.8 -0.1 -0.3 0.005 is 70.5 cm from where labels")
    assert prior.address == entry_address("prior")
    assert seeds.address == entry_address("seeds")
    assert found.uncertainty is not None
    assert found.repeatability is not None
    assert found.repeatability.num_seeds == 2
    assert list(found.stages) == ["initial", "refined", "polished", "fused"]
    assert [frame.points for frame in found.input.frames] == ["points/000000.bin", "points/000001.bin"]


def test_the_trusted_calibration_and_its_bare_transform() -> None:
    found = read_calibration(DOCUMENTS / "semcal_calibration-1/calibration.json")
    assert (found.status, found.reasons, found.settings.seed) == ("trusted", (), 1)
    path = DOCUMENTS / "semcal_transform-1/transform.yaml"
    assert np.array_equal(read_transform(path), found.pose)
    written = write_transform(found.pose, None, "semcal", FormatOptions())
    assert holds(parse(written.decode(), "yaml"), read_document(path))


def test_the_result_of_the_rig() -> None:
    path = DOCUMENTS / "semcal_rig_calibration-1/rig_calibration.yaml"
    found, kept = read_rig_of(path), read_document(path)
    assert (found.status, list(found.cameras), found.num_sweeps) == ("trusted", ["camera_0", "camera_1"], 2)
    (pair,) = found.pairs
    assert (pair.a, pair.b) == ("camera_0", "camera_1")
    files = {name: f"{name}.yaml" for name in found.cameras}
    written = describe_rig(found, files, kept["input"]["rig"], kept["input"]["sha256"])
    assert holds(plain(written), kept | {"versions": written["versions"]})


def test_the_fleet() -> None:
    path = DOCUMENTS / "semcal_fleet-1/fleet.yaml"
    assert read_transform(path).tolist() == read_document(path)["T_camera_lidar"]


def test_the_record_and_the_summary_of_a_batch() -> None:
    folder = DOCUMENTS / "semcal_record-1"
    drives = read_fleet_drives([folder])
    assert [drive.name for drive in drives] == [f"drives/00000{number}" for number in range(3)]
    assert all(drive.left_out is None and drive.covariance is not None for drive in drives)
    record = json.loads((folder / "record.json").read_text())
    stated = {key: value for key, value in record.items() if key not in ("files", "sha256")}
    assert validate(Record, stated, folder).outcome.drive == "drives/000000"
    assert drives[0].T_camera_lidar is not None
    assert drives[0].T_camera_lidar.tolist() == record["outcome"]["T_camera_lidar"]


TEXTS = (
    *("", " begins", "ends ", "a: b", "a #b", "- a", "? a", "a\\b", "a\tb", "a\n b\n", "x " * 200),
    *["[a", "{b", "*c", "&d", "!e", "|", ">", "%f", "@g", "`h", "<<", "...", "---", "it's", '"q"'],
    *("null", "~", "yes", "1e3", "0x1f", "12:30"),
    *("\a", "\x7f", "\x85", "\xa0", "\u2028", "\ufeff", "straße", "日本", "\U0001f600"),
)
"""Texts that YAML needs quotes or escapes for, or might break into lines."""


@pytest.mark.parametrize("text", TEXTS, ids=ascii)
def test_yaml_is_the_same_bytes_with_and_without_the_library_in_c(text: str) -> None:
    for document in ({"key": text}, {"key": [text, 1.5]}, {text or "key": [[0.1, 1e-30], [2.0, -3.0]]}):
        dumper = make_dumper(yaml.SafeDumper)
        expected = yaml.dump(document, Dumper=dumper, sort_keys=False, width=LONGEST_LINE)
        assert document_text(document, "yaml") == expected
