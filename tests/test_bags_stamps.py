"""Stamps of recordings: far off, standing, running backwards, and of another clock."""

from __future__ import annotations

from pathlib import Path

from bag_imports import (
    RECORDS,
    at,
    cloud,
    done,
    image,
    imported,
    info,
    refused,
    small,
)
from bags import NS, START_NS, BagWriter

from semcal_cli.importing.bags.candidates import longest_ascending


def test_a_stamp_that_is_far_off_and_a_clock_that_stands(tmp_path: Path) -> None:
    def off(index: int) -> int:
        return 400_000_000 * NS if index == 0 else 0

    path = small(tmp_path / "a", points=at(cloud(), off), image=at(image(), off))
    assert len(imported(path, tmp_path / "a/drive")["frames"]) == 5
    with BagWriter(tmp_path, "mcap library") as bag:
        for index in range(6):
            for name, maker in (("cam/camera_info", info()), ("cam/image_raw", image()), ("points", cloud())):
                bag.write(f"/{name}", maker(bag, index, START_NS + index * NS // 10), START_NS)
    assert len(imported(bag.path, tmp_path / "b/drive")["frames"]) == 6


def test_the_longest_ascending_part() -> None:
    assert longest_ascending([]) == []
    assert longest_ascending([9, 1, 2, 2, 3, 0, 4]) == [1, 3, 4, 6]
    assert longest_ascending([5, 4, 3]) == [2]


def test_times_of_receipt_and_clocks_that_differ(tmp_path: Path) -> None:
    path = small(tmp_path, points=at(cloud(), lambda index: -5 * NS))
    message = refused(path, tmp_path / "drive")
    assert "the clocks of /points and /cam/image_raw differ by 5.000 s; try --stamps receive" in message
    assert len(imported(path, tmp_path / "receive", by_receipt=True)["frames"]) == 6
    path = small(tmp_path / "zero", points=lambda bag, index, stamp: bag.cloud(RECORDS, 0))
    expected = "sweeps: found a stamp of zero, expected a time, or --stamps receive"
    assert expected in refused(path, tmp_path / "z")


def test_stamps_that_run_backwards_are_left_out(tmp_path: Path) -> None:
    def back(index: int) -> int:
        return -2 * NS if index >= 4 else 0

    found = done(small(tmp_path, points=at(cloud(), back), image=at(image(), back)), tmp_path / "drive")
    assert found.written.num_frames == 4
    assert found.left_out == {"pairs: their stamps run backwards": 2}
