"""Every reason that the code can give says what was found and what to do about it."""

import ast
from pathlib import Path
from types import ModuleType

import pytest

import semcal_cli
from semcal_cli.checks import registry
from semcal_cli.checks.registry import CHECKS
from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import PageSection

PACKAGE = Path(semcal_cli.__file__).parent
MAKERS = {"finding": 0, "without_value": 0, "measured": 1}
"""Methods of a check that make a finding, with the place of its sentence among their arguments."""
MODULES = [module for module in vars(registry).values() if isinstance(module, ModuleType)]
NAMES = {
    name: value for module in MODULES for name, value in vars(module).items() if isinstance(value, Check)
}
POSE_CHECKS = {
    topic: check for topic, check in CHECKS.items() if check.entry.section is not PageSection.INSPECTION
}
"""The checks of a verdict, by topic; the others are those of an inspection."""
ORDERS = {"add", "calibrate", "compare", "check", "give", "label", "measure", "record", "run", "start"}
"""Words that an advice begins with."""
FEWEST = 58
"""Number of places that make a finding; a walk that finds fewer has missed some."""


def sources(*words: str) -> dict[str, ast.Module]:
    """All modules whose text has one of these words, by name; to parse the others would take seconds."""
    texts = {
        path.relative_to(PACKAGE).with_suffix("").as_posix(): path.read_text()
        for path in sorted(PACKAGE.rglob("*.py"))
    }
    return {name: ast.parse(text) for name, text in texts.items() if any(word in text for word in words)}


def places() -> list[tuple[str, Check, ast.expr]]:
    """Place, check and sentence of each finding that any module makes."""
    found = []
    for name, tree in sources(*(f".{maker}(" for maker in MAKERS)).items():
        names = constants(tree)
        for node in ast.walk(tree):
            if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
                continue
            place = MAKERS.get(node.func.attr, len(node.args))
            if place >= len(node.args):
                continue
            check = NAMES.get(ast.unparse(node.func.value))
            if check is not None:
                found.append((f"{name}:{node.lineno}", check, resolved(node.args[place], names, tree, node)))
    return found


def constants(tree: ast.Module) -> dict[str, ast.expr]:
    """Values of the names that a module assigns at its top."""
    return {
        target.id: node.value
        for node in tree.body
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name)
    }


def resolved(value: ast.expr, names: dict[str, ast.expr], tree: ast.Module, call: ast.Call) -> ast.expr:
    """What a name stands for: the last assignment before the call, or the module's."""
    if not isinstance(value, ast.Name):
        return value
    before = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign)
        and node.lineno < call.lineno
        and [ast.unparse(target) for target in node.targets] == [value.id]
    ]
    return max(before, key=lambda node: node.lineno).value if before else names[value.id]


PLACES = places()


def test_all_places_are_walked() -> None:
    assert len(PLACES) >= FEWEST


def test_only_checks_make_findings() -> None:
    makers = {
        name
        for name, tree in sources("Finding").items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and "Finding" in map(ast.unparse, [node.func, *node.args])
    }
    assert makers == {"findings/check"}


def test_every_check_makes_a_finding() -> None:
    assert {check.topic for _, check, _ in PLACES} == set(CHECKS)


@pytest.mark.parametrize("check", CHECKS.values(), ids=CHECKS)
def test_every_check_has_an_advice(check: Check) -> None:
    assert check.topic not in POSE_CHECKS or check.advice.split()[0].rstrip(",") in ORDERS
    assert not check.advice.endswith(".")


@pytest.mark.parametrize(
    "what", [pytest.param(what, id=place) for place, check, what in PLACES if check.topic in POSE_CHECKS]
)
def test_what_was_found_says_no_nats_and_no_order(what: ast.expr) -> None:
    # Only the colon before the advice parts the two; figures of what was found are no information in nats.
    text = "".join(
        part.value
        for part in ast.walk(what)
        if isinstance(part, ast.Constant) and isinstance(part.value, str)
    )
    assert "nats" not in text
    assert "; add" not in text
