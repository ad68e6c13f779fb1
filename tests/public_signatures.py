"""The signature of everything public: `python tests/public_signatures.py` writes it to public_signatures.txt.

Public is what docs/python_reference.md shows, and what the examples of the other pages import. The sources are read and
not imported, as for that page.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import griffe
from documentation import PAGES, ROOT, blocks

import semcal_cli

LIST = Path(__file__).with_suffix(".txt")
MARKS = {"variadic positional": "*", "variadic keyword": "**"}
OF_PYDANTIC = "model_config"


def public_names() -> dict[str, str]:
    """Where what is public is found, by the name that it is called by: those of the package itself come first."""
    shown = re.findall(r"^::: (\S+)$", (ROOT / "docs/python_reference.md").read_text(), re.MULTILINE)
    sources = [block for path in PAGES for block in blocks(path, "python")]
    lines = [re.sub(r"^(>>>|\.\.\.) ?", "", line) for each in sources for line in each.splitlines()]
    imports = [ast.parse(line).body[0] for line in lines if line.startswith("from semcal_cli")]
    imported = [f"{each.module}.{name.name}" for each in imports for name in each.names]
    own = {
        f"semcal_cli.{name}": f"semcal_cli.{module}.{name}" for name, module in semcal_cli._MODULES.items()
    }
    return own | {name: name for name in sorted({*shown, *imported})}


def signatures() -> str:
    """What is public, a line for each parameter, field and method; modules have none of their own."""
    package = griffe.load("semcal_cli", search_paths=[str(ROOT)], allow_inspection=False)
    found: dict[str, list[str]] = {}
    names, seen = [*public_names().items()], set()
    for name, place in names:
        try:
            each = package[place.removeprefix("semcal_cli.")]
        except KeyError:  # of several names that are set at once
            found[name] = []
            continue
        each = each.final_target if each.is_alias else each
        if each.path not in seen and not each.is_module:
            seen.add(each.path)
            found[name] = [*described(each)]
            names += [(alias, alias) for alias in sorted(aliases(each, package))]
    return "\n".join(line for name in sorted(found) for line in (name, *found[name], ""))


def described(each: griffe.Object) -> Iterator[str]:
    """The lines below the name of a function, a class or a value."""
    if each.is_function:
        yield from (f"    {line}" for line in parameters(each))
    elif each.is_class:
        for name, member in each.all_members.items():
            member = member.final_target if member.is_alias else member
            if (name.startswith("_") and name != "__init__") or name == OF_PYDANTIC:
                continue
            if member.is_function:
                yield f"    {name}()"
                yield from (f"        {line}" for line in parameters(member))
            else:
                kind = " (property)" if "property" in member.labels else ""
                yield f"    {name}: {member.annotation}{default(member.value)}{kind}"
    else:
        yield f"    {each.annotation}{default(each.value)}"


def parameters(function: griffe.Function) -> Iterator[str]:
    """The parameters of a function, of which those after `*` go by name alone, and what it returns."""
    is_after_star = False
    for each in function.parameters:
        if each.name in ("self", "cls"):
            continue
        if each.kind is griffe.ParameterKind.keyword_only and not is_after_star:
            is_after_star = True
            yield "*"
        is_after_star |= each.kind is griffe.ParameterKind.var_positional
        mark = MARKS.get(each.kind.value, "")
        value = "" if mark else default(each.default)
        place = ", by place" if each.kind is griffe.ParameterKind.positional_only else ""
        yield f"{mark}{each.name}: {each.annotation}{value}{place}"
    yield f"-> {function.returns}"


def default(value: object) -> str:
    """The default of a parameter or a field, without the help and the limits of a setting."""
    if isinstance(value, griffe.ExprCall) and str(value.function) == "setting":
        value = value.arguments[0]
    return "" if value is None else f" = {value}"


def aliases(each: griffe.Object, package: griffe.Module) -> set[str]:
    """The names of types that a signature is written with: what they stand for is part of it."""
    members = [each, *each.all_members.values()] if each.is_class else [each]
    members = [member.final_target if member.is_alias else member for member in members]
    written: list[object] = []
    for member in members:
        if member.is_function:
            written += [member.returns, *(parameter.annotation for parameter in member.parameters)]
        elif member.is_attribute:
            written += [member.annotation]
    names = {
        name.canonical_path
        for annotation in written
        if isinstance(annotation, griffe.Expr)
        for name in annotation.iterate(flat=True)
        if isinstance(name, griffe.ExprName)
    }
    return {name for name in names if name.startswith("semcal_cli.") and is_alias_of_type(name, package)}


def is_alias_of_type(name: str, package: griffe.Module) -> bool:
    try:
        found = package[name.removeprefix("semcal_cli.")]
    except KeyError:  # a type of the core, in a class whose own `core` griffe takes for the module
        return False
    found = found.final_target if found.is_alias else found
    return found.is_attribute and str(found.annotation) == "TypeAlias"


if __name__ == "__main__":
    LIST.write_text(signatures())
