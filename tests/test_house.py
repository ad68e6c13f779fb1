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
    house.filler_docstrings: {
        "checks/a.py": 'def describe() -> str:\n    """Say how far."""',
        "checks/b.py": 'def describe() -> str:\n    """Describe how far."""',
    },
    house.superlative_names: {"checks/a.py": "A, LEAST_POINTS = 1, 2\nAT_LEAST_A = 3"},
    house.printed_units: {"checks/a.py": "def is_far(away_cm: float) -> bool: ..."},
    house.cue_questions: {
        "observations/cues/a.py": "is_by_edges = 'edges' in cues",
        "cli/a.py": "CHOSEN = ('edges',)",
        "checks/a.py": "is_by_edges = 'edges' in data.cues",
    },
    house.long_files: {"checks/a.py": "A = 1\n" * 401},
    house.crowded_rooms: {
        "synthetic/a.py": "",
        "checks/a.py": f"from planted.synthetic.a import {', '.join(f'name_{n}' for n in range(26))}",
    },
}
"""A violation of each rule: files of a package, by their paths in it."""


@pytest.mark.parametrize("rule", PLANTED, ids=lambda rule: rule.__name__)
def test_the_house_keeps_its_rules(rule: house.Rule) -> None:
    assert rule(house.PACKAGE) == []


def test_rooms_with_more_public_names_have_as_many_as_stated() -> None:
    """A number that fell is to be lowered there, so that it cannot rise again."""
    counts = {room: len(names) for room, names in house.imported_names(house.PACKAGE).items()}
    assert {room: counts[room] for room in house.MORE_PUBLIC_NAMES} == house.MORE_PUBLIC_NAMES
    assert min(house.MORE_PUBLIC_NAMES.values()) > house.MAX_PUBLIC_NAMES


@pytest.mark.parametrize(
    ("path", "code", "violation"),
    [
        ("estimation/refine/a.py", "class A:\n    edge_band_px: int", "A.edge_band_px"),
        ("pipeline/a.py", "class A:\n    max_baseline_m: float = 8.0", "A.max_baseline_m"),
        ("checks/a.py", "def check(T, max_baseline_m=8.0): ...", "check(max_baseline_m)"),
        ("estimation/refine/a.py", "def polish(T, *, edge_band_px=1): ...", "polish(edge_band_px)"),
        ("pipeline/a.py", "class A:\n    max_baseline_m: float", ""),
        ("checks/a.py", "def check(max_baseline_m, *, edge_band_px, digits=3): ...", ""),
    ],
)
def test_a_number_of_the_problem_has_no_default(path: str, code: str, violation: str, tmp_path: Path) -> None:
    (tmp_path / "planted" / path).parent.mkdir(parents=True)
    (tmp_path / "planted" / path).write_text(code)
    assert house.problem_numbers(tmp_path / "planted") == [f"{path}: {violation}"] * bool(violation)


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
