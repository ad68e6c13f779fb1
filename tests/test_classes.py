import numpy as np
import pytest

from semcal_cli.observations.observations import NO_CLASS
from semcal_cli.observations.reading import class_table


def test_ids_are_numbered_in_order_and_ignored_ones_carry_nothing() -> None:
    table = class_table([np.array([7, 3, 0], np.uint16), np.array([[40000]], np.uint16)], {}, [0])
    assert table.names == ("3", "7", "40000")
    np.testing.assert_array_equal(
        table(np.array([0, 3, 7, 40000, 9], np.uint16))[0], [NO_CLASS, 0, 1, 2, NO_CLASS]
    )


def test_names_merge_ids_and_drop_the_unlisted() -> None:
    named = {"road": [40, 44], "car": [10], "absent": [99]}
    table = class_table([np.array([44, 40, 10, 5], np.uint16)], named, [])
    assert table.names == ("road", "car")
    np.testing.assert_array_equal(table(np.array([40, 44, 10, 5], np.uint16))[0], [0, 0, 1, NO_CLASS])


def test_more_classes_than_bytes_hold() -> None:
    with pytest.raises(ValueError, match="found 300 classes, needed at most 255"):
        class_table([np.arange(300, dtype=np.uint16)], {}, [])
