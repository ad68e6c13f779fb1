"""Small batches for the tests: drives of one rig, and the command that calibrates them quickly."""

import json
import sys
from dataclasses import replace
from pathlib import Path

from click.testing import Result
from commands import invoke

from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.synthetic.synthesis import synthesize

TINY = SynthConfig(num_frames=1, channels=32, columns=400, width=320, height=180)
QUICK = ("--", "--no-polish", "--search-deg", "5", "--init")
NUM_DRIVES = 4


def make_drives(root: Path, count: int = NUM_DRIVES) -> Path:
    """Write drives of one rig."""
    for number in range(count):
        level = replace(TINY, camera_azimuth_deg=0.0, camera_pitch_deg=0.0, camera_roll_deg=0.0)
        synthesize(replace(level, seed=70 + number), root / f"{number:03d}")
    return root


def command(drives: Path, out: Path, *options: str) -> list[str]:
    """Calibrate quickly, from about where the camera of each is."""
    rest = [*QUICK, str(drives / "000")]
    return ["batch", f"{drives}/*", "-o", str(out), *options, *rest]


# In a process of its own, whose working folder is not the repository: there, Python finds the sources, not the package.
# A parent that ignores the signal would hand that on.
HEARD = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
SEMCAL = (sys.executable, "-c", f"{HEARD}from semcal_cli.cli import main; main()")


def run(arguments: list[str]) -> Result:
    return invoke(*arguments)


def summary(out: Path) -> list[dict]:
    return [json.loads(line) for line in (out / "summary.jsonl").read_text().splitlines()]
