"""Compare the results of two installed versions of semcal, number by number, and print a Markdown table.

    python tests/benchmarks/same_results.py --before OLD/bin/semcal --after NEW/bin/semcal --work DIR

Both versions run the same commands on the same drives, which the version before makes. Its results are kept in DIR
and used again, so that later comparisons run only the version after; delete DIR after a change of `derive_drives`.
The commands are listed in same_results.yaml, or in a file of the same form (--cases). Each real drive of the data
folder is a case of its own, `real:NAME`; `--only real` runs them all.

Numbers, exit codes and binary files must be the same. Keys, strings, messages and pages may differ and are listed.
The exit code is 1 if anything differs that must not. All differences are in DIR/differences.txt.
"""

from __future__ import annotations

import csv
import difflib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import cv2
import numpy as np
import yaml
from benchmark import script
from real_data import real_drives

from semcal_cli.errors import InputError

SHARED_DATA = Path(os.environ.get("SEMCAL_TEST_DATA", Path(__file__).parents[2] / "../shared/data"))
CASES = Path(__file__).with_suffix(".yaml")
LENSES: dict[str, dict[str, Any]] = {
    "double_sphere": {"distortion": [], "parameters": {"xi": 0.1, "alpha": 0.1}},
    "fov": {"distortion": [0.01]},
    "thin_prism": {"distortion": [0.01, -0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.001, 0.0, 0.001, 0.0]},
}
"""Lenses that `semcal synth` has not; images without distortion are read as if they were taken through these."""
SPEED_M_S = np.array([9.0, 0.5, -0.2])
VOLATILE_KEYS = ("seconds", "mtime_ns", "size")
"""Times, and the sizes of files in the records of a batch."""
MESSAGES = (".stderr", ".md", "log.txt")
DOCUMENTS = (".yaml", ".yml", ".json", ".stdout")
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
TIMES = re.compile(r" *\d+\.\d+ s\b|\d+\.\d+ \|$", re.MULTILINE)
JUNIT_TIME = re.compile(r' time="[^"]*"')
NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
VERDICTS = ("status", "verdict")
"""Keys of words that must not differ."""
MAX_LISTED = 20


@dataclass
class Differences:
    """What differs: exit codes, numbers and files must not, words and messages may."""

    exits: list[str] = field(default_factory=list)
    numbers: list[str] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    words: list[str] = field(default_factory=list)
    messages: list[str] = field(default_factory=list)
    num_numbers: int = 0

    def kinds(self) -> dict[str, list[str]]:
        """Return the lists by their names."""
        return {name: value for name, value in vars(self).items() if isinstance(value, list)}


def perturbed(T_camera_lidar: np.ndarray) -> np.ndarray:
    """Return a pose (4, 4) 2 degrees and 0.2 m away."""
    T = T_camera_lidar.copy()
    T[:3, :3] = cv2.Rodrigues(np.radians(2.0) * np.array([0.6, -0.64, 0.48]))[0] @ T[:3, :3]
    T[:3, 3] += [0.12, -0.1, 0.12]
    return T


def derive_drives(drives: Path) -> None:
    """Write starts 2 degrees and 0.2 m off, and drives with other lenses, features, soft labels and motion."""
    derived = drives / "derived"
    derived.mkdir()

    def write(name: str, document: dict[str, Any]) -> None:
        (derived / f"{name}.yaml").write_text(yaml.safe_dump(document))

    for path in drives.glob("*/drive.yaml"):
        T = perturbed(np.array(yaml.safe_load(path.read_text())["T_camera_lidar"]))
        write(path.parent.name, {"semcal_transform": 1, "T_camera_lidar": T.tolist()})
    text = (drives / "pinhole/drive.yaml").read_text()
    document = yaml.safe_load(re.sub(r"(?<=: )(?=\w+/\d{6}\.)", "../pinhole/", text))
    for model, lens in LENSES.items():
        write(model, document | {"camera": document["camera"] | {"model": model} | lens})
    bare = {key: document[key] for key in ("semcal_drive", "camera", "lidar")}
    twist = {"linear_m_s": SPEED_M_S.tolist(), "angular_rad_s": [0.0, 0.0, 0.0]}
    frames = [derive_frame(derived, number, frame) for number, frame in enumerate(document["frames"])]
    features, soft, moving = map(list, zip(*frames, strict=True))
    write("features", bare | {"frames": features})
    write("soft", bare | {"frames": soft})
    write("motion", bare | {"frames": moving, "ignore": {"image": [0]}, "motion": {"twist": twist}})


def derive_real_drives(data: Path, drives: Path) -> None:
    """Write the real drives of a data folder, each with a start 2 degrees and 0.2 m off."""
    real = drives / "real"
    real.mkdir()
    for drive in real_drives(data, real):
        document = yaml.safe_load((drive.path / "drive.yaml").read_text())
        T = perturbed(np.array(document.get("T_camera_lidar", np.eye(4))))
        (real / f"{drive.path.name}.yaml").write_text(
            yaml.safe_dump({"semcal_transform": 1, "T_camera_lidar": T.tolist()})
        )


def derive_frame(derived: Path, number: int, frame: dict[str, str]) -> tuple[dict[str, Any], ...]:
    """Write a frame with features, one with soft labels, and one seen from a moving LiDAR."""
    rng, vectors = np.random.default_rng(number), np.random.default_rng(99).normal(size=(256, 8))
    cloud = np.fromfile(derived / frame["points"], np.float32).reshape(-1, 4)
    labels = np.fromfile(derived / frame["point_labels"], np.uint32) & 0xFF
    image = cv2.imread(str(derived / frame["image_labels"]), cv2.IMREAD_UNCHANGED)
    features, soft = {"points": frame["points"]}, {"points": frame["points"]}
    for side, ids in (("point", labels), ("image", image)):
        noise = rng.normal(size=(*ids.shape, 8))
        features[f"{side}_features"] = f"{side}_features_{number}.npy"
        np.save(derived / f"{side}_features_{number}.npy", (vectors[ids] + noise).astype(np.float16))
        others = rng.integers(1, 26, (*ids.shape, 1))
        likely = 0.8 * (ids[..., None] == np.arange(26)) + 0.2 * (others == np.arange(26))
        soft[f"{side}_labels"] = f"{side}_labels_{number}.npz"
        np.savez_compressed(derived / f"{side}_labels_{number}.npz", likely.astype(np.float16))
    records = np.zeros(len(cloud), [("x", "f4"), ("y", "f4"), ("z", "f4"), ("time", "f8"), ("label", "u2")])
    records["label"], records["time"] = labels, 0.05 + np.arctan2(cloud[:, 1], cloud[:, 0]) / (20.0 * np.pi)
    seen = cloud[:, :3] - SPEED_M_S * (records["time"][:, None] - 0.06)
    records["x"], records["y"], records["z"] = seen.T
    np.save(derived / f"moving_{number}.npy", records)
    moving = {"points": f"moving_{number}.npy", "image_labels": frame["image_labels"]}
    return features, soft, moving | {"points_stamp": 100.0, "image_stamp": 100.06}


def read_cases(path: Path, data: Path) -> dict[str, list[str]]:
    """Read the commands of each case."""
    return {name: commands_of(name, given, data) for name, given in yaml.safe_load(path.read_text()).items()}


def commands_of(name: str, given: Sequence[str], data: Path) -> list[str]:
    """Return the commands of a case; the drives lie beside the folders of both versions."""
    meanings = {"CASE": name, "@": "../../drives/", "$data": f"{data}"}
    return [re.sub(r"CASE|@|\$data", lambda found: meanings[found[0]], text) for text in given]


def run_case(semcal: Path, commands: Sequence[str], folder: Path) -> list[int]:
    """Run the commands of a case in a new folder, and give their exit codes."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    codes = []
    for number, command in enumerate(commands, start=1):
        ended = subprocess.run([semcal, *shlex.split(command)], cwd=folder, capture_output=True, check=False)
        (folder / f"{number:02d}.stdout").write_bytes(ended.stdout)
        (folder / f"{number:02d}.stderr").write_bytes(ended.stderr)
        codes.append(ended.returncode)
    return codes


def run_before(semcal: Path, name: str, cases: dict[str, list[str]], work: Path) -> list[int]:
    """Return the exit codes of the version before, from an earlier call if its results are there."""
    commands = cases[name]
    kept, asked = work / f"before/{name}.json", [str(semcal), *cases["synth"], *commands]
    record = json.loads(kept.read_text()) if kept.exists() else {}
    if record.get("asked") != asked:
        kept.unlink(missing_ok=True)
        record = {"asked": asked, "exit_codes": run_case(semcal, commands, work / "before" / name)}
        if name == "synth":
            shutil.rmtree(work / "drives", ignore_errors=True)
            shutil.copytree(work / "before/synth", work / "drives")
            derive_drives(work / "drives")
        kept.write_text(json.dumps(record))
    return list(record["exit_codes"])


def read_result(path: Path, folder: Path) -> Any:
    """Read a document, lines of text cut at their numbers, a message as it is, or bytes of what is no text."""
    try:
        text = path.read_text("utf-8").replace(f"{folder}", ".")
    except UnicodeDecodeError:
        return path.read_bytes()
    if path.suffix == ".xml":
        text = JUNIT_TIME.sub("", text)
    if path.suffix in (".csv", ".jsonl"):
        lines = text.splitlines()
        return list(csv.DictReader(lines)) if path.suffix == ".csv" else list(map(json.loads, lines))
    if path.name.endswith(DOCUMENTS):
        try:
            document = yaml.load(text, LOADER)
        except yaml.YAMLError:
            document = None
        if isinstance(document, dict):
            return document
    if path.name.endswith((*MESSAGES, ".stdout")):
        return TIMES.sub("TIME", text)
    return [NUMBER.split(line) for line in text.splitlines()]


def as_number(value: Any) -> Any:
    """Return the number that a text holds, or anything else as it is."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def compare_values(before: Any, after: Any, path: str, found: Differences) -> None:
    """Walk two documents together."""
    if isinstance(before, dict) and isinstance(after, dict):
        compare_keys(before, after, path, found)
    elif isinstance(before, list) and isinstance(after, list):
        if len(before) != len(after):
            found.numbers.append(f"{path}: {len(before)} items -> {len(after)} items")
        for index, pair in enumerate(zip(before, after, strict=False)):
            compare_values(*pair, f"{path}[{index}]", found)
    else:
        left, right = as_number(before), as_number(after)
        is_number = isinstance(left, int | float) or isinstance(right, int | float)
        found.num_numbers += is_number
        if repr(left) != repr(right):
            must_not = is_number or path.endswith(VERDICTS) or figures(before) != figures(after)
            (found.numbers if must_not else found.words).append(f"{path}: {before!r:.90} -> {after!r:.90}")


def figures(value: Any) -> list[str]:
    """List the numbers in a value, or in all that it holds."""
    return NUMBER.findall(json.dumps(value, default=str))


def compare_keys(before: dict[str, Any], after: dict[str, Any], path: str, found: Differences) -> None:
    """Compare values of equal keys, and of renamed ones: those of equal value, or the only one that is new."""
    removed, added = [key for key in before if key not in after], [key for key in after if key not in before]
    pairs = [(key, key) for key in before if key in after and key not in VOLATILE_KEYS]
    is_only = len(removed) == len(added) == 1
    for key in removed:
        twin = next((other for other in added if is_only or after[other] == before[key]), None)
        if twin is not None:
            added.remove(twin)
            pairs.append((key, twin))
        is_lost = twin is None and bool(figures(before[key]))
        change = "removed" if twin is None else f"now {twin}"
        (found.numbers if is_lost else found.words).append(f"{path}.{key}: {change}, was {before[key]!r:.90}")
    found.words += [f"{path}.{key}: added, is {after[key]!r:.90}" for key in added]
    for key, twin in pairs:
        compare_values(before[key], after[twin], f"{path}.{key}", found)


def compare_files(name: str, folders: Sequence[Path], found: Differences) -> None:
    """Compare a file of both versions."""
    left, right = (read_result(folder / name, folder) for folder in folders)
    if name.endswith((".html", ".svg")):
        found.messages += [f"{name}: other bytes"] * (left != right)
    elif isinstance(left, str) and isinstance(right, str):
        lines = difflib.unified_diff(left.splitlines(), right.splitlines(), lineterm="", n=0)
        found.messages += [f"{name}: {line}" for line in lines if not line.startswith(("---", "+++", "@@"))]
    elif type(left) is not type(right) or isinstance(left, bytes):
        found.files += [f"{name}: other bytes"] * (left != right)
    else:
        compare_values(left, right, name, found)


def compare_case(folders: Sequence[Path]) -> Differences:
    """Compare all files of a case."""
    found = Differences()
    before, after = ({str(p.relative_to(top)) for p in top.rglob("*") if p.is_file()} for top in folders)
    found.files += [f"{name}: missing" for name in sorted(before - after)]
    found.words += [f"{name}: new file" for name in sorted(after - before)]
    for name in sorted(before & after):
        compare_files(name, folders, found)
    return found


def counted(codes: Sequence[int]) -> str:
    """Tell how often each exit code came."""
    return ", ".join(f"{count} x {code}" for code, count in sorted(Counter(codes).items()))


def run_and_compare(
    name: str, before: Path, after: Path, work: Path, cases: dict[str, list[str]]
) -> tuple[str, Differences]:
    """Run a case with both versions, and give its row of the table and what differs."""
    commands = cases[name]
    begin = perf_counter()
    codes_before = run_before(before, name, cases, work)
    middle = perf_counter()
    codes_after = run_case(after, commands, work / "after" / name)
    seconds = f"{middle - begin:.0f}, {perf_counter() - middle:.0f}"
    found = compare_case((work / "before" / name, work / "after" / name))
    for command, *codes in zip(commands, codes_before, codes_after, strict=True):
        if codes[0] != codes[1]:
            found.exits.append(f"{command}: {codes[0]} -> {codes[1]}")
    counts = " | ".join(str(len(lines)) for lines in found.kinds().values() if lines is not found.exits)
    exits = " -> ".join(dict.fromkeys([counted(codes_before), counted(codes_after)]))
    return f"| {name} | {exits} | {found.num_numbers:,} | {counts} | {seconds} |", found


def real_cases(work: Path, data: Path) -> dict[str, list[str]]:
    """Write the real drives once, and list the commands of each: by edges, and by segments where it has labels."""
    drives = work / "real_drives"
    if not drives.is_dir():
        drives.mkdir(parents=True)
        derive_real_drives(data, drives)
    cases = {}
    for path in sorted((drives / "real").glob("*/drive.yaml")):
        name, start = path.parent.name, path.parent.with_suffix(".yaml")
        cases[f"real:{name}"] = [
            f"inspect {path.parent} --json",
            f"calibrate {path.parent} --cue edges --init {start} --max-frames 8 -o edges.yaml",
        ]
        if "image_labels" in path.read_text():
            cases[f"real:{name}"].append(f"calibrate {path.parent} --max-frames 4 -o nothing.yaml")
    return cases


def main(
    *,
    before: Path,
    after: Path,
    work: Path,
    data: Path = SHARED_DATA,
    only: tuple[str, ...] = (),
    cases: Path = CASES,
) -> Iterator[str]:
    """Run both executables in a folder of work, and yield what differs and the table."""
    before, after, work, data = before.absolute(), after.absolute(), work.resolve(), data.resolve()
    listed = read_cases(cases, data)
    if unknown := set(only) - {*listed, "real"}:
        raise InputError(f"--only: found {min(unknown)!r}, expected one of: {', '.join(listed)}")
    if data.is_dir():
        listed |= real_cases(work, data)
    rows, differences, fails = [], [], False
    for name, commands in listed.items():
        if only and {name, name.split(":")[0]}.isdisjoint((*only, "synth")):
            continue
        if f"{data}" in "".join(commands) and not data.is_dir():
            rows.append(f"| {name} | left out: no {data} | | | | | | |")
            continue
        row, found = run_and_compare(name, before, after, work, listed)
        rows.append(row)
        fails |= bool(found.numbers or found.files or found.exits)
        print(row, file=sys.stderr)
        for kind, lines in found.kinds().items():
            differences += [f"{name}: {kind}: {line}" for line in lines]
            more = [f"{len(lines) - MAX_LISTED} more"] if len(lines) > MAX_LISTED else []
            yield from (f"{name}: {kind}: {line}" for line in lines[:MAX_LISTED] + more)
    (work / "differences.txt").write_text("".join(f"{line}\n" for line in differences))
    yield "| case | exit codes | numbers | differ | files differ | keys, strings | messages | s |"
    yield from ["|---|---|---|---|---|---|---|---|", *rows]
    raise SystemExit(fails)


if __name__ == "__main__":
    script(main)
