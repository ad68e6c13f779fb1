"""The stored corpus of the fuzz targets, without a fuzzer: what was found once stays mended on any machine.

`tests/fuzz/documents.py` goes on from this corpus, by coverage.
"""

import sys
import warnings
from pathlib import Path

import pytest

FUZZ = Path(__file__).parent / "fuzz"
sys.path.append(str(FUZZ))

from mutation import mutate  # noqa: E402
from targets import TARGETS, Target, check  # noqa: E402

from semcal_cli.errors import InputError  # noqa: E402

pytestmark = pytest.mark.slow

CORPUS = FUZZ / "corpus"
MUTATIONS = 20
MAX_FILES, MAX_BYTES = 200, 300_000
"""Largest corpus: small files are read by people."""


@pytest.mark.parametrize("name", TARGETS)
def test_stored_documents_are_read_or_refused_in_a_line(name: str, tmp_path: Path) -> None:
    TARGETS[name].prepare(tmp_path)
    paths = sorted((CORPUS / name).iterdir())
    assert paths
    for path in paths:
        check(TARGETS[name], path.read_bytes(), tmp_path)


@pytest.mark.parametrize("name", TARGETS)
def test_the_fuzzer_starts_from_a_document_that_is_read(name: str, tmp_path: Path) -> None:
    """All that begins with a refusal would never get past the parser."""
    TARGETS[name].prepare(tmp_path)
    refusals = []
    for path in sorted((CORPUS / name).iterdir()):
        document = tmp_path / TARGETS[name].name(path.read_bytes())
        document.parent.mkdir(parents=True, exist_ok=True)
        document.write_bytes(path.read_bytes())
        try:
            TARGETS[name].read(document)
            return
        except InputError as error:
            refusals.append(str(error))
    pytest.fail("\n".join(refusals))


@pytest.mark.parametrize("name", TARGETS)
def test_mutations_change_documents_and_are_the_same_again(name: str) -> None:
    max_bytes = TARGETS[name].max_bytes
    for path in (CORPUS / name).iterdir():
        content = path.read_bytes()
        changed, again = (
            [mutate(content, max_bytes, seed, lambda data, size: data[:-1]) for seed in range(MUTATIONS)]
            for _ in range(2)
        )
        assert changed == again
        assert len({*changed, content}) > MUTATIONS / 2
        assert all(len(each) <= max_bytes for each in changed)


def test_the_corpus_is_small_and_belongs_to_targets() -> None:
    assert {path.name for path in CORPUS.iterdir()} == set(TARGETS)
    sizes = {path: path.stat().st_size for path in CORPUS.rglob("*") if path.is_file()}
    assert len(sizes) <= MAX_FILES
    assert sum(sizes.values()) <= MAX_BYTES
    too_long = [path for path, size in sizes.items() if size > TARGETS[path.parent.name].max_bytes]
    assert not too_long, "the fuzzer would cut these"


def crash(path: Path) -> None:
    raise KeyError("T_camera_lidar")


def warn(path: Path) -> None:
    warnings.warn("overflow encountered in multiply", RuntimeWarning, stacklevel=2)


def refuse(message: str) -> Target:
    def read(path: Path) -> None:
        raise InputError(message.replace("PATH", str(path)))

    return Target(read, lambda content: "a.yaml")


@pytest.mark.parametrize(
    ("target", "finding"),
    [
        (Target(crash, lambda content: "a.yaml"), KeyError),
        (Target(warn, lambda content: "a.yaml"), RuntimeWarning),
        (refuse("a.yaml: found nothing, expected a value"), AssertionError),
        (refuse(""), AssertionError),
        (refuse("PATH: " + "found nothing " * 200), AssertionError),
    ],
)
def test_all_but_a_line_that_names_the_file_is_a_finding(
    target: Target, finding: type[BaseException], tmp_path: Path
) -> None:
    check(refuse("PATH: found nothing, expected a value"), b"", tmp_path)
    with pytest.raises(finding):
        check(target, b"", tmp_path)
