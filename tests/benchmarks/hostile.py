"""Prints a Markdown table: what kinds of hostile files take when they are large, in processor time and memory.

    python tests/benchmarks/hostile.py [--only "scans of a JPEG"] [--share 0.01]

The kinds are those of `tests/hostile_growth.py`; a share makes them smaller. No more than 60 s and 2 GB are promised.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[1]))

from hostile_commands import run_guarded
from hostile_growth import KINDS

from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.synthetic.synthesis import synthesize

SMALL = SynthConfig(num_frames=1, channels=32, columns=400, width=1280, height=720)


def main() -> None:
    """Run the program."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=list(KINDS), action="append")
    parser.add_argument("--share", type=float, default=1.0)
    settings = parser.parse_args()
    print("| kind | size | s | MB | last line |\n|---|---|---|---|---|")
    with TemporaryDirectory() as folder:
        synthesize(SMALL, Path(folder) / "drive")
        for name in settings.only or KINDS:
            kind, size = KINDS[name], max(round(settings.share * KINDS[name].large), KINDS[name].small)
            place = Path(folder) / "case"
            shutil.copytree(Path(folder) / "drive", place / "drive")
            kind.make(place, size)
            answer = run_guarded(kind.command, place)
            line = answer.line.replace("|", " ")[:80]
            print(
                f"| {name} | {size:,} | {answer.cpu_s:.1f} | {answer.max_bytes / 1e6:,.0f} | {line} |",
                flush=True,
            )
            shutil.rmtree(place)


if __name__ == "__main__":
    main()
