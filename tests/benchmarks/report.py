"""Times `semcal report` as a whole process, and prints the size of the page: a figure of docs/formats.md.

python tests/benchmarks/report.py --frames 20
"""

import argparse
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.experiments.page_tables import run_script
from semcal_cli.experiments.speed import SEMCAL
from semcal_cli.synthetic.synthesis import synthesize


def main() -> None:
    """Make a drive, calibrate it, and report it several times."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--width", type=int, default=1280)
    parser.add_argument("--height", type=int, default=720)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--runs", type=int, default=5)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        drive, result, page = (Path(folder) / name for name in ("drive", "c.yaml", "r.html"))
        size = options.width, options.height
        synthesize(
            SynthConfig(num_frames=options.frames, seed=options.seed, width=size[0], height=size[1]), drive
        )
        subprocess.run(
            [*SEMCAL, "calibrate", str(drive), "-o", str(result), "-q"],
            check=False,
            stdout=subprocess.DEVNULL,
        )
        seconds = []
        for _ in range(options.runs):
            start = time.perf_counter()
            subprocess.run([*SEMCAL, "report", str(drive), str(result), "-o", str(page), "-q"], check=True)
            seconds.append(time.perf_counter() - start)
        megabytes = page.stat().st_size / 1e6
    print("| frames | median time | range | page |\n|---|---|---|---|")
    span = f"{min(seconds):.1f} to {max(seconds):.1f} s"
    print(f"| {options.frames} | {statistics.median(seconds):.1f} s | {span} | {megabytes:.1f} MB |")


if __name__ == "__main__":
    run_script(main)
