"""A cue: what points and pixels are compared by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from semcal_cli.config import StartsConfig
from semcal_cli.drive.document import Drive
from semcal_cli.drive.observations import Observations
from semcal_cli.files.point_clouds import Sweeps


@dataclass(frozen=True, kw_only=True)
class Cue:
    """A way to give points and pixels classes whose mutual information tells the pose."""

    observe: Callable[[Drive, Sweeps | None, bool], Observations]
    """Loads every frame of a drive with the classes of the cue, or, if the last argument is true, with what it compares
    as it is in the files. Raises InputError or CalibrationError."""
    files: tuple[str, ...]
    """Keys of a frame's files that are read, beside its cloud and that cloud's labels."""
    config: Any = None
    """Settings of the cue, a dataclass that results record; None without any."""
    starts: StartsConfig | None = None
    """From where a pose is refined, if the information has many tops; None if one start leads to the top."""

    @property
    def settings(self) -> dict[str, Any]:
        """Settings of the cue, as results record them."""
        return {} if self.config is None else asdict(self.config)
