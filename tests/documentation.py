"""README and the pages of docs: their text, their fenced blocks, and the commands in them."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PAGES = [README, *sorted((ROOT / "docs").glob("*.md"))]

FENCED = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
OPERATORS = {"&&", "||", "|", ";"}


def text_of_all() -> str:
    """All pages, one after the other."""
    return "\n\n".join(path.read_text() for path in PAGES)


def blocks(path: Path, language: str) -> list[str]:
    """The fenced blocks of a language."""
    return [content for found, content in FENCED.findall(path.read_text()) if found == language]


def prose(path: Path) -> str:
    """A page without its fenced blocks."""
    return FENCED.sub("", path.read_text())


def commands(path: Path) -> Iterator[list[str]]:
    """The words after `semcal` of each command in the blocks of commands."""
    for block in blocks(path, "sh"):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.shlex(line, posix=True, punctuation_chars=True)
            words.whitespace_split = True
            command: list[str] = []
            for word in [*words, ";"]:
                if word not in OPERATORS:
                    command.append(word)
                    continue
                if command[:1] == ["semcal"]:
                    yield command[1:]
                command = []


def named_commands(path: Path) -> list[str]:
    """What follows `semcal` in backquotes, outside blocks."""
    return [" ".join(found.split()) for found in re.findall(r"`semcal\s+([^`]+)`", prose(path))]


def anchors(path: Path) -> set[str]:
    """The anchors that GitHub makes of the headings of a page, and those that the page states."""
    headings = re.findall(r"^#+ (?:<a .*></a>)?(.+)$", prose(path), re.MULTILINE)
    made = {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
    return made | set(re.findall(r'<a id="([^"]+)"></a>', prose(path)))


def links(path: Path) -> list[str]:
    """The targets of links and images of a page, less those on the web."""
    found = re.findall(r"\]\(([^)\s]+)\)", prose(path))
    return [target for target in found if not re.match(r"[a-z]+://", target)]
