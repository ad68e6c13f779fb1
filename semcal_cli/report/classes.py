"""Agreement of each class of points with the classes of the pixels that it projects onto."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.drive.observations import Observations
from semcal_cli.report.overlay import over_chance

NUM_PIXEL_CLASSES = 3
"""Number of pixel classes that are named for each class of points."""


@dataclass(frozen=True)
class ClassAgreement:
    """The visible points of one class, and how well they agree with the pixels that they project onto."""

    name: str
    share: float
    """Share of the class in all pairs of a visible point and a pixel that it projects onto."""
    agreeing: float
    """Share of the class's pairs that are found more often than by chance: positive pointwise mutual information."""
    agreeing_before: float | None
    """The same share at the other pose, measured by the pairs there; None without another pose."""
    nats: float
    """Contribution of the class to the mutual information, in nats."""
    lands_on: tuple[tuple[str, float], ...]
    """Classes of pixels, with their shares in the class's pairs, largest first."""


def class_agreements(
    observations: Observations, agreement: _core.Agreement, before: _core.Agreement | None
) -> list[ClassAgreement]:
    """Describe each class of points that the camera sees, the most frequent first."""
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
