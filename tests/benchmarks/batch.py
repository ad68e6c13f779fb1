"""Time batches, as a Markdown table: two at a time, against bare runs, and the bookkeeping of very many drives.

    python tests/benchmarks/batch.py --drives 200 --bookkeeping 10000

The drives are of 5 pairs. Bare runs are the same commands one after another in one process, without any records. The
bookkeeping is that of drives whose results are there already: folders, records, resuming, and the summary.
"""

from __future__ import annotations

import resource
import subprocess
import sys
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

from benchmark import script, seconds_of, street, table

from semcal_cli.many.batch.folders import check_folders, make_folder_of_drive
from semcal_cli.many.batch.records import read_inputs, write_record
from semcal_cli.many.batch.run import run_batch
from semcal_cli.many.batch.tasks import Outcome, Task

BARE = """
import sys
from semcal_cli.cli import run
codes = []
for number, drive in enumerate(sys.argv[2:]):
    codes.append(run(["calibrate", drive, "--threads", "1", "-q", "-o", f"{sys.argv[1]}/{number}.yaml"])[0])
sys.exit(max(codes, key=(0, 3, 1, 2).index) in (1, 2))
"""


def bookkeeping(folder: Path, count: int) -> Iterator[float]:
    """Seconds to keep the outcomes of so many drives, and to find them all done."""
    street(folder / "drive", 0, 1, 64)
    tasks = [
        Task(f"drives/{n:06d}", str(folder / "drive"), str(folder / f"out/{n:06d}"), "calibrate")
        for n in range(count)
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

    for _ in range(2):
        start = perf_counter()
        check_folders(tasks, folder / "out", folder / "out")
        run_batch(tasks, folder / "out", stub)
        yield perf_counter() - start


def rows(num_drives: int, num_records: int, frames: int, width: int) -> Iterator[tuple[str, str]]:
    """Measure both."""
    with TemporaryDirectory() as name:
        kept, resumed = bookkeeping(Path(name), num_records)
        yield f"bookkeeping of {num_records:,} drives: first time, resumed", f"{kept:.1f} s, {resumed:.1f} s"
        memory_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        yield "its peak memory", f"{memory_mib:.0f} MiB"
    with TemporaryDirectory() as name:
        folder, size = Path(name), ("--width", width, "--height", width * 9 // 16)
        seconds_of("synth", folder / "drives", "--drives", num_drives, "--frames", frames, *size)
        drives = sorted(map(str, (folder / "drives").iterdir()))
        (folder / "bare").mkdir()
        start = perf_counter()
        subprocess.run([sys.executable, "-I", "-c", BARE, str(folder / "bare"), *drives], check=True)
        bare = perf_counter() - start
        one = seconds_of("batch", *drives, "-o", folder / "one", "--jobs", 1, "--threads", 1)
        two = seconds_of("batch", *drives, "-o", folder / "two", "--jobs", 2)
    yield f"{num_drives} drives, bare runs in one process, one thread", f"{bare:.1f} s"
    yield "`--jobs 1 --threads 1`", f"{one:.1f} s, {one / bare - 1.0:+.1%} against bare runs"
    yield "`--jobs 2`", f"{two:.1f} s, {one / two:.2f} times as fast"


def main(*, drives: int = 200, bookkeeping: int = 10_000, frames: int = 5, width: int = 640) -> Iterator[str]:
    yield from table(" | measured", rows(drives, bookkeeping, frames, width))


if __name__ == "__main__":
    script(main)
