"""Batches that are run again: after the machine failed, after a person edited or removed files, after a kill."""

import hashlib
import json
import os
import resource
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from batches import SEMCAL, command, make_drives, run, summary

from semcal_cli.cli import Ending, run as run_command, worker
from semcal_cli.cli.worker import run_task
from semcal_cli.formats import read_transform
from semcal_cli.many.batch.records import Inputs, read_inputs, read_outcome, read_state, write_record
from semcal_cli.many.batch.tasks import Outcome, Task, failed_outcome, folder_of

pytestmark = pytest.mark.slow

NUM_DRIVES = 9
TIMEOUT_S = 10.0
ENDS = {"000": signal.SIGKILL, "003": signal.SIGTERM, "004": signal.SIGSEGV}


def unlucky(task: Task, inputs: Inputs) -> Outcome:
    """Run a task to whose command something happens; a limit of size refuses to write as a full disk does."""

    def command_of(arguments: list[str]) -> Ending:
        name = Path(arguments[1]).name
        limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        match name:
            case "000" | "003" | "004":
                os.kill(os.getpid(), ENDS[name])
            case "001":
                resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
            case "002":
                raise MemoryError("Unable to allocate 1 TiB")
            case "005":
                raise RuntimeError("out of luck")
            case "006":
                os._exit(7)
            case "007":
                time.sleep(1000.0)
        try:
            return run_command(arguments)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)

    worker.run = command_of
    return run_task(task, inputs)


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_drives(tmp_path_factory.mktemp("drives"), NUM_DRIVES)


@pytest.fixture(scope="module")
def finished(drives: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of the first drive, which tests do not write to."""
    out = tmp_path_factory.mktemp("finished") / "out"
    assert run(first(drives, out)).exit_code in (0, 3)
    return out


def first(drives: Path, out: Path) -> list[str]:
    """The command on the first drive only."""
    return [*command(drives, out)[:1], str(drives / "000"), *command(drives, out)[2:]]


def test_who_crashes_or_hangs_stops_no_other_and_what_the_machine_failed_at_is_done_again(
    drives: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = command(drives, tmp_path / "out", "--jobs", "2", "--timeout", f"{TIMEOUT_S}")
    with monkeypatch.context() as patch:
        patch.setattr(worker, "run_task", unlucky)
        result = run(arguments)
    assert result.exit_code == 1
    outcomes = summary(tmp_path / "out")
    assert [outcome["status"] == "failed" for outcome in outcomes] == [True] * 8 + [False]
    reasons = [outcome["reasons"][0] for outcome in outcomes[:8]]
    assert reasons[1].endswith("calibration.yaml: cannot be written: file too large")
    assert [reasons[0], *reasons[2:]] == [
        "the process was killed by SIGKILL, perhaps because memory ran out",
        "MemoryError: Unable to allocate 1 TiB",
        "the process was killed by SIGTERM",
        "the process was killed by SIGSEGV",
        "RuntimeError: out of luck",
        "the process exited with code 7",
        f"timed out after {TIMEOUT_S:g} s",
    ]
    for outcome in outcomes[:8]:
        assert Path(outcome["drive"]).name in result.stderr
    log = tmp_path / "out" / folder_of(outcomes[7]["drive"]) / "log.txt"
    assert f"timed out after {TIMEOUT_S:g} s" in log.read_text()
    assert run(arguments).exit_code == 1
    again = summary(tmp_path / "out")
    assert [outcome["status"] == "failed" for outcome in again] == [False] * 4 + [True] * 4 + [False]
    assert [outcome["reasons"][0] for outcome in again[4:8]] == reasons[4:]
    assert run([*arguments[:1], "--force", *arguments[1:]]).exit_code in (0, 3)


def sign(document: Any) -> str:
    """A record with the right hash, as only a person who wants to deceive writes it."""
    text = json.dumps({key: value for key, value in document.items() if key != "sha256"})
    return f'{text[:-1]}, "sha256": "{hashlib.sha256(text.encode()).hexdigest()}"}}\n'


RECORDS: dict[str, Callable[[dict[str, Any]], str]] = {
    "status": lambda record: sign(record | {"outcome": record["outcome"] | {"status": "splendid"}}),
    "no result": lambda record: sign(record | {"result": None}),
    "path": lambda record: sign(record | {"files": {"a\0b": None, **record["files"]}, "timed_out_s": "a"}),
    "signed depth": lambda record: sign(record | {"asked": 5}).replace("5", "[" * 900 + "]" * 900),
    "pose": lambda record: json.dumps(
        record | {"outcome": record["outcome"] | {"T_camera_lidar": [[1.0, 0.0, 0.0, 9.0], *IDENTITY[1:]]}}
    ),
}
IDENTITY = [[float(i == j) for j in range(4)] for i in range(4)]


@pytest.mark.parametrize("name", RECORDS)
def test_an_edited_record_is_none(name: str, drives: Path, finished: Path, tmp_path: Path) -> None:
    out = Path(shutil.copytree(finished, tmp_path / "out"))
    (record,) = out.rglob("record.json")
    record.write_text(RECORDS[name](json.loads(record.read_text())))
    result = run(first(drives, out))
    assert result.exit_code in (0, 3), result.output
    assert (out / "summary.jsonl").read_bytes() == (finished / "summary.jsonl").read_bytes()
    assert json.loads(record.read_text())["outcome"] == summary(finished)[0]


def test_an_edited_calibration_does_not_stay(drives: Path, finished: Path, tmp_path: Path) -> None:
    out = Path(shutil.copytree(finished, tmp_path / "out"))
    (outcome,) = summary(out)
    result = out / outcome["result"]
    result.write_text(result.read_text().replace("status: ", "status:  "))
    run(first(drives, out))
    assert result.read_bytes() == (finished / outcome["result"]).read_bytes()
    assert read_transform(result).tolist() == summary(out)[0]["T_camera_lidar"]


def test_results_that_vanish_are_failures(drives: Path, tmp_path: Path) -> None:
    """The results folder is moved away during the run."""
    out = tmp_path / "out"
    process = subprocess.Popen(
        [*SEMCAL, *command(drives, out)], cwd=tmp_path, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    process.stderr.readline()  # one drive is done
    out.rename(tmp_path / "gone")
    _, rest = process.communicate(timeout=300)
    assert process.returncode == 1, rest
    outcomes = summary(out)
    assert len(outcomes) == NUM_DRIVES
    assert outcomes[0]["reasons"] == [
        f"{out / folder_of(outcomes[0]['drive'])}/calibration.yaml: found no file when the run ended, expected the "
        "result"
    ]
    for outcome in outcomes:
        assert (outcome["status"] == "failed") == (outcome["result"] is None)
        assert outcome["result"] is None or (out / outcome["result"]).is_file()
    failures = sum(outcome["status"] == "failed" for outcome in outcomes)
    assert f"{NUM_DRIVES} of {NUM_DRIVES} drives: {failures} failed" in rest
    assert run(command(drives, out)).exit_code in (0, 3)


def killed_at_the_marker(out: Path) -> None:
    shutil.rmtree(out)
    place = out / "drive"
    place.mkdir(parents=True)
    (out / ".lock").write_text("A folder of semcal ba")
    (place / ".semcal_batch").touch()


def without_a_record(out: Path) -> None:
    for record in out.rglob("record.json"):
        record.rename(record.with_name(f".{'0' * 16}.tmp"))


@pytest.mark.parametrize("change", [killed_at_the_marker, without_a_record], ids=lambda f: f.__name__)
def test_a_batch_knows_its_own_folders(
    change: Callable[[Path], None], drives: Path, finished: Path, tmp_path: Path
) -> None:
    out = Path(shutil.copytree(finished, tmp_path / "out"))
    change(out)
    result = run(first(drives, out))
    assert result.exit_code in (0, 3), result.exception
    assert (out / "summary.jsonl").read_bytes() == (finished / "summary.jsonl").read_bytes()


@pytest.mark.parametrize("name", ["log.txt", "calibration.yaml"])
def test_links_in_finished_folders_are_not_followed(
    name: str, drives: Path, finished: Path, tmp_path: Path
) -> None:
    """What a person puts into the folders of a batch fails one drive, and hard links are cut."""
    out = Path(shutil.copytree(finished, tmp_path / "out"))
    place = out / folder_of(str(drives / "000"))
    precious = tmp_path / "precious"
    precious.write_text("a year of work\n")
    (place / name).unlink()
    (place / name).symlink_to(precious)
    result = run([*first(drives, out)[:1], "--force", *first(drives, out)[1:]])
    assert result.exit_code == 1
    assert summary(out)[0]["reasons"][0] == f"{place / name}: found a link, expected a file or nothing"
    assert precious.read_text() == "a year of work\n"
    (place / name).unlink()
    os.link(precious, place / name)
    run([*first(drives, out)[:1], "--force", *first(drives, out)[1:]])
    assert precious.read_text() == "a year of work\n"


def test_a_drive_of_terabytes_is_refused_at_once(drives: Path, tmp_path: Path) -> None:
    """Sizes are judged before any file is hashed; a drive that is refused for its size stays so until it changes."""
    drive, out = Path(shutil.copytree(drives / "000", tmp_path / "drive")), tmp_path / "out"
    (sweep,) = drive.glob("points/*")
    os.truncate(sweep, 1 << 40)
    arguments = ["batch", str(drive), "-o", str(out), "--timeout", "60"]
    assert run(arguments).exit_code == 1
    (reason,) = summary(out)[0]["reasons"]
    assert reason.startswith(f"{sweep}: found 1,099,511,627,776 bytes, needed at most")
    (record,) = out.rglob("record.json")
    before = record.stat().st_ino
    assert run(arguments).exit_code == 1
    assert record.stat().st_ino == before
    os.truncate(sweep, 1 << 39)
    assert run(arguments).exit_code == 1
    assert summary(out)[0]["reasons"][0].startswith(f"{sweep}: found 549,755,813,888 bytes")


def test_sizes_tell_of_a_change_before_hashes(drives: Path, tmp_path: Path) -> None:
    task = Task("a", str(drives / "000"), str(tmp_path / "a"), "calibrate")
    (tmp_path / "a").mkdir()
    inputs = read_inputs(task)
    assert len(inputs) > 2
    assert all(state is not None and state.sha256 for state in inputs.values())
    large = tmp_path / "large"
    large.write_bytes(b"1")
    write_record(task, failed_outcome("a", "why"), inputs | {str(large): read_state(large)}, timed_out=False)
    assert read_outcome(task) == failed_outcome("a", "why")
    os.utime(large, (1.0, 1.0))
    assert read_outcome(task) == failed_outcome("a", "why")  # The hash says that nothing changed.
    os.truncate(large, 1 << 40)
    assert read_outcome(task) is None
