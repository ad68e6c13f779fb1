"""Names of the coordinate frames of a drive's sensors, as a recording states them."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from semcal_cli.errors import describe, mismatch
from semcal_cli.files.validation import StrictModel

MAX_FRAME_ID = 200
"""Maximum length of a name, in characters."""


def _is_name(name: str) -> bool:
    return 0 < len(name) <= MAX_FRAME_ID and name.isprintable() and name == name.strip()


def _check_name(name: str) -> str:
    if not _is_name(name):
        raise mismatch(describe(name), f"a name of at most {MAX_FRAME_ID} printable characters")
    return name


_LENGTHS = {"minLength": 1, "maxLength": MAX_FRAME_ID}
FrameId = Annotated[str, AfterValidator(_check_name), Field(json_schema_extra=_LENGTHS)]


class FrameIds(StrictModel):
    """Names of the coordinate frames, ROS's `frame_id`, which files for a robot get."""

    lidar: FrameId | None = None
    """Frame of the sweeps."""
    camera: FrameId | None = None
    """Optical frame of the camera: x right, y down, z forward."""

    @classmethod
    def of_recording(cls, lidar: str, camera: str | None) -> FrameIds | None:
        """Keep the names of a recording, which may have any text in their place; None if neither can be kept."""
        names = {"lidar": lidar, "camera": "" if camera in (None, lidar) else camera}
        kept = {side: name for side, name in names.items() if _is_name(name)}
        return cls(**kept) if kept else None

    @model_validator(mode="after")
    def _check_distinct(self) -> FrameIds:
        if self.lidar is not None and self.lidar == self.camera:
            raise mismatch(f"{describe(self.lidar)} for both", "two names")
        return self
