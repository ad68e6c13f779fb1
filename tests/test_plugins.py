"""A plugin whose data set, cue or format is wrong gets one line that names it."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import invoke
from dataset_imports import run_import
from dataset_trees import write
from format_files import T_ANY

from semcal_cli import importing
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.files.documents import read_document
from semcal_cli.formats import write_transform
from semcal_cli.importing import read_dataset, recording
from semcal_cli.importing.choice import FrameChoice
from semcal_cli.importing.drive_folder import write_drive
from semcal_cli.observations.cues.cue_table import load_cues
from semcal_cli.plugins import PluginError, Plugins

CODE = """
from dataclasses import replace
import numpy as np
from semcal_cli.importing.recording import Cloud, Conversion, Recording, SourceFrame
from semcal_cli.observations.cues.cue import Cue
from semcal_cli.observations.cues.cue_table import find_cue
from semcal_cli.formats.format import Format

print("a module that greets")

def recording(request, points=None, **others):
    frame = SourceFrame("0", points or request.root / "drive.yaml", image=request.root / "drive.yaml")
    return Recording(**{"camera": {"model": "plumb_bob"}, "frames": [frame]} | others)
def failing(request):
    return {}["velodyne"]
def leaving(request):
    raise SystemExit(0)
def nothing(request):
    pass
def no_frames(request):
    return recording(request, frames=[])
def array(request):
    return recording(request, camera={"K": np.eye(3)})
def text(request):
    return recording(request, points="0.bin")
def conversion(request):
    return recording(request, Conversion(lambda: 1 // 0, False, request.root / "drive.yaml", True))
def no_cloud(request):
    return recording(request, Conversion(lambda: None, False, request.root / "drive.yaml", True))
def remark(request):
    return recording(request, remarks=("dark", 3))
def late(request):
    return recording(request, frames=[replace(recording(request).frames[0], image_stamp=float("inf"))])

def labels(drive, sweeps, is_raw):
    return find_cue("labels").observe(drive, sweeps, is_raw)
def fewer(drive, sweeps, is_raw):
    return labels(drive, sweeps, is_raw).of_frames([0])
def wide(drive, sweeps, is_raw):
    found = labels(drive, sweeps, is_raw)
    return found.with_images(replace(each, classes=np.int64(each.classes)) for each in found.images)
GOOD, FEWER = Cue(observe=labels, files=()), Cue(observe=fewer, files=())
WIDE, MISNAMED = Cue(observe=wide, files=()), Cue(observe=wide, files=("picture",))
STARTED, UNSURE = replace(GOOD, starts=(8, 4)), replace(GOOD, is_coarse=1)
WEIGHTLESS, SCENELESS = replace(GOOD, weight_beside_local=0), replace(GOOD, min_scenes=2.5)
LOST = replace(GOOD, can_find_mounting=False, finds_mounting_alone=True)
PARTED = replace(GOOD, has_partitions=True)
SEVERAL = find_cue("edges").starts_alone
CONTRASTED = replace(GOOD, starts=SEVERAL)
FLAT = replace(GOOD, starts=find_cue("edges").starts, starts_alone=SEVERAL)
OF_LABELS = replace(SEVERAL.contrast, class_weights={"building": 1.0, "car": 1.0})
PLAINLESS = replace(FLAT, starts_alone=replace(SEVERAL, contrast=OF_LABELS))

ONLY_READ = Format("x", "", lambda source: False, lambda source, options: None)
WORDS = replace(ONLY_READ, make=lambda T, options: "words")

from semcal_cli.importing import reads
@reads("lidar", "version")
def several(request):
    '''Several robots.

    Raises:
        ValueError: always.
    '''
    raise ValueError(f"{request.lidar} of {request.version}")
"""
"""A module of a plugin, all of whose functions are wrong."""


@pytest.fixture
def wrong(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An installed package whose objects load, and are wrong."""
    write(tmp_path / "wrong_robot.py", CODE)
    write(tmp_path / "w-2.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: w\nVersion: 2.0\n")
    groups = {
        "datasets": "failing leaving nothing no_frames array text conversion no_cloud remark late several",
        "cues": "FEWER WIDE MISNAMED STARTED UNSURE WEIGHTLESS SCENELESS LOST PARTED CONTRASTED FLAT PLAINLESS",
        "formats": "ONLY_READ WORDS",
    }
    lines = [
        f"[semcal.{group}]\n" + "".join(f"{each} = wrong_robot:{each}\n" for each in names.split())
        for group, names in groups.items()
    ]
    write(tmp_path / "w-2.0.dist-info/entry_points.txt", "".join(lines))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "wrong_robot", raising=False)
    for place, group in (
        ("importing", "datasets"),
        ("observations.cues.cue_table", "cues"),
        ("formats.format_table", "formats"),
    ):
        monkeypatch.setattr(f"semcal_cli.{place}.PLUGINS", Plugins(f"semcal.{group}", ()))


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("failing", "wrong_robot.py, line 15: KeyError: 'velodyne'"),
        ("leaving", "wrong_robot.py, line 17: SystemExit: 0"),
        ("nothing", "TypeError: found nothing, expected a Recording"),
        ("no_frames", "ValueError: frames: found none, needed at least one"),
        (
            "array",
            "TypeError: camera: Object of type ndarray is not JSON serializable; expected numbers, text, ",
        ),
        ("text", "TypeError: frames[0].points: found '0.bin', expected Path or Conversion"),
        ("remark", "TypeError: remarks[1]: found 3, expected str"),
        ("late", "TypeError: frames[0].image_stamp: found inf, expected a number or None"),
    ],
)
@pytest.mark.usefixtures("wrong")
def test_a_wrong_data_set_names_its_plugin(
    name: str, said: str, street: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whatever it raises or returns is one line, as is leaving with code 0; what it prints is no output."""
    with pytest.raises(PluginError, match=re.escape(f"w 2.0: entry point {name} of semcal.datasets: {said}")):
        read_dataset(name, recording.Request(street))
    assert capsys.readouterr() == ("", "a module that greets\n")


@pytest.mark.usefixtures("wrong")
def test_a_wrong_conversion_names_its_plugin_and_stays_in_its_folder(street: Path, tmp_path: Path) -> None:
    found = read_dataset("conversion", recording.Request(street))
    with pytest.raises(PluginError, match="line 27: ZeroDivisionError: "):
        (found.frames[0].points).cloud()  # type: ignore[union-attr]
    found = read_dataset("no_cloud", recording.Request(street))
    with pytest.raises(PluginError, match="TypeError: cloud: found nothing, expected a Cloud"):
        (found.frames[0].points).cloud()  # type: ignore[union-attr]
    camera = read_document(street / "drive.yaml")["camera"]
    for name, cloud, said in (
        (
            "../../0",
            np.zeros((2, 4), np.float32),
            "found the name of no file, expected one for its converted cloud",
        ),
        ("0", np.zeros((2, 3), np.float32), "found points of shape (2, 3), needed (N, 4)"),
    ):
        points = recording.Conversion(
            lambda cloud=cloud: recording.Cloud(cloud, None),
            False,
            street / "points/000000.bin",
            True,
        )
        frame = recording.SourceFrame(name, points, image=street / "images/000000.png")
        good = replace(
            frame,
            name="1",
            points=replace(points, cloud=lambda: recording.Cloud(np.ones((2, 4)), None)),
        )
        with pytest.raises(InputError, match=re.escape(said)):
            write_drive(recording.Recording(camera, [good, frame]), FrameChoice(), tmp_path / "a/b/drive")
    assert not (tmp_path / "a").exists()


@pytest.mark.usefixtures("wrong")
def test_a_data_set_has_the_options_that_it_declares(
    street: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("semcal_cli.cli.import_.PLUGINS", importing.PLUGINS)
    asked = (street, "--lidar", "left", "--version", "v2", "-o", tmp_path / "drive")
    with pytest.raises(PluginError, match="ValueError: left of v2"):
        run_import("several", *asked)
    shown = invoke("import", "several", "--help").stdout
    assert "Several robots.\n\n  The data set comes from w 2.0." in shown
    assert "No such option '--lidar'" in invoke("import", "failing", *asked).stderr
    with pytest.raises(TypeError, match="reads: found 'lidars', expected lidar or version"):
        importing.reads("lidars")
    with pytest.raises(TypeError, match="reads: found lidar, lidar, expected each once"):
        importing.reads("lidar", "lidar")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("FEWER", "ValueError: observe: found 1 frame, needed 4, by one cue"),
        (
            "WIDE",
            "ValueError: frame 0: classes of pixels: found int64 of shape (360, 640), expected uint8 of shape",
        ),
        ("MISNAMED", "ValueError: files: found ('picture',), expected a tuple of: points, "),
        ("STARTED", "TypeError: starts: found a list of 2, expected a StartsConfig or None"),
        ("UNSURE", "TypeError: is_coarse: found 1, expected True or False"),
        ("WEIGHTLESS", "ValueError: weight_beside_local: found 0, expected a number above 0 and up to 1"),
        ("SCENELESS", "ValueError: min_scenes: found 2.5, expected a whole number of at least 1"),
        (
            "LOST",
            "ValueError: can_find_mounting: found False beside finds_mounting_alone=True, expected True",
        ),
        (
            "PARTED",
            "ValueError: has_partitions: found False in what it observes, expected True, as the cue states",
        ),
        ("CONTRASTED", "ValueError: starts: found a contrast, expected none: it is for starts_alone"),
        (
            "FLAT",
            "ValueError: starts_alone.contrast: found weights of range step 1, range step 2, range step 3, expected "
            "any",
        ),
        (
            "PLAINLESS",
            "ValueError: plain_class: needed 0, the class that starts_alone.contrast compares others with",
        ),
    ],
)
@pytest.mark.usefixtures("wrong")
def test_a_wrong_cue_names_its_plugin(name: str, said: str, street: Path) -> None:
    """Fewer frames than the drive's would otherwise be calibrated as if they were all."""
    with pytest.raises(PluginError, match=re.escape(f"w 2.0: entry point {name} of semcal.cues: {said}")):
        load_cues(read_drive(street), [name])


@pytest.mark.usefixtures("wrong")
def test_a_wrong_format_names_its_plugin() -> None:
    with pytest.raises(
        InputError, match="found format ONLY_READ, which is only read, expected one that is written"
    ):
        write_transform(T_ANY, None, "ONLY_READ")
    with pytest.raises(
        PluginError, match=r"WORDS of semcal\.formats: TypeError: make: found 'words', expected bytes"
    ):
        write_transform(T_ANY, None, "WORDS")
