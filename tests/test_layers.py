"""A folder imports only what stands before it; torch, OpenCV and SciPy stay where they are needed."""

import ast
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import semcal_cli

PACKAGE = Path(semcal_cli.__file__).parent
MAY_IMPORT = {
    "errors": "",
    "extras": "",
    "setting": "",
    "synth_config": "",
    "config": "",
    "_core": "",
    "documentation": "",
    "threads": "",
    "geometry": "",
    "events": "geometry",
    "files": "geometry",
    "config_checks": "files",
    "drive": "files events config_checks",
    "result": "drive",
    "checks": "result",
    "initialization": "checks",
    "refinement": "checks",
    "formats": "result",
    "assessment": "initialization refinement formats",
    "stages": "assessment",
    "stage_words": "assessment",
    "pipeline": "stages stage_words",
    "verification": "pipeline",
    "library": "verification",
    "baselines": "pipeline",
    "synthetic": "drive",
    "datasets": "synthetic formats",
    "labelling": "datasets",
    "bags": "datasets",
    "report": "verification",
    "view": "report",
    "jobs": "files",
    "batch": "verification jobs",
    "rig": "report",
    "fleet": "batch report",
    "experiments": "jobs baselines datasets report",
    "schemas": "batch rig fleet labelling",
    "cli": "library labelling bags view experiments schemas",
}
"""Of each folder, and each module beside them, what it may import, with all that may be imported there. Everything may
import the first eight. The two stages, `initialization` and `refinement`, never meet but in a pose."""
EVERYWHERE = {"errors", "extras", "setting", "synth_config", "config", "_core", "documentation", "threads"}
WITH_TORCH = {
    f"refinement/{name}"
    for name in (
        "optimizers",
        "network",
        "labelled_points",
        "feature_points",
        "mine",
        "se3",
        "projection",
        "objective",
    )
}
WITH_OPENCV = {
    "files/images",
    "drive/intensity",
    "drive/edges",
    "labelling/views",
    "bags/pictures",
    "labelling/sides",
    "initialization/pnp",
    "assessment/scale",
    "assessment/uncertainty",
    "baselines/soic",
    "report",
    "view/session",
}
WITH_SCIPY = {"fleet/consensus"}


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


@pytest.mark.parametrize(
    ("library", "places"), [("torch", WITH_TORCH), ("cv2", WITH_OPENCV), ("scipy", WITH_SCIPY)]
)
def test_each_place_of_a_library_imports_it(library: str, places: set[str]) -> None:
    users = {
        name
        for name, path in FILES.items()
        if library in {module.split(".")[0] for module in imports(path, anywhere=False)}
    }
    used = {place for place in places if any(place in (name, name.split("/")[0]) for name in users)}
    assert used == places


RUST = Path(__file__).parents[1] / "rust"
Module = tuple[str, ...]
TEST_MODULE = re.compile(r"#\[cfg\(test\)\]\s*mod \w+ \{.*?^\}", re.MULTILINE | re.DOTALL)
TEST_FILE = re.compile(r"#\[cfg\(test\)\]\s*mod (\w+);")
USE = re.compile(r"^ *(pub(?:\([^)]*\))? )?use ([^;]+);", re.MULTILINE)
PATH = re.compile(r"\b(?:crate|super)(?:::\w+)+")


def rust_sources() -> dict[Module, str]:
    """Files of the core by the paths of their modules, without comments and tests."""
    found: dict[Module, str] = {}
    of_tests: set[Module] = set()
    for path in RUST.rglob("*.rs"):
        *folders, name = path.relative_to(RUST).with_suffix("").parts
        if folders[:1] in (["benches"], ["fuzz"]):
            continue
        module = (*folders, *([] if name in ("lib", "mod") else [name]))
        text = re.sub(r"//[^\n]*", "", path.read_text())
        of_tests |= {(*module, name) for name in TEST_FILE.findall(text)}
        found[module] = TEST_MODULE.sub("", text)
    return {module: text for module, text in found.items() if module not in of_tests}


def flat(tree: str) -> list[list[str]]:
    """Paths of a tree of names: `a::{b, c::d}` is `a::b` and `a::c::d`."""
    head, brace, inner = re.sub(r"\s", "", tree).partition("{")
    parts = [part for part in head.split("::") if part]
    if not brace:
        return [parts]
    branches, depth = [""], 0
    for letter in inner[: inner.rindex("}")]:
        depth += {"{": 1, "}": -1}.get(letter, 0)
        if letter == "," and depth == 0:
            branches.append("")
        else:
            branches[-1] += letter
    return [[*parts, *rest] for branch in branches if branch for rest in flat(branch)]


class RustModules:
    """Which file of the core declares what a path names, seen through re-exports."""

    def __init__(self, sources: dict[Module, str]) -> None:
        self.sources = sources
        self.used: dict[Module, list[Module]] = {module: [] for module in sources}
        self.shown: dict[Module, dict[str, Module]] = {module: {} for module in sources}
        for module, text in sources.items():
            for is_public, tree in USE.findall(text):
                paths = [
                    self.absolute(module, [part for part in path if part != "self"]) for path in flat(tree)
                ]
                for path in filter(None, paths):
                    if is_public:
                        self.shown[module][path[-1]] = path
                    else:
                        self.used[module].append(path)

    def absolute(self, module: Module, path: list[str]) -> Module | None:
        """Give the path from the root; None for one of another crate."""
        if path[0] == "crate":
            return tuple(path[1:])
        if path[0] == "super":
            num_up = sum(part == "super" for part in path)
            return (*module[:-num_up], *path[num_up:])
        return (*module, *path) if (*module, path[0]) in self.sources else None

    def file_of(self, path: Module) -> Module:
        """Find the file that declares the last name of a path."""
        length = max(length for length in range(len(path) + 1) if path[:length] in self.sources)
        module, rest = path[:length], path[length:]
        if rest and (target := self.shown[module].get(rest[0])) is not None:
            return self.file_of((*target, *rest[1:]))
        return module

    def needs(self, module: Module) -> set[Module]:
        """Find the files that declare what a file uses, which is not what it only declares or shows."""
        body = USE.sub("", self.sources[module])
        inline = (self.absolute(module, path.split("::")) for path in PATH.findall(body))
        paths = {*self.used[module], *filter(None, inline)}
        children = {other for other in self.sources if other[:-1] == module and other}
        for parent in {path for path in paths if path in self.sources} | children:
            names = re.findall(rf"(?<!::)\b{parent[-1]}::(\w+)", body)
            paths = (paths - {parent}) | {(*parent, name) for name in names}
        return {self.file_of(path) for path in paths} - {module}


def test_files_of_the_core_use_one_another_in_no_circle() -> None:
    modules = RustModules(rust_sources())
    graph = {module: modules.needs(module) for module in modules.sources}
    assert ("camera", "model") in graph[("camera", "fisheye")]
    assert ("alignment", "level") in graph[("alignment", "polish")]
    assert ("alignment", "ascent") in graph[("python", "alignment")]  # through a re-export
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join("/".join(module) for module in error.args[1]))
