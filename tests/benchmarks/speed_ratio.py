"""Compare the speed of two installed versions of semcal, in turns, and print Markdown tables.

    python tests/benchmarks/speed_ratio.py --before OLD/bin/semcal --after NEW/bin/semcal --pool DIR

Whole processes are timed. The versions take turns, so that a machine whose speed varies slows both alike; the ratio is
the median of the ratios of neighbours. The second table tells where the time of a calibration goes, as `calibrate`
prints it. Drives are made once by the version before.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median

import click

from semcal_cli.experiments.page_tables import run_script
from semcal_cli.experiments.speed import Run, run_process

PATH = click.Path(path_type=Path)
STAGES = ("load", "initial", "refined", "polished", "assessed")
STAGE = re.compile(rf"^({'|'.join(STAGES)}) +([0-9.]+) s ", re.MULTILINE)
ON_DRIVES = ("calibrate", "calibrate --estimator mine", "verify", "report", "overlay", "inspect")
"""Processes on a drive; all but the first two, and the last one, take its calibration as well."""


@click.command()
@click.option("--before", type=PATH, required=True, help="Executable of the version before.")
@click.option("--after", type=PATH, required=True, help="Executable of the version after.")
@click.option("--pool", type=PATH, required=True, help="Folder for drives and results.")
@click.option("--repeats", type=click.IntRange(1), default=5, show_default=True, help="Runs of each version.")
@click.option(
    "--pairs", type=click.IntRange(1), multiple=True, default=(1, 20, 70), help="Pairs of the drives."
)
@click.option(
    "--process",
    "processes",
    type=click.Choice(ON_DRIVES),
    multiple=True,
    default=ON_DRIVES,
    help="Processes to time on each drive.",
)
@click.option("--width", type=click.IntRange(16), default=1280, help="Columns of the pictures.")
@click.option("--height", type=click.IntRange(16), default=720, help="Rows of the pictures.")
def main(
    before: Path,
    after: Path,
    pool: Path,
    repeats: int,
    pairs: tuple[int, ...],
    processes: tuple[str, ...],
    width: int,
    height: int,
) -> None:
    """Time processes of both versions."""
    pool.mkdir(parents=True, exist_ok=True)
    executables = before.absolute(), after.absolute()
    click.echo(f"{os.cpu_count()} cores, {repeats} runs of each version\n")
    click.echo("| process | before, s | after, s | times as fast | peak memory, GiB: before, after |")
    click.echo("|---|---|---|---|---|")
    _row("--help", _in_turns(executables, repeats, lambda executable: [str(executable), "--help"]))
    stages: list[str] = []
    for count in pairs:
        drive = pool / f"pairs_{count}_{width}x{height}"
        if not drive.exists():
            size = ["--width", str(width), "--height", str(height)]
            run_process([str(executables[0]), "synth", str(drive), "--frames", str(count), *size, "-q"])
        result = drive / "calibration.yaml"
        run_process([str(executables[0]), "calibrate", str(drive), "-q", "-o", str(result)])
        of_drive = f"{count} pairs" if count > 1 else "1 pair"
        for process in processes:
            command = _command(process, drive, result, pool)
            runs = _in_turns(executables, repeats, lambda executable, rest=command: [str(executable), *rest])
            _row(f"{process}, {of_drive}", runs)
            if process == "calibrate":
                stages += _stage_rows(of_drive, runs)
    click.echo("\n| where the time goes | before, s | after, s |\n|---|---|---|")
    for row in stages:
        click.echo(row)


def _command(process: str, drive: Path, result: Path, pool: Path) -> list[str]:
    name, *options = process.split()
    output = {"report": ["-o", str(pool / "report.html")], "overlay": ["-o", str(pool / "overlays")]}
    if name == "calibrate":
        return [name, str(drive), *options, "-o", str(pool / "calibration.yaml")]
    results = [] if name == "inspect" else [str(result)]
    return [name, str(drive), *results, *output.get(name, [])]


def _in_turns(
    executables: tuple[Path, Path], repeats: int, command: Callable[[Path], list[str]]
) -> list[tuple[Run, Run]]:
    """Run both versions beside each other; the first of a pair changes, so that what drifts does no harm."""
    pairs = []
    for index in range(repeats):
        order = (0, 1) if index % 2 == 0 else (1, 0)
        runs = {which: run_process(command(executables[which])) for which in order}
        pairs.append((runs[0], runs[1]))
    return pairs


def _row(name: str, runs: list[tuple[Run, Run]]) -> None:
    ratio = median(before.seconds / after.seconds for before, after in runs)
    before_s, after_s = (median(pair[which].seconds for pair in runs) for which in (0, 1))
    before_gib, after_gib = (max(pair[which].peak_gib for pair in runs) for which in (0, 1))
    click.echo(
        f"| {name} | {before_s:.2f} | {after_s:.2f} | {ratio:.2f} | {before_gib:.2f}, {after_gib:.2f} |"
    )


def _stage_rows(of_drive: str, runs: list[tuple[Run, Run]]) -> Iterator[str]:
    """Give the median time of each stage, and what is left of the whole process: start, hashes and results."""
    parts = [[_stages(pair[which]) for pair in runs] for which in (0, 1)]
    for name in (*STAGES, "the rest"):
        before, after = (median(each[name] for each in of_version) for of_version in parts)
        yield f"| {of_drive}: {name} | {before:.2f} | {after:.2f} |"


def _stages(run: Run) -> dict[str, float]:
    stages = {name: float(seconds) for name, seconds in STAGE.findall(run.messages)}
    return stages | {"the rest": run.seconds - sum(stages.values())}


if __name__ == "__main__":
    run_script(main)
