"""Links where semcal writes, as a drive from a stranger may hold them: no writer follows one."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from commands import invoke
from networks import STREET_COLORS, color_network
from test_calibration import POSE, make_calibration

from semcal_cli.result.calibration_document import write_calibration

PRECIOUS = "a year of work\n"


def nothing(folder: Path) -> None:
    """Make nothing beside the drive."""


def network(folder: Path) -> None:
    """Write a network, and leave the drive's image labels to it."""
    color_network(folder / "net.onnx", stride=2, colors=STREET_COLORS)


def calibration(folder: Path) -> None:
    """Write a calibration."""
    write_calibration(make_calibration(POSE), folder / "c.yaml")


@dataclass(frozen=True)
class Writer:
    """A command, and the places at which it writes."""

    words: str
    """The command, run in a folder with `drive`."""
    files: tuple[str, ...] = ()
    """Files that it writes."""
    folders: tuple[str, ...] = ()
    """Folders that it makes and names itself."""
    make: Callable[[Path], object] = nothing
    """Makes what else it needs."""


LABELS = "drive/.semcal_labels"
WRITERS = {
    "refine": Writer(
        "refine drive --init drive --no-polish -o c.yaml --log log.json",
        ("c.yaml", "log.json"),
    ),
    "labels beside a drive": Writer(
        "calibrate drive --image-model net.onnx --no-polish -o c.yaml",
        folders=(LABELS, f"{LABELS}/*", f"{LABELS}/*/image_labels"),
        files=(
            f"{LABELS}/*/image_labels/*.png",
            f"{LABELS}/*/*.yaml",
            f"{LABELS}/*/image_labels/semcal_label.json",
        ),
        make=network,
    ),
    "label": Writer(
        "label drive --image-model net.onnx -o out --force",
        ("out/drive.yaml", "out/image_labels/*.png", "out/image_labels/semcal_label.json"),
        ("out/image_labels",),
        network,
    ),
    "synth": Writer(
        "synth out --frames 1 --force",
        ("out/drive.yaml", "out/*/000000.*"),
        ("out/points", "out/images"),
    ),
    "merge": Writer("merge drive -o out --force", ("out/drive.yaml",)),
    "overlay": Writer("overlay drive drive -o out", ("out/*.png",)),
    "report": Writer("report drive drive -o page.html", ("page.html",)),
    "verify": Writer("verify drive drive --junit junit.xml", ("junit.xml",)),
    "convert": Writer(
        "convert c.yaml --to npy --to-direction lidar-to-camera -o T.npy", ("T.npy",), make=calibration
    ),
    "fleet": Writer("fleet c.yaml -o f.json --plot plot.svg", ("f.json", "plot.svg"), make=calibration),
    "audit": Writer("audit drive -o audit.html --junit junit.xml", ("audit.html", "junit.xml")),
    "batch": Writer(
        "batch drive -o out -- --no-polish",
        ("out/summary.jsonl", "out/*/record.json", "out/*/calibration.yaml", "out/*/log.txt", "out/.lock"),
        ("out/*",),
    ),
}


def prepared(writer: Writer, street: Path, folder: Path) -> Path:
    """Make what a command needs in a folder."""
    folder.mkdir()
    shutil.copytree(street, folder / "drive")
    writer.make(folder)
    return folder


def run(writer: Writer, folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Run a command in a folder; return all that it says."""
    monkeypatch.chdir(folder)
    result = invoke(*writer.words.split())
    return f"{result.output}{result.exception}"


@pytest.mark.parametrize("name", WRITERS)
def test_no_writer_follows_a_link(
    name: str, street: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = WRITERS[name]
    first = prepared(writer, street, tmp_path / "first")
    said = run(writer, first, monkeypatch)
    for pattern, target in [
        *((file, "file") for file in writer.files),
        *((path, "folder") for path in writer.folders),
    ]:
        places = sorted(first.glob(pattern))
        assert places, f"{pattern}: not written: {said}"
        again = prepared(writer, street, tmp_path / f"again-{abs(hash(pattern))}")
        precious = again / "precious"
        precious.mkdir()
        (precious / "work").write_text(PRECIOUS)
        place = again / places[0].relative_to(first)
        place.parent.mkdir(parents=True, exist_ok=True)
        place.symlink_to(precious / "work" if target == "file" else precious)
        said_again = run(writer, again, monkeypatch)
        left = {path.name: path.read_text() for path in precious.iterdir()}
        assert left == {"work": PRECIOUS}, f"{place}: {said_again}"
