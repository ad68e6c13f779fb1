"""Time batches, as a Markdown table: two at a time, against bare runs, and the bookkeeping of very many drives.

    python tests/benchmarks/batch.py --drives 200 --bookkeeping 10000

The drives are of 5 pairs. Bare runs are the same commands one after another in one process, without any records. The
bookkeeping is that of drives whose results are there already: folders, records, resuming, and the summary.
"""

from __future__ import annotations

import resource
import subprocess
import sys
from collections.abc import Generator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import click

from semcal_cli.batch.folders import check_made_by_batch, make_folder_of_drive
from semcal_cli.batch.records import read_inputs, write_record
from semcal_cli.batch.run import run_batch
from semcal_cli.batch.tasks import Outcome, Task
from semcal_cli.experiments.page_tables import run_script
from semcal_cli.experiments.speed import SEMCAL

BARE = """
import sys
from semcal_cli.cli import run
codes = []
for number, drive in enumerate(sys.argv[2:]):
    codes.append(run(["calibrate", drive, "--threads", "1", "-q", "-o", f"{sys.argv[1]}/{number}.yaml"])[0])
sys.exit(max(codes, key=(0, 3, 1, 2).index))
"""


def seconds(arguments: Sequence[str]) -> float:
    """Time a process in which every drive ends with a result, trusted or not."""
    start = perf_counter()
    ended = subprocess.run(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False)
    if ended.returncode not in (0, 3):
        raise click.ClickException(f"exit code {ended.returncode}: {ended.stderr.decode()[-500:]}")
    return perf_counter() - start


def bookkeeping(folder: Path, count: int) -> tuple[float, float, float]:
    """Seconds to keep the outcomes of so many drives, and to find them all done; and the peak memory in MiB."""
    drive = folder / "drive"
    subprocess.run(
        [*SEMCAL, "synth", str(drive), "--frames", "1", "--width", "64", "--height", "48", "-q"], check=True
    )
    tasks = [
        Task(f"drives/{n:06d}", str(drive), str(folder / f"out/{n:06d}"), "calibrate") for n in range(count)
    ]
    rows = tuple(tuple(float(i == j) for j in range(4)) for i in range(4))
    covariance = tuple(tuple(0.1 * (i + j) for j in range(6)) for i in range(6))

    inputs = read_inputs(tasks[0])

    def stub(missing: Sequence[Task]) -> Generator[Outcome, None, None]:
        for task in missing:
            make_folder_of_drive(task, folder / "out")
            outcome = Outcome(
                drive=task.drive,
                status="trusted",
                exit_code=0,
                reasons=(),
                stamp=1.5,
                T_camera_lidar=rows,
                covariance=covariance,
                mutual_information_nats=2.0,
                camera="a",
                result=f"{Path(task.folder).name}/calibration.yaml",
            )
            task.result.write_text("recorded\n")
            write_record(task, outcome, inputs, timed_out=False)
            yield outcome

    times = []
    for _ in range(2):
        start = perf_counter()
        check_made_by_batch(tasks, folder / "out", folder / "out")
        run_batch(tasks, folder / "out", stub)
        times.append(perf_counter() - start)
    return times[0], times[1], resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


@click.command()
@click.option("--drives", "num_drives", default=200)
@click.option("--bookkeeping", "num_records", default=10_000)
@click.option("--frames", "num_frames", default=5, show_default=True, help="Pairs of each drive.")
@click.option("--width", default=640, show_default=True, help="Columns of the pictures.")
@click.option("--height", default=360, show_default=True, help="Rows of the pictures.")
def main(num_drives: int, num_records: int, num_frames: int, width: int, height: int) -> None:
    """Print the table."""
    print("| | measured |\n|---|---|")
    with TemporaryDirectory() as name:
        kept, resumed, memory_mib = bookkeeping(Path(name), num_records)
        print(
            f"| bookkeeping of {num_records:,} drives: first time, resumed | {kept:.1f} s, {resumed:.1f} s |"
        )
        print(f"| its peak memory | {memory_mib:.0f} MiB |", flush=True)
    with TemporaryDirectory() as name:
        folder = Path(name)
        small = ("--frames", f"{num_frames}", "--width", f"{width}", "--height", f"{height}", "-q")
        subprocess.run(
            [*SEMCAL, "synth", str(folder / "drives"), "--drives", str(num_drives), *small], check=True
        )
        drives = sorted(map(str, (folder / "drives").iterdir()))
        (folder / "bare").mkdir()
        bare = seconds([sys.executable, "-I", "-c", BARE, str(folder / "bare"), *drives])
        batch = [*SEMCAL, "batch", *drives]
        one = seconds([*batch, "-o", str(folder / "one"), "--jobs", "1", "--threads", "1"])
        two = seconds([*batch, "-o", str(folder / "two"), "--jobs", "2"])
        print(f"| {num_drives} drives, bare runs in one process, one thread | {bare:.1f} s |")
        print(f"| `--jobs 1 --threads 1` | {one:.1f} s, {one / bare - 1.0:+.1%} against bare runs |")
        print(f"| `--jobs 2` | {two:.1f} s, {one / two:.2f} times as fast |")


if __name__ == "__main__":
    run_script(main)
