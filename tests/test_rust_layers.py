"""The Rust of the core: no module imports in a circle, and a name means one thing."""

from collections import defaultdict
from pathlib import Path

import pytest
from rust_modules import circle, public_types, read_crate, uses_of

RUST = Path(__file__).parents[1] / "rust"
CRATES = [RUST / "lib.rs", RUST / "geometry" / "src" / "lib.rs", RUST / "streets" / "src" / "lib.rs"]
#: A crate has a `lib.rs`, a folder a `mod.rs`, and a module its tests.
REPEATED = {"lib.rs", "mod.rs", "tests.rs"}


def plant(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    return folder / "lib.rs"


@pytest.mark.parametrize("root", CRATES, ids=lambda root: str(root.relative_to(RUST)))
def test_no_module_imports_in_a_circle(root: Path) -> None:
    modules = read_crate(root)
    assert len(modules) > 5
    assert not circle(uses_of(modules)), " -> ".join(circle(uses_of(modules)))


def test_every_file_belongs_to_a_crate() -> None:
    files = {source.file for root in CRATES for source in read_crate(root).values()}
    others = {file for file in RUST.rglob("*.rs") if "fuzz" not in file.parts} - files
    assert all(file.stem.endswith("tests") or file.stem.startswith("test_") for file in others), others


def test_a_circle_through_a_re_export_is_found(tmp_path: Path) -> None:
    root = plant(
        tmp_path,
        {
            "lib.rs": "mod a;\nmod b;",
            "a.rs": "use crate::b::B;\npub struct A(B);",
            "b/mod.rs": "mod inner;\npub use inner::B;",
            "b/inner.rs": "pub struct B;\nfn grow(_: crate::a::A) {}",
        },
    )
    assert set(circle(uses_of(read_crate(root)))) == {"crate::a", "crate::b::inner"}


def test_a_parent_that_a_child_calls_and_that_calls_it_is_found(tmp_path: Path) -> None:
    root = plant(
        tmp_path,
        {
            "lib.rs": "mod a;",
            "a/mod.rs": "mod child;\npub use child::Child;\npub struct A { child: Child }",
            "a/child.rs": "use super::A;\npub struct Child;",
        },
    )
    assert set(circle(uses_of(read_crate(root)))) == {"crate::a", "crate::a::child"}


def test_re_exports_and_tests_make_no_circle(tmp_path: Path) -> None:
    root = plant(
        tmp_path,
        {
            "lib.rs": "mod a;\nmod b;",
            "a/mod.rs": "mod child;\npub use child::{Child, grow as raise};\npub struct A;",
            "a/child.rs": "use super::A;\npub struct Child(A);\n#[cfg(test)]\nmod tests {\n use crate::b::B;\n}",
            "b.rs": '// crate::b\nuse crate::a::{self, raise};\npub struct B(a::Child);\nconst A: &str = "crate::b";',
        },
    )
    uses = uses_of(read_crate(root))
    assert not circle(uses)
    assert {("a", "child"), ("a",)} == uses[("b",)]


def test_no_file_name_is_used_twice() -> None:
    """Bindings are named like what they bind."""
    folders = defaultdict(list)
    for file in RUST.rglob("*.rs"):
        if file.name not in REPEATED and file.relative_to(RUST).parts[0] not in ("python", "fuzz"):
            folders[file.name].append(str(file.parent.relative_to(RUST)))
    assert not {name: places for name, places in folders.items() if len(places) > 1}


def test_no_public_type_name_is_used_twice() -> None:
    files = defaultdict(list)
    for file in RUST.rglob("*.rs"):
        for name in public_types(file):
            files[name].append(str(file.relative_to(RUST)))
    assert not {name: places for name, places in files.items() if len(places) > 1}
