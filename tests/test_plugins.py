"""The example package of docs/plugins.md works once it is installed, and broken packages are left out with a line."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from textwrap import dedent

import numpy as np
import pytest
from camera_infos import ROS
from commands import invoke
from dataset_imports import run_import
from dataset_trees import write, write_cloud, write_ids
from documentation import ROOT, blocks
from format_files import T_ANY

import semcal_cli
from semcal_cli import importing
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.files.documents import read_document
from semcal_cli.formats import read_transform, write_transform
from semcal_cli.importing import read_dataset, recording
from semcal_cli.importing.choice import FrameChoice
from semcal_cli.importing.drive_folder import write_drive
from semcal_cli.observations.cues.cue_table import cues_of_options, load_cues
from semcal_cli.plugins import PluginError, Plugins, PluginWarning
from semcal_cli.result.calibration_document import read_calibration

EXAMPLE = Path(__file__).with_name("example_plugin")
NEEDED = "expected one or more of labels, segments, edges, intensity, features, auto"


def semcal(*words: object, packages: Path | None = None, code: int = 0) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own, which finds the packages of a folder as if they were installed."""
    paths = [*([packages] if packages else []), Path(semcal_cli.__file__).parents[1]]
    env = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, paths))}
    command = [sys.executable, "-m", "semcal_cli", *map(str, words)]
    # `-m` would find the sources without the core where the tests run at the root of a checkout.
    done = subprocess.run(command, env=env, capture_output=True, text=True, cwd=EXAMPLE.parent)
    assert done.returncode == code, done.stderr
    return done


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that pip has installed the example in, without a network."""
    folder = tmp_path_factory.mktemp("plugin")
    shutil.copytree(EXAMPLE, folder / "source")  # setuptools builds where the sources are
    offline = ["--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check", "--quiet"]
    target = folder / "site"
    pip = [sys.executable, "-m", "pip", "install", *offline, "--target", target, folder / "source"]
    subprocess.run(pip, check=True)
    return target


def test_the_page_shows_the_files_of_the_example() -> None:
    page = ROOT / "docs/plugins.md"
    shown = [*blocks(page, "toml"), *blocks(page, "python")[:3]]
    files = ["pyproject.toml", *(f"my_robot/{name}.py" for name in ("format", "cue", "dataset"))]
    assert shown == [(EXAMPLE / name).read_text() for name in files]


def test_a_format_is_listed_read_and_written(installed: Path, tmp_path: Path) -> None:
    *_, last = re.split(r"\n(?=\S)", semcal("convert", "--formats", packages=installed).stdout.strip())
    assert " ".join(last.split()) == (
        "my-robot p_lidar = T p_camera: mounting.q (w x y z) and mounting.t; my-robot 1.0"
    )
    write_transform(T_ANY, tmp_path / "any.txt", "text", semcal_cli.FormatOptions("lidar-to-camera"))
    path = tmp_path / "rig.yaml"
    semcal(
        *("convert", tmp_path / "any.txt", "--direction", "lidar-to-camera"),
        "--to",
        "my-robot",
        "-o",
        path,
        packages=installed,
    )
    back = tmp_path / "back.tum.yaml"
    semcal("convert", path, "--to", "semcal", "-o", back, packages=installed)
    np.testing.assert_allclose(read_transform(back), T_ANY, atol=1e-12)
    without = semcal("convert", path, "--to", "semcal", code=1).stderr
    assert "found top-level keys 'mounting', expected a transform in a format of --from: semcal, " in without


def test_a_data_set_is_listed_and_imported(installed: Path, tmp_path: Path) -> None:
    listed = " ".join(semcal("import", "--help", packages=installed).stdout.split())
    line = "my-robot My robot: ROOT/clouds and ROOT/images, and its camera and its mounting beside them."
    assert listed.endswith(f"{line} (my-robot 1.0)")
    write_cloud(tmp_path / "set/clouds/1.bin")
    write_ids(tmp_path / "set/images/1.png")
    write(tmp_path / "set/camera.yaml", ROS)
    write_transform(T_ANY, tmp_path / "set/transform.yaml", "semcal")
    semcal("import", "my-robot", tmp_path / "set", "-o", tmp_path / "drive", packages=installed)
    drive = read_drive(tmp_path / "drive")
    assert [(frame.points, frame.image) for frame in drive.frames] == [
        ("../set/clouds/1.bin", "../set/images/1.png")
    ]
    np.testing.assert_allclose(np.array(drive.T_camera_lidar), T_ANY, atol=1e-12)


def test_a_cue_is_compared_beside_labels(installed: Path, street: Path, tmp_path: Path) -> None:
    """The result is that of the command, and is read and shown where the plugin is missing, too."""
    shown = " ".join(semcal("calibrate", "--help", packages=installed).stdout.split())
    assert "[plugins: brightness (my-robot 1.0)]" in shown
    path = tmp_path / "calibration.yaml"
    both = ("--cue", "brightness,labels", "-q", "-o", path)
    semcal("refine", street, "--init", street, *both, "--max-frames", 4, packages=installed)
    made = read_calibration(path)
    cues = made.settings.options["cues"]
    assert cues == {"labels": {}, "brightness": {}}
    assert cues_of_options(made.settings.options) == ("labels",)  # of those that are here
    assert cues_of_options({"cues": {"brightness": {}}}) == ()
    np.testing.assert_array_equal(read_transform(path), made.pose)
    semcal("overlay", street, path, "-o", tmp_path / "overlay")
    asked = semcal("refine", street, "--init", street, "--cue", "brightness", code=2).stderr
    assert NEEDED in " ".join(asked.split())


def test_the_policy_of_a_cue_takes_effect(installed: Path, street: Path, tmp_path: Path) -> None:
    """It finds no mounting, is refined from its several starts, and is not trusted with few scenes."""
    path = tmp_path / "calibration.yaml"
    asked = ("--cue", "brightness", "-q", "-o", path)
    lost = semcal("calibrate", street, "--from-nothing", *asked, packages=installed, code=1).stderr
    assert "drive.yaml: a calibration by brightness needs a start within 5 degrees and 0.3 m" in lost
    assert "or segments beside them; the motion of camera and LiDAR gives no start" in lost
    lost = semcal(
        "calibrate", street, "--init", street, "--search-deg", 10, *asked, packages=installed, code=1
    )
    assert lost.stderr.endswith("(`search_deg`), or add segments beside them\n")
    semcal("refine", street, "--init", street, *asked, "--max-frames", 2, packages=installed, code=3)
    made = read_calibration(path)
    assert made.settings.options["refinement"]["starts"]["num_starts"] == [8, 4, 2]  # type: ignore[index, call-overload]
    few = "the frames show 2 places; at least 3 are needed for brightness: add frames from other places"
    assert few in made.reasons


def broken(folder: Path) -> Path:
    """An installed package none of whose entry points is right."""
    made = folder / "z_robot-2.0.dist-info"
    write(made / "METADATA", "Metadata-Version: 2.1\nName: z-robot\nVersion: 2.0\n")
    write(folder / "z_robot.py", "NUMBER = 3\n")
    write(folder / "z_leaving.py", "raise SystemExit('not\\ntoday')\n")
    write(
        made / "entry_points.txt",
        dedent(
            """
            [semcal.formats]
            absent = nowhere:FORMAT
            number = z_robot:NUMBER
            urdf = z_robot:NUMBER
            --up = z_robot:NUMBER
            [semcal.datasets]
            folder = z_robot:NUMBER
            leaving = z_leaving:read
            [semcal.cues]
            brightness = z_robot:NUMBER
            typo = z_robot:NAMBER
            """
        ),
    )
    return folder


def warned(done: subprocess.CompletedProcess[str]) -> list[str]:
    start = "semcal: warning: z-robot 2.0: entry point "
    return [line.removeprefix(start) for line in done.stderr.splitlines() if line.startswith(start)]


def test_broken_plugins_are_one_line_each(installed: Path, street: Path, tmp_path: Path) -> None:
    packages = broken(Path(shutil.copytree(installed, tmp_path / "site")))
    formats = semcal("convert", "--formats", packages=packages)
    assert warned(formats) == [
        "--up of semcal.formats: found this name, expected letters, digits, '_', '.' and '-', not '-' or '.' first",
        "urdf of semcal.formats: found a name that semcal already has; choose another",
        "absent of semcal.formats: cannot be imported: ModuleNotFoundError: No module named 'nowhere'",
        "number of semcal.formats: found an object of class int, expected Format",
    ]
    assert len(formats.stderr.splitlines()) == 4
    assert "my-robot" in formats.stdout
    imports = semcal("import", "--help", packages=packages)
    assert warned(imports) == [
        "folder of semcal.datasets: found a name that semcal already has; choose another",
        "leaving of semcal.datasets: cannot be imported: SystemExit: not today",
    ]
    assert "leaving" not in imports.stdout
    assert "my-robot" in imports.stdout
    cue = semcal("refine", street, "--init", street, "--cue", "typo", packages=packages, code=1)
    assert warned(cue) == [
        "brightness of semcal.cues: found a name that my-robot 1.0 already has; choose another",
        "typo of semcal.cues: cannot be imported: AttributeError: module 'z_robot' has no attribute 'NAMBER'",
    ]
    *_, error = cue.stderr.splitlines()
    assert error.startswith("semcal: error: cues: found 'typo', expected one of: labels, ")
    assert "Traceback" not in formats.stderr + imports.stderr + cue.stderr
    # Who asks for nothing of plugins hears nothing of them.
    assert semcal("convert", street, "--to", "kalibr", packages=packages).stderr == ""


def test_a_plugin_is_loaded_once_and_warned_of_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(broken(tmp_path))
    plugins = Plugins("semcal.formats", ["urdf"])
    with pytest.warns(PluginWarning) as found:
        plugins.all(int)
    assert len(found) == 3
    assert plugins.all(int) == {"number": 3}
    assert plugins.get("absent", int) is None
    assert plugins.names == ("number",)
    assert plugins.package("number") == "z-robot 2.0"


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
