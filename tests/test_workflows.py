"""The workflows on GitHub: what they run cannot change without a commit here."""

import re

from documentation import ROOT


def test_every_action_of_others_is_pinned_to_a_commit() -> None:
    """A tag can be moved to other code, which would then publish in our name."""
    used = [
        name
        for path in sorted((ROOT / ".github").rglob("*.yml"))
        for name in re.findall(r"uses: (?!\./)(.+)", path.read_text())
    ]
    assert "pypa/gh-action-pypi-publish" in {name.partition("@")[0] for name in used}
    assert [name for name in used if not re.fullmatch(r"[\w./-]+@[0-9a-f]{40} # v[\d.]+", name)] == []
