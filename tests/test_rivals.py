"""Methods beside one another: over pairs, over wrong labels, and the tables of the paper."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from commands import invoke
from conftest import FINE_STREET, edited

from semcal_cli.drive.document import read_drive
from semcal_cli.experiments import pairs_and_noise, table
from semcal_cli.experiments.drives import Pool
from semcal_cli.experiments.methods import METHODS
from semcal_cli.experiments.pairs_and_noise import (
    EXPERIMENTS,
    Choice,
    ComparisonSetting,
    MethodError,
    cases,
    complete,
    report,
    run,
)
from semcal_cli.experiments.plots import plot_png
from semcal_cli.files.image_files import read_image
from semcal_cli.formats import read_transform, write_transform
from semcal_cli.geometry.poses import mounting_rpy_deg, pose_from_mounting

pytestmark = pytest.mark.slow

FLAT_PX = 0.1
"""Distance between borders that may differ among machines on this frame."""
FLAT_NATS = 0.02
"""Mutual information of the frame changes by less over a metre along the optical axis: tops near one another are as
good, and that of semcal is among them."""


def run_table(drive: Path, out: Path, *arguments: object) -> str:
    result = invoke("experiment", "table", drive, "-o", out, *arguments)
    assert result.exit_code == 0, result.output
    return result.stdout


def read_rows(folder: Path) -> dict[str, dict[str, str]]:
    with (folder / "results.csv").open() as file:
        return {row["method"]: row for row in csv.DictReader(file)}


def test_angles_of_the_table_are_those_of_a_mounting() -> None:
    for rpy_deg in ([3.0, -20.0, 170.0], [-40.0, 10.0, -95.0]):
        T = pose_from_mounting(rpy_deg, [0.3, -0.2, 0.1])
        assert mounting_rpy_deg(T) == pytest.approx(rpy_deg)


def test_every_method_on_a_real_frame(rellis3d: Path, tmp_path: Path) -> None:
    """From the reference itself: the frame does not determine the pose, and semcal says so."""
    printed = run_table(rellis3d, tmp_path, "--init", rellis3d)
    assert "| reference | 70.80, 67.78, -68.06 | -0.04, -0.17, -0.13 | 0.51, 0.29, 178.02 |  |" in printed
    assert (
        "| reference, published | 70.80, 67.78, -68.06 | -0.04, -0.17, -0.13 | 0.51, 0.29, 178.02 |"
        in printed
    )
    assert (
        "\nReference, published: that of RELLIS-3D as printed in arXiv 2104.12023, with two decimals.\n"
        in printed
    )
    assert (
        "| start | 70.80, 67.78, -68.06 | -0.04, -0.17, -0.13 | 0.51, 0.29, 178.02 | 0.000 deg, 0.0 cm |"
        in printed
    )
    assert "semcal's own verdict: not_trusted; " in printed
    rows = read_rows(tmp_path / "table_rellis3d_000104")
    assert set(rows) == {"reference", "reference, published", "start", *METHODS}
    for method in ("SOIC", "semcal"):
        assert float(rows[method]["rotation_error_deg"]) < 5.0
    measure = {m: float(row["mutual_information_nats"]) for m, row in rows.items()}
    assert measure["semcal"] > max(measure.values()) - FLAT_NATS
    distance = {m: float(row["distance_px"]) for m, row in rows.items()}
    assert distance["SOIC"] <= min(distance.values()) + FLAT_PX
    size = read_image(rellis3d / "frame000104-1581624663_149.jpg").shape
    for name in ("a_reference", "b_soic", "c_pmi", "d_semcal"):
        image = read_image(tmp_path / f"table_rellis3d_000104/{name}.png")
        assert image.shape[0] > size[0]
        assert image.shape[1] == size[1]
    assert (tmp_path / "table_rellis3d_000104/table.md").read_text() == printed
    summary = json.loads((tmp_path / "table_rellis3d_000104/summary.json").read_text())
    assert summary["experiment"] == "table"
    assert summary["published"][0]["rotation_vector_deg"] == [70.80, 67.78, -68.06]


@pytest.mark.parametrize(
    ("has_intensity", "methods"),
    [
        (True, ("semcal", "SOIC", "PMI")),
        (False, ("semcal", "SOIC", *(name for name, method in METHODS.items() if not method.is_by_labels))),
    ],
)
def test_methods_need_what_they_see(
    street: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    has_intensity: bool,
    methods: tuple[str, ...],
) -> None:
    """Points that are accumulated over sweeps have lost their intensity; all else is compared by labels."""
    monkeypatch.setattr(table, "ORDER", methods)
    drive = read_drive(street)
    with edited(street, tmp_path) as document:
        for number, frame in enumerate(document["frames"]):
            cloud = np.fromfile(drive.resolve(frame["points"]), np.float32).reshape(-1, 4)
            np.save(tmp_path / f"{number}.npy", cloud[:, : 4 if has_intensity else 3])
            others = {key: str(drive.resolve(name)) for key, name in frame.items() if isinstance(name, str)}
            frame.update({**others, "points": f"{number}.npy"})
    printed = run_table(tmp_path, tmp_path / "out")
    folder = tmp_path / f"out/table_{tmp_path.name}"
    rows = read_rows(folder)
    assert float(rows["semcal"]["rotation_error_deg"]) < 0.2
    assert float(rows["SOIC"]["rotation_error_deg"]) < 0.5
    for method in methods[2:]:
        assert (method in rows) == has_intensity
        assert (f"| {method} | failed: " in printed) != has_intensity
    assert (folder / "c_pmi.png").exists() == has_intensity


def test_settings_are_those_of_the_paper() -> None:
    assert {1, 10, 20, 50, 70} <= {setting.num_pairs for setting in EXPERIMENTS["pairs"]}
    assert [setting.wrong for setting in EXPERIMENTS["noise"]] == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]


def test_a_drive_by_every_method(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Wrong labels harm what looks at labels, of which two run; what does not has one run for both settings."""
    monkeypatch.setattr(pairs_and_noise, "SLOW_SETTINGS", ("right",))
    harmed = {"semcal", "SOIC"}
    settings = ComparisonSetting("right", 3), ComparisonSetting("wrong", 3, 0.5)
    changes = {key: value for key, value in vars(FINE_STREET).items() if key != "seed"}
    pool = Pool(tmp_path / "drives", has_images=True)
    runs = cases(settings, range(15, 16))
    labelled = {name for name, method in METHODS.items() if method.is_by_labels}
    in_wrong = {name for name in labelled if not METHODS[name].is_slow}
    assert {(case.setting, case.method) for case in runs} == {
        *(("right", name) for name in METHODS),
        *(("wrong", name) for name in in_wrong),
    }
    runs = [case for case in runs if case.setting == "right" or case.method in harmed]
    results = complete(
        settings, [result for case in runs for result in run(settings, pool, changes, True, case)]
    )
    by = {(f.setting, f.method): f for f in results}
    assert {name for setting, name in by if setting == "right"} == {*METHODS}
    assert {name for setting, name in by if setting == "wrong"} == harmed | ({*METHODS} - labelled)
    for method in ("semcal", "SOIC", "paper", "paper, own start", "semcal, MINE and polish"):
        assert by["right", method].rotation_deg < 0.5
    for method in harmed:
        assert by["wrong", method].rotation_deg > by["right", method].rotation_deg
    assert by["wrong", "PMI"].rotation_deg == by["right", "PMI"].rotation_deg
    reported = report("noise", True, results)
    assert reported.table.count("\n") == 2 + len(results)
    assert len(plot_png(reported.draw)) > 1000
    assert reported.facts["start"]["rotation_deg"] == 2.0


def test_drives_take_turns_and_slow_methods_run_on_some() -> None:
    settings = (ComparisonSetting("10", 10), ComparisonSetting("20", 20))
    runs = cases(settings, range(10, 20))
    assert len(set(runs)) == len(runs)
    assert {case.seed for case in runs[: len(runs) // 3]} == {10, 11, 12, 13}
    slow = [case for case in runs if METHODS[case.method].is_slow]
    assert {(case.setting, case.seed) for case in slow} == {("10", 10), ("10", 15)}


def test_what_came_back_counts() -> None:
    findings = [
        *(MethodError("10", "semcal", seed, 0.01 * seed, 0.1, 1.0) for seed in range(1, 4)),
        MethodError("10", "SOIC", 1, 2.5, 1.0, 1.0),
        MethodError("10", "SOIC", 2, 0.1, 25.0, 1.0),
        MethodError("10", "SOIC", 3, math.inf, math.inf, 1.0, "no overlap"),
        MethodError("10", "SOIC", 4, 0.1, 1.0, 1.0),
    ]
    semcal, soic = report("pairs", True, findings[::-1]).rows
    assert (semcal["method"], soic["method"]) == ("semcal", "SOIC")
    assert semcal["rotation_deg"] == pytest.approx((0.02, 0.03, 0.03))
    assert (semcal["num_back"], soic["num_back"]) == (3, 1)
    assert soic["camera_center_cm"] == (13.0, math.inf, math.inf)


def test_a_start_at_which_nothing_is_seen_fails_each_by_itself(street: Path, tmp_path: Path) -> None:
    """Straight up, where nothing returns: no method has an answer, and the table says so of each."""
    up = tmp_path / "up.yaml"
    write_transform(pose_from_mounting([0.0, -90.0, 0.0], [0.0, 0.0, 0.0]), up, "semcal")
    result = invoke("experiment", "table", street, "--init", up, "-o", tmp_path)
    for name in METHODS:
        assert (f"| {name} | failed: " in result.stdout) == (name != "paper, own start"), result.output
    assert "semcal's own verdict: failed." in result.stdout


def test_a_frame_that_is_not_there_is_seen_at_once(street: Path, tmp_path: Path) -> None:
    result = invoke("experiment", "table", street, "--frame", "9", "-o", tmp_path)
    assert result.exit_code == 1
    assert "found 4 frames, expected one numbered 9" in str(result.exception)


def test_the_command_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(EXPERIMENTS, "pairs", (ComparisonSetting("1", 1),))
    monkeypatch.setattr(pairs_and_noise, "METHODS", {name: METHODS[name] for name in ("semcal", "SOIC")})
    arguments = ["experiment", "pairs", "--seeds", "1", "--first-seed", "16", "-o", tmp_path]
    tables = [invoke(*arguments) for _ in range(2)]
    assert tables[0].exit_code == 0, tables[0].output
    assert "| 1 | semcal | 1 | 0.0" in tables[0].stdout
    assert tables[1].stdout == tables[0].stdout  # with the same seconds: nothing was run again
    results = tmp_path / "pairs/results.jsonl"
    assert len(results.read_text().splitlines()) == len(cases(EXPERIMENTS["pairs"], range(16, 17)))
    assert not (tmp_path / "pairs/drives").exists()
    results.write_text("garbage\n")
    result = invoke(*arguments)
    assert result.exit_code == 1
    assert "results.jsonl: line 1: found 'garbage" in str(result.exception)


def test_a_part_of_the_runs_is_what_the_whole_goes_on_from() -> None:
    for name, settings in EXPERIMENTS.items():
        whole, part = (cases(settings, range(50, 52), choice) for choice in (Choice(), Choice({"20", "20%"})))
        assert set(part) < set(whole)
        assert part == [case for case in whole if case in part]
        assert {METHODS[case.method].is_by_labels for case in part if case.setting == "0%"} <= {False}
        found = [MethodError(case.setting, case.method, case.seed, 0.0, 0.0, 0.0) for case in part]
        assert {result.setting for result in complete(settings, found, Choice({"20", "20%"}))} <= {
            "20",
            "20%",
        }
        one = cases(settings, range(50, 52), Choice(methods=["SOIC"]))
        assert {case.method for case in one} == {"SOIC"}, name


def test_the_command_runs_a_part_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(EXPERIMENTS, "pairs", (ComparisonSetting("1", 1), ComparisonSetting("2", 2)))
    monkeypatch.setattr(pairs_and_noise, "METHODS", {name: METHODS[name] for name in ("semcal", "SOIC")})
    arguments = ["experiment", "pairs", "--seeds", "1", "--first-seed", "16", "-o", tmp_path]
    part = invoke(*arguments, "--pairs", "2", "--method", "semcal")
    assert part.exit_code == 0, part.output
    assert [line for line in part.stdout.splitlines()[2:] if not line.startswith("| 2 | semcal |")] == []
    whole = invoke(*arguments)
    assert "1 of 4 runs are already done" in whole.stderr
    assert part.stdout.splitlines()[2] in whole.stdout


@pytest.mark.parametrize(
    ("option", "value", "needed"),
    [
        ("--pairs", "3", "found '3', expected one of: 1; 2; 5; 10; 20; 50; 70."),
        ("--method", "soic", "found 'soic', expected one of: semcal; paper; paper, own start; SOIC; PMI;"),
    ],
)
def test_a_part_that_is_not_there_is_named(option: str, value: str, needed: str, tmp_path: Path) -> None:
    result = invoke("experiment", "pairs", option, value, "-o", tmp_path)
    assert result.exit_code == 2
    assert needed in " ".join(result.stderr.split())
    slow = ("--method", "PMI, MINE and polish", "--pairs", "1")
    none = invoke("experiment", "pairs", *slow, "-o", tmp_path)
    assert str(none.exception) == (
        "found no run of PMI, MINE and polish, which run only at 10 or 20% and on seeds that 5 divides"
    )


def test_a_table_overwrites_nothing_that_it_reads(street: Path, tmp_path: Path) -> None:
    folder = tmp_path / f"table_{street.name}"
    folder.mkdir()
    reference = folder / "summary.json"
    write_transform(read_transform(street), reference, "semcal")
    before = reference.read_bytes()
    for option in ("--reference", "--init"):
        result = invoke("experiment", "table", street, option, reference, "-o", tmp_path)
        assert result.exit_code == 1
        assert "found a file that this run reads or writes" in str(result.exception)
    assert reference.read_bytes() == before
