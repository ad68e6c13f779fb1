"""Every sentence that semcal prints, raises or puts into a page or a schema, with its place, to be read at one go.

python tests/messages.py                  # messages of the Python package and of the core
python tests/messages.py --docstrings     # and the docstrings, which schemas and the reference show
python tests/messages.py semcal_cli/cli   # of one folder or file
"""

import argparse
import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
RUST_STRING = re.compile(r'"((?:[^"\\]|\\.)*)"', re.DOTALL)
HOLE = "{}"
"""What stands for a value that is put in."""


class Message(NamedTuple):
    """A sentence, or a part of one, as the source has it."""

    file: Path
    line: int
    text: str
    is_docstring: bool = False

    def __str__(self) -> str:
        return f"{self.file.relative_to(ROOT)}:{self.line}: {self.text}"


def messages_of(paths: list[Path]) -> Iterator[Message]:
    """List the messages of files and folders, in their order."""
    for path in paths:
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.suffix == ".py":
                yield from _of_python(file)
            elif file.suffix == ".rs":
                yield from _of_rust(file)


def _of_python(file: Path) -> Iterator[Message]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    found = list(_texts(tree))
    for node, text in sorted(found, key=lambda each: (each[0].lineno, each[0].col_offset)):
        if _is_sentence(text):
            yield Message(file, node.lineno, " ".join(text.split()), id(node) in docstrings)


def _texts(node: ast.AST) -> Iterator[tuple[ast.expr, str]]:
    """Walk to the strings, without the parts of formatted ones on their own."""
    if isinstance(node, ast.Constant):
        if isinstance(node.value, str):
            yield node, node.value
        return
    if isinstance(node, ast.JoinedStr):
        parts = [part.value if isinstance(part, ast.Constant) else HOLE for part in node.values]
        yield node, "".join(map(str, parts))
        for part in node.values:
            if isinstance(part, ast.FormattedValue):
                yield from _texts(part.value)
        return
    for child in ast.iter_child_nodes(node):
        yield from _texts(child)


def _of_rust(file: Path) -> Iterator[Message]:
    source = file.read_text(encoding="utf-8").split("#[cfg(test)]")[0]
    code = re.sub(r"^\s*//.*$", "", source, flags=re.MULTILINE)
    for match in RUST_STRING.finditer(code):
        text = " ".join(re.sub(r"\\\n\s*", "", match[1]).split())
        if _is_sentence(text):
            yield Message(file, code.count("\n", 0, match.start()) + 1, text)


def _is_sentence(text: str) -> bool:
    """Whether a string is for people to read: two words or more, which are no code."""
    words = re.findall(r"[A-Za-z]{2,}", text.replace(HOLE, ""))
    return len(words) > 1 and " " in text.strip() and not text.startswith(("<", "http"))


def main() -> None:
    """Print the messages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("paths", nargs="*", type=Path, default=[ROOT / "semcal_cli", ROOT / "rust"])
    parser.add_argument("--docstrings", action="store_true")
    given = parser.parse_args()
    for message in messages_of([path.resolve() for path in given.paths]):
        if given.docstrings or not message.is_docstring:
            print(message)


if __name__ == "__main__":
    main()
