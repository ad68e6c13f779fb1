"""What to do next, as commands to paste into a shell."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from semcal_cli.documentation import ADDRESS, entry_address
from semcal_cli.drive.document import DRIVE_FILE
from semcal_cli.errors import shell
from semcal_cli.findings.finding import Leading
from semcal_cli.observations.cues.cue_table import cues_of_options, policy_of

if TYPE_CHECKING:
    from semcal_cli.result.calibration_document import CalibrationDocument

Rows: TypeAlias = list[tuple[str, str]]
"""Pairs of a label and a text."""
_TROUBLESHOOTING = f"{ADDRESS}/troubleshooting/"
"""Address of the page that explains every finding, for results of older versions, which have no topics."""


def after_calibration(
    calibration: CalibrationDocument,
    result: Path,
    leading: Leading | None = None,
    *,
    has_overlays: bool = False,
) -> Rows:
    """Describe what to do with a calibration that was written to a file.

    A trusted result is looked at, converted for a robot, and verified later. Each kind of reason against another one
    has an entry in the documentation, and what the first one can be corrected by comes first. A result that nothing
    checked is refined, which checks it.

    Args:
        calibration: The calibration.
        result: Its file.
        leading: The reasons to name, if not all are.
        has_overlays: Whether its overlays are drawn already.
    """
    drive = Path(os.path.normpath(result.parent / calibration.input.drive))
    drive = drive.parent if drive.name == DRIVE_FILE else drive
    if calibration.status == "not_assessed":
        refined = result.with_stem(f"{result.stem}_refined")
        return [("next", shell("refine", drive, "--init", result, "-o", refined))]
    if calibration.status == "not_trusted":
        leading = leading or Leading(len(calibration.topics))
        entries = [*map(entry_address, dict.fromkeys(calibration.topics[: leading.num]))] or [
            _TROUBLESHOOTING
        ]
        labels = ["why", *[""] * (len(entries) - 1)]
        correction = _correction(calibration, drive, result, leading.options)
        commands = [*correction, shell("inspect", drive), shell("view", drive, result)]
        return [
            *zip(["next", *[""] * (len(commands) - 1)], commands, strict=True),
            *zip(labels, entries, strict=True),
        ]
    if calibration.status == "trusted":
        overlay = shell("overlay", drive, result, "-o", result.with_name(f"{result.stem}_overlay"))
        return [
            *([] if has_overlays else [("next", overlay)]),
            ("for a robot", shell("convert", result, "--to", "ros2-static-transform")),
            *(
                []
                if calibration.camera is None
                else [("with its K", shell("convert", result, "--to", "camera-info"))]
            ),
            ("later", f"semcal verify NEW_DRIVE {shlex.quote(str(result))}"),
        ]
    return []


def _correction(
    calibration: CalibrationDocument, drive: Path, result: Path, options: Sequence[str]
) -> list[str]:
    """Write the calibration with options that correct this one, if there are any and it was made without them."""
    settings = calibration.settings.options
    if not options or "jointly" in settings:
        return []
    cues = cues_of_options(settings)
    cue_options = ["--cue", ",".join(cues)] if "cues" in settings else []
    start = ["--init", result] if policy_of(cues).needs_near_start else []
    corrected = result.with_stem(f"{result.stem}_corrected")
    return [shell("calibrate", drive, *cue_options, *start, *options, "-o", corrected)]
