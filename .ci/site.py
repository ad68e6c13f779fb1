"""Hook of mkdocs that publishes the JSON Schemas at their addresses, and the list of pages as llms.txt."""

import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
SCHEMAS = ROOT / "semcal_cli" / "schemas"
INDEX = ROOT / "docs" / "index.md"
ROW = re.compile(r"^\| \[(?P<name>[^]]+)\]\((?P<page>\w+)\.\w+\) \| (?P<question>.+) \|$", re.MULTILINE)
"""A row of the index: a page, and the question that it answers."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the schemas and llms.txt to what the site consists of."""
    for path in sorted(SCHEMAS.glob("*.schema.json")):
        files.append(File.generated(config, f"schemas/{path.name}", abs_src_path=str(path)))
    files.append(File.generated(config, "llms.txt", content=_llms(INDEX.read_text(encoding="utf-8"), config)))
    return files


def _llms(index: str, config: MkDocsConfig) -> str:
    """List the pages of the index for language models (llmstxt.org)."""
    sections = re.split(r"^## ", index, flags=re.MULTILINE)[1:]
    parts = [f"# {config.site_name}\n\n> {config.site_description}"]
    for section in sections:
        rows = [
            f"- [{row['name']}]({config.site_url}{row['page']}/): {row['question']}"
            for row in ROW.finditer(section)
        ]
        parts.append("\n".join([f"## {section.splitlines()[0]}\n", *rows]))
    return "\n\n".join(parts) + "\n"
