"""How well each class of points agrees with what it lands on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.drive.observations import Observations
from semcal_cli.report.overlay import over_chance

NUM_PIXEL_CLASSES = 3
"""So many classes of pixels are named for each class of points."""


@dataclass(frozen=True)
class ClassAgreement:
    """Visible points of one class."""

    name: str
    share: float
    """Of all pairs of a visible point and the pixels it lands on."""
    agreeing: float
    """Share of its pairs that are found more often than by chance: positive pointwise mutual information."""
    agreeing_before: float | None
    """Likewise at the other pose, by the same measure there."""
    nats: float
    """What it adds to the mutual information."""
    lands_on: tuple[tuple[str, float], ...]
    """Classes of pixels, and the shares of its pairs on them, largest first."""


def class_agreements(
    observations: Observations, agreement: _core.Agreement, before: _core.Agreement | None
) -> list[ClassAgreement]:
    """Tell of each class of points that the camera sees, the most frequent first."""
    joint = agreement.joint
    total = max(joint.sum(), 1.0)
    shares, agreeing = joint.sum(axis=1) / total, _agreeing(joint)
    agreeing_before = None if before is None else _agreeing(before.joint)
    # A pair that was never seen adds nothing.
    nats = (joint * np.log(np.where(joint > 0.0, over_chance(joint), 1.0))).sum(axis=1) / total
    found = []
    for index in np.argsort(-shares, kind="stable").tolist():
        if shares[index] == 0.0:
            continue
        row = joint[index] / joint[index].sum()
        largest = np.argsort(-row, kind="stable")[:NUM_PIXEL_CLASSES].tolist()
        found.append(
            ClassAgreement(
                name=observations.point_class_names[index],
                share=float(shares[index]),
                agreeing=float(agreeing[index]),
                agreeing_before=None if agreeing_before is None else float(agreeing_before[index]),
                nats=float(nats[index]),
                lands_on=tuple(
                    (observations.image_class_names[i], float(row[i])) for i in largest if row[i] > 0
                ),
            )
        )
    return found


def _agreeing(joint: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    totals = joint.sum(axis=1)
    above = np.where(over_chance(joint) > 1.0, joint, 0.0).sum(axis=1)
    return np.asarray(above / np.where(totals > 0.0, totals, 1.0))
