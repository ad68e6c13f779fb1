"""Hostile batches: names, lists, results folders and what lies in them."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

from hostile_commands import Hostile
from hostile_files import absent, pipe

from semcal_cli.batch.folders import MARK

BOTH = ("batch", "drive", "other", "-o")
QUICK = ("--", "--no-polish", "--search-deg", "5", "--init", "other")
PRECIOUS = "a year of work\n"
APART = "needed a folder apart from the drives$"
NEEDED = "needed a folder that is new, empty or of a batch$"
WHOLE_BATCH = r"^summary +out/summary.csv, out/summary.jsonl$"
"""Last line of a batch that did all drives, whatever became of them."""
UNKNOWN = f"which no batch wrote, {NEEDED}"


def write(name: str, content: bytes = PRECIOUS.encode()) -> Callable[[Path], object]:
    """Write a file, and the folders that it needs."""

    def make(folder: Path) -> None:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)

    return make


def link(name: str, target: str) -> Callable[[Path], object]:
    """Write a file `precious`, and make a link."""

    def make(folder: Path) -> None:
        (folder / "precious").write_text(PRECIOUS)
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).symlink_to(folder / target)

    return make


def moved(folder: Path) -> None:
    """Move the points out of a drive, which then names them by their path, and write a log beside them."""
    points = folder / "elsewhere/points"
    points.parent.mkdir()
    (folder / "drive/points").rename(points)
    drive = folder / "drive/drive.yaml"
    drive.write_text(drive.read_text().replace("points: points/", "points: ../elsewhere/points/"))
    (points / "log.txt").write_text(PRECIOUS)


def linked(folder: Path) -> None:
    """Move the points out of a drive, and leave a link."""
    points = folder / "elsewhere/points"
    points.parent.mkdir()
    (folder / "drive/points").rename(points)
    (folder / "drive/points").symlink_to(points)
    (points / "log.txt").write_text(PRECIOUS)


def results_of_a_batch(folder: Path) -> None:
    """Write what a batch leaves, with the results of a drive."""
    for name, content in (
        (".lock", MARK),
        ("third/.semcal_batch", MARK),
        ("third/log.txt", PRECIOUS.encode()),
    ):
        write(f"out/{name}", content)(folder)


def no_work(folder: Path) -> None:
    assert not list(folder.rglob("summary.*"))


def reasons(folder: Path) -> list[str]:
    lines = (folder / "out/summary.jsonl").read_text().splitlines()
    return [(json.loads(line)["reasons"] or [""])[0] for line in lines]


def reason_is(reason: str) -> Callable[[Path], object]:
    """Check the reason of the only drive that failed."""

    def check(folder: Path) -> None:
        assert [found for found in reasons(folder) if found.startswith(str(folder))] == [f"{folder}/{reason}"]

    return check


def drive_of_bytes(folder: Path) -> None:
    shutil.copytree(folder / "other", os.fsdecode(os.fsencode(folder / "caf") + b"\xe9"))  # Latin-1


def drive_named(name: str) -> Callable[[Path], object]:
    return lambda folder: shutil.copytree(folder / "other", folder / name)


FOLDERS: dict[str, Hostile] = {
    "results where the drives are": Hostile(
        write("log.txt"),
        (*BOTH, "."),
        rf"^semcal: error: \.: found a folder that holds drive drive, {APART}",
        kept=("log.txt",),
        check=no_work,
    ),
    "results in a drive": Hostile(
        write("drive/log.txt"),
        (*BOTH, "drive/results"),
        rf"^semcal: error: drive/results: found a folder in drive drive, {APART}",
        kept=("drive/log.txt",),
        check=no_work,
    ),
    "results that a link leads into a drive": Hostile(
        link("out", "drive"),
        (*BOTH, "out"),
        rf"^semcal: error: out: found the folder of drive drive, {APART}",
        check=no_work,
    ),
    "results beside a drive file": Hostile(
        write("drive/log.txt"),
        ("batch", "drive/drive.yaml", "-o", "drive"),
        rf"^semcal: error: drive: found the folder of drive drive/drive.yaml, {APART}",
        kept=("drive/log.txt",),
        check=no_work,
    ),
    **{
        f"results where a drive's files are, {output}": Hostile(
            moved,
            (*BOTH, output),
            rf"^semcal: error: {output}: found {found} files of drive drive, {APART}",
            kept=("elsewhere/points/log.txt",),
            check=no_work,
        )
        for output, found in (
            ("elsewhere/points", "a folder with"),
            ("elsewhere", "a folder that holds"),
            ("elsewhere/points/out", "a folder in one with"),
        )
    },
    "results where a link in a drive leads": Hostile(
        linked,
        (*BOTH, "elsewhere/points"),
        rf"^semcal: error: elsewhere/points: found a folder with files of drive drive, {APART}",
        kept=("elsewhere/points/log.txt",),
        check=no_work,
    ),
    "results where one drive of another batch has them": Hostile(
        results_of_a_batch,
        (*BOTH, "out/third"),
        rf"^semcal: error: out/third: found the results of one drive of another batch, {NEEDED}",
        kept=("out/third/log.txt",),
    ),
    **{
        f"results in those of another batch, {output}": Hostile(
            results_of_a_batch,
            (*BOTH, output),
            rf"^semcal: error: {output}: found a folder in .*/{above}, the results of another batch, {NEEDED}",
            kept=("out/third/log.txt",),
        )
        for output, above in (("out/new", "out"), ("out/a/b", "out"), ("out/third/new", "out/third"))
    },
    "a drive's results where another batch has its own": Hostile(
        write("out/drive/.lock", MARK),
        (*BOTH, "out"),
        rf"^semcal: error: out/drive: found the results of another batch, {NEEDED}",
        check=no_work,
    ),
    "a person's folder for results": Hostile(
        write("out/summary.csv"),
        (*BOTH, "out"),
        rf"^semcal: error: out: found summary.csv, {UNKNOWN}",
        kept=("out/summary.csv",),
    ),
    "another program's lock": Hostile(
        write("out/.lock"),
        (*BOTH, "out"),
        rf"^semcal: error: out: found .lock, {UNKNOWN}",
        kept=("out/.lock",),
        check=no_work,
    ),
    "a person's folder for a drive's results": Hostile(
        write("out/other/calibration.yaml"),
        (*BOTH, "out"),
        rf"^semcal: error: out/other: found calibration.yaml, {UNKNOWN}",
        kept=("out/other/calibration.yaml",),
        check=no_work,
    ),
    "a person's record": Hostile(
        write("out/other/record.json", b'{"outcome": 1}'),
        (*BOTH, "out"),
        rf"^semcal: error: out/other: found record.json, {UNKNOWN}",
        check=no_work,
    ),
    "a link for a drive's results": Hostile(
        link("out/drive", "other"),
        (*BOTH, "out"),
        r"^semcal: error: out/drive: found a link, needed a folder or nothing$",
        check=no_work,
    ),
    "a link for the log": Hostile(
        link("out/drive/log.txt", "precious"),
        (*BOTH, "out"),
        rf"^semcal: error: out/drive: found log.txt, {UNKNOWN}",
        kept=("precious",),
        check=no_work,
    ),
    "a link for the lock": Hostile(
        link("out/.lock", "precious"),
        (*BOTH, "out"),
        r"^semcal: error: out/.lock: found a link, needed a file or nothing$",
        kept=("precious",),
        check=no_work,
    ),
    "a link for the summary": Hostile(
        link("out/summary.jsonl", "precious"),
        (*BOTH, "out"),
        r"^semcal: error: out/summary.jsonl: found a link, needed a file or nothing$",
        kept=("precious",),
    ),
}
PIPES: dict[str, Hostile] = {
    **{
        f"a pipe for {name}": Hostile(
            pipe(f"out/{name}"),
            (*BOTH, "out"),
            rf"^semcal: error: out/{name}: found a pipe, needed a file or nothing$",
        )
        for name in (".lock", "summary.csv", "summary.jsonl")
    },
    **{
        f"a pipe for a drive's {name}": Hostile(
            pipe(f"out/drive/{name}"),
            ("batch", "drive", "-o", "out"),
            WHOLE_BATCH,
            check=reason_is(f"out/drive/{name}: found a pipe, needed a file or nothing"),
        )
        for name in (
            ".semcal_batch",
            "record.json",
            "times.json",
            "calibration.yaml",
            "verification.json.part",
        )
    },
    "a pipe for a drive's log, and a good drive": Hostile(
        pipe("out/drive/log.txt"),
        (*BOTH, "out", *QUICK),
        WHOLE_BATCH,
        check=reason_is("out/drive/log.txt: found a pipe, needed a file or nothing"),
    ),
    **{
        f"a pipe for an experiment's {name}": Hostile(
            pipe(f"out/accuracy/{name}"),
            ("experiment", "accuracy", "--seeds", "1", "-o", "out"),
            rf"^semcal: error: out/accuracy/{name}: found a pipe, needed a file or nothing$",
        )
        for name in ("results.jsonl", "summary.json")
    },
    "a folder for a drive's log": Hostile(
        lambda folder: write("out/drive/.x")(folder) or (folder / "out/drive/log.txt").mkdir(),
        ("batch", "drive", "-o", "out"),
        WHOLE_BATCH,
        check=reason_is("out/drive/log.txt: found a folder, needed a file or nothing"),
    ),
}
NAMES: dict[str, Hostile] = {
    "a name that is not UTF-8": Hostile(
        drive_of_bytes,
        ("batch", "*", "-o", "out"),
        r"^semcal: error: caf\\xe9: found a name that is not UTF-8, needed one line of UTF-8 text$",
        check=no_work,
    ),
    "a line break in a name": Hostile(
        drive_named("two\nlines"),
        ("batch", "*", "-o", "out"),
        r"^semcal: error: two\\nlines: found a NUL or a line break in a name, needed one line of UTF-8 text$",
        check=no_work,
    ),
    "NUL on standard input": Hostile(
        lambda folder: None,
        ("batch", "-", "-o", "out"),
        r"^semcal: error: standard input: line 2: ot\\x00er: found a NUL or a line break in a name, needed .*$",
        stdin=b"drive\not\0er\n",
        check=no_work,
    ),
    "a name of megabytes on standard input": Hostile(
        lambda folder: None,
        ("batch", "-", "-o", "out"),
        r"^semcal: error: standard input: line 2: found a name of 4,000,000 bytes, needed at most 4,095$",
        stdin=b"drive\n" + b"a/" * 2_000_000,
        check=no_work,
    ),
    "bytes on standard input": Hostile(
        lambda folder: None,
        ("batch", "-", "-o", "out"),
        r"^semcal: error: standard input: line 3: \\xff\\xfe: found a name that is not UTF-8, needed .*$",
        stdin=b"# drives\r\ndrive\r\n\xff\xfe\r\n",
        check=no_work,
    ),
    "bytes in a list": Hostile(
        write("list.txt", b"drive\n\ncaf\xe9\n"),
        ("batch", "list.txt", "-o", "out"),
        r"^semcal: error: list.txt: line 3: caf\\xe9: found a name that is not UTF-8, needed .*$",
        check=no_work,
    ),
    "no pattern": Hostile(
        lambda folder: None,
        ("batch", "x**y", "-o", "out"),
        r"^semcal: error: x\*\*y: found (no pattern|nothing of this pattern)\b.*$",
    ),
    **{
        f"a drive named {name}": Hostile(
            drive_named(name),
            ("batch", name, "-o", "out"),
            rf"^semcal: error: {name}: found a drive whose results would go to {name}, a file of the batch, needed .*$",
            check=absent("out"),
        )
        for name in ("summary.csv", ".lock")
    },
    "a drive named log.txt in another": Hostile(
        drive_named("drive/log.txt"),
        ("batch", "drive", "drive/log.txt", "-o", "out"),
        r"^semcal: error: drive/log.txt: found a drive whose results would go to drive/log.txt, a file of the batch.*$",
        check=no_work,
    ),
}
BATCHES = FOLDERS | PIPES | NAMES
