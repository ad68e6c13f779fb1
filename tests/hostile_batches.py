"""Hostile batches: names, lists, results folders and what lies in them."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

from hostile_commands import Hostile
from hostile_files import pipe

from semcal_cli.many.batch.folders import MARK

BOTH = ("batch", "drive", "other", "-o")
QUICK = ("--", "--no-polish", "--search-deg", "5", "--init", "other")
PRECIOUS = "a year of work\n"
APART = "expected a folder apart from the drives$"
NEEDED = "expected a folder that is new, empty or from a batch$"
WHOLE_BATCH = r"^summary +out/summary.csv, out/summary.jsonl$"
"""Last line of a batch that did all drives, whatever became of them."""
ONE_LINE = "found an invalid file name, expected one line of UTF-8 text of at most 4,095 bytes"
TAKEN = "a file of the batch; choose another name"
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


def results_of_a_batch(folder: Path) -> None:
    """Write what a batch leaves, with the results of a drive."""
    for name, content in (
        (".lock", MARK),
        ("third/.semcal_batch", MARK),
        ("third/log.txt", PRECIOUS.encode()),
    ):
        write(f"out/{name}", content)(folder)


def no_work(folder: Path) -> None:
    """Check that no summary was written, over a person's file or beside it."""
    summaries = [path for path in folder.rglob("summary.*") if path.is_file()]
    assert all(summary.read_text() == PRECIOUS for summary in summaries)


def refused(
    make: Callable[[Path], object], command: tuple[str, ...] | str, line: str, *kept: str, stdin: bytes = b""
) -> Hostile:
    """Make a case in which a batch refuses its drives or the folder of its results before any work.

    Args:
        make: Makes the files of the case.
        command: Arguments of the batch, or the folder of the results of both drives.
        line: Pattern of the message.
        kept: Files that stay as they are.
        stdin: Standard input.
    """
    arguments = (*BOTH, command) if isinstance(command, str) else ("batch", *command, "-o", "out")
    return Hostile(make, arguments, f"^semcal: error: {line}", kept=kept, stdin=stdin, check=no_work)


def reasons(folder: Path) -> list[str]:
    lines = (folder / "out/summary.jsonl").read_text().splitlines()
    return [(json.loads(line)["reasons"] or [""])[0] for line in lines]


def reason_is(reason: str) -> Callable[[Path], object]:
    """Check the reason of the only drive that failed."""

    def check(folder: Path) -> None:
        assert [line for line in reasons(folder) if line.startswith(str(folder))] == [f"{folder}/{reason}"]

    return check


def drive_of_bytes(folder: Path) -> None:
    shutil.copytree(folder / "other", os.fsdecode(os.fsencode(folder / "caf") + b"\xe9"))  # Latin-1


def drive_named(name: str) -> Callable[[Path], object]:
    return lambda folder: shutil.copytree(folder / "other", folder / name)


FOLDERS: dict[str, Hostile] = {
    "results where the drives are": refused(
        write("log.txt"), ".", rf"\.: found a folder that contains drive drive, {APART}", "log.txt"
    ),
    "results in a drive": refused(
        write("drive/log.txt"),
        "drive/results",
        rf"drive/results: found a folder in drive drive, {APART}",
        "drive/log.txt",
    ),
    "results that a link leads into a drive": refused(
        link("out", "drive"), "out", rf"out: found the folder of drive drive, {APART}"
    ),
    "results beside a drive file": Hostile(
        write("drive/log.txt"),
        ("batch", "drive/drive.yaml", "-o", "drive"),
        rf"^semcal: error: drive: found the folder of drive drive/drive.yaml, {APART}",
        kept=("drive/log.txt",),
        check=no_work,
    ),
    **{
        f"results in those of another batch, {output}": refused(
            results_of_a_batch,
            output,
            rf"{output}: found the results of another batch in .*{above}, {NEEDED}",
            "out/third/log.txt",
        )
        for output, above in (("out/third", "out/third"), ("out/a/b", "out"))
    },
    "a drive's results where another batch has its own": refused(
        write("out/drive/.lock", MARK),
        "out",
        rf"out: found the results of another batch in out/drive, {NEEDED}",
    ),
    **{
        f"a person's {name}": refused(
            write(f"{folder}/{name}", content),
            "out",
            rf"{folder}: found {name}, {UNKNOWN}",
            f"{folder}/{name}",
        )
        for folder, name, content in (
            ("out", "summary.csv", PRECIOUS.encode()),
            ("out", ".lock", PRECIOUS.encode()),
            ("out/other", "record.json", b'{"outcome": 1}'),
        )
    },
    "a link for the log": refused(
        link("out/drive/log.txt", "precious"), "out", rf"out/drive: found log.txt, {UNKNOWN}", "precious"
    ),
    "a link for a drive's results": refused(
        link("out/drive", "other"), "out", r"out/drive: found a link, expected a folder or nothing$"
    ),
    **{
        f"a link for {name}": refused(
            link(f"out/{name}", "precious"),
            "out",
            rf"out/{name}: found a link, expected a file or nothing$",
            "precious",
        )
        for name in (".lock", "summary.jsonl")
    },
}
PIPES: dict[str, Hostile] = {
    "a pipe for the summary": Hostile(
        pipe("out/summary.csv"),
        (*BOTH, "out"),
        r"^semcal: error: out/summary.csv: found a pipe, expected a file or nothing$",
    ),
    "a pipe for a drive's log, and a good drive": Hostile(
        pipe("out/drive/log.txt"),
        (*BOTH, "out", *QUICK),
        WHOLE_BATCH,
        check=reason_is("out/drive/log.txt: found a pipe, expected a file or nothing"),
    ),
    "a pipe for an experiment's results": Hostile(
        pipe("out/pairs/results.jsonl"),
        ("experiment", "pairs", "--seeds", "1", "-o", "out"),
        r"^semcal: error: out/pairs/results.jsonl: found a pipe, expected a file or nothing$",
    ),
}
NAMES: dict[str, Hostile] = {
    "a name that is not UTF-8": refused(drive_of_bytes, ("*",), rf"caf\\xe9: {ONE_LINE}$"),
    **{
        f"{found} on standard input": refused(
            lambda folder: None, ("-",), f"standard input: line 2: {shown}: {ONE_LINE}$", stdin=content
        )
        for found, content, shown in (
            ("NUL", b"drive\not\0er\n", r"ot\\x00er"),
            ("a name of megabytes", b"drive\n" + b"a/" * 2_000_000, r"(a/)+"),
        )
    },
    "bytes in a list": refused(
        write("list.txt", b"# drives\r\n\r\ncaf\xe9\r\n"),
        ("list.txt",),
        rf"list.txt: line 3: caf\\xe9: {ONE_LINE}$",
    ),
    "no pattern": refused(
        lambda folder: None, ("x**y",), r"x\*\*y: found (an invalid pattern|no match for this pattern)\b.*$"
    ),
    **{
        f"a drive named {name}": refused(
            drive_named(name), drives, rf"{name}: found a drive whose results would go to {name}, {TAKEN}$"
        )
        for name, drives in (
            ("summary.csv", ("summary.csv",)),
            (".lock", (".lock",)),
            ("drive/log.txt", ("drive", "drive/log.txt")),
        )
    },
}
BATCHES = FOLDERS | PIPES | NAMES
