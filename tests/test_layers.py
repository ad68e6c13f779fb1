"""A folder imports only what stands before it; torch, OpenCV and SciPy stay where they are needed."""

import ast
from pathlib import Path

import pytest

import semcal_cli

PACKAGE = Path(semcal_cli.__file__).parent
MAY_IMPORT = {
    "errors": "",
    "config": "",
    "_core": "",
    "geometry": "",
    "events": "geometry",
    "files": "geometry",
    "drive": "files events",
    "result": "drive",
    "initialization": "result",
    "refinement": "result",
    "formats": "result",
    "assessment": "initialization refinement formats",
    "pipeline": "assessment",
    "verification": "pipeline",
    "library": "verification",
    "baselines": "pipeline",
    "synthetic": "drive",
    "datasets": "synthetic formats",
    "report": "verification",
    "jobs": "",
    "batch": "verification jobs",
    "rig": "verification",
    "fleet": "batch report",
    "experiments": "jobs baselines datasets report",
    "schemas": "batch rig fleet",
    "cli": "library datasets experiments schemas",
}
"""Of each folder, and each module beside them, what it may import, with all that may be imported there. Everything may
import the first three. The two stages, `initialization` and `refinement`, never meet but in a pose."""
EVERYWHERE = {"errors", "config", "_core"}
WITH_TORCH = {"refinement/mine", "refinement/se3", "refinement/projection", "refinement/objective"}
WITH_OPENCV = {
    "files/images",
    "drive/intensity",
    "initialization/pnp",
    "assessment/uncertainty",
    "baselines/soic",
    "report",
}
WITH_SCIPY = {"fleet/consensus", "experiments/accuracy"}


def allowed(folder: str) -> set[str]:
    """All that a folder may import, its own modules among them."""
    found = {folder, *EVERYWHERE}
    for name in MAY_IMPORT[folder].split():
        found |= allowed(name)
    return found


def imports(path: Path, *, anywhere: bool) -> set[str]:
    """Modules that a file imports: at the top, or anywhere."""
    tree = ast.parse(path.read_text())
    nodes = list(ast.walk(tree)) if anywhere else tree.body
    found: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module == "semcal_cli":
            found |= {f"semcal_cli.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(node.module or "")
    return found


FILES = {
    path.relative_to(PACKAGE).with_suffix("").as_posix(): path
    for path in sorted(PACKAGE.rglob("*.py"))
    if path != PACKAGE / "__init__.py"
}


@pytest.mark.parametrize("name", FILES)
def test_a_folder_imports_only_what_stands_before_it(name: str) -> None:
    may_import = allowed(name.split("/")[0])
    folders = {
        module.split(".")[1]
        for module in imports(FILES[name], anywhere=True)
        if module.startswith("semcal_cli.")
    }
    assert folders <= may_import, f"{name} imports {folders - may_import}"


@pytest.mark.parametrize("name", FILES)
def test_torch_opencv_and_scipy_stay_where_they_are_needed(name: str) -> None:
    roots = {module.split(".")[0] for module in imports(FILES[name], anywhere=False)}
    assert "torch" not in roots or name in WITH_TORCH
    assert "scipy" not in roots or name in WITH_SCIPY
    assert "cv2" not in roots or name in WITH_OPENCV or name.split("/")[0] in WITH_OPENCV
