"""Compare the speed of two installed versions of semcal, in turns, and print a Markdown table.

    python tests/benchmarks/speed_ratio.py --before OLD/bin/semcal --after NEW/bin/semcal --pool DIR

Whole processes are timed. The versions take turns, so that a machine whose speed varies slows both alike; the ratio is
the median of the ratios of neighbours. Drives are made once by the version before.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from statistics import median

import click

from semcal_cli.experiments.page_tables import run_script
from semcal_cli.experiments.speed import run_process

PATH = click.Path(path_type=Path)


@click.command()
@click.option("--before", type=PATH, required=True, help="Executable of the version before.")
@click.option("--after", type=PATH, required=True, help="Executable of the version after.")
@click.option("--pool", type=PATH, required=True, help="Folder for drives and results.")
@click.option(
    "--repeats", type=click.IntRange(1), default=10, show_default=True, help="Runs of each version."
)
@click.option("--pairs", type=click.IntRange(1), multiple=True, default=(1, 20), help="Pairs of the drives.")
@click.option("--width", type=click.IntRange(16), default=1280, help="Columns of the pictures.")
@click.option("--height", type=click.IntRange(16), default=720, help="Rows of the pictures.")
def main(
    before: Path, after: Path, pool: Path, repeats: int, pairs: tuple[int, ...], width: int, height: int
) -> None:
    """Time `semcal --help` and `semcal calibrate` with both versions."""
    pool.mkdir(parents=True, exist_ok=True)
    click.echo(f"{os.cpu_count()} cores, {repeats} runs of each version\n")
    click.echo("| process | before, s | after, s | after / before |\n|---|---|---|---|")
    executables = before.absolute(), after.absolute()
    _row("--help", repeats, executables, lambda executable: [str(executable), "--help"])
    for count in pairs:
        drive = pool / f"pairs_{count}_{width}x{height}"
        if not drive.exists():
            size = ["--width", str(width), "--height", str(height)]
            run_process([str(executables[0]), "synth", str(drive), "--frames", str(count), *size, "-q"])
        command = ["calibrate", str(drive), "-q", "-o", str(pool / "calibration.yaml")]
        name = f"calibrate, {count} pairs" if count > 1 else "calibrate, 1 pair"
        _row(name, repeats, executables, lambda executable, command=command: [str(executable), *command])


def _row(
    name: str, repeats: int, executables: tuple[Path, Path], command: Callable[[Path], list[str]]
) -> None:
    # Neighbours are compared, and the first of a pair changes, so that what drifts does no harm.
    times: list[tuple[float, float]] = []
    for index in range(repeats):
        order = (0, 1) if index % 2 == 0 else (1, 0)
        seconds = {which: run_process(command(executables[which]))[0] for which in order}
        times.append((seconds[0], seconds[1]))
    ratio = median(after / before for before, after in times)
    before_s, after_s = (median(pair[which] for pair in times) for which in (0, 1))
    click.echo(f"| {name} | {before_s:.2f} | {after_s:.2f} | {ratio:.3f} |")


if __name__ == "__main__":
    run_script(main)
