"""No line of a command's output is wider than a terminal of 80 columns."""

import re
from pathlib import Path

import pytest
from commands import invoke
from dataset_trees import kitti_object
from documentation import README

from semcal_cli.cli.tables import COLUMNS

LINES = (
    "calibrate d --init d -o c.yaml",
    "calibrate d --init d -o j.yaml --refine-intrinsics fx,fy,cx,cy -v",
    "initialize d -o i.yaml",
    "refine d --init i.yaml -o f.yaml",
    "verify d c.yaml",
    "compare c.yaml d",
    "compare c.yaml j.yaml",
    "inspect d",
    "inspect d --frames",
    "import kitti-object tree -o k",
    "merge k -o m",
    "label d --points segments -o s",
    "label --list-models",
    "convert c.yaml --to opencalib -o T.txt",
    "base d --yaw-deg 0 -o base.yaml",
    "convert --formats",
    "export rerun d c.yaml -o c.rrd",
    "overlay d c.yaml -o o",
    "report d c.yaml -o r.html",
    "synth n --frames 1 --width 160 --height 90",
    "batch d -o b",
    "fleet b c.yaml -o fleet.yaml",
    "audit d -o audit.html",
    "demo demo",
)
"""Commands in the order in which they use one another's files."""
ELSEWHERE = {
    "view": "prints an address, and serves until it is stopped",
    "accumulate": "takes sweeps of one place; tests/test_accumulation.py measures its lines",
    "odometry": "takes many sweeps; its lines are those of `import`",
    "experiment": "takes minutes, and prints tables of Markdown",
    "completion": "prints a program",
    "doctor": "prints paths of this machine, and asks the network",
}
"""Commands of the table that are not run, and why."""


def test_every_command_of_the_readme_keeps_to_80_columns(
    street: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = README.read_text().partition("## Commands")[2].partition("\n## ")[0]
    named = set(re.findall(r"`semcal ([a-z]+)", table))
    assert named - ELSEWHERE.keys() == {line.split()[0] for line in LINES}
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("semcal_cli.cli.demo.NUM_FRAMES", 2)
    Path("d").symlink_to(street)  # no path makes a line long
    kitti_object(Path("tree"))
    wide = []
    for line in LINES:
        done = invoke(*line.split(), env={"COLUMNS": str(COLUMNS)})
        assert done.exit_code in (0, 3, 4), f"{line}: {done.output}"
        wide += [f"{line}: {each}" for each in done.output.splitlines() if len(each) > COLUMNS]
    assert wide == []
