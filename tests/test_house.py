"""The rules of the house hold, and each of them would notice a violation."""

from pathlib import Path

import house
import pytest

PLANTED: dict[house.Rule, dict[str, str]] = {
    house.file_names_in_two_rooms: {"drive/motion.py": "", "observations/motion.py": ""},
    house.types_in_two_modules: {
        "fleet/a.py": "class Pair: pass",
        "many/rig/b.py": "from typing import TypeAlias\nPair: TypeAlias = tuple[int, int]",
    },
    house.core_imports: {"checks/a.py": "from planted import _core"},
    house.array_aliases: {"checks/a.py": "import numpy.typing as npt\nMatrix = npt.NDArray[float]"},
    house.paths_in_the_pipeline: {
        "pipeline/a.py": "def verify(drive: Drive | Path | str) -> None: ...",
        "report/a.py": "def write(path: Path) -> None: ...",
    },
    house.problem_numbers: {"config/a.py": "class NewtonConfig:\n    max_baseline_m: float = 3.0"},
    house.printed_units: {"checks/a.py": "def is_far(away_cm: float) -> bool: ..."},
    house.cue_questions: {
        "observations/cues/a.py": "is_by_edges = 'edges' in cues",
        "cli/a.py": "CHOSEN = ('edges',)",
        "checks/a.py": "is_by_edges = 'edges' in data.cues",
    },
    house.crowded_rooms: {
        "synthetic/a.py": "",
        "checks/a.py": f"from planted.synthetic.a import {', '.join(f'name_{n}' for n in range(26))}",
    },
}
"""A violation of each rule: files of a package, by their paths in it."""


@pytest.mark.parametrize("rule", PLANTED, ids=lambda rule: rule.__name__)
def test_the_house_keeps_its_rules(rule: house.Rule) -> None:
    assert rule(house.PACKAGE) == []


@pytest.mark.parametrize(
    "question",
    [
        "data.cues == LABELS",
        "cues != config.LABELS",
        "{*data.cues} <= {'labels', 'segments'}",
        "data.of_cue('labels')",
        "observations.has_segments",
        "data.is_refined_by_edges",
    ],
)
def test_a_question_for_a_cue_by_its_name_is_noticed(question: str, tmp_path: Path) -> None:
    path = tmp_path / "planted/checks/a.py"
    path.parent.mkdir(parents=True)
    path.write_text(question)
    assert house.cue_questions(tmp_path / "planted") == [f"checks/a.py: {question}"]


@pytest.mark.parametrize("rule", PLANTED, ids=lambda rule: rule.__name__)
def test_a_rule_notices_a_violation(rule: house.Rule, tmp_path: Path) -> None:
    for name, text in PLANTED[rule].items():
        path = tmp_path / "planted" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    assert len(rule(tmp_path / "planted")) == 1
