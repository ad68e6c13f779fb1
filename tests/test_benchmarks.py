"""Scripts whose figures are documented run to their end on their smallest input, and have the options named there."""

import os
import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import headless
import numpy as np
import pytest
import yaml
from conftest import TEST_DATA, make_pose
from documentation import PAGES, ROOT, text_of_all
from laboratory.page_tables import END, find_place

from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.synthetic.synthesis import synthesize

pytestmark = pytest.mark.slow

BENCHMARKS = ROOT / "tests/benchmarks"

SMALL = SynthConfig(num_frames=2, seed=5, width=320, height=180)
START = make_pose((0.021, -0.0224, 0.0168), (0.12, -0.1, 0.12))
"""2 degrees and 0.2 m."""
NEAR_DEG, NEAR_CM = 0.3, 5.0
"""Two small pairs in plain torch end at 0.05 degrees and 0.5 cm; a script that learns nothing stays at the start."""

NUMBER = r"\d+\.\d+"
RUNS = {
    "accumulation.py --streets 1 --sweeps 10 --points 10000 --width 160 --cue labels": 4,
    "arrays.py --pairs 2 --width 160 --cue labels --repeats 1": 1,
    "batch.py --drives 1 --bookkeeping 3 --frames 2 --width 160": 5,
    "bin_layouts.py DATA --only nuscenes": 11,
    "bootstrap.py --pool POOL --seeds 1 --resamples 2 --pairs 1 --pairs 2 --frames 2 --width 320": 2,
    "closure.py DATA --only jam --halvings 1": 2,
    "clocks.py DATA --starts 1 --only 'nuScenes back left'": 1,
    "contrast.py DATA --starts 1 --poses 2 --only '360 street'": 1,
    "cues.py --seeds 1 --frames 2 --width 160": 5,
    "features.py --seeds 1 --frames 1 --width 128": 1,
    "fleet.py --fleets 1": 15,
    "import_bag.py -o OUT/recordings --gigabytes 0.001 --rounds 1 --points 1000 --width 160": 3,
    "find_mask.py DATA --only street": 1,
    "first_hour.py DATA -o OUT/hour --only mcap --places 2": 1,
    "hostile.py --only 'a long unknown key' --share 0.0001": 0,
    "growth.py --pool OUT/growth -o OUT/growth.png --frames 1 --frames 2 --points 10000 --classes 2 --classes 40 "
    "--threads 1 --width 160 --repeats 1": 6,
    "hand_eye.py --drives 1 --width 320 --without-edges": 2,
    "hand_eye.py --drives 1 --width 320 --check": 5,
    "higher_maxima.py DATA --only jam --poses 1": 12,
    "image_matching.py DATA --only synthetic --seeds 1 --frames 2 --width 640": 2,
    "initialization.py --pool POOL --seeds 1 --jobs 1 --only '35-degree lens' --frames 2 --width 160": 3,
    "knocked_drive.py -o OUT/knocked.png --frames 4 --width 320 --angle-deg 3": 0,
    "labels_from_images.py -o OUT/labels --seconds 1 --training-frames 1 --drives 1 --frames 1 --width 128": 4,
    "point_clouds.py --rounds 1 --columns 32": 2,
    "real_drives.py DATA --starts 1 --only 'nuScenes back left' --pairs 1 --cue edges --cue segments,edges": 2,
    "intrinsics.py DATA --halves --synthetic 1 --cue labels": 2,
    "confident_and_wrong.py DATA --only mirrored --synthetic 1 --cue labels": 1,
    "ray_origin.py DATA --only 'KITTI object'": 2,
    "ray_origin.py DATA --only TAMU --quarters": 4,
    "verify.py DATA --only nothing --by-other --synthetic 1": 5,
    "skewed_intrinsics.py DATA --starts 1 --only jam --errors right": 2,
    "spin.py DATA --starts 1 --only 'right camera, as recorded'": 1,
    "odometry.py --seeds 1 --points 5000": 7,
    "odometry_gain.py --only clock --seeds 1 --points 10000 --width 160": 1,
    "odometry_speed.py -o OUT/speed --sweeps 12 --points 5000": 1,
    "pictures.py --frames 2 --width 320 -o OUT/pictures --work OUT/work --program SEMCAL": 0,
    "real_rig.py DATA --cameras 2 --starts 1": 2,
    "report.py --frames 2 --width 320 --runs 1": 1,
    "rig.py --seeds 1 --cameras 2 --frames 2 --width 160": 1,
    "rig_constraints.py --seeds 1 --cameras 2 --frames 2 --width 320": 1,
    "stereo_rig.py DATA --max-frames 2": 2,
    "rig_lidars.py --seeds 1 --frames 3 --width 320": 3,
    "same_results.py --before SEMCAL --after SEMCAL --work OUT/work --cases CASES --only inspect": 0,
    "segmentation.py --rounds 1 --frames 1 --columns 100": 3,
    "segment_scores.py DATA -o OUT/scores.png --only KITTI --max-frames 1 --steps 1": 3,
    "edges_image.py DATA -o OUT/edges.png --max-frames 1": 0,
    "edge_ideas.py DATA -o OUT/ideas.png --only jam --max-frames 1 --starts 1 --steps 1": 7,
    "speed_ratio.py --before SEMCAL --after SEMCAL --pool POOL/speed --repeats 1 --pairs 1 --width 64 "
    "--process calibrate --process inspect": 9,
    "transformers_labels.py --width 640 --only SegFormer": 1,
    "world_realism.py --seeds 1 --frames 1 --drive DRIVE": 13,
}
"""The smallest run of each script, and the least number of rows that its tables have."""
CASES = {
    "synth": ["synth pinhole --frames 2 --width 160 --height 90 -q"],
    "inspect": ["inspect @pinhole --json", "inspect @nothing"],
}
"""Cases for the comparison of two versions."""
IMAGES = ("overlay", "report", "verify", "fleet", "view")


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """What the words in capitals of a command stand for; drives are made once."""
    folder = tmp_path_factory.mktemp("benchmarks")
    synthesize(SMALL, folder / "drive")
    T = START @ read_transform(folder / "drive")
    (folder / "start.yaml").write_text(yaml.safe_dump({"semcal_transform": 1, "T_camera_lidar": T.tolist()}))
    semcal = folder / "semcal"
    # As pip writes it: processes that are spawned import it again.
    lines = ("from semcal_cli.cli import main", 'if __name__ == "__main__":', "    main()")
    semcal.write_text("\n".join([f"#!{sys.executable}", *lines, ""]))
    semcal.chmod(0o755)
    for name in ("pool", "out"):
        (folder / name).mkdir()
    (folder / "cases.yaml").write_text(yaml.safe_dump(CASES, sort_keys=False))
    names = {"DRIVE": "drive", "START": "start.yaml", "SEMCAL": "semcal", "CASES": "cases.yaml"}
    places = {word: folder / name for word, name in {**names, "POOL": "pool", "OUT": "out"}.items()}
    return {**places, "DATA": TEST_DATA}


def run(command: list[str], places: dict[str, Path]) -> str:
    """Run a command in which words stand for places, and give what it prints."""
    words = re.compile("|".join(rf"\b{word}\b" for word in places))
    command = [words.sub(lambda found: str(places[found[0]]), part) for part in command]
    # Threads of torch that wait for one another take all the time of a busy machine.
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    ended = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert ended.returncode == 0, ended.stderr
    for part in command:
        if Path(part).parent == places["OUT"]:
            assert Path(part).stat().st_size > 0
    return ended.stdout


def page_for(name: str, folder: Path) -> Path:
    """Copy the page with the place of that name, or make one."""
    mark = f"<!-- table: {name} -->\n"
    pages = [text for text in (path.read_text() for path in PAGES) if mark in text]
    page = folder / f"{name}.md"
    page.write_text(pages[0] if pages else f"# Figures\n\n{mark}{END}\n")
    return page


@pytest.mark.parametrize("command", RUNS, ids=lambda command: command.split()[0])
def test_a_script_runs_to_its_end(command: str, places: dict[str, Path], tmp_path: Path) -> None:
    script, *arguments = shlex.split(command)
    if script == "pictures.py" and headless.missing() and "CI" not in os.environ:
        pytest.skip(headless.missing())
    if script == "transformers_labels.py":
        pytest.importorskip("transformers")
    if "DATA" in arguments and not TEST_DATA.is_dir():
        pytest.skip(f"no real frames: {TEST_DATA} does not exist; set SEMCAL_TEST_DATA")
    page = page_for(Path(script).stem, tmp_path)
    outside = find_place(str(page), page.stem).split()
    into = ["--into", str(page)] if RUNS[command] else []
    printed = run([sys.executable, str(BENCHMARKS / script), *arguments, *into], places)
    if script == "pictures.py":
        assert all((places["OUT"] / f"pictures/{name}.webp").stat().st_size > 0 for name in IMAGES)
    if into:
        assert find_place(str(page), page.stem).split() == outside
        written = page.read_text().removeprefix(outside[0]).removesuffix(outside[1])
        *tables, measured = filter(None, written.splitlines())
        assert tables == [line for line in printed.splitlines() if line.startswith("|")]
        assert len(tables) - 2 * sum(line.startswith("|---") for line in tables) >= RUNS[command]
        assert measured.startswith(f"Measured by `python tests/benchmarks/{script} ")
        assert str(places["OUT"].parent) not in measured


def test_plain_torch_ends_near_the_truth(places: dict[str, Path]) -> None:
    options = "DRIVE --init START --estimator mine -o OUT/pose.npy"
    run([sys.executable, str(BENCHMARKS / "plain_torch.py"), *options.split()], places)
    error = compare_poses(np.load(places["OUT"] / "pose.npy"), read_transform(places["DRIVE"]))
    assert error.rotation_deg < NEAR_DEG
    assert error.camera_center_cm < NEAR_CM


def test_the_speed_beside_plain_torch(places: dict[str, Path], tmp_path: Path) -> None:
    small = "--repeats 1 --only refine --frames 1 --width 160 --height 90 -o OUT"
    page = page_for("speed", tmp_path)
    speed, kept_table = ([sys.executable, str(BENCHMARKS / f"{name}.py")] for name in ("speed", "kept_table"))
    printed = run([*speed, "--plain-torch", *small.split(), "--into", str(page)], places)
    written = f"<!-- table: speed -->\n\n{printed}\nMeasured by `COMMAND "
    command = "python tests/benchmarks/speed.py --plain-torch --repeats 1 --only refine"
    assert written.replace("COMMAND", command) in page.read_text()
    folder, options = places["OUT"] / "speed_1_160x90", ["semcal experiment", "--into", f"{page}#speed"]
    assert run([*kept_table, str(folder), *options], places) == printed
    assert written.replace("COMMAND ", "semcal experiment` ") in page.read_text()
    for estimator in ("exact", "mine"):
        figures = rf"\| 1 \| 1 \| {NUMBER}, {NUMBER} \| {NUMBER} \| {NUMBER} deg, {NUMBER} cm \|"
        assert re.search(rf"^\| refine, {estimator} {figures} {NUMBER} \|$", printed, re.MULTILINE)
        assert re.search(rf"^\| plain torch, {estimator} {figures}  \|$", printed, re.MULTILINE)


def documented_scripts() -> list[tuple[str, list[str]]]:
    """The scripts that the documentation names, each with the options that it gives them there."""
    found = re.findall(r"tests/benchmarks/(\w+\.py)([^`]*)`", text_of_all())
    return [(script, [word for word in shlex.split(rest) if word.startswith("-")]) for script, rest in found]


def test_the_documentation_names_scripts() -> None:
    scripts = {script for script, _ in documented_scripts()}
    assert {"accuracy.py", "initialization.py", "bootstrap.py"} <= scripts
    assert {script for script in scripts if not (BENCHMARKS / script).is_file()} == set()


@pytest.mark.parametrize(("script", "options"), [(s, o) for s, o in documented_scripts() if o])
def test_a_script_has_the_options_that_the_documentation_gives_it(
    script: str, options: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [script, "--help"])
    with pytest.raises(SystemExit):
        runpy.run_path(str(BENCHMARKS / script), run_name="__main__")
    known = set(re.findall(r"(?<![\w-])--?[a-z][\w-]*", capsys.readouterr().out))
    assert set(options) <= known


def test_every_script_is_run() -> None:
    """Other tests run the experiments, and `profiles.py` and `real_data.py` are no scripts."""
    scripts = {command.split()[0] for command in RUNS} | {"plain_torch.py", "speed.py", "kept_table.py"}
    experiments = {f"{name}.py" for name in ("accuracy", "check_limits", "gradient", "jointly", "trust")}
    others = {"benchmark.py", "real_data.py", "profiles.py", "troubleshooting.py"}
    assert scripts | experiments | others == {path.name for path in BENCHMARKS.glob("*.py")}
