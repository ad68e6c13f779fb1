"""Many drives: what fails never stops the others, nothing is done twice, and nothing is lost."""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from bag_imports import small
from batches import NUM_DRIVES, QUICK, SEMCAL, command, make_drives, run, summary
from click.testing import Result
from hostile_drives import HOSTILE as HOSTILE_DRIVES, break_drive

import semcal_cli as semcal
from semcal_cli.errors import InputError
from semcal_cli.files.output_files import lock_file
from semcal_cli.formats import read_transform, write_transform
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.many.batch.folders import MARKER
from semcal_cli.many.batch.records import worst_exit_code
from semcal_cli.many.batch.tasks import folder_of


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Small drives of one rig, which tests do not write to."""
    return make_drives(tmp_path_factory.mktemp("drives"))


@pytest.fixture(scope="module")
def whole(drives: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    """A batch that nothing happens to, and its results, which tests do not write to."""
    out = tmp_path_factory.mktemp("whole") / "out"
    return run(command(drives, out)), out


@pytest.fixture
def copies(drives: Path, tmp_path: Path) -> Path:
    shutil.copytree(drives, tmp_path / "drives")
    return tmp_path / "drives"


def test_drives_in_a_row_and_two_at_a_time(drives: Path, whole: tuple[Result, Path], tmp_path: Path) -> None:
    found, one = whole
    assert found.exit_code in (0, 3), found.output
    assert f"{NUM_DRIVES} of {NUM_DRIVES} drives: " in found.stderr
    assert f"summary          {one}/summary.csv," in found.stderr
    outcomes = summary(one)
    assert [outcome["drive"] for outcome in outcomes] == [str(drives / f"{n:03d}") for n in range(NUM_DRIVES)]
    for outcome in outcomes:
        T = read_transform(one / outcome["result"])
        assert outcome["T_camera_lidar"] == T.tolist()
        assert compare_poses(T, read_transform(Path(outcome["drive"]))).rotation_deg < 2.0
    assert found.exit_code == worst_exit_code(outcome["exit_code"] for outcome in outcomes)
    assert [worst_exit_code(codes) for codes in ([0, 4, 3, 1], [0, 4, 3], [0, 4], [])] == [1, 3, 4, 0]
    with (one / "summary.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["translation_x_m"]) for row in rows] == [o["T_camera_lidar"][0][3] for o in outcomes]
    alone = [
        "calibrate",
        str(drives / "001"),
        *QUICK[1:],
        str(drives / "000"),
        "-o",
        str(tmp_path / "c.yaml"),
    ]
    assert run(alone).exit_code in (0, 3)
    assert outcomes[1]["T_camera_lidar"] == read_transform(tmp_path / "c.yaml").tolist()
    run(command(drives, tmp_path / "two", "--jobs", "2"))
    for name in ("summary.csv", "summary.jsonl"):
        assert (one / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_only_what_changed_is_done_again(
    copies: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = command(copies, tmp_path / "out")
    run(arguments)
    results = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").rglob("calibration.yaml")}
    assert len(results) == NUM_DRIVES

    def redone() -> set[str]:
        ending = run(arguments)
        assert ending.exit_code in (0, 1, 3), ending.output
        changed = {path.parent.name for path, when in results.items() if path.stat().st_mtime_ns != when}
        results.update({path: path.stat().st_mtime_ns for path in results})
        return changed

    before = (tmp_path / "out/summary.jsonl").read_bytes()
    assert redone() == set()
    os.utime(copies / "001/drive.yaml")  # touched, but the same
    assert redone() == set()
    cloud = copies / "002/points/000000.bin"
    points = np.fromfile(cloud, np.float32)
    points[0] += 0.01
    points.tofile(cloud)
    assert redone() == {"002"}
    result = next(path for path in results if path.parent.name == "003")
    result.write_text(result.read_text() + "# edited\n")
    assert redone() == {"003"}
    (result.parent / "record.json").write_text('{"asked": ')  # half a record is none
    assert redone() == {"003"}
    team = tmp_path / "team.yaml"
    arguments += ["--config", str(team)]
    for seed in (1, 2):
        team.write_text(f"semcal_options: 1\ncalibrate: {{seed: {seed}}}\n")
        assert redone() == {path.parent.name for path in results}
    arguments[-1] = team.name
    monkeypatch.chdir(tmp_path)
    assert redone() == set()
    arguments.insert(1, "--force")
    assert redone() == {path.parent.name for path in results}
    assert (tmp_path / "out/summary.jsonl").read_bytes() != before


def test_each_hostile_drive_is_named(street: Path, drives: Path, tmp_path: Path) -> None:
    """Every drive that the tests of the command know to be wrong, beside some that are not."""
    for number, (edit, _) in enumerate(HOSTILE_DRIVES.values()):
        break_drive(Path(shutil.copytree(street, tmp_path / f"drives/wrong_{number:02d}")), edit)
    shutil.copytree(drives, tmp_path / "drives", dirs_exist_ok=True)
    assert run(command(tmp_path / "drives", tmp_path / "out", "--jobs", "2")).exit_code == 1
    outcomes = summary(tmp_path / "out")
    wrong = [outcome for outcome in outcomes if outcome["status"] == "failed"]
    assert [Path(outcome["drive"]).name for outcome in wrong] == [
        f"wrong_{number:02d}" for number in range(len(HOSTILE_DRIVES))
    ]
    for outcome, (_, message) in zip(wrong, HOSTILE_DRIVES.values(), strict=True):
        assert re.fullmatch(f"{re.escape(outcome['drive'])}/{message}", outcome["reasons"][0])
    assert len(outcomes) == NUM_DRIVES + len(HOSTILE_DRIVES)


def test_a_recording_is_not_imported_on_the_way(drives: Path, tmp_path: Path) -> None:
    """Its drive would lie among the results; the reason says how to make it elsewhere."""
    recording = small(tmp_path / "recorded", "mcap library")
    words = ["batch", str(recording.parent), "-o", str(tmp_path / "out"), *QUICK, str(drives / "000")]
    assert run(words).exit_code == 1
    (failed,) = summary(tmp_path / "out")
    assert failed["status"] == "failed"
    assert failed["reasons"] == [
        f"{recording.parent}: found a recording, expected a drive; first import it: "
        f"`semcal import bag {recording.parent} -o recorded_drive`"
    ]
    assert not [*tmp_path.rglob("recorded_drive")]


def test_a_folder_that_is_in_the_way_is_one_drive_s_failure(drives: Path, tmp_path: Path) -> None:
    one, other = (tmp_path / "out" / folder_of(str(drives / name)) for name in ("000", "001"))
    one.parent.mkdir(parents=True)
    one.write_text("a file")
    result = run(command(drives, tmp_path / "out"))
    assert result.exit_code == 1
    outcomes = summary(tmp_path / "out")
    assert outcomes[0]["reasons"][0].endswith("000: cannot be created: file exists")
    assert [outcome["status"] == "failed" for outcome in outcomes] == [True, *[False] * (NUM_DRIVES - 1)]
    assert (other / "calibration.yaml").exists()
    one.unlink()
    (one / "log.txt").mkdir(parents=True)
    result = run(command(drives, tmp_path / "out"))
    assert summary(tmp_path / "out")[0]["reasons"][0].endswith(
        "log.txt: found a folder, expected a file or nothing"
    )
    assert f"{NUM_DRIVES} of {NUM_DRIVES} drives: 1 failed" in result.stderr
    assert "Traceback" not in result.stderr


def test_results_of_two_drives_do_not_go_to_one_folder(
    copies: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(copies / "000", tmp_path / "cwd" / str(copies)[1:] / "000")
    monkeypatch.chdir(tmp_path / "cwd")
    result = run(["batch", str(copies / "000"), f"{str(copies)[1:]}/000", "-o", str(tmp_path / "out")])
    assert "found two drives whose results would go to the same folder" in str(result.exception)


def test_more_time_is_a_reason_to_try_again(copies: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    one = [*command(copies, out)[:1], str(copies / "000"), *command(copies, out)[2:]]
    hurried = [*one[:2], "--timeout", "0.01", *one[2:]]
    assert run(hurried).exit_code == 1
    assert run(hurried).exit_code == 1
    assert summary(out)[0]["reasons"] == ["timed out after 0.01 s"]
    assert run(one).exit_code in (0, 3)
    assert run(hurried).exit_code in (0, 3)  # done is done


def test_killed_at_any_moment_it_goes_on(drives: Path, whole: tuple[Result, Path], tmp_path: Path) -> None:
    """kill -9 at some moments: the summary at the end is that of a batch that nothing happened to."""
    rng = np.random.default_rng(5)
    num_kills = 0
    # A busy machine starts slowly, so that a batch may be killed before it begins.
    while num_kills < 4 or (num_kills < 12 and not (tmp_path / "killed").exists()):
        process = subprocess.Popen(
            [*SEMCAL, *command(drives, tmp_path / "killed", "--jobs", "2")],
            cwd=tmp_path,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        time.sleep(rng.uniform(0.2, 3.0 + num_kills))
        process.send_signal(signal.SIGKILL)
        process.wait()
        num_kills += 1
    assert (tmp_path / "killed").exists()
    assert run(command(drives, tmp_path / "killed", "--jobs", "2")).exit_code in (0, 3)
    for name in ("summary.csv", "summary.jsonl"):
        assert (whole[1] / name).read_bytes() == (tmp_path / "killed" / name).read_bytes()
    assert not list((tmp_path / "killed").rglob("*.part"))


@pytest.mark.parametrize("waited_s", [0.0, 1.0])
def test_ctrl_c_ends_all_processes(waited_s: float, drives: Path, tmp_path: Path) -> None:
    """A terminal sends Ctrl-C to all processes of a command, also to those that are just beginning."""
    process = subprocess.Popen(
        [*SEMCAL, *command(drives, tmp_path / "out", "--jobs", "2"), "--search-deg", "90"],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while not list((tmp_path / "out").rglob(MARKER)):  # A drive begins, and starts the first process.
        time.sleep(0.01)
    time.sleep(waited_s)
    os.killpg(process.pid, signal.SIGINT)
    _, told = process.communicate(timeout=10)
    assert process.returncode == 130
    assert "Traceback" not in told
    assert told.endswith(" of 4 drives are done; run the same command again for the others\n")
    for _ in range(100):
        with suppress(ProcessLookupError):
            os.killpg(process.pid, 0)
            time.sleep(0.1)
            continue
        return
    pytest.fail("a process goes on")


def test_a_folder_is_one_batch_s_at_a_time(drives: Path, tmp_path: Path) -> None:
    with lock_file(tmp_path / ".lock", "batch"):
        result = run(command(drives, tmp_path))
    assert result.exit_code == 1
    assert "found another batch using this folder" in str(result.exception)


def test_verify_many(drives: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each against one transform, which is that of the first drive only."""
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "summary.md"))
    good = tmp_path / "good.yaml"
    write_transform(read_transform(drives / "000"), good, "semcal")
    limits = ("--", "--max-rotation-deg", "20", "--max-translation-m", "5")
    result = run(["batch", f"{drives}/000", f"{drives}/001", "-o", str(tmp_path / "out"), "--command", "verify",
                 "--calibration", str(good), *limits])  # fmt: skip
    outcomes = summary(tmp_path / "out")
    assert [outcome["status"] for outcome in outcomes] == ["pass", "pass"], result.output
    document = json.loads((tmp_path / "out" / outcomes[0]["result"]).read_text())
    assert document["verdict"] == "pass"
    assert result.exit_code == 0
    assert result.stderr.count("::notice title=semcal batch verify::pass") == 1
    told = (tmp_path / "summary.md").read_text()
    assert f"| {drives}/001 | pass | pass |" in told
    assert told.count("###") == 1  # and none of each drive


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen]]]:
    """The address and the processes of two workers and a scheduler, on loopback; the second worker has a nanny."""
    pytest.importorskip("distributed")
    file = tmp_path / "scheduler.json"

    def start(program: str, *options: str) -> subprocess.Popen:
        return subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.{program}", "--no-dashboard", "--scheduler-file", str(file),
             *options], cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip

    scheduler = start("dask_scheduler", "--host", "127.0.0.1", "--port", "0")
    one = ("--nthreads", "1", "--local-directory", str(tmp_path / "workers"))
    workers = [start("dask_worker", *one, option) for option in ("--no-nanny", "--nanny")]
    try:
        for _ in range(600):
            if file.exists() and file.read_text():
                break
            time.sleep(0.1)
        yield json.loads(file.read_text())["address"], [*workers, scheduler]
    finally:
        for process in (*workers, scheduler):
            process.kill()  # the process of a nanny ends with it; asked to, they would wait for one another
            process.wait()


def test_a_cluster_gives_the_same_summary_though_a_worker_is_lost(
    drives: Path,
    whole: tuple[Result, Path],
    tmp_path: Path,
    cluster: tuple[str, list[subprocess.Popen]],
) -> None:
    address, workers = cluster
    process = subprocess.Popen(
        [*SEMCAL, *command(drives, tmp_path / "cluster", "--dask", address)],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    process.stderr.readline()  # one drive is done, others are under way
    workers[0].send_signal(signal.SIGKILL)
    _, rest = process.communicate(timeout=300)
    assert process.returncode in (0, 3), rest
    assert f"{NUM_DRIVES} of {NUM_DRIVES} drives" in rest
    for name in ("summary.csv", "summary.jsonl"):
        assert (whole[1] / name).read_bytes() == (tmp_path / "cluster" / name).read_bytes()
    from distributed import Client

    with Client(address) as client:
        found = dict(semcal.batch([drives / "000", Path("/nowhere")], client=client))
    assert isinstance(found[drives / "000"], semcal.Calibration)
    assert str(found[Path("/nowhere")]).startswith("/nowhere: no such file")


def test_a_cluster_whose_scheduler_is_lost_is_one_line(
    drives: Path, tmp_path: Path, cluster: tuple[str, list[subprocess.Popen]]
) -> None:
    address, (*_, scheduler) = cluster
    out = tmp_path / "out"
    words = [*SEMCAL, *command(drives, out, "--dask", address)]
    process = subprocess.Popen(words, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    process.stderr.readline()  # one drive is done, others are under way
    scheduler.kill()
    _, rest = process.communicate(timeout=120)
    assert process.returncode == 1
    said = "lost the scheduler; what is finished is kept, and the same command goes on"
    assert rest.splitlines()[-1] == f"semcal: error: --dask {address}: {said}"
    assert "Traceback" not in rest
    num_kept = len((out / "summary.jsonl").read_text().splitlines())
    assert 0 < num_kept < NUM_DRIVES
    again = run(command(drives, out))
    assert again.exit_code in (0, 3), again.output
    assert len((out / "summary.jsonl").read_text().splitlines()) == NUM_DRIVES


def test_a_scheduler_that_is_lost_while_a_result_is_fetched(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    from semcal_cli.many.batch.cluster import on_cluster

    def lose(_: object) -> None:
        raise OSError("timed out trying to connect")

    with distributed.Client(processes=False, n_workers=1, dashboard_address=None) as client:
        # What the work raises is its own.
        for _, get in on_cluster(client, os.remove, ["nowhere"]):
            with pytest.raises(FileNotFoundError, match="nowhere"):
                get()
        monkeypatch.setattr(distributed.Future, "result", lose)
        for _, get in on_cluster(client, str, [1]):
            with pytest.raises(InputError, match="lost the scheduler; what is finished is kept"):
                get()


@pytest.mark.parametrize(
    "address", ["tls://127.0.0.1:1", "127.0.0.1:1", "tcp://nowhere.invalid:1", "x://y", ""]
)
def test_an_address_without_a_scheduler_is_one_line(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from semcal_cli.many.batch import cluster

    monkeypatch.setattr(cluster, "CONNECT_S", 1)
    with pytest.raises(InputError, match=f"^--dask {address}: found no scheduler: "):
        cluster.connect(address)


def test_a_cluster_that_is_not_there(drives: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from semcal_cli.many.batch import cluster

    monkeypatch.setattr(cluster, "CONNECT_S", 1)
    result = run(["batch", str(drives / "000"), "-o", str(tmp_path / "out"), "--dask", "tcp://127.0.0.1:1"])
    assert result.exit_code == 1
    assert "--dask tcp://127.0.0.1:1: found no scheduler" in str(result.exception)
