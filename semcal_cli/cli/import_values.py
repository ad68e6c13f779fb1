"""Values of the options of `semcal import`, each parsed and checked."""

from __future__ import annotations

from typing import Any, get_args

import click

from semcal_cli.config.point_files import MAX_UNIT_S, SECONDS_PER_UNIT, PointColumn
from semcal_cli.errors import InputError

KEYS = {"rate_hz": "HZ", "seam_deg": "SEAM_DEG"}
"""What the parts of `--spin` are called there."""


class SpinOfLidar(click.ParamType):  # type: ignore[type-arg]
    """HZ:cw|ccw:SEAM_DEG:STAMP, as the keys of `lidar: spin:` in a drive. The stamp may be left out."""

    name = "HZ:cw|ccw:SEAM_DEG[:start|middle|end]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> dict[str, Any]:
        """Parse the spin."""
        from semcal_cli.drive.lidar import Spin
        from semcal_cli.files.validation import validate

        if isinstance(value, dict):
            return value
        parts = str(value).split(":")
        spin = dict(zip(("rate_hz", "clockwise", "seam_deg", "stamp"), parts, strict=False))
        try:
            numbers = {key: float(spin[key]) for key in ("rate_hz", "seam_deg")}
            is_clockwise = {"cw": True, "ccw": False}[spin["clockwise"]]
            if len(parts) > len(spin):
                raise ValueError(value)
        except (KeyError, ValueError):
            needed = f"{self.name}, such as 10:cw:180:end"
            self.fail(f"found {str(value)[:40]!r}, expected {needed}.", param, ctx)
        try:
            return validate(Spin, spin | numbers | {"clockwise": is_clockwise}, "", KEYS).model_dump()
        except InputError as error:
            self.fail(str(error), param, ctx)


class OwnPointsOfLidar(click.ParamType):  # type: ignore[type-arg]
    """FIELD=FIRST:LAST, as the keys of `lidar: own_points:` in a drive; or FIELD=VALUE."""

    name = "FIELD=FIRST[:LAST]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> dict[str, Any]:
        """Parse the field and its values."""
        from semcal_cli.drive.lidar import Lidar
        from semcal_cli.files.validation import validate

        if isinstance(value, dict):
            return value
        field, _, values = str(value).rpartition("=")
        first, separator, last = values.partition(":")
        try:
            numbers = [float(first), float(last if separator else first)]
        except ValueError:
            self.fail(f"found {str(value)[:40]!r}, expected {self.name}, such as ring=0:31.", param, ctx)
        try:
            lidar = validate(Lidar, {"own_points": {"field": field, "range": numbers}}, "")
            return lidar.model_dump(mode="json")["own_points"]  # type: ignore[no-any-return]
        except InputError as error:
            self.fail(str(error), param, ctx)


class PointColumns(click.ParamType):  # type: ignore[type-arg]
    """Comma-separated columns of a file without a header."""

    name = "columns"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[PointColumn, ...]:
        """Parse the columns: x, y and z, and any others, each once."""
        if isinstance(value, tuple):
            return value
        known = get_args(PointColumn)
        names: list[Any] = [name.strip() for name in str(value).split(",")]
        used = [name for name in names if name != "_"]
        if not {*"xyz"} <= {*used} or not {*names} <= {*known} or len({*used}) < len(used):
            needed = f"expected x, y and z, and any of {', '.join(known[3:])}, each once but _"
            self.fail(f"found {str(value)[:40]!r}, {needed}.", param, ctx)
        return tuple(names)


class TimeUnit(click.ParamType):  # type: ignore[type-arg]
    """A unit of time, or its length in seconds."""

    name = "unit"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str | float:
        """Parse the unit."""
        if value in SECONDS_PER_UNIT:
            return str(value)
        try:
            seconds = float(value)
        except ValueError:
            seconds = 0.0
        if not 0.0 < seconds <= MAX_UNIT_S:
            needed = f"expected {', '.join(SECONDS_PER_UNIT)} or its length in seconds"
            self.fail(f"found {str(value)[:40]!r}, {needed}.", param, ctx)
        return seconds
