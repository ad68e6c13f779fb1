"""Times `semcal report` as a whole process, and prints the size of the page: a figure of docs/formats.md.

python tests/benchmarks/report.py --frames 20
"""

from collections.abc import Iterator
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from benchmark import script, seconds_of, street, table


def main(*, frames: int = 20, width: int = 1280, seed: int = 5, runs: int = 5) -> Iterator[str]:
    """Make a drive, calibrate it, and report it several times."""
    with TemporaryDirectory() as folder:
        drive, result, page = (Path(folder) / name for name in ("drive", "c.yaml", "r.html"))
        street(drive, seed, frames, width)
        seconds_of("calibrate", drive, "-o", result)
        seconds = [seconds_of("report", drive, result, "-o", page) for _ in range(runs)]
        size = f"{page.stat().st_size / 1e6:.1f} MB"
    span = f"{min(seconds):.1f} to {max(seconds):.1f} s"
    yield from table(
        "frames | median time | range | page", [(frames, f"{median(seconds):.1f} s", span, size)]
    )


if __name__ == "__main__":
    script(main)
