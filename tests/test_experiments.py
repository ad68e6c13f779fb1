"""Experiments run each case once, keep its results, resume and sum up; each measures what it says on a small drive."""

import json
import math
import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import accuracy
import check_limits
import gradient
import jointly
import numpy as np
import pytest
import speed
import trust
from accuracy import Result
from benchmark import SEMCAL, run_process, script
from conftest import FINE_STREET, make_pose
from laboratory import spoiled
from laboratory.outcomes import AS_IT_IS, MOVED, TURNED, Case as TrustCase, Outcome, run_case
from laboratory.rates import Rate
from laboratory.rigs import RIGS, Case as RowCase, row_cases

from semcal_cli.cli.experiment import RunProgress
from semcal_cli.cli.terminal import make_console
from semcal_cli.config import EDGE_BAND_PX
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.experiments import drives, pairs_and_noise
from semcal_cli.experiments.drives import Pool
from semcal_cli.experiments.experiment_run import Experiment, Report, describe_case
from semcal_cli.files.output_files import lock_file
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.many.batch.pace import Pace
from semcal_cli.observations.reading import load_observations
from semcal_cli.synthetic.synthesis import synthesize

pytestmark = pytest.mark.slow

SMALL = {key: value for key, value in vars(FINE_STREET).items() if key not in ("seed", "num_frames")}


@dataclass(frozen=True)
class Case:
    seed: int


def result(seed: int) -> Result:
    return Result("row", seed, "exact", 0.01 * seed, float(seed), seed <= 18, "trusted", 0.1, 1.0, 2.0)


def run(case: Case) -> list[Result]:
    return [result(case.seed)]


def run_but_the_last(case: Case) -> list[Result]:
    return run(case) if case.seed < 21 else [Result("row", 21, "exact", status="failed: no overlap")]


def run_until_five(case: Case) -> list[Result]:
    if case.seed == 5:
        raise KeyboardInterrupt
    return run(case)


def run_until_killed(case: Case) -> list[Result]:
    if case.seed == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return run(case)


def run_slowly_at_first(case: Case) -> list[Result]:
    time.sleep(1.0 if case.seed == 0 else 0.0)
    return run(case)


class Recorder(Pace):
    """Writes down what it is told."""

    def __init__(self) -> None:
        super().__init__(0, 1)
        self.events: list[str] = []

    def resume(self, num_done: int, num_items: int) -> None:
        self.events.append(f"{num_done} of {num_items}")

    def begin(self, name: str) -> None:
        self.events.append(f"begin {name}")

    def end(self, name: str) -> None:
        self.events.append(f"end {name}")


def make(
    folder: Path, seeds: Sequence[int], run: Callable[[Case], list[Result]] = run
) -> Experiment[Case, Result]:
    return Experiment(
        "ours",
        folder,
        [Case(seed) for seed in seeds],
        run,
        Result,
        partial(Report.of, columns=accuracy.COLUMNS),
    )


def test_a_run_is_named_by_its_words(capsys: pytest.CaptureFixture[str]) -> None:
    assert describe_case(TrustCase("good", 20_000, 5, 0.1)) == "good, seed 20000, pairs 5, noise 0.1, draw 0"
    assert describe_case(pairs_and_noise.ComparisonCase("20", "soic", 7)) == "setting 20, soic, seed 7"
    progress = RunProgress(make_console(quiet=False), 2)
    progress.resume(3, 10)
    progress.begin("16 channels, seed 1")
    progress.begin("16 channels, seed 2")
    progress.end("16 channels, seed 1")
    lines = [line.plain for line in progress.lines()]
    assert lines == ["4 of 10 runs are done   about 1 s left", "      0:00  16 channels, seed 2"]
    assert capsys.readouterr().err.splitlines() == [
        "3 of 10 runs are already done",
        " 4/10  16 channels, seed 1  (after 0:00, about 1 s left)",
    ]


def test_a_stopped_run_resumes_where_it_was(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        make(tmp_path, range(8), run_until_five).run_cases(1, Recorder())
    with (tmp_path / "results.jsonl").open("a") as file:
        file.write('{"case": "half a li')
    recorder = Recorder()
    assert make(tmp_path, range(8)).run_cases(1, recorder) == [result(seed) for seed in range(8)]
    assert recorder.events[0] == "5 of 8"
    # The next run may begin before the end of the one before is told.
    assert sorted(recorder.events[1:]) == [
        f"{what} seed {seed}" for what in ("begin", "end") for seed in (5, 6, 7)
    ]
    assert all(json.loads(line) for line in (tmp_path / "results.jsonl").read_text().splitlines())


def test_results_of_another_version_are_measured_again(tmp_path: Path) -> None:
    make(tmp_path, [1]).run_cases(1, Recorder())
    file, recorder = tmp_path / "results.jsonl", Recorder()
    file.write_text(json.dumps(json.loads(file.read_text()) | {"version": "0.0"}) + "\n")
    make(tmp_path, [1]).run_cases(1, recorder)
    assert recorder.events == ["0 of 1", "begin seed 1", "end seed 1"]


def test_a_process_that_is_killed_is_named_with_its_case(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match=r"Case\(seed=2\): the process was killed by SIGKILL"):
        make(tmp_path, range(4), run_until_killed).run_cases(1, Recorder())
    assert make(tmp_path, range(4)).run_cases(1, Recorder()) == [result(seed) for seed in range(4)]


def test_several_jobs_write_what_one_writes(tmp_path: Path) -> None:
    folders = [tmp_path / f"{num_jobs}" for num_jobs in (1, 2)]
    for num_jobs, folder in enumerate(folders, start=1):
        make(folder, range(6), run_slowly_at_first).run_cases(num_jobs, Recorder())
    one, two = ((folder / "results.jsonl").read_bytes() for folder in folders)
    assert one == two


def test_a_folder_is_one_run_s_at_a_time(tmp_path: Path) -> None:
    with (
        lock_file(tmp_path / "results.jsonl", "run"),
        pytest.raises(InputError, match="found another run using this folder"),
    ):
        make(tmp_path, [0]).run_cases(1, Recorder())


def test_summary_and_files(tmp_path: Path) -> None:
    (tmp_path / "scratch").mkdir()
    experiment = replace(make(tmp_path, range(1, 22), run_but_the_last), scratch=tmp_path / "scratch")
    assert experiment.measure(1, Recorder()) == (tmp_path / "table.md").read_text()
    assert not (tmp_path / "scratch").exists()
    assert (tmp_path / "results.csv").read_text().count("\n") == 22
    document = json.loads((tmp_path / "summary.json").read_text())
    assert list(document) == ["experiment", "machine", "jobs", "rows"]
    assert (document["experiment"], document["jobs"]) == ("ours", 1)
    (summary,) = document["rows"]
    assert summary["rotation_deg"] == pytest.approx((0.11, 0.2, math.inf))
    assert [summary[key] for key in ("n", "num_right", "num_missed", "num_failed")] == [21, 18, 2, 1]
    assert "| row | exact | 21 | 0.1100, 0.2000, inf |" in (tmp_path / "table.md").read_text()


@pytest.mark.parametrize(
    ("arguments", "ending"),
    [
        (["--row", "nothing", "-o", "OUT"], 2),
        (["--seeds", "1", "-o", "OUT/file"], "OUT/file/accuracy: cannot"),
    ],
)
def test_a_wrong_row_or_folder_is_an_error(
    arguments: list[str], ending: int | str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    words = [word.replace("OUT", str(tmp_path)) for word in arguments]
    monkeypatch.setattr(sys, "argv", ["accuracy.py", *words])
    with pytest.raises(SystemExit) as ended:
        script(accuracy.main)
    assert str(ended.value.code).startswith(str(ending).replace("OUT", str(tmp_path)))


@pytest.mark.parametrize(
    ("main", "told"),
    [
        (accuracy.main, "accuracy: 32"),
        (check_limits.main, "limits: 19"),
        (gradient.main, "gradient: 2"),
        (jointly.main, "jointly: 17"),
        (trust.main, f"trust: {19 + len(spoiled.KINDS)}"),
    ],
)
def test_a_script_runs_all_cases_of_its_experiment(
    main: Callable[..., Iterable[str]], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        Experiment, "measure", lambda experiment, *_: f"{experiment.name}: {len(experiment.cases)}"
    )
    assert [*main(seeds=1, output=tmp_path)] == [told]


def test_every_row_on_every_seed_and_starts_on_more() -> None:
    cases = accuracy.cases(range(100, 104))
    assert len(cases) == len(set(cases))
    assert {case.row for case in cases} == set(accuracy.ROWS)
    assert sum(case.row == "start 20 degrees and 0.5 m off" for case in cases) == 10
    assert sum(case.row == "16 channels" for case in cases) == 4
    assert accuracy.cases(range(3), ["16 channels"]) == [RowCase("16 channels", seed) for seed in range(3)]


def test_a_start_is_as_far_off_as_it_says() -> None:
    truth = make_pose((0.4, -1.0, 0.2), (0.5, 0.1, -0.7))
    error = compare_poses(displace(truth, 20.0, 0.5, np.random.default_rng(0)), truth)
    assert error.rotation_deg == pytest.approx(20.0)
    assert error.camera_center_cm == pytest.approx(50.0)


def test_accuracy_of_a_small_drive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drives, "NUM_FRAMES", FINE_STREET.num_frames)
    monkeypatch.setitem(accuracy.RIGS, "default", {"width": FINE_STREET.width, "height": FINE_STREET.height})
    row = "20 % wrong labels on both sides"
    results = accuracy.run(Pool(tmp_path), ("exact", "mine"), EDGE_BAND_PX, RowCase(row, FINE_STREET.seed))
    assert [(r.row, r.estimator) for r in results] == [(row, "exact"), (row, "mine")]
    assert max(r.rotation_deg for r in results) < 0.2


def test_processes_are_timed_and_failures_are_errors(tmp_path: Path) -> None:
    ended = run_process([*SEMCAL, "--version"])
    seconds, peak_gib = ended.seconds, ended.peak_gib
    assert seconds > 0.0
    own_gib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    assert 0.005 < peak_gib < 1.0 + own_gib
    with pytest.raises(CalibrationError, match=r"exit code 1: .*no such file"):
        run_process([*SEMCAL, "calibrate", str(tmp_path / "nowhere")])


def test_the_ratio_is_that_of_the_medians() -> None:
    cases = speed.cases(3, with_torch=True)
    assert len(cases) == len(set(cases)) == 3 * (7 + 4)
    seconds = {"refine, exact": 2.0, "plain torch, exact": 30.0}
    timings = [
        speed.Timing(c.name, c.num_pairs, seconds.get(c.name, 1.0) + c.repeat, 0.5, 0.01, 0.1) for c in cases
    ]
    report = speed.report(timings)
    ratios = {(row["name"], row["num_pairs"]): row["against_plain_torch"] for row in report.rows}
    assert ratios["refine, exact", 20] == pytest.approx(31.0 / 3.0)
    assert ratios["calibrate, exact", 20] is None
    assert "| refine, exact | 20 | 3 | 3.00, 4.00 | 0.50 | 0.0100 deg, 0.10 cm | 10.3 |" in report.table


def outcome(kind: str, status: str, error: float, seed: int = 0) -> Outcome:
    """All axes alike: a standard error of 1 cm and 0.1 degrees, and twice that for half the interval."""
    scale = (1.0, 1.0, 1.0, 0.1, 0.1, 0.1)
    errors, sigmas, halves = (tuple(x * factor for factor in scale) for x in (error, 1.0, 2.0))
    return Outcome(kind, seed, "default", 10, 0.1, status, "", errors, sigmas, halves)


def test_rates_of_trust() -> None:
    outcomes = [
        *(outcome("good", "trusted", error) for error in (0.0, 1.0, -1.9, 2.1)),
        outcome("good", "not_trusted", 100.0),
        outcome("labels shuffled", "not_trusted", 100.0),
        outcome("labels shuffled", "trusted", 6.0),
        outcome("labels shuffled", "trusted", 3.9),
        Outcome("as it is", 0, "default", 20, 0.0, "fail", ""),
    ]
    rates = {rate.name: (rate.count, rate.n) for rate in trust.rates(outcomes)}
    assert rates["trusted: axes in the 95 % interval"] == (18, 24)
    assert rates["trusted, 10 pairs"] == (18, 24)
    assert rates["trusted, 5 pairs"] == (0, 0)
    assert rates["the same, trusted or not"] == (18, 30)
    assert rates["confident and wrong, of all"] == (1, 8)
    assert rates["confident and wrong, of those trusted"] == (1, 6)
    assert rates["good drives are trusted, 10 pairs or more"] == (4, 5)
    assert rates["not trusted or failed, labels shuffled"] == (1, 3)
    assert rates["verify fails, as it is"] == (1, 1)
    expected = 1.0 / np.sqrt((0.0 + 1.0 + 1.9**2 + 2.1**2) / 4.0)
    assert trust.sharpness(outcomes) == pytest.approx(expected)
    low, high = Rate("", 3, 10).interval  # Wilson's, as in Brown, Cai and DasGupta (2001)
    assert (low, high) == pytest.approx((0.1078, 0.6032), abs=1e-4)


def test_trust_of_a_drive_that_cannot_be_calibrated_and_of_a_good_one(tmp_path: Path) -> None:
    seed = 6 * 7 + list(RIGS).index("default")
    synthesize(replace(FINE_STREET, seed=seed), tmp_path / f"pool/default_{seed:06d}")
    pool = Pool(tmp_path / "pool")
    kinds = ("good", "labels shuffled", "one class everywhere", "sweeps behind the camera only", "verify")
    outcomes = {kind: run_case(pool, TrustCase(kind, seed, 2, 0.0)) for kind in kinds}
    verified = {outcome_of_kind.kind: outcome_of_kind.status for outcome_of_kind in outcomes["verify"]}
    assert list(verified) == [AS_IT_IS, TURNED, MOVED[seed % 3]]
    assert verified.pop(AS_IT_IS) in ("pass", "inconclusive")
    assert verified[TURNED] == "fail"
    assert verified[MOVED[seed % 3]] in ("fail", "inconclusive")  # two pairs of a small image
    assert outcomes["good"][0].status == "trusted"
    assert {outcomes[kind][0].status for kind in kinds[1:4]} <= {"not_trusted", "failed"}
    report = trust.report([outcome_of_kind for listed in outcomes.values() for outcome_of_kind in listed])
    assert "| confident and wrong, of all | 0 | 4 | 0.0% |" in report.table


def test_the_gradient_of_the_objective_is_that_of_differences(street: Path, street_truth: Pose) -> None:
    observations = load_observations(read_drive(street))
    start = displace(street_truth, 1.0, 0.1, np.random.default_rng(0))
    objective = gradient.Objective(observations, start, 8, 0)
    differences = [
        (objective.value(objective.pose(step)) - objective.value(objective.pose(-step))) / 2e-4
        for step in 1e-4 * np.eye(6)
    ]
    assert objective.gradient(start) == pytest.approx(differences, abs=2e-4)


def test_gradient_and_powell_on_the_same_information(tmp_path: Path) -> None:
    cases = gradient.cases(range(3, 4))
    results = [result for case in cases for result in gradient.run(Pool(tmp_path / "pool"), SMALL, case)]
    by = {result.optimizer: result for result in results}
    assert by["gradient"].rotation_deg < 0.3
    assert by["gradient"].num_evaluations < by["Powell"].num_evaluations
    assert Report.of(results, gradient.COLUMNS).table.count("\n") == 4


def test_intrinsics_and_a_clock_beside_the_truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small = {"width": 320, "height": 180, "channels": 32, "columns": 400}
    late = {**small, "motion": "mixed", "delay_ms": 20.0}
    rows = {
        "wrong": jointly.Row("small", small, intrinsics=("fx", "fy", "cx", "cy")),
        "late": jointly.Row("late", late, is_wrong=False, intrinsics=(), with_delay=True),
    }
    monkeypatch.setattr(drives, "NUM_FRAMES", 6)
    monkeypatch.setattr(jointly, "ROWS", rows)
    wrong, adjusted = (jointly.run(Pool(tmp_path / "pool"), case)[0] for case in row_cases(rows, range(5, 6)))
    # What was wrong by 3 % is not, where it is told at all; six small frames tell little.
    assert all(percent is None or abs(percent) < 1.5 for percent in (wrong.fx_percent, wrong.fy_percent))
    assert adjusted.is_kept
    assert adjusted.clock_ms is not None
    assert abs(adjusted.clock_ms) < 3.0
    table = Report.of([wrong, adjusted], jointly.COLUMNS).table
    assert [line.split(" | ")[0] for line in table.splitlines()[2:]] == ["| wrong", "| late"]
