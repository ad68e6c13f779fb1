"""The modules of a Rust crate, and which of them use which, read from its sources without their tests."""

import re
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

Module = tuple[str, ...]
"""Path of a module from the root of its crate: `("camera", "lens")`."""

_STRING = re.compile(r'r(#+)".*?"\1|"(?:\\.|[^"\\])*"|\'(?:\\.|[^\'\\])\'', re.DOTALL)
_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
_TEST = re.compile(r"#\[cfg\((?:all\()?test\b[^\]]*\]")
_VISIBLE = r"pub(?:\([\w:\s]+\))?\s+"
_DECLARED = re.compile(rf"^\s*(?:{_VISIBLE})?mod\s+(\w+)\s*;", re.MULTILINE)
_USE = re.compile(rf"^\s*({_VISIBLE})?use\s+([^;]+);", re.MULTILINE)
_PATH = re.compile(r"(?<![\w:])\w+(?:::\w+)+")
_PUBLIC_TYPE = re.compile(rf"^(?:{_VISIBLE})(?:struct|enum|trait|union|type)\s+(\w+)", re.MULTILINE)


@dataclass(frozen=True)
class Use:
    """One name that a module imports; `*` for all."""

    name: str
    path: tuple[str, ...]
    is_public: bool


@dataclass
class Source:
    """One module: its code without tests, and without the imports that `uses` lists."""

    file: Path
    code: str
    uses: list[Use] = field(default_factory=list)


def code_of(file: Path) -> str:
    """Return the code of a file without strings, comments and tests."""
    code = _COMMENT.sub("", _STRING.sub('""', file.read_text()))
    while test := _TEST.search(code):
        code = code[: test.start()] + code[_end_of_item(code, test.end()) :]
    return code


def public_types(file: Path) -> list[str]:
    """Return the names of the types of a file that other modules see."""
    return _PUBLIC_TYPE.findall(code_of(file))


def read_crate(root: Path) -> dict[Module, Source]:
    """Return the modules of the crate whose root is the file `root`."""
    modules: dict[Module, Source] = {}

    def read(module: Module, file: Path, folder: Path) -> None:
        code = code_of(file)
        uses = [use for public, tree in _USE.findall(code) for use in _flattened(tree, bool(public))]
        modules[module] = Source(file, _DECLARED.sub("", _USE.sub("", code)), uses)
        for name in _DECLARED.findall(code):
            flat, nested = folder / f"{name}.rs", folder / name / "mod.rs"
            read((*module, name), flat if flat.exists() else nested, folder / name)

    read((), root, root.parent)
    return modules


def uses_of(modules: dict[Module, Source]) -> dict[Module, set[Module]]:
    """Return the modules that each module uses. A name is of the module that defines it."""
    return {module: _used(modules, module) - {module} for module in modules}


def circle(uses: dict[Module, set[Module]]) -> list[str]:
    """Return one circle of modules, in which each uses the next, or nothing."""
    try:
        TopologicalSorter(uses).prepare()
    except CycleError as error:
        return ["::".join(("crate", *module)) for module in reversed(error.args[1])]
    return []


def _end_of_item(code: str, start: int) -> int:
    """Return where an item ends: at its semicolon or at its closing brace."""
    depth = 0
    for index in range(start, len(code)):
        depth += {"(": 1, "[": 1, "{": 1, ")": -1, "]": -1, "}": -1}.get(code[index], 0)
        if depth == 0 and code[index] in ";}":
            return index + 1
    return len(code)


def _flattened(tree: str, is_public: bool, prefix: tuple[str, ...] = ()) -> list[Use]:
    """Return the names that a tree of `use` imports: `a::{b, c as d}` has b and d."""
    head, brace, rest = tree.partition("{")
    path, _, alias = head.partition(" as ")
    full = prefix + tuple(part.strip() for part in path.split("::") if part.strip())
    if brace:
        branches = _branches(rest.rsplit("}", 1)[0])
        return [use for branch in branches for use in _flattened(branch, is_public, full)]
    full = full[:-1] if full[-1] == "self" and len(full) > 1 else full
    return [Use(alias.strip() or full[-1], full, is_public)]


def _branches(inside: str) -> list[str]:
    """Return the parts between the commas that are in no inner braces."""
    parts, depth = [""], 0
    for character in inside:
        depth += {"{": 1, "}": -1}.get(character, 0)
        if character == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return [part.strip() for part in parts if part.strip()]


def _used(modules: dict[Module, Source], module: Module) -> set[Module]:
    source = modules[module]
    paths = [
        use.path
        for use in source.uses
        if not use.is_public or re.search(rf"\b{re.escape(use.name)}\b", source.code)
    ]
    paths += [tuple(path.split("::")) for path in _PATH.findall(source.code)]
    defining = (_defining(modules, module, path) for path in paths)
    return {found for found in defining if found is not None}


def _defining(
    modules: dict[Module, Source], module: Module, path: tuple[str, ...], depth: int = 0
) -> Module | None:
    """Return the module that defines what a path names as seen from a module, or None for another crate's."""
    first, rest = path[0], path[1:]
    if first == "super":
        start = module[:-1]
    elif first in ("crate", "self"):
        start = module if first == "self" else ()
    elif (*module, first) in modules:
        start = (*module, first)
    else:
        return _through_import(modules, module, path, depth)
    while rest and (rest[0] == "super" or (*start, rest[0]) in modules):
        start, rest = (start[:-1] if rest[0] == "super" else (*start, rest[0])), rest[1:]
    if not rest or rest[0] == "*":
        return start
    return _through_import(modules, start, rest, depth) or start


def _through_import(
    modules: dict[Module, Source], module: Module, path: tuple[str, ...], depth: int
) -> Module | None:
    """Follow a name that a module imports, such as one that it re-exports."""
    if depth > len(modules):
        return None
    for use in modules[module].uses:
        if use.name == path[0] and use.path != path:
            return _defining(modules, module, use.path + path[1:], depth + 1)
    return None
