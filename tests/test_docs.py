"""What the documentation says is so: its links, commands, drives, sessions of Python, limits and reasons."""

import ast
import doctest
import html
import inspect
import json
import os
import re
import subprocess
import sys
from contextlib import suppress
from itertools import takewhile
from pathlib import Path
from pydoc import locate
from types import FunctionType

import click
import pytest
from documentation import PAGES, README, ROOT, anchors, blocks, commands, links, named_commands
from test_findings import PLACES
from troubleshooting import limits_page, page as troubleshooting_page

import semcal_cli
from semcal_cli import pipeline
from semcal_cli.checks.registry import ALL_CHECKS, CHECKS
from semcal_cli.cli import semcal
from semcal_cli.config import MAX_PIXELS, MAX_POINTS, file_limits as reading
from semcal_cli.documentation import ADDRESS, entry_address, schema_address
from semcal_cli.drive.document import read_drive
from semcal_cli.experiments import experiment_run
from semcal_cli.files import point_clouds, rows, yaml_values
from semcal_cli.files.validation import NEWEST_VERSION
from semcal_cli.findings.check import Check
from semcal_cli.findings.symptoms import LOOKS_LIKE, MOVED_SENSOR
from semcal_cli.formats import format
from semcal_cli.geometry import poses
from semcal_cli.importing import kitti_360_windows, sweep_odometry as odometry
from semcal_cli.importing.ontologies import read_ontology
from semcal_cli.many.batch import records
from semcal_cli.schemas import MODELS, schema_file

DOCS = ROOT / "docs"
MOST_README_LINES, MOST_LINES = 150, 335
MAX_LINES_OF_ENTRY = 12
"""Those of an entry on the page of reasons, with its row of the table: a reader looks up one at a time."""
LIMITS = {
    reading.MAX_DOCUMENT_BYTES: "bytes",
    reading.MAX_TABLE_BYTES: "bytes",
    reading.MAX_PROTOBUF_VALUES: "values",
    records.MAX_RECORD_BYTES: "bytes",
    experiment_run.MAX_JOURNAL_BYTES: "bytes",
    kitti_360_windows.MAX_BYTES: "bytes",
    rows.MAX_ROWS_BYTES: "bytes",
    rows.MAX_ROW: "characters a row",
    format.MAX_YAML_BYTES: "bytes",
    yaml_values.MAX_VALUES: "values",
    yaml_values.MAX_DEPTH: "levels",
    MAX_POINTS: "points a sweep",
    point_clouds.BYTES_PER_POINT: "bytes a point",
    MAX_PIXELS: "pixels",
}


def test_limits_are_those_of_the_code() -> None:
    text = (DOCS / "input.md").read_text()
    stated = {
        (int(number.replace(",", "")), unit)
        for number, unit in re.findall(
            r"([\d,]*\d) (bytes a point|bytes|characters a row|values|levels|points a sweep|pixels)\b", text
        )
    }
    assert stated == set(LIMITS.items())
    assert f"off by {poses.RIGID_TOLERANCE:g}" in text


LIMITS_OF_WHOLE_FILES = f"""
keys up to {reading.MAX_WHOLE_KEY:,} |
{reading.MAX_COMMAND:,} characters |
| {reading.MAX_CAMERAS} cameras; {reading.MAX_FLEET_DRIVES:,} drives |
| {reading.MAX_JPEG_SCANS} scans and {reading.MAX_JPEG_SEGMENTS:,} segments of a JPEG;
| a recording, unpacked | {reading.MAX_UNPACKED_BYTES >> 20} MiB a chunk and a message;
{reading.MAX_READ_RATIO} times its size or {reading.MIN_READ_BYTES >> 30} GiB;
or {reading.MIN_READ_RECORDS:,} records |
| {reading.MAX_CHUNK_RECORDS:,} records a chunk, {reading.MAX_CHUNK_DEFINITIONS:,} of them schemas and channels;
{reading.MAX_HELD_BYTES >> 20} MiB of messages that wait for other chunks,
an index of {reading.MAX_SUMMARY_BYTES >> 20} MiB,
{reading.MAX_CONNECTIONS:,} connections; an index of {reading.MAX_INDEX_ENTRIES:,} messages,
headers of records of {reading.MAX_RECORD_HEADER >> 10} KiB and {reading.MAX_RECORD_FIELDS} fields |
frames of level 6 of H.264, {reading.MAX_VIDEO_PIXELS / 1e6:.1f} megapixels;
{reading.MAX_PIXELS_A_BYTE:,} px a byte in all, or {reading.MIN_VIDEO_PIXELS // 10**9} gigapixels |
{reading.MAX_TOPICS:,} topics, whose names and types have up to {reading.MAX_TOPIC_NAME:,} characters;
{reading.MAX_SQLITE_STEPS:,} instructions a statement, and {reading.SQLITE_STEPS_A_BYTE} a byte |
{reading.MAX_PROTOBUF_VALUES:,} values a message
{reading.MAX_MESSAGE_TRANSFORMS:,} a message, {reading.MAX_TRANSFORMS:,} pairs of frames a recording |
| fields of a cloud | {reading.MAX_FIELDS} |
| the XML of an E57 | {reading.MAX_E57_ELEMENTS:,} elements |
{odometry.MAX_SWEEP_CELLS:,} voxels a sweep, and {odometry.MAX_SWEEP_POINTS:,} points,
{odometry.MAX_ITERATIONS} iterations; {odometry.MAX_RESTARTS} new starts after jumps,
one more every {odometry.SWEEPS_A_RESTART} sweeps |
{reading.MAX_NETWORK_FILES} files of a network;
{reading.ANSWER_S:.0f} s, {reading.MAX_ANSWER_BYTES >> 20} MiB for a description, {reading.MAX_REDIRECTS} redirections;
downloads of {reading.MIN_BYTES_PER_S / 1000:.0f} kB a second or more,
"""


@pytest.mark.parametrize("limit", LIMITS_OF_WHOLE_FILES.strip().splitlines())
def test_limits_of_whole_files_are_those_of_the_code(limit: str) -> None:
    text = (DOCS / "input.md").read_text()
    assert limit in text.partition("## Limits of whole files")[2].partition("\n## ")[0]


def test_every_limit_of_files_stands_in_the_documentation() -> None:
    """Each is compared above, or is not a number that a file can meet."""
    compared = set(re.findall(r"reading\.([A-Z_\d]+)", Path(__file__).read_text()))
    assert {name for name in vars(reading) if name.isupper()} - compared == {"MIN_ROW_BYTES"}


def test_the_files_of_class_names_are_read(tmp_path: Path) -> None:
    section = (DOCS / "labels.md").read_text().partition("### Names of classes")[2].partition("\n### ")[0]
    blocks = re.findall(r"```yaml\n(.*?)```", section, re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        (tmp_path / "classes.yaml").write_text(block)
        assert read_ontology(str(tmp_path / "classes.yaml")).ids() == {"road": [7], "car": [26, 27]}


def test_the_readme_is_one_read() -> None:
    text = README.read_text()
    assert len(text.splitlines()) <= MOST_README_LINES
    assert "@@" not in text


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_a_page_is_short(path: Path) -> None:
    most = MAX_LINES_OF_ENTRY * len(ALL_CHECKS) if path.name == "troubleshooting.md" else MOST_LINES
    assert len(path.read_text().splitlines()) <= most


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_no_link_is_dead(path: Path) -> None:
    for target in links(path):
        name, _, anchor = target.partition("#")
        file = path.parent / name if name else path
        assert file.is_file(), target
        assert not anchor or anchor in anchors(file), target


@pytest.mark.parametrize("start", [README, DOCS / "index.md"], ids=lambda path: path.name)
def test_a_start_leads_to_every_page(start: Path) -> None:
    linked = {(start.parent / target.partition("#")[0]).resolve() for target in links(start)}
    assert {path for path in PAGES if path != README} - {start} <= linked


def test_the_address_of_the_documentation_is_stated_everywhere() -> None:
    assert f'\nDocumentation = "{ADDRESS}"\n' in (ROOT / "pyproject.toml").read_text()
    assert f"\nsite_url: {ADDRESS}/\n" in (ROOT / "mkdocs.yml").read_text()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The documentation as a site."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, env=environment)
    assert ended.returncode == 0, ended.stderr
    assert "WARNING" not in ended.stderr
    return folder


def test_the_site_builds(site: Path) -> None:
    for path in PAGES[1:]:
        name = "index.html" if path.stem == "index" else f"{path.stem}/index.html"
        assert (site / name).stat().st_size > 0
    page = (site / "troubleshooting" / "index.html").read_text()
    for topic in (*ENTRIES, LOOKS_LIKE, MOVED_SENSOR):
        assert f'<a id="{topic}"></a>' in page
    for key in MODELS:
        published = site / schema_address(key, NEWEST_VERSION).removeprefix(f"{ADDRESS}/")
        assert published.read_bytes() == schema_file(key).read_bytes()
    assert entry_address("clocks") == f"{ADDRESS}/troubleshooting/#clocks"
    listed = re.findall(
        rf"^- \[.+\]\({ADDRESS}/(\w+)/\): .+\?$", (site / "llms.txt").read_text(), re.MULTILINE
    )
    assert set(listed) == {path.stem for path in PAGES[1:]} - {"index"} | {"notebook"}


def test_the_notebook_is_stored_without_outputs_and_shown_with_them(site: Path) -> None:
    cells = json.loads((DOCS / "notebook.ipynb").read_text())["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert [(cell["outputs"], cell["execution_count"]) for cell in code] == [([], None)] * len(code)
    page = (site / "notebook" / "index.html").read_text()
    text = " ".join(html.unescape(re.sub(r"<[^>]+>", "", page)).split())
    assert re.search(r"Trusted: ±\d+\.\d mm, ±0\.\d+ degrees \(95 %\)", text)
    assert "'pass'" in text
    assert "fail: The camera is not where the transform says." in text
    assert "ros2 run tf2_ros static_transform_publisher --x" in text
    assert len(re.findall(r'<img alt="[^"]+" src="data:image/jpeg;base64,', page)) == 2


def test_links_of_the_page_on_pypi_lead_to_the_site(site: Path) -> None:
    printed = subprocess.check_output([ROOT / ".ci" / "readme_for_pypi"], text=True)
    assert len(printed.splitlines()) == len(README.read_text().splitlines())
    targets = re.findall(r"\]\(([^)\s]+)\)", printed)
    assert [target for target in targets if not target.startswith("https://")] == []
    for target in targets:
        path, _, anchor = target.removeprefix(f"{ADDRESS}/").partition("#")
        if target.startswith(ADDRESS):
            page = site / path / ("index.html" if target.endswith("/") or anchor else "")
            assert page.is_file(), target
            assert not anchor or f'id="{anchor}"' in page.read_text(), target


def test_the_reference_has_every_public_name_with_its_docstring(site: Path) -> None:
    page = (site / "python_reference/index.html").read_text()
    of_stages = {name: each for name, each in vars(pipeline).items() if isinstance(each, FunctionType)}
    public = of_stages | {
        name: getattr(semcal_cli, name) for name in dir(semcal_cli) if name != "__version__"
    }
    shown = {id(locate(name)) for name in re.findall(r'<h3 id="([\w.]+)"', page)}
    assert {name for name, each in public.items() if id(each) not in shown} == set()
    text = " ".join(html.unescape(re.sub(r"<[^>]+>", "", page)).split())
    assert (
        "verify( drive: DriveInput | None = None, transform: GivenTransform | None = None, "
        "limits: Limits | None = None," in text
    )
    for name, each in public.items():
        assert inspect.getdoc(each).splitlines()[0].replace("`", "") in text, name


def parse(words: list[str], group: click.Group = semcal) -> None:
    """Parse a command without running it: its name, its options and their values, its arguments and its rules."""
    name, *rest = words
    assert name in group.commands, words
    command = group.commands[name]
    if isinstance(command, click.Group):
        if rest and not rest[0].startswith("-"):
            parse(rest, command)
        return
    if "--" in rest:
        parse(["calibrate", "DRIVE", *rest[rest.index("--") + 1 :]])
    with suppress(click.exceptions.Exit):
        command.make_context(name, rest)


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_every_command_in_a_block_parses(path: Path) -> None:
    for words in commands(path):
        parse(words)


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["calibrat", "DRIVE"], AssertionError),
        (["calibrate", "DRIVE", "--never"], click.NoSuchOption),
        (["calibrate"], click.MissingParameter),
        (["calibrate", "DRIVE", "--estimator", "never"], click.BadParameter),
        (["batch", "DRIVES", "-o", "DIR", "--", "--never"], click.NoSuchOption),
    ],
)
def test_a_wrong_command_does_not_parse(words: list[str], error: type[Exception]) -> None:
    with pytest.raises(error):
        parse(words)


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_every_command_in_a_sentence_has_its_options(path: Path) -> None:
    """Names in capitals stand for any command of a group, and brackets for what may be left out."""
    for text in named_commands(path):
        words = re.sub(r"[\[\]]", "", text).split()
        group: click.Command = semcal
        known = {"--help", "--version"}
        while isinstance(group, click.Group) and words and not words[0].startswith("-"):
            names = words.pop(0).replace("\\", "").split("|")
            if names[0].isupper():
                known |= {option for each in group.commands.values() for option in options_of(each)}
                break
            assert set(names) <= set(group.commands), text
            group = group.commands[names[0]]
            known |= options_of(group)
        mine = list(takewhile(lambda word: word != "--", words))
        named = {word.partition("=")[0] for word in mine if re.match(r"--?[a-z]", word)}
        assert named <= known, text


def options_of(command: click.Command) -> set[str]:
    return {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}


@pytest.mark.parametrize(
    "path", [path for path in PAGES if blocks(path, "python")], ids=lambda path: path.name
)
def test_every_block_of_python_is_right(path: Path) -> None:
    """Sessions run, on data that they make; other blocks compile."""
    failed, _ = doctest.testfile(str(path), module_relative=False, optionflags=doctest.ELLIPSIS)
    assert failed == 0
    for block in blocks(path, "python"):
        if ">>>" not in block:
            compile(block, path.name, "exec")


def drives() -> list[tuple[str, str]]:
    found = [(path.name, block) for path in PAGES for block in blocks(path, "yaml")]
    return [(name, block) for name, block in found if "semcal_drive:" in block]


def test_what_pages_show_is_found() -> None:
    assert ["demo"] in commands(README)
    assert sum(1 for path in PAGES for _ in commands(path)) > 30
    assert len(doctest.DocTestParser().get_examples((DOCS / "python.md").read_text())) > 20
    assert "drive.md" in {name for name, _ in drives()}


@pytest.mark.parametrize(("name", "block"), drives(), ids=[name for name, _ in drives()])
def test_every_drive_is_valid(name: str, block: str, tmp_path: Path) -> None:
    (tmp_path / "drive.yaml").write_text(block)
    read_drive(tmp_path)


def sentence_pattern(check: Check, what: ast.expr) -> re.Pattern[str]:
    """What a finding looks like as it is printed: its words, with anything in place of its figures."""
    parts = what.values if isinstance(what, ast.JoinedStr) else [what]
    words = (re.escape(str(part.value)) if isinstance(part, ast.Constant) else ".*" for part in parts)
    advice = f": {re.escape(check.advice)}" if check.advice else ""
    return re.compile("".join(words) + advice)


ENTRY = re.compile(r'^### <a id="([a-z-]+)"></a>.+\n((?:(?!##).*\n)*)', re.MULTILINE)
ENTRIES = dict(ENTRY.findall((DOCS / "troubleshooting.md").read_text()))
"""The entries of the page of reasons, by the topics that pages link to."""
QUOTED = [
    (topic, quoted) for topic, entry in ENTRIES.items() for quoted in re.findall(r"^> (.+)$", entry, re.M)
]
PATTERNS = [(check.topic, sentence_pattern(check, what)) for _, check, what in PLACES]


def test_the_page_of_reasons_is_generated_from_the_checks() -> None:
    page = (DOCS / "troubleshooting.md").read_text()
    assert list(ENTRIES) == list(CHECKS)
    assert len(ENTRIES) == page.count("\n### ")
    assert page == troubleshooting_page()
    assert (DOCS / "benchmarks_limits.md").read_text() == limits_page()


@pytest.mark.parametrize(("topic", "pattern"), PATTERNS, ids=[place for place, *_ in PLACES])
def test_every_reason_is_explained_where_its_link_leads(topic: str, pattern: re.Pattern[str]) -> None:
    found = [quoted for of, quoted in QUOTED if of == topic and pattern.fullmatch(quoted)]
    assert found, f"docs/troubleshooting.md quotes nothing under {topic} like: {pattern.pattern}"


@pytest.mark.parametrize(("topic", "quoted"), QUOTED)
def test_every_explained_reason_is_given(topic: str, quoted: str) -> None:
    assert [pattern for of, pattern in PATTERNS if of == topic and pattern.fullmatch(quoted)]


def test_a_mistake_that_a_transform_looks_like_is_explained_where_its_link_leads() -> None:
    _, _, section = (DOCS / "troubleshooting.md").read_text().partition(f'## <a id="{LOOKS_LIKE}"></a>')
    assert "looks like" in section


@pytest.mark.parametrize("topic", ENTRIES)
def test_an_entry_says_what_why_and_what_now(topic: str) -> None:
    entry = ENTRIES[topic]
    assert entry.count("\n> ") >= 1
    figure = ("Figure.",) if CHECKS[topic].limits else ()
    for part in ("What it means.", "Why it comes up.", "What to do.", *figure):
        assert re.search(rf"^- \*\*{re.escape(part)}\*\* \S", entry, re.MULTILINE), part
