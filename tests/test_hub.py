"""Networks by their names, from a hub on the loopback interface: the library's cache, and what cannot be had."""

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import onnx
import pytest
import yaml
from commands import invoke
from documentation import ROOT
from huggingface_hub import constants
from model_hub import ModelHub, serve
from networks import STREET_COLORS, color_network

from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.events import StageDone
from semcal_cli.labelling.hub import RECOMMENDED, find_model, hub_name

NAME = "lab/street"
CONFIG = {
    "architectures": ["SegformerForSemanticSegmentation"],
    "id2label": {"0": "sky", "1": "road", "2": "green", "3": "brown"},
}
PREPROCESSOR = {"do_normalize": False, "rescale_factor": 1 / 255, "size": {"height": 96, "width": 128}}
MEGABYTE = 1_000_000


@pytest.fixture
def hub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModelHub]:
    """A hub to which the library in this process goes, with an empty cache."""
    with serve() as served:
        at = served.address + "/{repo_id}/resolve/{revision}/{filename}"
        monkeypatch.setattr(constants, "ENDPOINT", served.address)
        monkeypatch.setattr(constants, "HUGGINGFACE_CO_URL_TEMPLATE", at)
        monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "cache"))
        yield served


def repository(folder: Path, names: dict[str, str] = CONFIG["id2label"]) -> Path:  # type: ignore[assignment]
    """Write a repository as those of Xenova: weights of two kinds, a pickle, code, and what transformers says of it."""
    (folder / "onnx").mkdir(parents=True)
    color_network(folder / "onnx/model.onnx", stride=2, colors=STREET_COLORS)
    color_network(folder / "onnx/model_fp16.onnx", stride=4, dtype="float16", colors=STREET_COLORS)
    (folder / "config.json").write_text(json.dumps(CONFIG | {"id2label": names}))
    (folder / "preprocessor_config.json").write_text(json.dumps(PREPROCESSOR))
    for name in ("pytorch_model.bin", "modeling.py", "README.md", "onnx/model_quantized.onnx"):
        (folder / name).write_bytes(b"never fetched")
    return folder


def close(hub: ModelHub, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the library go where nobody listens."""
    monkeypatch.setattr(constants, "ENDPOINT", "http://127.0.0.1:9")


def test_a_drive_is_labelled_by_a_name_and_the_second_run_fetches_nothing(
    hub: ModelHub, plain: Path, tmp_path: Path
) -> None:
    folder = repository(tmp_path / "repository")
    hub.add(NAME, folder)
    words = ("label", plain, "--image-model", f"hf:{NAME}", "-o", tmp_path / "out")
    first = invoke(*words)
    assert first.exit_code == 0, first.output
    assert sorted(hub.fetched) == ["config.json", "onnx/model.onnx", "preprocessor_config.json"]
    assert f"hf:{NAME}@" in first.output
    assert "3 files, 0.0 MB" in first.output
    assert "guessed" not in first.output
    labelled = read_drive(tmp_path / "out")
    assert labelled.classes is not None
    assert labelled.classes.image == {"sky": (0,), "road": (1,), "green": (2,), "brown": (3,)}
    record = json.loads((tmp_path / "out/image_labels/semcal_label.json").read_text())
    assert record["model"] == {"model": hashlib.sha256((folder / "onnx/model.onnx").read_bytes()).hexdigest()}
    assert record["from"] == f"hf:{NAME}@{hub.commit(NAME)}:onnx/model.onnx"
    assert record["size"] == [128, 96]
    second = invoke(*words)
    assert second.exit_code == 0, second.output
    assert "fetched" not in second.output
    assert len(hub.fetched) == 3
    # The same file under another commit makes the same labels.
    (folder / "README.md").write_text("new")
    hub.add(NAME, folder)
    third = invoke(*words)
    assert third.exit_code == 0, third.output
    assert "fetched" not in third.output
    assert "4 label files reused" in third.output


def test_the_command_takes_the_library_s_variables_and_then_needs_no_network(
    plain: Path, tmp_path: Path
) -> None:
    words = ["label", str(plain), "--image-model", f"hf:{NAME}", "-o"]
    env = {key: value for key, value in os.environ.items() if not key.upper().endswith("_PROXY")}

    def run(name: str, **variables: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "semcal_cli", *words, str(tmp_path / name)]
        environment = env | {"HF_HOME": str(tmp_path / "home")} | variables
        return subprocess.run(
            command, capture_output=True, text=True, env=environment, check=False, timeout=120, cwd=tmp_path
        )

    with serve() as hub:
        hub.add(NAME, repository(tmp_path / "repository"))
        online = run("online", HF_ENDPOINT=hub.address)
        assert online.returncode == 0, online.stderr
        num_fetched = len(hub.fetched)
        cold = run("cold", HF_ENDPOINT=hub.address, HF_HUB_OFFLINE="1", HF_HOME=str(tmp_path / "empty"))
        assert cold.returncode == 1
        assert "cannot reach http" in cold.stderr
        assert len(cold.stderr.splitlines()) == 1
    offline = run("offline", HF_HUB_OFFLINE="1")
    assert offline.returncode == 0, offline.stderr
    assert num_fetched == len(hub.fetched) == 3
    files = [sorted((tmp_path / name / "image_labels").iterdir()) for name in ("online", "offline")]
    assert [file.read_bytes() for file in files[0]] == [file.read_bytes() for file in files[1]]


def test_a_hub_out_of_reach_or_broken_leaves_what_the_cache_has(
    hub: ModelHub, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hub.add(NAME, repository(tmp_path / "repository"))
    path = find_model(f"hf:{NAME}", 1.0)
    hub.is_broken = True
    assert find_model(f"hf:{NAME}", 1.0) == path
    with pytest.raises(InputError, match=r"hf:lab/other: cannot reach http.* \(.*503"):
        find_model("hf:lab/other", 1.0)
    close(hub, monkeypatch)
    assert find_model(f"hf:{NAME}", 1.0) == path
    with pytest.raises(InputError, match=r"hf:lab/street@v1: cannot reach http://127"):
        find_model(f"hf:{NAME}@v1", 1.0)


def test_a_revision_is_a_branch_a_tag_or_a_commit(hub: ModelHub, tmp_path: Path) -> None:
    hub.add(NAME, repository(tmp_path / "new"))
    hub.add(NAME, repository(tmp_path / "old", {"0": "a", "1": "b", "2": "c", "3": "d"}), "v1")
    commit = hub.commit(NAME, "v1")
    for revision in ("v1", commit):
        shown = invoke("label", "--show", f"hf:{NAME}@{revision}:onnx/model.onnx")
        assert shown.exit_code == 0, shown.output
        assert "classes   4: a, b, c, d" in shown.output
    assert hub_name(find_model(f"hf:{NAME}@v1", 1.0)) == f"hf:{NAME}@{commit}:onnx/model.onnx"
    assert "classes   4: sky, road" in invoke("label", "--show", f"hf:{NAME}").output
    with pytest.raises(InputError, match="found no revision 'v2', expected a branch, a tag or a commit"):
        find_model(f"hf:{NAME}@v2", 1.0)


def test_another_file_may_be_named_and_weights_beside_it_come_along(hub: ModelHub, tmp_path: Path) -> None:
    folder = repository(tmp_path / "repository")
    half = folder / "onnx/model_fp16.onnx"
    weights = {"save_as_external_data": True, "location": "model_fp16.onnx_data", "size_threshold": 0}
    onnx.save(onnx.load(str(half)), str(half), **weights)
    hub.add(NAME, folder)
    shown = invoke("label", "--show", f"hf:{NAME}:onnx/model_fp16.onnx")
    assert shown.exit_code == 0, shown.output
    assert "'x' 1 x 3 x any x any float16" in shown.output
    assert {"onnx/model_fp16.onnx", "onnx/model_fp16.onnx_data"} < set(hub.fetched)
    assert "onnx/model.onnx" not in hub.fetched


def test_what_is_too_large_is_refused_before_it_is_fetched(hub: ModelHub, tmp_path: Path) -> None:
    folder = repository(tmp_path / "repository")
    (folder / "onnx/model.onnx_data").write_bytes(bytes(2 * MEGABYTE))
    hub.add(NAME, folder)
    refused = invoke("label", "--show", f"hf:{NAME}", "--max-download-mb", 1)
    assert str(refused.exception) == (
        f"hf:{NAME}: found 2.0 MB to fetch, needed at most 1 MB; --max-download-mb allows more"
    )
    assert not hub.fetched
    events: list[object] = []
    find_model(f"hf:{NAME}", 3.0, events.append)
    assert "onnx/model.onnx_data" in hub.fetched
    assert any("onnx/model.onnx_data of lab/street: 2.0 of 2.0 MB" in str(event) for event in events)
    assert isinstance(events[-1], StageDone)
    # What is in the cache is not fetched, and thus not too large.
    assert invoke("label", "--show", f"hf:{NAME}", "--max-download-mb", 1).exit_code == 0


def test_a_fetch_that_breaks_off_is_one_line(
    hub: ModelHub, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hub.add(NAME, repository(tmp_path / "repository"))

    def fail(*args: object, **about: object) -> None:
        raise RuntimeError("lost\nthe connection")

    monkeypatch.setattr("semcal_cli.labelling.hub.parts_of", fail)
    with pytest.raises(InputError, match=f"^hf:{NAME}: could not be fetched: lost the connection$"):
        find_model(f"hf:{NAME}", 1.0)
    assert not [path for path in (tmp_path / "cache").rglob("*") if path.is_file()]


def _gated(status: int) -> Callable[[ModelHub, Path], None]:
    return lambda hub, folder: hub.add(NAME, folder, gate=status)


def _only(hub: ModelHub, folder: Path) -> None:
    for path in [*folder.rglob("*.onnx")]:
        path.unlink()
    hub.add(NAME, folder)


def _other_file(hub: ModelHub, folder: Path) -> None:
    (folder / "onnx/model.onnx").rename(folder / "onnx/net.onnx")
    hub.add(NAME, folder)


TERMS = f"expected access to it: accept its terms at http://.*/{NAME} and log in with `hf auth login`"


@pytest.mark.parametrize(
    ("make", "name", "message"),
    [
        (_gated(401), f"hf:{NAME}", f"hf:{NAME}: found a gated model, {TERMS}"),
        (_gated(403), f"hf:{NAME}", f"hf:{NAME}: found a gated model, {TERMS}"),
        (ModelHub.add, "hf:lab/none", "hf:lab/none: found no such model at http://.*, or it is private"),
        (
            _only,
            f"hf:{NAME}",
            r"found no ONNX file \(weights: pytorch_model\.bin\), expected a repository with onnx/",
        ),
        (
            _other_file,
            f"hf:{NAME}",
            r"found no onnx/model\.onnx or model\.onnx among onnx/.*, onnx/net\.onnx, expected",
        ),
        (
            _other_file,
            f"hf:{NAME}:x.onnx",
            r"found x\.onnx among onnx/.*, expected hf:lab/street:FILE with one of",
        ),
        (
            _other_file,
            f"hf:{NAME}:pytorch_model.bin",
            r"is not the name of an ONNX network on the hub, expected hf:OWNER/",
        ),
        (_other_file, f"hf:{NAME}:../x.onnx", "is not the name of an ONNX network on the hub"),
        (_other_file, "hf:street", "is not the name of an ONNX network on the hub"),
        (
            _other_file,
            "citiscapes",
            "found network 'citiscapes', expected a file, hf:.*, or one of: cityscapes, ade20k",
        ),
    ],
)
def test_what_cannot_be_had_is_one_line_and_nothing_is_fetched(
    hub: ModelHub, tmp_path: Path, make: Callable[..., None], name: str, message: str
) -> None:
    folder = repository(tmp_path / "repository")
    make(hub, NAME, folder) if make is ModelHub.add else make(hub, folder)
    with pytest.raises(InputError, match=message) as caught:
        find_model(name, 1.0)
    assert "\n" not in str(caught.value)
    assert not hub.fetched


def test_a_short_name_is_that_of_a_repository(hub: ModelHub, plain: Path, tmp_path: Path) -> None:
    hub.add(RECOMMENDED["cityscapes"].repository, repository(tmp_path / "repository"))
    result = tmp_path / "out.yaml"
    ending = invoke("calibrate", plain, "--image-model", "cityscapes", "--no-polish", "-o", result)
    assert ending.exit_code in (0, 3), ending.output
    assert "images by cityscapes" in ending.output
    written = yaml.safe_load(result.read_text())["input"]
    assert ".semcal_labels" in written["drive"]
    weights = (tmp_path / "repository/onnx/model.onnx").read_bytes()
    repository_name, licence = RECOMMENDED["cityscapes"].repository, RECOMMENDED["cityscapes"].licence
    assert written["networks"]["image"] == {
        "name": f"hf:{repository_name}@{hub.commit(repository_name)}:onnx/model.onnx",
        "sha256": {"model": hashlib.sha256(weights).hexdigest()},
        "licence": licence,
    }
    assert ending.output.count(f"licence of model.onnx: {licence}") == 1
    listed = invoke("label", "--list-models")
    assert listed.exit_code == 0
    assert listed.output.splitlines()[:3] == [
        "cityscapes  15 MB, 19 classes of Cityscapes",
        f"            hf:{repository_name}",
        f"            {licence}",
    ]


def test_the_documentation_lists_the_short_names() -> None:
    page = (ROOT / "docs/labels.md").read_text()
    for name, it in RECOMMENDED.items():
        row = f"| `{name}` | {it.megabytes} MB | {it.classes} | `{it.repository}` | {it.licence} |"
        assert row in page


def test_a_batch_fetches_a_network_once(hub: ModelHub, plain: Path, tmp_path: Path) -> None:
    """Its drives are calibrated in processes of their own, which do not know this hub."""
    hub.add(NAME, repository(tmp_path / "repository"))
    words = ("--image-model", f"hf:{NAME}", "--no-polish", "--max-frames", 1)
    result = invoke("batch", plain, "-o", tmp_path / "results", "--", *words)
    assert result.exit_code in (0, 3), result.output
    assert len(hub.fetched) == 3


def test_a_downloaded_network_works_elsewhere_without_a_connection(
    hub: ModelHub, plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It keeps its name on the hub, and the hub's library finds it there."""
    hub.add(NAME, repository(tmp_path / "repository"))
    folder = tmp_path / "carried"
    done = invoke("label", "--download", f"hf:{NAME}", "--to", folder)
    assert done.exit_code == 0, done.output
    files = [path for path in folder.rglob("*") if not path.is_dir()]
    names = ["config.json", "main", "model.onnx", "preprocessor_config.json"]
    assert sorted(path.name for path in files) == names
    assert not any(path.is_symlink() for path in files)
    close(hub, monkeypatch)
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "empty"))
    assert invoke("label", plain, "--image-model", f"hf:{NAME}", "-o", tmp_path / "no").exit_code == 1
    (model,) = folder.rglob("model.onnx")
    assert f"offline: semcal label DRIVE --image-model {model} -o labelled" in " ".join(done.output.split())
    for name, cache in ((model, tmp_path / "empty"), (f"hf:{NAME}", folder)):
        monkeypatch.setattr(constants, "HF_HUB_CACHE", str(cache))
        out = tmp_path / f"out_{cache.name}"
        done = invoke("label", plain, "--image-model", name, "-o", out)
        assert done.exit_code == 0, done.output
        record = json.loads((out / "image_labels/semcal_label.json").read_text())
        assert record["from"] == f"hf:{NAME}@{hub.commit(NAME)}:onnx/model.onnx"


def test_a_file_of_the_user_is_not_downloaded(tmp_path: Path) -> None:
    color_network(tmp_path / "net.onnx", stride=2, colors=STREET_COLORS)
    done = invoke("label", "--download", tmp_path / "net.onnx", "--to", tmp_path / "carried")
    assert done.exit_code == 1
    assert "net.onnx: found a file of your own, expected a network on the hub" in str(done.exception)
