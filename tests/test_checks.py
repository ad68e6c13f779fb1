"""The table of checks: its limits, what is measured on both sides of them, and the page that is made of it."""

import ast
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest
from check_limits import (
    ANOTHER_DRIVE,
    BAD_OF,
    FEW,
    GOOD,
    KINDS,
    LABELLED_FROM_IMAGES,
    MOTIONS,
    WRONG_POSE,
    Case,
    Value,
    limits_text,
    markdown,
    rows,
    run,
)
from conftest import STREET
from documentation import ROOT
from laboratory.outcomes import OTHER_DRIVE
from laboratory.rigs import RIGS

from semcal_cli.checks import registry
from semcal_cli.checks.leaked_labels import LEAKED_LABELS
from semcal_cli.checks.other_pose import OTHER_POSE
from semcal_cli.checks.registry import CHECKS
from semcal_cli.experiments.drives import Pool
from semcal_cli.findings.check import LIMITS, LIMITS_FILE, Check, Evidence, findings_among, read_limits
from semcal_cli.synthetic.synthesis import synthesize

TOPICS = {
    name: check.topic
    for module in vars(registry).values()
    if isinstance(module, ModuleType)
    for name, check in vars(module).items()
    if isinstance(check, Check)
}
"""Topic of each check, by its name in the code."""
POSITIONS = {"limit": 0, "measured": 2}
"""Methods of a check that look a limit up, and the position of its name among their arguments."""
BY = ("labels", "segments")
"""Names of the limits that `compared_by` chooses."""
ALL = [(topic, name) for topic, check in CHECKS.items() for name in check.limits]


def value(kind: str, number: float, topic: str, limit: str = "", *, is_right: bool = True) -> Value:
    return Value(kind, "labels", 0, "default", 5, 0.0, is_right, topic, limit, number)


@pytest.mark.parametrize(("topic", "name"), ALL)
def test_every_limit_says_where_it_comes_from(topic: str, name: str) -> None:
    limit = CHECKS[topic].limits[name]
    assert (limit.at_most is None) != (limit.at_least is None)
    # A word or two, such as "a setting", would say nothing.
    assert len(limit.source.split()) > 3 or limit.measured


def test_every_limit_of_the_file_is_of_a_check() -> None:
    assert set(LIMITS) <= set(CHECKS)
    assert set(BAD_OF) <= set(LIMITS)
    assert set(BAD_OF.values()) <= {*KINDS, *MOTIONS, WRONG_POSE}


def lookups(code: str) -> Iterator[tuple[str, str]]:
    """List the topics and names of the limits that a module looks up: by `CHECK.limit` or `CHECK.measured`."""
    for node in ast.walk(ast.parse(code)):
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)):
            continue
        topic, position = TOPICS.get(ast.unparse(node.func.value)), POSITIONS.get(node.func.attr)
        if topic is None or position is None:
            continue
        named = [keyword.value for keyword in node.keywords if keyword.arg in ("limit", "name")]
        (name, *_) = (*named, *node.args[position : position + 1], ast.Constant(""))
        if isinstance(name, ast.Constant):
            yield topic, str(name.value)
        elif ast.unparse(name) in ("by", "compared_by(observations)"):
            yield from ((topic, chosen) for chosen in BY)


def test_every_limit_is_looked_up_by_the_code() -> None:
    """Whoever looks a limit up names its check; the name is a constant, or what `compared_by` returns."""
    paths = (ROOT / "semcal_cli").rglob("*.py")
    looked_up = {limit for path in paths for limit in lookups(path.read_text(encoding="utf-8"))}
    assert {(topic, name) for topic, name in ALL if topic in LIMITS} - looked_up == set()


@pytest.mark.parametrize(
    ("code", "limits"),
    [
        ("PRIOR.limit('one axis')", [("prior", "one axis")]),
        ("PRIOR.measured(2.0, 'found', limit='one axis')", [("prior", "one axis")]),
        ("PRIOR.measured(2.0, 'found', 'one axis')", [("prior", "one axis")]),
        ("OTHER_POSE.measured(2.0, 'found')", [("other-pose", "")]),
        ("WRONG_PAIRING.limit(by)", [("wrong-pairing", name) for name in BY]),
        ("WRONG_PAIRING.limit(other)", []),
        ("'one axis'", []),
        ("OTHER.limit('one axis')", []),
        ("PRIOR.finding('one axis')", []),
    ],
)
def test_a_limit_is_looked_up_by_a_call_of_its_check(code: str, limits: list[tuple[str, str]]) -> None:
    assert list(lookups(code)) == limits


def test_a_value_beyond_its_limit_makes_a_finding() -> None:
    most = LEAKED_LABELS.limit()
    assert LEAKED_LABELS.measured(most, "found").findings == ()
    assert LEAKED_LABELS.measured(most + 0.01, "found").findings == (LEAKED_LABELS.finding("found"),)
    assert LEAKED_LABELS.measured(most + 0.01).findings == ()
    assert OTHER_POSE.measured(3.0, "found").findings == ()
    behind = OTHER_POSE.measured(2.9, "found")
    assert findings_among([behind, behind]) == (OTHER_POSE.finding("found"),) * 2
    assert LEAKED_LABELS.without_value("found").findings[0].advice == LEAKED_LABELS.advice


def test_what_cannot_be_computed_keeps_no_limit() -> None:
    assert LEAKED_LABELS.measured(math.nan, "found").finding is not None
    assert OTHER_POSE.measured(math.nan, "found").finding is not None


def test_the_worst_value_of_a_calibration_counts() -> None:
    (row,) = rows([value(GOOD, 1.1, "one-class"), value(GOOD, 5.0, "one-class")])
    assert (row["num_good"], row["worst_good"], row["num_good_beyond"]) == (1, 1.1, 1)


def test_the_rule_lies_midway_between_good_and_bad() -> None:
    found = [value(GOOD, 0.2, "wrong-pairing", "labels"), value(FEW, 0.4, "wrong-pairing", "labels")]
    found += [value(ANOTHER_DRIVE, 0.8, "wrong-pairing", "labels", is_right=False)] * 3
    (row,) = rows(found)
    assert (row["num_good"], row["worst_good"], row["num_bad"], row["mildest_bad"]) == (2, 0.4, 1, 0.8)
    assert row["by_rule"] == pytest.approx(0.6)
    assert (
        "| wrong-pairing | labels | 2 | 40 % | 0 | 1, images of another drive | 80 % | 0 | 55 % | 60 % |"
        in (markdown([row]))
    )


def test_there_is_no_rule_where_good_and_bad_overlap_and_a_margin_without_bad_ones() -> None:
    (row,) = rows([value(GOOD, 0.9, "leaked-labels"), value(BAD_OF["leaked-labels"], 0.8, "leaked-labels")])
    assert (row["by_rule"], row["num_good_beyond"], row["num_bad_within"]) == (None, 1, 1)
    (row,) = rows([value(GOOD, 5.0, "other-pose")])
    assert (row["by_rule"], row["bad_kind"], row["mildest_bad"]) == (4.0, None, None)


def test_a_wrong_pose_of_a_good_drive_is_a_bad_one() -> None:
    (row,) = rows([value(GOOD, 5.0, "other-pose"), value(FEW, 1.0, "other-pose", is_right=False)])
    assert (row["worst_good"], row["mildest_bad"], row["by_rule"]) == (5.0, 1.0, 3.0)


def test_the_file_of_limits_is_written_as_it_is_read() -> None:
    assert limits_text([], "a command", range(1)) == LIMITS_FILE.read_text(encoding="utf-8")
    found = rows([value(GOOD, 0.9, "leaked-labels")])
    limit = read_limits(limits_text(found, "a command", range(7, 9)))["leaked-labels"][""]
    assert limit.value == LEAKED_LABELS.limit()
    assert limit.measured == Evidence(
        command="a command",
        first_seed=7,
        num_seeds=2,
        num_good=1,
        worst_good=0.9,
        num_good_beyond=1,
        by_rule=1.125,
    )


def test_what_checks_measure_on_a_good_drive_and_on_bad_ones(tmp_path: Path) -> None:
    seed = 6 * 7 + list(RIGS).index("default")
    for number in (seed, seed + OTHER_DRIVE):
        synthesize(replace(STREET, seed=number, num_frames=4), tmp_path / f"default_{number:06d}")
    pool = Pool(tmp_path, has_images=True)

    def measured(kind: str) -> dict[tuple[str, str], float]:
        found = run(pool, Case(kind, "labels", seed, 3, 0.0))
        return {(each.topic, each.limit): each.value for each in found}

    good, exchanged, leaked = (measured(kind) for kind in (GOOD, ANOTHER_DRIVE, LABELLED_FROM_IMAGES))
    assert good.keys() >= {("wrong-pairing", "labels"), ("other-mounting", ""), ("shifted-label-images", "")}
    for (topic, name), number in good.items():
        assert CHECKS[topic].limits[name].is_kept_by(number), topic
    assert exchanged[("wrong-pairing", "labels")] > good[("wrong-pairing", "labels")]
    assert leaked[("leaked-labels", "")] > LEAKED_LABELS.limit() > good[("leaked-labels", "")]
