"""Recordings of ROS become drives: every storage, and recordings that are damaged or have no index."""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bag_imports import COLORS, RECORDS, T_MOUNT, fill, imported, refused, remarks, run_cli, small
from bags import KINDS, NS, START_NS, BagWriter, cut, write_drive_as_bag
from conftest import run
from mcap.writer import IndexType

from semcal_cli.config.file_limits import MAX_DOCUMENT_BYTES
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.files.image_files import read_image
from semcal_cli.importing.bags.bag import Bag
from semcal_cli.importing.bags.bag_import import import_bag
from semcal_cli.importing.bags.topics import BagRequest
from semcal_cli.observations.reading import read_clouds


@pytest.mark.parametrize("kind", KINDS)
def test_a_drive_comes_back_from_each_storage(kind: str, synthetic: Drive, tmp_path: Path) -> None:
    path = write_drive_as_bag(synthetic, tmp_path, kind, T_camera_lidar=T_MOUNT)
    imported(path, tmp_path / "drive")
    drive = read_drive(tmp_path / "drive")
    # No recording states how well K is known.
    assert drive.camera == synthetic.camera.model_copy(update={"intrinsics_sigma": None})
    np.testing.assert_allclose(drive.T_camera_lidar or 0, T_MOUNT, atol=1e-12)
    assert len(drive.frames) == len(synthetic.frames)
    for mine, theirs in zip(read_clouds(drive), read_clouds(synthetic), strict=True):
        np.testing.assert_array_equal(mine.points, theirs.points)
    for index, (mine, theirs) in enumerate(zip(drive.frames, synthetic.frames, strict=True)):
        assert mine.points_stamp == pytest.approx(START_NS / NS + index / 10, abs=1e-6)
        assert mine.image_stamp == pytest.approx(mine.points_stamp + 0.01, abs=1e-6)
        images = (
            read_image(read_drive.resolve(each.image))
            for read_drive, each in ((drive, mine), (synthetic, theirs))
        )
        np.testing.assert_array_equal(*images)


@pytest.mark.parametrize(
    ("kind", "compression"),
    [("ros1", "LZ4"), ("ros1", "BZ2"), ("mcap library", "LZ4"), ("mcap library", "ZSTD"), ("sqlite3", "MESSAGE"),
     ("mcap", "MESSAGE"), ("sqlite3", "FILE"), ("mcap", "FILE"), ("mcap", "STORAGE")],
)  # fmt: skip
def test_compressed_recordings(kind: str, compression: str, synthetic: Drive, tmp_path: Path) -> None:
    path = write_drive_as_bag(synthetic, tmp_path, kind, compression=compression)
    assert len(imported(path, tmp_path / "drive")["frames"]) == len(synthetic.frames)


def test_the_pose_is_that_of_the_drive_itself(synthetic: Drive, tmp_path: Path) -> None:
    """Import, take over the labels, calibrate: the same pose to 1e-9."""
    path = write_drive_as_bag(synthetic, tmp_path, "mcap library")
    document = imported(path, tmp_path / "drive")
    first = yaml.safe_load(synthetic.path.read_text())
    for mine, theirs in zip(document["frames"], first["frames"], strict=True):
        for side in ("image_labels", "point_labels"):
            mine[side] = str(synthetic.resolve(theirs[side]).absolute())
    document |= {key: first[key] for key in ("classes", "ignore", "lidar") if key in first}
    (tmp_path / "drive/drive.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
    found = []
    for drive in (tmp_path / "drive", synthetic.path):
        out = tmp_path / f"{len(found)}.yaml"
        run_cli("calibrate", drive, "-o", out, code=None)
        found.append(np.array(yaml.safe_load(out.read_text())["T_camera_lidar"]))
    np.testing.assert_allclose(*found, atol=1e-9)


def test_the_parts_of_a_recording_are_one(synthetic: Drive, tmp_path: Path) -> None:
    paths = []
    for name, chosen in (("a", slice(0, 3)), ("b", slice(3, 6))):
        (tmp_path / name).mkdir()
        part = synthetic.model_copy(update={"frames": synthetic.frames[chosen]})
        paths.append(write_drive_as_bag(part, tmp_path / name, "ros1"))
    # The stamps of both parts are the same: a second part that begins again is told by its stamps.
    found = import_bag(BagRequest(paths), tmp_path / "drive")
    assert found.written.num_frames == 3
    assert found.left_out.total() == 3


INDEXES: dict[str, Any] = {
    "without those of messages": {"index_types": IndexType.ALL & ~IndexType.MESSAGE},
    "without any": {"index_types": IndexType.NONE},
    "without statistics": {"use_statistics": False},
    "without chunks": {"use_chunking": False},
    "without a summary": {"index_types": IndexType.NONE, "use_statistics": False, "repeat_channels": False,
                          "repeat_schemas": False, "use_summary_offsets": False},
}  # fmt: skip


@pytest.mark.parametrize("index", INDEXES)
def test_an_index_that_lacks_something(index: str, tmp_path: Path) -> None:
    """The same frames as with a whole one; without indexes of messages, their times are known by chunks alone."""
    count = 6 if index == "without those of messages" else 60
    drives = []
    for name, options in (("whole", {}), ("part", INDEXES[index])):
        (tmp_path / name).mkdir()
        path = fill(BagWriter(tmp_path / name, "mcap library", **options), count)
        drives.append(imported(path, tmp_path / name / "drive", max_frames=9)["frames"])
    assert drives[0] == drives[1]


def test_a_database_that_was_not_closed_says_so(tmp_path: Path) -> None:
    path = small(tmp_path)
    (path / "bag.db3-wal").write_bytes(bytes(5000))
    told = remarks(path, tmp_path / "drive")
    assert "bag.db3-wal, 5,000 bytes: the recording was not closed" in told


def test_ten_thousand_topics_and_unknown_types(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path, "mcap library")
    for index in range(10_000):
        bag.write_raw(f"/odd/{index:05d}", "odd_msgs/msg/Odd", b"\0\1\0\0\7", START_NS)
    path = fill(bag)
    assert len(imported(path, tmp_path / "drive")["frames"]) == 6
    listed = run_cli("import", "bag", path, "--list")
    assert len(listed.stdout.splitlines()) == 10_004


@pytest.mark.parametrize("kind", ["mcap library", "sqlite3"])
def test_a_recording_that_is_cut_off_gives_what_is_whole(
    kind: str, synthetic: Drive, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = write_drive_as_bag(synthetic, tmp_path, kind, T_camera_lidar=T_MOUNT)
    file = next(path.glob("*.db3")) if path.is_dir() else path
    counts = []
    for tenth in range(10):
        part = cut(file, tenth / 10 + 0.05, tmp_path / f"{tenth}{file.suffix}")
        code, _, stderr = run(capfd, "import", "bag", part, "-o", tmp_path / f"drive{tenth}")
        if code == 0:
            counts.append(len(read_drive(tmp_path / f"drive{tenth}").frames))
            assert "damaged" in stderr
        else:
            counts.append(0)
            assert (code, len(stderr.splitlines())) == (1, 1)
            assert str(part) in stderr
    assert counts == sorted(counts)
    assert counts[0] == 0
    assert counts[-1] >= len(synthetic.frames) - 1


@pytest.mark.parametrize(
    ("kind", "compression"), [("ros1", "BZ2"), ("mcap library", "LZ4"), ("mcap library", "")]
)
def test_damage_in_the_middle_costs_what_lies_there(
    kind: str, compression: str, synthetic: Drive, tmp_path: Path
) -> None:
    """Bzip2 and MCAP have checksums; without one, nobody can tell."""
    path = write_drive_as_bag(synthetic, tmp_path, kind, compression=compression)
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 64] = bytes(64)
    path.write_bytes(content)
    assert "left out damaged data" in remarks(path, tmp_path / "drive")
    assert 1 <= len(read_drive(tmp_path / "drive").frames) < len(synthetic.frames)


def test_a_bag_without_its_index_names_what_mends_it(synthetic: Drive, tmp_path: Path) -> None:
    path = write_drive_as_bag(synthetic, tmp_path, "ros1")
    for share in (0.05, 0.5, 0.95):
        part = cut(path, share, tmp_path / "part.bag")
        message = refused(part, tmp_path / "drive")
        assert message.startswith(f"{part}: found a recording that cannot be read: ")
        assert message.endswith("; if it is damaged, `rosbag reindex` may repair it")


@pytest.mark.parametrize("name", ["other.db3?x.db3", "run#1.db3", "50%25.db3"])
def test_a_database_is_the_one_that_is_named(name: str, tmp_path: Path) -> None:
    """SQLite opens these as other.db3, run and 50%.db3 where names are not quoted."""
    for path, count in ((tmp_path / name, 6), (tmp_path / "other.db3", 2), (tmp_path / "50%.db3", 2)):
        (small(tmp_path / path.name[:2] / str(count), count=count) / "bag.db3").rename(path)
    assert len(imported(tmp_path / name, tmp_path / "drive")["frames"]) == 6


TABLES = "found no tables 'topics' and 'messages'"
ODD_ROWS = "1 rows whose timestamp is not a whole number or whose data are not bytes"
DATABASES = {
    "a timestamp that is text": ("UPDATE messages SET timestamp = 'soon' WHERE id = 3", ODD_ROWS),
    "a timestamp with a fraction": ("UPDATE messages SET timestamp = 0.5 WHERE id = 3", ODD_ROWS),
    "a message that is text": ("UPDATE messages SET data = 'x' WHERE id = 3", ODD_ROWS),
    "a name that is none": ("UPDATE topics SET name = x'00' WHERE id = 3", "found no topic of sweeps"),
    "a view of messages": ("ALTER TABLE messages RENAME TO m; CREATE VIEW messages AS SELECT * FROM m", TABLES),
    "a view of topics": ("ALTER TABLE topics RENAME TO t; CREATE VIEW topics AS SELECT * FROM t", TABLES),
    "no topics": ("DROP TABLE topics", TABLES),
}  # fmt: skip


@pytest.mark.parametrize("fault", DATABASES)
def test_a_database_that_holds_anything_else(fault: str, tmp_path: Path) -> None:
    script, expected = DATABASES[fault]
    file = small(tmp_path) / "bag.db3"
    with closing(sqlite3.connect(file)) as database:
        database.executescript(script)
    if expected != ODD_ROWS:
        assert expected in refused(file, tmp_path / "drive")
        return
    assert expected in remarks(file, tmp_path / "drive")
    assert len(read_drive(tmp_path / "drive").frames) == 5


def test_an_index_that_is_out_of_order_gives_nothing_that_was_not_asked_for(tmp_path: Path) -> None:
    file = small(tmp_path) / "bag.db3"
    with closing(sqlite3.connect(file)) as database:
        ((page,),) = database.execute("SELECT rootpage FROM sqlite_master WHERE name = 'timestamp_idx'")
        ((size,),) = database.execute("PRAGMA page_size")
        times_ns = sorted({time_ns for (time_ns,) in database.execute("SELECT timestamp FROM messages")})
    content = file.read_bytes()
    place = content.index(times_ns[1].to_bytes(8, "big"), (page - 1) * size)
    early = (times_ns[0] - NS).to_bytes(8, "big")
    file.write_bytes(content[:place] + early + content[place + 8 :])
    with Bag([file]) as bag:
        found = [message.received_ns for message in bag.messages(bag.topics)]
        assert len(found) > 10
        assert bag.start_ns <= min(found) <= max(found) <= bag.end_ns


@pytest.mark.parametrize("kind", KINDS)
def test_two_types_of_one_name_are_two_topics(kind: str, tmp_path: Path) -> None:
    def both(bag: BagWriter, index: int, stamp: int) -> Any:
        bag.write("/points", bag.image(COLORS, "bgr8", stamp), stamp)
        bag.write("/cam/image_raw", bag.cloud(RECORDS, stamp), stamp)
        return bag.cloud(RECORDS, stamp)

    path = small(tmp_path, kind, points=both)
    document = imported(path, tmp_path / "drive", points="/points", image="/cam/image_raw")
    assert len(document["frames"]) == 6
    assert "found 2 topics of sweeps" in refused(path, tmp_path / "other")


def test_metadata_that_cannot_be_read(tmp_path: Path) -> None:
    path = small(tmp_path)
    metadata = path / "metadata.yaml"
    metadata.write_bytes(b"#" * (MAX_DOCUMENT_BYTES + 1))
    assert "metadata.yaml: found 16,777,217 bytes, needed at most" in refused(path, tmp_path / "drive")
    metadata.unlink()
    os.mkfifo(metadata)
    assert "metadata.yaml: found a special file" in refused(path, tmp_path / "drive")
    metadata.unlink()
    metadata.write_text("rosbag2_bagfile_information: {relative_file_paths: [gone.db3]}")
    assert "found no file 'gone.db3'" in remarks(path, tmp_path / "drive")


def test_a_recording_without_its_metadata(synthetic: Drive, tmp_path: Path) -> None:
    path = write_drive_as_bag(synthetic, tmp_path, "mcap")
    (path / "metadata.yaml").unlink()
    assert len(imported(path, tmp_path / "drive")["frames"]) == len(synthetic.frames)
    (path / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    assert len(imported(path, tmp_path / "again")["frames"]) == len(synthetic.frames)


@pytest.mark.parametrize(
    ("name", "content"),
    [("a.bag", b""), ("a.bag", b"#ROSBAG V2.0\n"), ("a.bag", b"#ROSBAG V1.2\n"), ("a.mcap", b"\x89MCAP0\r\n"),
     ("a.db3", b"SQLite format 3\0"), ("a.db3", b"SQLite format 3\0" + bytes(4096)), ("a.txt", b"hello"),
     ("a.mcap", b"\x89MCAP0\r\n\x01" + b"\xff" * 30)],
)  # fmt: skip
def test_a_file_that_is_no_recording_gets_one_line(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    assert str(tmp_path / name) in refused(tmp_path / name, tmp_path / "drive")
    assert "no such file" in refused(tmp_path / "missing.bag", tmp_path / "drive")


def test_bags_are_read_in_the_order_of_receipt(synthetic: Drive, tmp_path: Path) -> None:
    path = write_drive_as_bag(synthetic, tmp_path, "mcap")
    with Bag([path]) as bag:
        times = [message.received_ns for message in bag.messages(bag.topics)]
    assert times == sorted(times)
    assert len(times) == 3 * len(synthetic.frames)
