"""What is public stays as it is, or its change is meant."""

import difflib
import inspect

import public_signatures
from documentation import ROOT

import semcal_cli

ADVICE = """the public signatures are not those of tests/public_signatures.txt:

{}
Where a name, a parameter or a field came in, that is all right. Where one went or changed, keep it for two minor
versions with a DeprecationWarning, and name it under Deprecated in CHANGELOG.md: docs/python_reference.md says so.
Then `python tests/public_signatures.py` writes the list anew."""


def test_public_signatures_are_those_of_the_list() -> None:
    stored = public_signatures.LIST.read_text()
    found = public_signatures.signatures()
    changed = difflib.unified_diff(stored.splitlines(True), found.splitlines(True), "before", "now", n=3)
    assert found == stored, ADVICE.format("".join(changed))


def test_the_list_has_what_the_package_names() -> None:
    """Below each name stand its parameters with their kinds, annotations and defaults."""
    stored = public_signatures.LIST.read_text()
    assert {*dir(semcal_cli)} == {*semcal_cli.__all__}
    entries = {entry.partition("\n")[0] for entry in stored.split("\n\n")}
    assert {f"semcal_cli.{name}" for name in semcal_cli.__all__} - entries == {"semcal_cli.__version__"}
    (calibrate,) = (each for each in stored.split("\n\n") if each.startswith("semcal_cli.calibrate\n"))
    assert [line.strip().split(":")[0] for line in calibrate.splitlines()[1:-1]] == [
        *("drive", "config", "*"),
        *(name for name in list(inspect.signature(semcal_cli.calibrate).parameters)[2:-1]),
        "**arrays",
    ]
    assert "    drive: DriveInput | None = None\n" in calibrate
    assert "semcal_cli.api.arguments.DriveInput\n    TypeAlias = LoadedDrive | Drive | Path | str\n" in stored
    assert "    translation_m: float = 0.05\n" in stored  # the default of a setting alone


def test_the_reference_says_what_is_stable() -> None:
    page = (ROOT / "docs/python_reference.md").read_text()
    assert "two minor versions" in page.partition("## Stability")[2].partition("\n## ")[0]
