"""The rules of the house, which ARCHITECTURE.md describes: each function lists the violations in a package."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import get_args

from documentation import ROOT

from semcal_cli.config.cues import BuiltInCue

PACKAGE = ROOT / "semcal_cli"
FRONT = {"__init__", "__main__"}
FLOORS = ("estimation", "many")
"""Folders whose rooms are the folders in them."""
NUMERIC_ROOMS = {"checks", "estimation", "pipeline"}
OF_FILES = {"hashes", "relative_to"}
"""Names of parameters that only matter where a result is saved."""
ARRAYS = "geometry/arrays.py"
"""The module of the names of array types."""
MAX_PUBLIC_NAMES = 25
MORE_PUBLIC_NAMES = {
    "checks": 28,
    "drive": 40,
    "estimation/uncertainty": 28,
    "files": 84,
    "geometry": 30,
    "observations": 62,
    "pipeline": 29,
    "result": 55,
}
"""Rooms that still have more than the rest may have: their numbers are those of today, and may only fall."""
MAX_LINES = 400
"""Length of a module that a reader takes in; CONTRIBUTING.md states it."""
OF_PROBLEM = {"max_baseline_m", "edge_band_px"}
FALLBACKS = {"MAX_BASELINE_M", "EDGE_BAND_PX"}
"""What describes the problem stands on its observations: settings of a solver that repeat it can be forgotten."""
WITHOUT_A_DEFAULT = {"checks", "estimation", "pipeline"}
"""Rooms whose parameters and fields of these names have no default, so that no caller can leave them out."""
FILLER = r"(Give|Say|Tell)s?\b"
"""First words of docstrings that say less than "Return", "Describe" or "Name"."""
SUPERLATIVE = r"_?(LEAST|MOST)_"
"""First words of names of limits that are called `MIN_` and `MAX_`."""
PRINTING_ROOMS = {"cli", "experiments", "fleet", "many/audit", "many/rig", "report"}
"""Rooms whose figures a person reads, in centimetres and millimetres."""
POSE_ERRORS = "geometry/poses.py"
"""The module whose `PoseError` also has its figures as they are printed."""
FACES = {"__init__.py", "__main__.py", "core.py"}
"""Modules that pass on what others define."""
CUES = ("observations/cues/", "config/cues.py")
"""Where cues have their names."""
CUE_NAMES = {*get_args(BuiltInCue)} - {"auto"}
AFTER_A_CUE = r"(has|is|are)_(\w+_)?(segments|edges)"
OTHER_MEANINGS = {"labelling/cloud_labeller.py", "report/view/server.py"}
"""Modules in which such a word is the channel of a cloud, or part of an address."""
BROAD_ROOMS = {"cli", "config", "formats"}
"""Rooms that may have more public names: commands, settings and formats are many by their nature. The names of array
types are words of the whole package, and count for no room."""


@cache
def modules(package: Path) -> dict[str, ast.Module]:
    """Parse all modules of a package, by their paths in it."""
    return {
        path.relative_to(package).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
        for path in sorted(package.rglob("*.py"))
    }


def room_of(path: str) -> str:
    """Name the room in which a module stands."""
    parts = path.removesuffix(".py").split("/")
    return "/".join(parts[: 2 if parts[0] in FLOORS else 1])


def repeated(places: dict[str, list[str]]) -> list[str]:
    return [f"{name}: {', '.join(paths)}" for name, paths in sorted(places.items()) if len(paths) > 1]


def file_names_in_two_rooms(package: Path) -> list[str]:
    places = defaultdict(list)
    for path in modules(package):
        if Path(path).stem not in FRONT:
            places[Path(path).stem].append(path)
    return repeated(places)


def is_alias(statement: ast.stmt) -> bool:
    return (
        isinstance(statement, ast.AnnAssign)
        and isinstance(statement.annotation, ast.Name)
        and statement.annotation.id == "TypeAlias"
    )


def types_in(module: ast.Module) -> Iterator[str]:
    """Name the public classes and aliases that a module defines."""
    for statement in module.body:
        if isinstance(statement, ast.ClassDef):
            name = statement.name
        elif isinstance(statement, ast.AnnAssign) and is_alias(statement):
            name = ast.unparse(statement.target)
        else:
            continue
        if not name.startswith("_"):
            yield name


def types_in_two_modules(package: Path) -> list[str]:
    places = defaultdict(list)
    for path, module in modules(package).items():
        for name in types_in(module):
            places[name].append(path)
    return repeated(places)


def core_imports(package: Path) -> list[str]:
    """List the imports of the compiled core outside `core.py`, which says what to do where it is not built."""
    return [
        f"{path}: {ast.unparse(node)}"
        for path, module in modules(package).items()
        if path != "core.py"
        for node in ast.walk(module)
        if isinstance(node, ast.ImportFrom)
        and ("_core" in (node.module or "").split(".") or any(alias.name == "_core" for alias in node.names))
    ]


def array_aliases(package: Path) -> list[str]:
    """List the names of array types outside the module that has them all."""
    return [
        f"{path}: {ast.unparse(statement)}"
        for path, module in modules(package).items()
        if path != ARRAYS
        for statement in module.body
        if isinstance(statement, ast.Assign | ast.AnnAssign)
        and statement.value is not None
        and re.fullmatch(
            r"(npt?\.)?NDArray\[[\w.]+\]( \| (npt?\.)?NDArray\[[\w.]+\])*", ast.unparse(statement.value)
        )
    ]


def imported_names(package: Path) -> dict[str, set[str]]:
    """Collect the public names of each room: those that other rooms import."""
    trees, names = modules(package), defaultdict(set)
    for path, module in trees.items():
        for node in ast.walk(module):
            if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith(package.name):
                continue
            *_, source = ["", *(node.module or "").split(".", 1)]
            for alias in node.names:
                target = f"{source}/{alias.name}".replace(".", "/").removeprefix(f"{package.name}/")
                room = room_of(target)
                is_counted = f"{target.rpartition('/')[0]}.py" != ARRAYS and path not in FACES
                if is_counted and room != room_of(path):
                    names[room].add(f"{target.rpartition('/')[0]}: {alias.name}")
    return names


def long_files(package: Path) -> list[str]:
    """List the modules that are too long."""
    lengths = {
        path: len((package / path).read_text(encoding="utf-8").splitlines()) for path in modules(package)
    }
    return [f"{path}: {length} lines" for path, length in lengths.items() if length > MAX_LINES]


def crowded_rooms(package: Path) -> list[str]:
    return [
        f"{room}: {len(names)} public names, needed at most {most}"
        for room, names in sorted(imported_names(package).items())
        if room not in BROAD_ROOMS and len(names) > (most := MORE_PUBLIC_NAMES.get(room, MAX_PUBLIC_NAMES))
    ]


def parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> list[ast.arg]:
    arguments = function.args
    named = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    return [*named, *filter(None, (arguments.vararg, arguments.kwarg))]


def knows_paths(parameter: ast.arg) -> bool:
    annotation = "" if parameter.annotation is None else ast.unparse(parameter.annotation)
    return parameter.arg in OF_FILES or re.search(r"\bPath\b", annotation) is not None


def paths_in_the_pipeline(package: Path) -> list[str]:
    """List the parameters of the numeric rooms that are paths, or that say how a file names its input.

    A drive and a given pose know the files that they were read from, for messages and for `with_provenance`.
    """
    return [
        f"{path}: {node.name}({parameter.arg})"
        for path, module in modules(package).items()
        if path.split("/")[0] in NUMERIC_ROOMS
        for node in ast.walk(module)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        for parameter in parameters(node)
        if knows_paths(parameter)
    ]


def with_default(function: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """Name the parameters that have a default."""
    arguments = function.args
    positional = [*arguments.posonlyargs, *arguments.args]
    by_name = zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
    optional = [*positional[len(positional) - len(arguments.defaults) :]]
    optional += [parameter for parameter, default in by_name if default is not None]
    return [parameter.arg for parameter in optional]


def problem_numbers(package: Path) -> list[str]:
    """List the settings, defaults and fallbacks that repeat what `Observations` say of the problem."""
    violations = []
    for path, module in modules(package).items():
        room, floor = room_of(path), path.removesuffix(".py").split("/")[0]
        for node in ast.walk(module):
            if isinstance(node, ast.ClassDef) and node.name not in ("RefinementConfig", "SynthConfig"):
                fields = [field for field in node.body if isinstance(field, ast.AnnAssign)]
                if floor == "pipeline":
                    fields = [field for field in fields if field.value is not None]
                names = [ast.unparse(field.target) for field in fields]
                if floor == "config" or floor in WITHOUT_A_DEFAULT:
                    violations += [f"{path}: {node.name}.{name}" for name in names if name in OF_PROBLEM]
            elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and floor in WITHOUT_A_DEFAULT:
                violations += [
                    f"{path}: {node.name}({name})" for name in with_default(node) if name in OF_PROBLEM
                ]
            elif isinstance(node, ast.ImportFrom) and room not in ("config", "observations", "cli"):
                violations += [f"{path}: {alias.name}" for alias in node.names if alias.name in FALLBACKS]
    return violations


def printed_units(package: Path) -> list[str]:
    """List the names in centimetres and millimetres in rooms that compute."""
    violations = set()
    for path, module in modules(package).items():
        if room_of(path) not in PRINTING_ROOMS and path != POSE_ERRORS:
            printed = {
                id(node)
                for text in ast.walk(module)
                if isinstance(text, ast.JoinedStr)
                for node in ast.walk(text)
            }
            for node in ast.walk(module):
                if id(node) in printed:
                    continue
                name = getattr(node, "id", None) or getattr(node, "attr", None) or getattr(node, "arg", None)
                if isinstance(name, str) and re.search(r"_[cm]m$", name):
                    violations.add(f"{path}: {name}")
    return sorted(violations)


def cue_questions(package: Path) -> list[str]:
    """List the questions for a cue by its name where a cue states its own policy: see `observations/cues/cue.py`.

    A question is a comparison or a membership test with the name of a cue, a cue's observations by its name, or an
    attribute that is named after a cue. An option or an experiment may choose a cue by its name.
    """
    return [
        f"{path}: {ast.unparse(node)}"
        for path, module in modules(package).items()
        if not path.startswith(CUES) and path not in OTHER_MEANINGS
        for node in ast.walk(module)
        if isinstance(node, ast.expr) and asks_for_a_cue(node)
    ]


def asks_for_a_cue(node: ast.expr) -> bool:
    if isinstance(node, ast.Compare):
        return any(names_a_cue(part) for part in ast.walk(node))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "of_cue":
        return any(names_a_cue(argument) for argument in node.args)
    return isinstance(node, ast.Attribute) and re.fullmatch(AFTER_A_CUE, node.attr) is not None


def names_a_cue(node: ast.AST) -> bool:
    if isinstance(node, ast.Name | ast.Attribute):
        return (node.id if isinstance(node, ast.Name) else node.attr) == "LABELS"
    return isinstance(node, ast.Constant) and node.value in CUE_NAMES


def filler_docstrings(package: Path) -> list[str]:
    """List the docstrings, of values as well, that begin with words such as "Give"."""
    return [
        f"{path}: {node.value.value.splitlines()[0]}"
        for path, module in modules(package).items()
        for node in ast.walk(module)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if isinstance(node.value.value, str) and re.match(FILLER, node.value.value)
    ]


def superlative_names(package: Path) -> list[str]:
    """List the names of modules that begin with "LEAST" or "MOST"."""
    return [
        f"{path}: {node.id}"
        for path, module in modules(package).items()
        for statement in module.body
        if isinstance(statement, ast.Assign | ast.AnnAssign)
        for node in ast.walk(statement)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and re.match(SUPERLATIVE, node.id)
    ]


Rule = Callable[[Path], list[str]]
