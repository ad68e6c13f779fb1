"""Names of the coordinate frames of a drive's sensors, as a recording states them."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from semcal_cli.errors import describe, mismatch
from semcal_cli.files.validation import StrictModel

MAX_FRAME_ID = 200
"""Maximum length of a name, in characters."""
_NEEDED = (
    f"a name of at most {MAX_FRAME_ID} printable characters, without spaces at its ends, $ and a leading -"
)


def _is_name(name: str) -> bool:
    """Return whether a text can name a frame: ROS's launch files and command lines compute `$(...)`, and take `-`."""
    is_text = 0 < len(name) <= MAX_FRAME_ID and name.isprintable() and name == name.strip()
    return is_text and "$" not in name and not name.startswith("-")


def _check_name(name: str) -> str:
    if not _is_name(name):
        raise mismatch(describe(name), _NEEDED)
    return name


_LENGTHS = {"minLength": 1, "maxLength": MAX_FRAME_ID}
FrameId = Annotated[str, AfterValidator(_check_name), Field(json_schema_extra=_LENGTHS)]


class FrameIds(StrictModel):
    """Names of the coordinate frames, ROS's `frame_id`, which files for a robot get."""

    lidar: FrameId | None = None
    """Frame of the sweeps."""
    camera: FrameId | None = None
    """Optical frame of the camera: x right, y down, z forward."""

    @staticmethod
    def check(name: str) -> None:
        """Check that a text can name a frame.

        Raises:
            ValueError: it cannot.
        """
        _check_name(name)

    @classmethod
    def of_recording(cls, lidar: str, camera: str | None) -> tuple[FrameIds | None, list[str]]:
        """Keep the names of a recording, which may have any text in their place.

        Returns:
            The names, None if neither can be kept; and a remark on each text that is left out.
        """
        texts = {"lidar": lidar, "camera": camera if camera and camera != lidar else ""}
        kept = {side: text for side, text in texts.items() if _is_name(text)}
        remarks = [
            f"the frame of the {side} is left out of frame_ids: {mismatch(describe(text), _NEEDED)}"
            for side, text in texts.items()
            if text and side not in kept
        ]
        return (cls(**kept) if kept else None), remarks

    @model_validator(mode="after")
    def _check_distinct(self) -> FrameIds:
        if self.lidar is not None and self.lidar == self.camera:
            raise mismatch(f"{describe(self.lidar)} for both", "two names")
        return self
