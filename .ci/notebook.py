"""Hook of mkdocs that runs docs/notebook.ipynb, which is stored without outputs, and makes it a page with them."""

import html
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import nbformat
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from nbclient import NotebookClient
from traitlets.config import Config

NOTEBOOK = "notebook.ipynb"
IMAGES = ("image/jpeg", "image/png")
TIMEOUT_S = 300
"""Longest time of a cell; all together take seconds."""


class NotebookPage(File):
    """A page whose source is no Markdown file."""

    def is_documentation_page(self) -> bool:
        """Whether mkdocs makes a page of it."""
        return True


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Put the page in place of the notebook, to which the other pages link."""
    stored = files.get_file_from_path(NOTEBOOK)
    assert stored is not None
    content = page(Path(config.docs_dir, NOTEBOOK).read_text())
    files.remove(stored)
    files.append(NotebookPage.generated(config, NOTEBOOK, content=content))
    return files


@cache
def page(stored: str) -> str:
    """Run a notebook, and write it as Markdown."""
    notebook = nbformat.reads(stored, as_version=4)
    # From elsewhere, so that the installed package is run and not the source folder; the kernel is spoken to through
    # files there, and not through ports of the machine.
    with TemporaryDirectory() as elsewhere:
        NotebookClient(
            notebook,
            timeout=TIMEOUT_S,
            kernel_name="python3",
            config=Config({"KernelManager": {"transport": "ipc", "ip": f"{elsewhere}/kernel"}}),
            resources={"metadata": {"path": elsewhere}},
        ).execute()
    parts = []
    for cell in notebook.cells:
        parts.append(f"```python\n{cell.source}\n```" if cell.cell_type == "code" else cell.source)
        parts += [shown(output, cell.metadata.get("alt", "")) for output in cell.get("outputs", ())]
    return "\n\n".join(parts)


def shown(output: dict[str, Any], alt: str) -> str:
    """Write an output of a cell; `alt` says what its image shows."""
    if output["output_type"] == "stream":
        return f"```text\n{output['text'].strip()}\n```"
    data: dict[str, str] = output["data"]
    if "text/html" in data:
        return data["text/html"]
    for kind in IMAGES:
        if kind in data:
            return f'<p><img alt="{html.escape(alt)}" src="data:{kind};base64,{data[kind].strip()}"></p>'
    return f"```text\n{data['text/plain']}\n```"
