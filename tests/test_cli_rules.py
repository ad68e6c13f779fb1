"""Options that do not go together, of every command: each is refused before anything is read, in one line."""

from collections.abc import Iterator

import click
import pytest
from conftest import Cli

from semcal_cli.cli import semcal
from semcal_cli.cli.settings_command import SettingsCommand

EXIT_USAGE = 2
START = "--init t"
PRIOR = "--prior-translation-m 0 0 0 1"
EXACT = "priors need the exact estimator"
JOINT = "it follows the polish, needs the exact estimator, and takes no priors"
OF_MI = "requires --method mi"
BATCH = "batch d -o r"
TRANSFORM = "requires --init or --init-rpy-xyz"
REFUSED = {
    # calibrate, initialize, refine
    "calibrate d --init-direction lidar-to-camera": "--init-direction requires --init.",
    f"calibrate d {START} --init-rpy-xyz 0 0 0 0 0 0": "--init cannot be used with --init-rpy-xyz.",
    "calibrate d --search-deg 10": f"--search-deg {TRANSFORM}.",
    f"calibrate d {START} --roll any": "--roll cannot be used with --init: --search-deg searches around a "
    "transform.",
    f"initialize d {START} --zoom paper": "--zoom requires --search-deg with --init: without it, there "
    "is no search around a transform.",
    "calibrate d --fix tx": f"--fix {TRANSFORM}: it keeps axes of the start transform.",
    f"refine d {START} --no-polish --fix tx": "--fix cannot be used with --no-polish: priors are applied after "
    "the polish.",
    f"calibrate d --cue features --estimator mine {PRIOR}": "--prior-translation-m cannot be used with --cue features: "
    f"{EXACT}.",
    f"refine d {START} --device cuda": "--device cuda requires --estimator mine.",
    "calibrate d --device cuda": "--device cuda requires --estimator mine or --method paper.",
    "calibrate d --cue features": "--cue features requires --estimator mine or --method paper: feature vectors have "
    "no histogram.",
    "calibrate d --cue segments --estimator mine": "--cue segments cannot be used with --estimator mine: "
    "segments differ from frame to frame.",
    "calibrate d --refine-intrinsics fx --no-polish": f"--refine-intrinsics cannot be used with --no-polish: {JOINT}.",
    "calibrate d --estimate-delay --no-polish": f"--estimate-delay cannot be used with --no-polish: {JOINT}.",
    "calibrate d --refine-intrinsics fx --cue features --estimator mine": "--refine-intrinsics cannot be used with "
    f"--cue features: {JOINT}.",
    "calibrate d --cross-validate 2 --no-polish": "--cross-validate cannot be used with --no-polish: parts of the "
    "drive are only polished.",
    f"refine d {START} --estimate-delay --fix tx": f"--estimate-delay cannot be used with --fix: {JOINT}.",
    f"calibrate d --refine-intrinsics fx {PRIOR}": "--refine-intrinsics cannot be used with --prior-translation-m: "
    f"{JOINT}.",
    "calibrate d --refine-intrinsics fx --intrinsics-sigma 0 10": "--intrinsics-sigma: found 0 10, "
    "needed at least 1e-09 for both with --refine-intrinsics.",
    f"calibrate d {PRIOR[:-1]}0 --prior-rotation-deg 0 0 0 0": "--prior-translation-m 0 0 0 0, "
    "--prior-rotation-deg 0 0 0 0: found all six axes known exactly, expected one that is not",
    # methods
    **{
        f"calibrate d --method paper {option}": f"{option.split()[0]} {OF_MI}."
        for option in (
            "--estimator mine",
            "--no-polish",
            "--repeat 2",
            "--cross-validate 2",
            "--refine-intrinsics fx",
            "--zoom exact",
        )
    },
    "calibrate d --method paper --cue intensity": f"--cue intensity {TRANSFORM} with --method paper: Alg. 2 needs "
    "labels.",
    f"calibrate {__file__} --method paper --cue labels,intensity --init-rpy-xyz 0 0 0 0 0 0": "--cue: found "
    "labels,intensity, expected one cue for --method paper.",
    "calibrate d --mine-steps 3": "--mine-steps requires --method paper.",
    "calibrate d --mine-units 8": "--mine-units requires --method paper.",
    # outputs
    "calibrate d --to-camera front": "--to-camera requires --to.",
    "calibrate d --json --to text": "--to requires -o with --json: both would write to standard output.",
    **{
        f"{command} --json {option} {name}": f"--json and {option} would both write to standard output; give {option} "
        "a file"
        for command, option, name in (
            ("calibrate d", "-o", "-"),
            ("calibrate d", "--log", "-"),
            ("initialize d", "-o", "/dev/stdout"),
            (f"refine d {START}", "--log", "/dev/stdout"),
            ("verify d c", "--junit", "/proc/self/fd/1"),
            ("fleet r", "-o", "-"),
            ("fleet r", "--plot", "/dev/stdout"),
        )
    },
    "convert a": "Give --to or --into.",
    # checks
    "verify d c --cue features": "--cue features cannot be used with verify: feature vectors have no histogram.",
    "view d --cue features": "--cue features cannot be used with view: feature vectors have no classes to show.",
    # labels
    "label d -o o": "Give --image-model, --point-model, --points, --show or --download.",
    "label d --image-card x -o o": "--image-card requires --image-model or --show.",
    "calibrate d --rectify": "--rectify requires --image-model.",
    "label d --points segments": "Give -o, --preview, --show or --to.",
    "label d --points segments --probabilities -o o": "--probabilities requires --image-model or --show: it is for "
    "images.",
    "label d --points segments --point-model x -o o": "--points cannot be used with --point-model.",
    "label d --image-model m --point-card x -o o": "--point-card requires --point-model or --show.",
    "label d --image-model m --preview x.jpg": "Invalid value for '--preview': found x.jpg, expected a .png.",
    "label d --image-model m --image-model ./m -o o": "Invalid value for '--image-model': found m twice, expected two "
    "networks.",
    "label --show m --points segments": "--show cannot be used with --points: it labels nothing.",
    "label --image-model m -o o": "Missing argument 'DRIVE'.",
    # recordings
    "import bag r": "Give -o or --list.",
    "import bag r -o d --camera-info /a --intrinsics b": "--intrinsics cannot be used with --camera-info.",
    "import bag r -o d --motion none --motion-frame c": "--motion-frame cannot be used with --motion none.",
    "import folder --points p --camera-info c -o d --image-classes n": "--image-classes requires --image-labels.",
    # many drives
    f"{BATCH} --command verify": "--command verify requires --calibration.",
    f"{BATCH} --calibration c": "--calibration requires --command verify.",
    f"{BATCH} --dask tcp://127.0.0.1:1 --jobs 2": "--dask cannot be used with --jobs: the workers' threads set "
    "the number of jobs.",
    f"{BATCH} -- --": "-- --: found a second --, expected options of the command",
    f"{BATCH} -- -o x": "-o cannot be used with many drives.",
    f"{BATCH} -- --overlay x": "--overlay cannot be used with many drives.",
    f"{BATCH} -- --threads 2": "--threads cannot be used with many drives.",
    f"{BATCH} -- --fix tx": f"--fix {TRANSFORM}: it keeps axes of the start transform.",
    f"{BATCH} -- --device cuda": "--device cuda requires --estimator mine or --method paper.",
    f"{BATCH} --command verify --calibration c -- --cue features": "--cue features cannot be used with verify: "
    "feature vectors have no histogram.",
    f"{BATCH} -- --seed -1": "Invalid value for '--seed': -1 is not in the range 0<=x<=9223372036854775807.",
    f"{BATCH} -- --intrinsics-sigma -2 10": "Invalid value for '--intrinsics-sigma': -2.0 is not in the range "
    "0.0<=x<=1000.0.",
    f"{BATCH} -- extra": "Got unexpected extra argument (extra)",
    f"{BATCH} -- -Z": "No such option '-Z'.",
    # values
    **{
        f"calibrate d --cue {value}": f"Invalid value for '--cue': found '{value}', {expected}."
        for value, expected in (
            ("colour", "expected one or more of labels, segments, edges, intensity, features, auto"),
            ("segments,segments", "expected each name once"),
            ("edges,auto", "expected auto alone"),
            ("labels,features", "expected features alone"),
        )
    },
    "synth d --delay-ms 5": "--delay-ms: found 5; add --motion steady or mixed, without which it has no effect",
    "synth d --readout-ms 30": "--readout-ms: found 30; add --motion steady or mixed, without which it has no "
    "effect",
    "synth d --motion mixed --readout-direction up": "--readout-direction: found up; add --readout-ms, without "
    "which it has no effect",
    "synth d --fov-up-deg -30": "--fov-down-deg: found -30.0, needed less than --fov-up-deg, -30.0",
}
"""Command lines, and what is said of them."""


@pytest.mark.parametrize("line", REFUSED)
def test_what_does_not_go_together_is_refused(line: str, cli: Cli) -> None:
    code, out, err = cli(*line.split())
    assert (code, out) == (EXIT_USAGE, "")
    assert err.splitlines()[0] == f"semcal: error: {REFUSED[line]}"


@pytest.mark.parametrize(
    "line",
    [
        "no-command",
        "calibrate",
        "refine d",
        "calibrate d --init-rpy-xyz 0 0 nan 0 0 0",
        "calibrate d --seed -1",
        "calibrate d --max-frames 0",
        "calibrate d --repeat 1",
        "calibrate d --cross-validate 1",
        "calibrate d --to nothing",
        "calibrate d --init t --fix tx,qx",
        "calibrate d --init-rpy-xyz 0 0 0 0 0 0 --fix tx,ty,tz,rx,ry,rz",
        "calibrate d --prior-rotation-deg 0 0 0 -1",
        "calibrate d --prior-translation-m 0 0 nan 1",
        "calibrate d --method paper --mine-pose-rate 0",
        "initialize d --roll some",
        "initialize d --roll nan",
        "initialize d --max-baseline-m 0",
        "initialize d --max-baseline-m inf",
        "refine d --init t --edge-band -1",
        "import bag r -o d --every 1e300",
        "import bag r -o d --max-gap-s 1e300",
        "synth d --frames 0",
        "synth d --lens telescope",
        "synth d --label-noise 1",
        "synth d --baseline-m 2",
        "synth d --motion slow",
        "synth d --motion mixed --delay-ms 201",
        *(f"verify d c --max-delay-ms {value}" for value in ("0", "-1", "nan", "inf", "x")),
        "experiment",
        "experiment pairs --seeds 0",
        *(f"calibrate d --intrinsics-sigma {pair}" for pair in ("nan 10", "2 inf", "-1 10", "2 x", "2")),
        *(f"calibrate d --refine-intrinsics {names}" for names in ("fx,fy,fx", ",", "fx,", "fx,,fy")),
    ],
)
def test_values_out_of_their_ranges_are_wrong_usage(line: str, cli: Cli) -> None:
    code, out, err = cli(*line.split())
    assert (code, out) == (EXIT_USAGE, "")
    assert err.startswith("semcal: error: ") or line == "experiment"


def commands_with_rules(group: click.Group = semcal) -> Iterator[SettingsCommand]:
    """Find the commands with rules, those of groups among them."""
    for command in group.commands.values():
        if isinstance(command, click.Group):
            yield from commands_with_rules(command)
        elif isinstance(command, SettingsCommand):
            yield command


@pytest.mark.parametrize("command", list(commands_with_rules()), ids=lambda command: str(command.name))
def test_rules_name_options_and_values_that_there_are(command: SettingsCommand) -> None:
    everywhere = {name: each for one in commands_with_rules() for each in one.params for name in each.opts}
    own = {name for each in command.params for name in each.opts}
    for rule in command.rules:
        terms = (*rule.subjects, *rule.required, *rule.excluded, *rule.where)
        assert {term.partition(" ")[0] for term in terms} <= everywhere.keys()
        assert own & {term.partition(" ")[0] for term in (*rule.subjects, *rule.required, *rule.excluded)}
        for name, _, value in (term.partition(" ") for term in terms):
            kind = everywhere[name].type
            assert not (value and isinstance(kind, click.Choice)) or value in kind.choices
