"""What a path holds that is no drive, and what each command says of it."""

import os
import shlex
import shutil
from pathlib import Path

import pytest
from bag_imports import small
from bags import KINDS
from commands import invoke
from conftest import Cli
from dataset_trees import TREES, own_data

from semcal_cli.config.file_limits import MAX_DOCUMENT_BYTES
from semcal_cli.importing.recognition import recognise


@pytest.mark.parametrize("name", TREES)
def test_each_data_set_is_recognised_and_imported_by_the_command_that_is_told(
    name: str, tmp_path: Path
) -> None:
    tree = TREES[name](tmp_path / "tree")
    source = recognise(tree.root)
    assert source is not None
    assert (source.kind, source.root, source.sequence) == (name, tree.root, None)
    semcal, *words = shlex.split(source.command(tmp_path / "drive", *tree.arguments))
    assert semcal == "semcal"
    assert invoke(*words).exit_code == 0
    assert recognise(tmp_path / "drive") is None


@pytest.mark.parametrize(
    ("name", "folder", "sequence"),
    [
        ("semantickitti", "sequences/00", "00"),
        ("kitti-raw", "2011_09_26", "2011_09_26_drive_0001_sync"),
        ("kitti-raw", "2011_09_26/2011_09_26_drive_0001_sync", "2011_09_26_drive_0001_sync"),
        ("rellis-3d", "00000", "00000"),
    ],
)
def test_a_sequence_is_recognised(
    name: str, folder: str, sequence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = TREES[name](tmp_path / "tree").root
    source = recognise(root / folder)
    assert source is not None
    assert (source.kind, source.root, source.sequence) == (name, root, sequence)
    monkeypatch.chdir(root / folder)
    here = recognise(Path())
    assert here is not None
    assert here.root.resolve() == root.resolve()


@pytest.mark.parametrize(
    ("name", "one", "other", "sequence"),
    [
        ("semantickitti", "sequences/00", "sequences/01", None),
        ("kitti-raw", *(f"2011_09_26/2011_09_26_drive_000{i}_sync" for i in (1, 2)), "2011_09_26"),
    ],
)
def test_a_folder_of_several_sequences_is_a_sequence_only_if_its_reader_knows_it(
    name: str, one: str, other: str, sequence: str | None, tmp_path: Path, cli: Cli
) -> None:
    root = TREES[name](tmp_path / "tree").root
    shutil.copytree(root / one, root / other)
    folder = (root / one).parent
    source = recognise(folder)
    assert source is not None
    assert (source.kind, source.root, source.sequence) == (name, root, sequence)
    code, _, err = cli("calibrate", folder, "-o", tmp_path / "c.yaml")
    assert code == 1
    typed = f"semcal calibrate {folder} -o {tmp_path / 'c.yaml'}"
    choices = [f"`{typed} --sequence {Path(path).name}`" for path in (one, other)]
    assert (f"choose one: {', '.join(choices)}" in err) == (sequence is None)
    assert (tmp_path / f"{sequence}_drive").exists() == (sequence is not None)


@pytest.mark.parametrize("kind", KINDS)
def test_a_recording_is_recognised(kind: str, tmp_path: Path) -> None:
    path = small(tmp_path, kind)
    source = recognise(path)
    assert source is not None
    assert source.is_recording
    if path.is_dir():
        assert recognise(path / "metadata.yaml") == source
    else:
        renamed = path.rename(tmp_path / "renamed.data")
        assert recognise(renamed) is not None


def test_recordings_that_differ_after_a_dot_make_drives_of_their_own(tmp_path: Path) -> None:
    recorded = small(tmp_path, "mcap library")
    names = {}
    for name in ("run v1.2.mcap", "run v1.3.mcap"):
        source = recognise(Path(shutil.copy(recorded, tmp_path / name)))
        assert source is not None
        names[name] = str(source.drive)
    assert names == {"run v1.2.mcap": "run v1.2_drive", "run v1.3.mcap": "run v1.3_drive"}


def test_what_is_no_recording_is_not_recognised(street: Path, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("nothing")
    for path in (street, street / "drive.yaml", tmp_path, tmp_path / "notes.txt", tmp_path / "missing"):
        assert recognise(path) is None


@pytest.mark.parametrize(
    "command", ["inspect {}", "overlay {} {} -o {out}", "label {} --points segments -o {out}"]
)
def test_other_commands_name_the_import(command: str, tmp_path: Path, cli: Cli) -> None:
    path = small(tmp_path, "mcap library")
    code, out, err = cli(*command.format(path, path, out=tmp_path / "out").split())
    assert (code, out) == (1, "")
    assert err == (
        f"semcal: error: {path}: found a recording, expected a drive; first import it: "
        f"`semcal import bag {path} -o bag_drive`\n"
    )


def test_a_folder_of_drives_is_for_batch(street: Path, tmp_path: Path, cli: Cli) -> None:
    for name in ("a", "b"):
        (tmp_path / "many" / name).mkdir(parents=True)
        (tmp_path / "many" / name / "drive.yaml").write_text("{}")
    for command in ("inspect", "calibrate"):
        code, _, err = cli(command, tmp_path / "many")
        assert code == 1
        assert err == (
            f"semcal: error: {tmp_path / 'many'}: found a folder of 2 drives, expected one drive; for all of them: "
            f"`semcal batch '{tmp_path / 'many'}/*' -o results`\n"
        )
    code, _, err = cli("batch", tmp_path / "many", "-o", tmp_path / "results")
    assert code == 1
    assert "2 drives" in err, err


def test_an_error_of_a_batch_is_not_about_its_folder_of_drives(
    street: Path, tmp_path: Path, cli: Cli
) -> None:
    (tmp_path / "many").mkdir()
    (tmp_path / "many/street").symlink_to(street)
    file, missing = tmp_path / "file", tmp_path / "nope.yaml"
    file.touch()
    for options, named in (
        (["-o", file], file),
        (["-o", tmp_path / "results", "--command", "verify", "--calibration", missing], missing),
    ):
        code, _, err = cli("batch", tmp_path / "many", *options)
        assert code == 1
        assert err.startswith(f"semcal: error: {named}: ")


def test_a_folder_of_ones_own_files_gets_the_patterns(tmp_path: Path, cli: Cli) -> None:
    own_data(tmp_path / "own")
    code, _, err = cli("calibrate", tmp_path / "own")
    assert code == 1
    clouds, images = (tmp_path / f"own/{name}" for name in ("clouds/*.bin", "labels/*.png"))
    assert f"semcal import folder --points '{clouds}' --images '{images}' --camera-info FILE -o" in err


def test_an_import_of_another_kind_names_the_right_one(tmp_path: Path, cli: Cli) -> None:
    root = TREES["kitti-object"](tmp_path / "tree").root
    code, _, err = cli("import", "nuscenes", root, "-o", tmp_path / "drive")
    assert code == 1
    assert f"{root}: found no version, expected folders such as v1.0-mini and samples in ROOT; " in err
    assert f"looks like the data set kitti-object: `semcal import kitti-object {root} -o" in err
    path = small(tmp_path / "bag", "mcap library")
    code, _, err = cli("import", path)
    assert code == 2
    assert f"{path} is a recording. Type `semcal import bag {path} -o bag_drive`." in err
    assert "`semcal import bag PATH -o DRIVE`" in cli("import", "ros", path)[2]
    listed = cli("import", "kitti", path)[2]
    assert all(name in listed for name in ("kitti-raw", "kitti-360", "kitti-object", "kitti-odometry"))


def test_a_pattern_that_the_shell_expanded_is_told(tmp_path: Path, cli: Cli) -> None:
    code, _, err = cli(
        "import", "folder", "--points", "data/1.bin", "data/2.bin", "--images", "a.png", "-o", "x"
    )
    assert code == 2
    assert "Quote it: --points 'data/*.bin'." in err


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        ("a.e57", b"ASTM-E57", "a point cloud"),
        ("A.PCD", b"VERSION .7\n", "a point cloud"),
        ("a.las", b"LASF", "a point cloud"),
        ("a.pcd.bin", bytes(20), "a point cloud"),
        ("a.npy", b"\x93NUMPY", "an array"),
        ("a.label", bytes(4), "point labels"),
        ("a.png", b"\x89PNG", "an image"),
        ("a.jpg", b"\xff\xd8\xff", "an image"),
        ("a.tif", b"II*\0", "a file that is not text"),
    ],
)
def test_a_file_of_data_is_no_drive(name: str, content: bytes, kind: str, tmp_path: Path, cli: Cli) -> None:
    (tmp_path / name).write_bytes(content)
    code, out, err = cli("inspect", tmp_path / name)
    assert (code, out) == (1, "")
    assert err == (
        f"semcal: error: {tmp_path / name}: found {kind}, expected a drive.yaml or its folder; `semcal import folder "
        "--points GLOB --images GLOB --camera-info FILE -o my_drive` makes one of clouds and images\n"
    )


WITH_DRIVES = """
accumulate {} -o {out}
audit {} {calibration} -o {page}
base {}
batch {} -o {out}
calibrate {}
export colmap {} {calibration} -o {out}.json
export mcap {} {calibration} -o {out}.mcap
export nerfstudio {} {calibration} -o {out}.json
export ply {} {calibration} -o {out}
export rerun {} -o {out}.rrd
experiment table {} -o {out}
initialize {}
inspect {} --find-origin
label {} --points segments -o {out}
merge {} {} -o {out}
odometry {} -o {out}
overlay {} {calibration} -o {out}
refine {} --init {calibration}
report {} {calibration} -o {page}
verify {} {calibration}
view {} {calibration}
"""


@pytest.mark.parametrize("command", WITH_DRIVES.strip().splitlines())
def test_every_command_refuses_a_cloud_in_the_place_of_a_drive(
    command: str, tmp_path: Path, cli: Cli
) -> None:
    cloud, calibration = tmp_path / "clouds/a.pcd", tmp_path / "T.yaml"
    cloud.parent.mkdir()
    cloud.write_bytes(b"VERSION .7\n")
    os.truncate(cloud, MAX_DOCUMENT_BYTES + 1)
    calibration.write_text("T_camera_lidar: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]")
    names = {"calibration": calibration, "out": tmp_path / "out", "page": tmp_path / "page.html"}
    _, out, err = cli(*command.format(cloud, cloud, **names).split())
    told = " ".join((out + err).split())
    assert f"{cloud}: found a point cloud, expected a drive.yaml or its folder; `semcal import folder" in told


@pytest.mark.parametrize("command", ["inspect {0}", "import bag {0} -o {1}", "compare {0} {0}"])
def test_packets_of_an_ouster_are_turned_into_sweeps_elsewhere(
    command: str, tmp_path: Path, cli: Cli
) -> None:
    packets = tmp_path / "a.osf"
    packets.write_bytes(b"\0packets")
    code, _, err = cli(*command.format(packets, tmp_path / "drive").split())
    assert code == 1
    assert f"{packets}: found packets of a LiDAR, which `ouster-cli source FILE save sweeps.csv` turns" in err
