"""Prints a Markdown table: what kinds of hostile files take when they are large, in processor time and memory.

    python tests/benchmarks/hostile.py [--only "scans of a JPEG"] [--share 0.01] [--before CHECKOUT]

The kinds are those of `tests/hostile_growth.py`; a share makes them smaller. No more than 60 s and 2 GiB are promised:
a command is stopped after 60 s, and may not have more than 8 GiB of addresses. `--before` also runs an earlier version,
with its core in the checkout.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmark import script, table
from hostile_commands import MAX_CPU_S, Answer, run_guarded
from hostile_growth import KINDS

from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.synthetic.synthesis import synthesize

SMALL = SynthConfig(num_frames=1, channels=32, columns=400, width=1280, height=720)
MAX_LINE = 80


def main(*, only: tuple[str, ...] = (), share: float = 1.0, before: str = "") -> Iterator[str]:
    """Print the table, of all kinds or some."""
    versions = [Path(before).absolute(), None] if before else [None]
    head = "s before | MB before | s | MB" if before else "s | MB"
    with TemporaryDirectory() as folder:
        synthesize(SMALL, Path(folder) / "drive")

        def rows() -> Iterator[tuple[str, ...]]:
            for name in only or KINDS:
                kind, size = KINDS[name], max(round(share * KINDS[name].large), KINDS[name].small)
                place = Path(folder) / "case"
                shutil.copytree(Path(folder) / "drive", place / "drive")
                kind.make(place, size)
                answers = [run_guarded(kind.command, place, source=source) for source in versions]
                shutil.rmtree(place)
                taken = [figure for answer in answers for figure in figures(answer)]
                yield name, f"{size:,}", *taken, answers[-1].line.replace("|", " ")[:MAX_LINE]

        yield from table(f"kind | size | {head} | last line", rows())


def figures(answer: Answer) -> tuple[str, str]:
    """Format processor time and memory."""
    is_stopped = answer.exit_code >= 128  # by a signal
    return f"> {MAX_CPU_S}" if is_stopped else f"{answer.cpu_s:.1f}", f"{answer.max_bytes / 1e6:,.0f}"


if __name__ == "__main__":
    script(main)
