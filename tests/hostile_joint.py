"""Hostile options of what is estimated beside the pose."""

from collections.abc import Callable
from pathlib import Path

from hostile_commands import Hostile
from hostile_files import absent
from hostile_outputs import drive_with, every_failure_has_a_reason, nothing

CALIBRATE = ("calibrate", "drive", "-q", "-o", "out.yaml")
NAMES = ("--refine-intrinsics", "fx,fy")
NO_RESULT = absent("out.yaml", "x")
OF_LENS = "fx, fy, cx, cy, k1, k2, p1, p2, k3$"


def refused(line: str, *options: str, make: Callable[[Path], object] = nothing) -> Hostile:
    """Gives options to `calibrate`, which end in a line and write nothing."""
    return Hostile(make, (*CALIBRATE, *options), line, check=NO_RESULT)


def all_round(folder: Path) -> None:
    """Makes the drive's camera equirectangular."""
    drive_with("camera", "model", value="equirectangular")(folder)
    drive_with("camera", "distortion", value=[])(folder)


JOINT: dict[str, Hostile] = {
    "k1 of an image all round": refused(
        r"--refine-intrinsics: found 'k1', expected names of equirectangular: fx, fy, cx, cy$",
        *("--refine-intrinsics", "fx,k1"),
        make=all_round,
    ),
    "a speed alone for the clock": refused(
        r"motion: found no direction of motion, expected poses or a twist for --estimate-delay$",
        "--estimate-delay",
        make=drive_with("motion", value={"speed_m_s": 12.0}),
    ),
    "intrinsics of many drives": Hostile(
        nothing,
        ("batch", "drive", "other", "-o", "results", "--", "--refine-intrinsics", "k9"),
        r"^summary +results/summary.csv, results/summary.jsonl$",
        check=every_failure_has_a_reason,
    ),
    "no motion for the clock of a verification": Hostile(
        nothing,
        ("verify", "drive", "drive", "-q", "--max-delay-ms", "5"),
        r"drive\.yaml: motion: found no direction of motion, expected poses or a twist for --max-delay-ms$",
    ),
}
