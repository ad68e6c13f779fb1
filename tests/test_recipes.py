"""The recipes of CONTRIBUTING.md work, followed to the letter."""

import re
import sys
import textwrap
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest
from documentation import ROOT
from troubleshooting import page

from semcal_cli import checks
from semcal_cli.checks import registry


def recipe(title: str) -> list[str]:
    """List the blocks in the ordered steps of the section of CONTRIBUTING.md with a title."""
    _, _, text = (ROOT / "CONTRIBUTING.md").read_text().partition(f"## {title}\n")
    section = text.partition("\n## ")[0]
    indented = re.findall(r"^ +```\w+\n(.*?)^ +```$", section, re.MULTILINE | re.DOTALL)
    return [textwrap.dedent(block) for block in indented]


def module_of(name: str, text: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Import a module with this text, as if it were a part of the package."""
    path = folder / f"{name.rpartition('.')[2]}.py"
    path.write_text(text)
    spec = spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    monkeypatch.setitem(sys.modules, name, module)
    spec.loader.exec_module(module)
    return module


def test_a_check_that_is_added_by_the_recipe_is_on_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, line, test = recipe("Add a check")
    added = module_of("semcal_cli.checks.overexposed", file, tmp_path, monkeypatch)
    monkeypatch.setattr(checks, "overexposed", added, raising=False)
    table = Path(registry.__file__).read_text()
    place, first = "    baseline.FAR_CAMERA,\n", "    baseline,\n"
    assert table.count(place) == table.count(first) == 1
    table = table.replace(place, f"    {line}{place}").replace(first, f"    overexposed,\n{first}")
    registered = module_of("semcal_cli.checks.registry", table, tmp_path, monkeypatch)
    generated, today = page(registered.ALL_CHECKS), page()
    new = [text for text in generated.splitlines() if text not in today.splitlines()]
    assert new[0] == "| [overexposed](#overexposed) | Images are overexposed | at most 20 % |"
    assert new[1:] == [
        '### <a id="overexposed"></a>Images are overexposed',
        "> 31% of the pixels are white, needed at most 20%: record again with a shorter exposure",
        "- **What it means.** Much of the images is white, so that edges and classes are lost there.",
        "- **Why it comes up.** The exposure is set for the shade.",
        "- **What to do.** Record again with a shorter exposure.",
        "- **Figure.** Share of the pixels that are white.",
        "- **Limit.** At most 20 %: an example.",
    ]
    module_of("test_overexposed", test, tmp_path, monkeypatch).test_white_images_are_doubted()
