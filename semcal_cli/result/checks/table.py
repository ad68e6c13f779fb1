"""All checks, by the sections of docs/troubleshooting.md."""

from semcal_cli.result.checks import belonging, camera, convergence, determination, mounting, stated
from semcal_cli.result.checks.check import Check

SECTIONS: dict[str, tuple[Check, ...]] = {
    title: tuple(value for value in vars(module).values() if isinstance(value, Check))
    for title, module in {
        "The mounting is not clear": mounting,
        "The labels do not determine the pose": determination,
        "The search for the pose did not end well": convergence,
        "Files do not belong together": belonging,
        "Camera, clocks and motion": camera,
        "What you stated contradicts the data": stated,
    }.items()
}
"""Checks of each section, in the order of their modules."""
CHECKS = {check.topic: check for checks in SECTIONS.values() for check in checks}
"""All checks by topic."""
