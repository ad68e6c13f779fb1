"""Each room imports only what stands below it; torch, OpenCV and SciPy stay where they are needed."""

import ast
import re
import sys
from pathlib import Path

import pytest
from documentation import ROOT
from importlinter.cli import lint_imports

PACKAGE = ROOT / "semcal_cli"
WITH_TORCH = {
    f"estimation/refine/{name}"
    for name in ("level_points", "mine", "statistics_network", "objective", "torch_geometry")
}
WITH_OPENCV = {
    "observations/cues/intensity",
    "observations/cues/edges",
    "labelling/views",
    "importing/bags/image_messages",
    "importing/bags/video",
    "labelling/sides",
    "estimation/search/pnp",
    "estimation/search/visual_motion",
    "checks/scale",
    "experiments/soic",
    "estimation/uncertainty/covariance",
    "many/rig/image_matching",
    "report",
}
WITH_SCIPY = {"fleet/consensus"}
CONTRACTS = {
    "layers": 'containers = ["{package}"]\nlayers = ["upper", "lower"]',
    "acyclic_siblings": 'ancestors = ["{package}"]',
}
"""Settings of a contract of each type, for a package with an upper and a lower room."""
PLANTED = {
    "layers": {"lower": "from {package} import upper"},
    "acyclic_siblings": {"upper": "from {package} import lower", "lower": "from {package} import upper"},
}
"""Imports that a contract of each type refuses, by the room that has them."""


def test_each_room_imports_only_what_stands_below_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The rooms stand in pyproject.toml; `lint-imports` says the same."""
    # The linter puts the working directory before the installed package, for all tests that follow.
    monkeypatch.setattr(sys, "path", [*sys.path])
    code = lint_imports(config_filename=str(ROOT / "pyproject.toml"), no_cache=True)
    assert code == 0, capsys.readouterr().out


def lint(package: str, imports: dict[str, str], contract: str, folder: Path) -> int:
    """Lint a package with two rooms by one contract, and return the exit status."""
    (folder / package).mkdir()
    for name in ("__init__", "upper", "lower"):
        (folder / package / f"{name}.py").write_text(imports.get(name, "").format(package=package))
    config = folder / "contracts.toml"
    config.write_text(
        f'[tool.importlinter]\nroot_package = "{package}"\n[[tool.importlinter.contracts]]\n'
        f'name = "planted"\ntype = "{contract}"\n{CONTRACTS[contract].format(package=package)}\n'
    )
    return lint_imports(config_filename=str(config), no_cache=True)


def test_a_violation_of_each_type_of_contract_is_planted() -> None:
    types = re.findall(r'^type = "(\w+)"$', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    assert set(types) == PLANTED.keys() == CONTRACTS.keys()


@pytest.mark.parametrize("contract", PLANTED)
def test_a_contract_refuses_what_is_planted(
    contract: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Packages without these imports keep the contract, so that the imports are what is refused."""
    monkeypatch.syspath_prepend(tmp_path)
    assert lint(f"kept_{contract}", {}, contract, tmp_path) == 0, capsys.readouterr().out
    capsys.readouterr()
    assert lint(f"broken_{contract}", PLANTED[contract], contract, tmp_path) == 1
    assert "planted BROKEN" in capsys.readouterr().out


def libraries(path: Path) -> set[str]:
    """Names of the libraries that a file imports as it is imported itself."""
    found: set[str] = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.split(".")[0])
    return found


@pytest.mark.parametrize(
    ("library", "places"), [("torch", WITH_TORCH), ("cv2", WITH_OPENCV), ("scipy", WITH_SCIPY)]
)
def test_slow_libraries_are_imported_where_they_are_needed(library: str, places: set[str]) -> None:
    """A place is a file, or a folder all of whose files may import the library."""
    names = {path.relative_to(PACKAGE).with_suffix("").as_posix(): path for path in PACKAGE.rglob("*.py")}
    users = {name for name, path in names.items() if library in libraries(path)}
    assert {name if name in places else name.split("/")[0] for name in users} == places
