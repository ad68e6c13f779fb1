"""Compare the speed of two installed versions of semcal, in turns, and print Markdown tables.

    python tests/benchmarks/speed_ratio.py --before OLD/bin/semcal --after NEW/bin/semcal --pool DIR

Whole processes are timed. The versions take turns, so that a machine whose speed varies slows both alike; the ratio is
the median of the ratios of neighbours. The second table tells where the time of a calibration goes, as `calibrate`
prints it. Drives are made once.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from statistics import median

from benchmark import Ended, run_process, script, street, table

STAGES = ("load", "initial", "refined", "deskewed", "polished", "assessed")
STAGE = re.compile(rf"^({'|'.join(STAGES)}) +([0-9.]+) s ", re.MULTILINE)
ON_DRIVES = ("calibrate", "calibrate --estimator mine", "verify", "report", "overlay", "inspect")
"""Processes on a drive; all but the first two, and the last one, take its calibration as well."""

CODES = 0, 3, 4
"""Exit codes of what is timed. `verify` is inconclusive on the drive that a transform was calibrated from."""


def main(
    *,
    before: Path,
    after: Path,
    pool: Path,
    repeats: int = 5,
    pairs: tuple[int, ...] = (1, 20, 70),
    process: tuple[str, ...] = ON_DRIVES,
    width: int = 1280,
    drive: tuple[Path, ...] = (),
) -> Iterator[str]:
    """Time processes of both executables on drives of so many pairs, or on given drives.

    On given drives, `--process "calibrate --cue edges --init FILE"` states what starts from where.
    """
    pool.mkdir(parents=True, exist_ok=True)
    executables = before.absolute(), after.absolute()
    yield f"{os.cpu_count()} cores, {repeats} runs of each version\n"
    stages: list[tuple[str, str, str]] = []
    drive_of = [(path.absolute(), path.name) for path in drive]

    def made() -> Iterator[tuple[Path, str]]:
        for count in pairs:
            path = pool / f"pairs_{count}_{width}"
            if not path.exists():
                street(path, 0, count, width)
            yield path, f"{count} pairs" if count > 1 else "1 pair"

    def rows() -> Iterator[tuple[str, ...]]:
        yield row("--help", in_turns(executables, repeats, ["--help"]))
        for path, of_drive in drive_of or made():
            result = path / "calibration.yaml" if not drive_of else pool / f"{path.name}.yaml"
            first = next(each for each in (*process, "calibrate") if each.startswith("calibrate"))
            run_process([str(executables[0]), *command(first, path, result, pool)[:-1], str(result), "-q"])
            for each in process:
                runs = in_turns(executables, repeats, command(each, path, result, pool))
                yield row(f"{each}, {of_drive}", runs)
                if each == first:
                    stages.extend(stage_rows(of_drive, runs))

    yield from table(
        "process | before, s | after, s | times as fast | peak memory, GiB: before, after", rows()
    )
    yield ""
    yield from table("where the time goes | before, s | after, s", stages)


def command(process: str, drive: Path, result: Path, pool: Path) -> list[str]:
    name, *options = process.split()
    output = {"report": ["-o", str(pool / "report.html")], "overlay": ["-o", str(pool / "overlays")]}
    if name == "calibrate":
        return [name, str(drive), *options, "-o", str(pool / "calibration.yaml")]
    results = [] if name == "inspect" else [str(result)]
    return [name, str(drive), *results, *output.get(name, [])]


def in_turns(executables: tuple[Path, Path], repeats: int, words: list[str]) -> list[tuple[Ended, Ended]]:
    """Run both versions beside each other; the first of a pair changes, so that what drifts does no harm."""
    pairs = []
    for index in range(repeats):
        runs = {
            which: run_process([str(executables[which]), *words], CODES)
            for which in ((0, 1) if index % 2 == 0 else (1, 0))
        }
        pairs.append((runs[0], runs[1]))
    return pairs


def row(name: str, runs: list[tuple[Ended, Ended]]) -> tuple[str, ...]:
    ratio = median(before.seconds / after.seconds for before, after in runs)
    before, after = zip(*runs, strict=True)
    before_s, after_s = (f"{median(run.seconds for run in each):.2f}" for each in (before, after))
    peaks = ", ".join(f"{max(run.peak_gib for run in each):.2f}" for each in (before, after))
    return name, before_s, after_s, f"{ratio:.2f}", peaks


def stage_rows(of_drive: str, runs: list[tuple[Ended, Ended]]) -> Iterator[tuple[str, str, str]]:
    """Return the median time of each stage, and what is left of the whole process: start, hashes and results."""

    def stages(run: Ended) -> dict[str, float]:
        found = {name: float(seconds) for name, seconds in STAGE.findall(run.messages)}
        return found | {"the rest": run.seconds - sum(found.values())}

    parts = [[stages(run) for run in each] for each in zip(*runs, strict=True)]
    for name in (*STAGES, "the rest"):
        before, after = (f"{median(each.get(name, 0.0) for each in of_version):.2f}" for of_version in parts)
        yield f"{of_drive}: {name}", before, after


if __name__ == "__main__":
    script(main)
