"""Arrays of a program in place of files: the same numbers, to the bit, and errors that name the argument."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

sys.path.insert(0, str(Path(__file__).parent / "benchmarks"))
from arrays import arrays_of

from semcal_cli.config import CalibrationConfig, CueName
from semcal_cli.drive.document import Drive
from semcal_cli.drive.loading import load
from semcal_cli.drive.observations import Observations

CUES: tuple[tuple[CueName, ...], ...] = (
    ("labels",),
    ("segments",),
    ("edges",),
    ("intensity",),
    ("segments", "intensity"),
    ("labels", "intensity"),
)


def numbers(observations: Observations) -> Iterator[npt.NDArray[Any] | None]:
    """All arrays that a calibration computes with."""
    for cloud, image in zip(observations.clouds, observations.images, strict=True):
        yield from (cloud.points, cloud.classes, cloud.vectors, cloud.exposed_s)
        yield from (image.classes, image.vectors)
        for shares in (cloud.shares, image.shares):
            yield None if shares is None else shares.classes


def assert_same(a: Observations, b: Observations) -> None:
    for left, right in zip(numbers(a), numbers(b), strict=True):
        np.testing.assert_array_equal(left, right)
        assert left is None or left.dtype == right.dtype
    for observed, other in zip(a.frame_observations, b.frame_observations, strict=True):
        assert (observed.weight, observed.twist_per_s, observed.is_rigid) == (
            other.weight,
            other.twist_per_s,
            other.is_rigid,
        )
    assert (a.point_class_names, a.image_class_names) == (b.point_class_names, b.image_class_names)


@pytest.mark.parametrize("cues", CUES, ids="+".join)
def test_arrays_load_as_files_do(synthetic: Drive, cues: tuple[CueName, ...]) -> None:
    config = CalibrationConfig(cues=cues)
    of_files, of_arrays = (
        load(each, config) for each in (synthetic, Drive.from_arrays(**arrays_of(synthetic)))
    )
    assert_same(of_arrays.observations, of_files.observations)
    assert of_arrays.observations.starts == of_files.observations.starts
