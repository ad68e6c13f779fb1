"""Imports go one way: cli, pipeline, stages, leaves; torch and OpenCV stay where they are needed."""

import ast
from pathlib import Path

import semcal_cli

PACKAGE = Path(semcal_cli.__file__).parent
LAYERS = [
    {"errors", "_core"},
    {"documents", "poses", "se3", "synthesis_config", "classes"},
    {"validation", "metrics", "pictures", "limits"},
    {"drive"},
    {"calibration", "camera", "point_clouds"},
    {"formats", "motion", "projection", "provenance"},
    {"observations"},
    {"label_noise", "selection", "objective", "intensity", "features"},
    {"cues"},
    {"datasets"},
    {"pnp", "overlay", "synthesis"},
    {"initialization", "refinement", "soic"},
    {"mine", "polish", "inspection"},
    {"uncertainty"},
    {"trust", "prior", "reasons"},
    {"pipeline", "comparison", "report"},
    {"verification"},
    {"experiments", "batch", "rig"},
    {"fleet", "schemas"},
    {"cli"},
]
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}
WITH_TORCH = {"mine", "se3", "projection", "objective"}
WITH_OPENCV = {"pnp", "pictures", "overlay", "report", "intensity", "soic"}


def imports(path: Path, *, anywhere: bool) -> set[str]:
    """Modules that a file imports: at the top, or anywhere but for type checkers."""
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


def modules() -> dict[Path, str]:
    """Each file and the module of the layers that it belongs to."""
    files = [path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py"]
    return {path: path.relative_to(PACKAGE).parts[0].removesuffix(".py") for path in files}


def test_imports_go_one_way() -> None:
    for path, module in modules().items():
        for name in imports(path, anywhere=True):
            if name.startswith("semcal_cli."):
                imported = name.split(".")[1]
                assert imported == module or LEVEL[imported] < LEVEL[module], f"{path} imports {name}"


def test_torch_and_opencv_stay_where_they_are_needed() -> None:
    for path, module in modules().items():
        roots = {name.split(".")[0] for name in imports(path, anywhere=False)}
        assert "torch" not in roots or module in WITH_TORCH, path
        assert "cv2" not in roots or module in WITH_OPENCV, path


def test_the_two_stages_meet_only_in_a_pose() -> None:
    for stage, other in (("initialization", "refinement"), ("refinement", "initialization")):
        assert f"semcal_cli.{other}" not in imports(PACKAGE / f"{stage}.py", anywhere=True)
