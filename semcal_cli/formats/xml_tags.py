"""Start tags of an XML file and their places in its text, so that attributes can be replaced where they stand."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from xml.parsers import expat

from semcal_cli.errors import InputError
from semcal_cli.formats.format import Edits, Source

TAG = re.compile(r"""<[^\s/>]+(?:[^>"']|"[^"]*"|'[^']*')*>""")


@dataclass(frozen=True)
class Tag:
    """The start tag of an element."""

    name: str
    attributes: dict[str, str]
    text: str
    start: int
    """Position in the text of the file."""
    children: list[Tag] = field(default_factory=list)

    def attribute(self, name: str) -> tuple[int, int] | None:
        """Find the beginning and end of the value of an attribute, without its quotes."""
        match = re.search(rf"""\s{re.escape(name)}\s*=\s*(?:"([^"]*)"|'([^']*)')""", self.text)
        if match is None:
            return None
        start, end = match.span(1 if match[1] is not None else 2)
        return self.start + start, self.start + end

    def replaced(self, name: str, value: str) -> Edits:
        """Replace the value of an attribute, or add it."""
        from xml.sax.saxutils import quoteattr  # imports HTTP and TLS, which takes 6 ms

        if (place := self.attribute(name)) is not None:
            return [(*place, value)]
        end = self.start + 1 + len(self.name)
        return [(end, end, f" {name}={quoteattr(value)}")]

    @property
    def end(self) -> int:
        """Position after the tag."""
        return self.start + len(self.text)


def start_tags(source: Source) -> list[Tag]:
    """List all elements of a file in their order; comments hold none.

    Raises:
        InputError: the file is not well-formed XML, or declares entities.
    """
    _ = source.xml
    text, tags, stack = source.text, list[Tag](), list[Tag]()
    content = text.lstrip().encode()
    start, num_bytes = len(text) - len(text.lstrip()), 0
    parser = expat.ParserCreate(encoding="utf-8")

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal start, num_bytes
        start += len(content[num_bytes : parser.CurrentByteIndex].decode())
        num_bytes = parser.CurrentByteIndex
        match = TAG.match(text, start)
        if match is None:
            raise InputError(
                f"{source.path}: line {parser.CurrentLineNumber}: found no start tag, expected one"
            )
        tag = Tag(name, attributes, match[0], start)
        if stack:
            stack[-1].children.append(tag)
        tags.append(tag)
        stack.append(tag)

    parser.StartElementHandler = begin
    parser.EndElementHandler = lambda name: stack.pop()
    parser.Parse(content, True)
    return tags
