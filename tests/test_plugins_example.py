"""The example package of docs/plugins.md works once it is installed, and broken packages are left out with a line."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from textwrap import dedent

import numpy as np
import pytest
from camera_infos import ROS
from dataset_trees import write, write_cloud, write_ids
from documentation import ROOT, blocks
from format_files import T_ANY

import semcal_cli
from semcal_cli.drive.document import read_drive
from semcal_cli.formats import read_transform, write_transform
from semcal_cli.observations.cues.cue_table import cues_of_options
from semcal_cli.plugins import Plugins, PluginWarning
from semcal_cli.result.calibration_document import read_calibration

NEEDED = "expected one or more of labels, segments, edges, intensity, features, auto"
EXAMPLE = Path(__file__).with_name("example_plugin")


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
