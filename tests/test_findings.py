"""Every reason that the code can give says what was found and what to do about it."""

import ast
from pathlib import Path

import pytest

import semcal_cli
from semcal_cli.result.stage import Finding

PACKAGE = Path(semcal_cli.__file__).parent
OF_EXPERIMENTS = {"experiments/rivals", "experiments/gradient"}
"""Modules with another `Finding`, a row of a table."""
ORDERS = {"add", "calibrate", "check", "give", "label", "measure", "record", "start"}
"""Words that an advice begins with."""
FEWEST = 28
"""Number of places that make a finding; a walk that finds fewer has missed some."""


def arguments() -> list[tuple[str, ast.expr, ast.expr, ast.expr]]:
    """Place, topic, and what was found and advised, of each finding that any module makes."""
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE).with_suffix("").as_posix()
        if name in OF_EXPERIMENTS:
            continue
        tree = ast.parse(path.read_text())
        names = constants(tree)
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "Finding":
                topic, what, advice = (resolved(each, names, tree, node) for each in node.args)
                found.append((f"{name}:{node.lineno}", topic, what, advice))
            # `map(Finding, ...)` and the like would hide what is made.
            is_handed_on = isinstance(node, ast.Call) and any(
                isinstance(each, ast.Name) and each.id == "Finding" for each in node.args
            )
            assert not is_handed_on, f"{name}:{node.lineno}"
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


PLACES = arguments()


def test_all_places_are_walked() -> None:
    assert len(PLACES) >= FEWEST


@pytest.mark.parametrize(
    ("what", "advice"), [each[2:] for each in PLACES], ids=[place for place, *_ in PLACES]
)
def test_every_reason_has_an_advice(what: ast.expr, advice: ast.expr) -> None:
    assert isinstance(advice, ast.Constant), ast.unparse(advice)
    sentence = advice.value
    assert isinstance(sentence, str)
    assert sentence.split()[0].rstrip(",") in ORDERS
    assert not sentence.endswith(".")
    # Only the colon before the advice parts the two; figures of what was found are no information in nats.
    text = "".join(
        part.value
        for part in ast.walk(what)
        if isinstance(part, ast.Constant) and isinstance(part.value, str)
    )
    assert "nats" not in text
    assert "; add" not in text


def test_what_was_found_stands_before_the_advice() -> None:
    assert Finding("sky", "the sky is 3 m high, needed 30 m", "add sky").sentence == (
        "the sky is 3 m high, needed 30 m: add sky"
    )
    with pytest.raises(TypeError):
        Finding("sky", "found only")  # type: ignore[call-arg]
