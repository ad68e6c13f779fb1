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
    """A way to give points and pixels classes whose mutual information depends on the pose."""

    observe: Callable[[Drive, Sweeps | None, bool], Observations]
    """Loads every frame of a drive with the classes of the cue, or, if the last argument is true, with its unprocessed
    data. Raises InputError or CalibrationError."""
    files: tuple[str, ...]
    """Keys of a frame's files that are read, in addition to its cloud and that cloud's labels."""
    config: Any = None
    """Settings of the cue, a dataclass that results record; None if there are none."""
    starts: StartsConfig | None = None
    """Starts from which a pose is refined, if the information has many maxima; None if one start is enough."""

    @property
    def settings(self) -> dict[str, Any]:
        """Settings of the cue, as results record them."""
        return {} if self.config is None else asdict(self.config)
