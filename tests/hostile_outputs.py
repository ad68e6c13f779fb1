"""Hostile outputs, numbers and options of single commands."""

from hostile_commands import Hostile

OUTPUTS: dict[str, Hostile] = {
    "a drive that does not exist": Hostile(
        lambda folder: None, ("inspect", "none"), r"^semcal: error: none: no such file or folder$"
    ),
}
