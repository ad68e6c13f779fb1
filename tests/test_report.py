"""The page about a calibration: what it says, and its figures."""

import base64
import re
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from commands import invoke
from conftest import make_pose
from pages import page_of
from scipy.spatial.transform import Rotation

from semcal_cli import core
from semcal_cli.config.synthetic import SynthConfig, SynthLens
from semcal_cli.documentation import ADDRESS
from semcal_cli.drive.camera import IntrinsicsSigma, core_camera
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.frames import Frame
from semcal_cli.formats import find_format
from semcal_cli.formats.format import FormatOptions, Source
from semcal_cli.geometry.poses import camera_center, pose_from_mounting
from semcal_cli.report import ReportInput, read_report_input, write_report
from semcal_cli.report.cloud import frame_cloud
from semcal_cli.report.colors import class_colors
from semcal_cli.report.figures import class_agreements, information_curves
from semcal_cli.report.notations import files, notations
from semcal_cli.report.template import Reason
from semcal_cli.report.words import NOT_BELIEVED, map_sentences, uncertainty_sentences, verdict, verdict_of
from semcal_cli.result.calibration_document import read_calibration, write_calibration
from semcal_cli.synthetic.synthesis import synthesize

T_ANY = make_pose((0.4, -1.1, 0.7), (0.3, -0.2, 1.4))
MAX_BYTES = 5_000_000


@pytest.fixture(scope="module")
def report(made: Path, street: Path) -> ReportInput:
    return read_report_input(read_drive(street), made / "c.yaml")


# What it says.


def test_one_run_leaves_the_page_and_the_images(made: Path, street: Path, tmp_path: Path) -> None:
    """And the page is that of `report`, to the byte, but for the names of files."""
    assert sorted(path.name for path in (made / "overlays").iterdir()) == [f"00000{i}.png" for i in range(4)]
    result = invoke("report", street, made / "c.yaml", "-o", tmp_path / "r.html", "-q")
    assert result.exit_code == 0
    assert (tmp_path / "r.html").read_bytes() == (made / "r.html").read_bytes()


def test_the_page_needs_no_network(made: Path) -> None:
    page = (made / "r.html").read_text().replace(f'<a href="{ADDRESS}/', "")
    assert "default-src 'none'" in page
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", page)
    assert not re.search(r"url\((?!data:|#)", page)


def test_the_verdict_and_its_reasons_come_first(made: Path, street: Path, tmp_path: Path) -> None:
    record = read_calibration(made / "c.yaml")
    reasons = {"reasons": ("1 < 2 <script>", "3 < 4"), "topics": ("clocks", "focal-length")}
    damned = record.model_copy(update={"status": "not_trusted", **reasons})
    write_calibration(damned, tmp_path / "c.yaml")
    page = page_of(street, tmp_path / "c.yaml", tmp_path)
    header = page.split("</header>")[0]
    assert "<h1>Not trusted</h1>" in header
    address = "https://semcal.readthedocs.io/troubleshooting/#clocks"
    assert f'<li>1 &lt; 2 &lt;script&gt; (<a href="{address}">why this comes up</a>)</li>' in header
    assert header.count(f'<a href="{ADDRESS}/troubleshooting/#') == 2
    assert f"<h1>{record.status.replace('_', ' ').capitalize()}</h1>" in (made / "r.html").read_text()


def test_reasons_of_a_file_without_topics_are_shown_without_links(made: Path) -> None:
    reasons = {"reasons": ("3 < 4",), "topics": ()}
    earlier = read_calibration(made / "c.yaml").model_copy(update={"status": "not_trusted", **reasons})
    assert verdict_of(earlier).reasons == (Reason("3 < 4", None),)


def test_a_bare_transform_is_shown_without_a_verdict(street: Path, tmp_path: Path) -> None:
    page = page_of(street, street, tmp_path)
    assert "<h1>Not assessed</h1>" in page
    assert "semcal verify checks whether it holds" in page
    assert "Stage by stage" not in page


def test_the_page_says_where_its_figures_are_not_those_of_the_calibration(
    made: Path, street: Path, tmp_path: Path
) -> None:
    copy = Path(shutil.copytree(street, tmp_path / "drive"))
    drive, labels = read_drive(copy), sorted((copy / "image_labels").iterdir())
    renamed = [frame.model_copy(update={"image_labels": f"./{frame.image_labels}"}) for frame in drive.frames]

    def notices(frames: Sequence[Frame]) -> tuple[str, ...]:
        return read_report_input(drive.model_copy(update={"frames": tuple(frames)}), made / "c.yaml").notices

    labels[0].write_bytes(labels[0].read_bytes() + b"\0")
    changed = f"Files have changed since it was computed: image_labels/{labels[0].name}."
    assert notices(drive.frames) == (changed,)
    assert notices(drive.frames[:3])[0].startswith("Of the 4 frames it was computed from, 3 are in ")
    for path in labels:
        path.write_bytes(path.read_bytes() + b"\0")
    others = notices(drive.frames)
    assert notices(renamed) == others
    assert others[0].startswith("The calibration was computed from other frames, those of ")


def test_a_verdict_is_not_carried_to_other_data(made: Path, street: Path) -> None:
    drive = read_drive(street)
    K_drive = drive.camera.K
    K = ((300.0, 0.0, 319.5), (0.0, 300.0, 179.5), (0.0, 0.0, 1.0))
    other = drive.model_copy(update={"camera": drive.camera.model_copy(update={"K": K})})
    report = read_report_input(other, made / "c.yaml")
    assert report.record is not None
    assert report.record.status == "trusted"
    assert verdict(report).title == "Not assessed here"
    figures = (
        f"fx 300 ({made / 'c.yaml'}: {K_drive[0][0]:.6g}), fy 300 ({made / 'c.yaml'}: {K_drive[1][1]:.6g})"
    )
    assert report.notices == (f"The camera is that of {drive.path}: {figures}.",)


def test_frames_that_are_listed_again_are_read_once(made: Path, street: Path) -> None:
    drive = read_drive(street)
    again = drive.model_copy(update={"frames": drive.frames * 100})
    report_input = read_report_input(again, made / "c.yaml")
    assert report_input.drive.frames == drive.frames
    assert report_input.is_of_record
    assert report_input.notices == ()


def test_a_page_replaces_nothing_that_is_read(made: Path, street: Path) -> None:
    for output, needed in (
        (made / "c.yaml", "expected .html"),
        (made / "none" / "r.html", "expected one to"),
    ):
        result = invoke("report", street, made / "c.yaml", "-o", output)
        assert result.exit_code == 1
        assert needed in str(result.exception)


# Its figures.


def test_classes_add_up_to_all(report: ReportInput) -> None:
    agreement = core.agreement(report.observations.core, report.T_camera_lidar)
    agreements = class_agreements(report.observations, agreement, agreement)
    assert sum(row.share for row in agreements) == pytest.approx(1.0)
    assert sum(row.nats for row in agreements) == pytest.approx(agreement.mutual_information)
    assert sum(row.share * row.agreeing for row in agreements) == pytest.approx(agreement.label_agreement)
    assert all(row.agreeing == row.agreeing_before for row in agreements)
    assert {row.lands_on[0][0] for row in agreements if row.share > 0.05} == {
        row.name for row in agreements if row.share > 0.05
    }


def test_curves_are_those_of_the_camera_moved_along_its_axes(report: ReportInput) -> None:
    T, record = report.T_camera_lidar, report.record
    assert record is not None
    curves = information_curves(report.observations, T, record.uncertainty)
    for axis, curve in enumerate(curves):
        offset = curve.offsets[-3]
        R, center = T[:3, :3], camera_center(T)
        if axis < 3:
            center = center + 0.01 * offset * R[axis]
        else:
            R = Rotation.from_rotvec(np.radians(offset) * np.eye(3)[axis - 3]).as_matrix() @ R
        moved = np.eye(4)
        moved[:3, :3], moved[:3, 3] = R, -R @ center
        motion = moved @ np.linalg.inv(T)
        twist = [*motion[:3, 3], *Rotation.from_matrix(motion[:3, :3]).as_rotvec()]
        ((at,),) = core.information_along(report.observations.core, T, [(twist, [1.0])])
        assert curve.nats[-3] == pytest.approx(at, abs=1e-9)
        in_the_middle = core.agreement(report.observations.core, T).mutual_information
        assert curve.nats[len(curve.nats) // 2] == pytest.approx(in_the_middle, abs=1e-6)
        assert curve.sigma is not None
        # Within what is known: the curve is of all points, the pose of those in the bands of borders.
        assert abs(curve.optimum) <= 2.0 * curve.sigma
        assert curve.offsets[len(curve.offsets) // 2] == 0.0


def test_notations_are_one_transform() -> None:
    texts = {(notation.name, notation.meaning.split(",")[0]): notation.text for notation in notations(T_ANY)}
    values = {key: np.array(text.split(), float) for key, text in texts.items()}
    R, t = Rotation.from_matrix(T_ANY[:3, :3]), T_ANY[:3, 3]
    close = {"atol": 2e-9}
    by_name = {name: value for (name, _), value in values.items()}
    np.testing.assert_allclose(by_name["T_camera_lidar"].reshape(4, 4), T_ANY, **close)
    np.testing.assert_allclose(by_name["T_lidar_camera"].reshape(4, 4), np.linalg.inv(T_ANY), **close)
    np.testing.assert_allclose(by_name["translation x y z"], t, **close)
    np.testing.assert_allclose(by_name["quaternion x y z w"], R.as_quat(canonical=True), **close)
    np.testing.assert_allclose(
        by_name["quaternion w x y z"][[1, 2, 3, 0]], R.as_quat(canonical=True), **close
    )
    np.testing.assert_allclose(values["rotation vector", "degrees"], np.degrees(R.as_rotvec()), atol=1e-7)
    np.testing.assert_allclose(values["rotation vector", "radians"], R.as_rotvec(), **close)
    mounting = pose_from_mounting(by_name["roll pitch yaw"].tolist(), by_name["camera centre x y z"].tolist())
    np.testing.assert_allclose(mounting, T_ANY, atol=1e-8)


@pytest.mark.parametrize("notation", files(T_ANY), ids=lambda notation: notation.name)
def test_files_on_the_page_are_read_back(notation: object, tmp_path: Path) -> None:
    name, text = notation.name, notation.text  # type: ignore[attr-defined]
    path = tmp_path / "calib_cam_to_velo.txt"
    path.write_text(text)
    options = FormatOptions(direction="lidar-to-camera", frame="optical")
    np.testing.assert_allclose(find_format(name).read(Source.read(path), options), T_ANY, atol=1e-9)


def test_points_have_the_colour_of_the_pixel_they_land_on(report: ReportInput) -> None:
    cloud, observations = frame_cloud(report), report.observations
    positions = np.frombuffer(base64.b64decode(cloud.positions_cm), "<i2").reshape(-1, 3) / 100.0
    by = {
        name: np.frombuffer(base64.b64decode(text), np.uint8).reshape(-1, 3)
        for name, text in cloud.colors.items()
    }
    assert set(by) == {"label of the pixel", "label of the point", "image"}
    assert all(len(colors) == len(positions) for colors in by.values())
    T = report.T_camera_lidar
    points = np.asarray(positions, np.float32)
    projected = core.project_points(core_camera(observations.camera), points, T)
    is_grey = (by["label of the pixel"] == by["label of the pixel"][-1]).all(axis=1)
    colored = np.flatnonzero(~is_grey & np.isfinite(projected.ranges))
    u, v = np.rint(projected.pixels[colored]).astype(int).T
    names = list(dict.fromkeys([*observations.point_class_names, *observations.image_class_names]))
    palette = dict(zip(names, class_colors(names)[:, ::-1].tolist(), strict=True))
    expected = np.array(
        [palette[observations.image_class_names[i]] for i in observations.images[0].classes[v, u]]
    )
    # Positions are rounded to centimetres: near a label's border that is a pixel.
    assert (by["label of the pixel"][colored] == expected).all(axis=1).mean() > 0.97
    assert len(colored) > 1000
    np.testing.assert_allclose(cloud.cameras[0].camera_center, camera_center(T))


def test_a_page_of_twenty_frames_of_any_content_is_below_its_limit(
    report: ReportInput, tmp_path: Path
) -> None:
    height, width = report.observations.images[0].classes.shape
    noise = np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "noise.png"), noise)
    frames = [f.model_copy(update={"image": str(tmp_path / "noise.png")}) for f in report.drive.frames]
    many = replace(
        report,
        drive=report.drive.model_copy(update={"frames": tuple(5 * frames)}),
        observations=report.observations.of_frames(5 * list(range(4))),
    )
    write_report(many, tmp_path / "r.html")
    assert 2_000_000 < (tmp_path / "r.html").stat().st_size < MAX_BYTES


@pytest.mark.parametrize("lens", ["fisheye", "equirectangular"])
def test_a_page_of_any_lens(lens: SynthLens, tmp_path: Path) -> None:
    synthesize(SynthConfig(num_frames=1, seed=3, width=320, height=200, lens=lens), tmp_path / "drive")
    page = page_of(tmp_path / "drive", tmp_path / "drive", tmp_path)
    assert "NaN" not in page.split("cloud-data")[1]


def test_a_rejected_polish_is_said_to_be(made: Path, street: Path, tmp_path: Path) -> None:
    record = read_calibration(made / "c.yaml")
    assert record.polish is not None
    worse = {"accepted": False, "held_out_gain_nats": -0.3, "held_out_sigma_nats": 0.05}
    rejected = {"polish": record.polish.model_copy(update=worse), "uncertainty": None}
    write_calibration(record.model_copy(update=rejected), tmp_path / "c.yaml")
    page = page_of(street, tmp_path / "c.yaml", tmp_path)
    assert "held-out data agree worse after the polish, by 0.3000 ± 0.0500 nats" in page
    assert "polished <small>rejected</small>" in page
    lost = (
        "held-out data lost information (-0.3000 \u00b1 0.0500 nats), of which 3 standard errors are allowed."
    )
    assert f"The polish was not kept: {lost}" in page


def test_words_state_the_uncertainty(report: ReportInput) -> None:
    record = report.record
    assert record is not None
    assert record.uncertainty is not None
    covariance = np.diag([0.01, 0.02, 0.03, 0.001, 0.002, 0.003]) ** 2
    uncertainty = record.uncertainty.model_copy(
        update={
            "covariance": tuple(map(tuple, covariance.tolist())),
            "half_width_95_camera_center_m": (0.02, 0.041, 0.06),
            "half_width_95_rotation_deg": tuple(np.degrees([0.002, 0.004, 0.006]).tolist()),
            "weak_directions": ("in roll: +- 0.30 degrees; add frames",),
            "label_bleed": None,
            "intrinsics_cost": None,
            "covariance_of_intrinsics": None,
            "twist_by_intrinsics": None,
            "degrees_of_freedom": (100.0,) * 6,
        }
    )
    camera = report.observations.camera
    uncertain = record.model_copy(update={"uncertainty": uncertainty})
    first, weak = uncertainty_sentences(uncertain)
    reading, meaning = map_sentences(uncertain)
    assert "2.0 cm" in first
    assert "4.1 cm up or down" in first
    assert "0.23 in yaw" in first
    twists = np.random.default_rng(0).multivariate_normal(np.zeros(6), covariance, 20_000)
    ahead_px, worst_px = map(float, re.findall(r"within ([\d.]+) pixels", reading))
    corner_px = np.array([[0.0, 0.0], camera.size]) - [[0.0, 0.0], [1.0, 1.0]]
    rays = np.vstack([[0.0, 0.0, 1.0], core_camera(camera).unproject(corner_px)])
    for ray, radius_px in zip(rays, (ahead_px, worst_px, worst_px), strict=True):
        moved = 10.0 * ray + twists[:, :3] + np.cross(twists[:, 3:], 10.0 * ray)
        pixels = core_camera(camera).project(np.vstack([10.0 * ray, moved]))
        within = np.linalg.norm(pixels[1:] - pixels[0], axis=1) <= radius_px
        assert 0.94 < within.mean() < 0.995
    assert meaning.endswith("in the worst direction.")
    of_K = uncertainty.model_copy(update={"covariance_of_intrinsics": uncertainty.covariance})
    with_K = map_sentences(record.model_copy(update={"uncertainty": of_K}))[-1]
    assert with_K.endswith("although both largely cancel in the image.")
    twisted = of_K.model_copy(update={"twist_by_intrinsics": tuple([(0.0,) * 4] * 6)})
    with_twist = map_sentences(record.model_copy(update={"uncertainty": twisted}))[-1]
    assert with_twist.endswith("what its errors do to both largely cancels.")
    # The errors that the calibration was made with count, whatever those of the drive beside it.
    sure = record.input.camera.model_copy(update={"intrinsics_sigma": IntrinsicsSigma(cx=0.3)})
    by_cx = twisted.model_copy(update={"twist_by_intrinsics": tuple([(0.0, 0.0, 1e-4, 0.0)] * 6)})
    of_sure = record.model_copy(
        update={"uncertainty": by_cx, "input": record.input.model_copy(update={"camera": sure})}
    )
    (headline,) = re.findall(r"or ([\d.]+) px at 10 m", verdict_of(of_sure).figures)
    assert f"within {headline} pixels of where it should straight ahead" in map_sentences(of_sure)[0]
    assert weak == "Least certain: in roll: +- 0.30 degrees; add frames."
    unknown = record.model_copy(update={"uncertainty": None})
    assert map_sentences(unknown) == []
    (nothing,) = uncertainty_sentences(unknown)
    assert nothing.startswith("Its error is unknown")


def test_a_page_states_no_interval_that_is_not_believed(made: Path, street: Path, tmp_path: Path) -> None:
    """The file keeps it; neither the verdict, the sentences nor the curves show it."""
    record = read_calibration(made / "c.yaml")
    assert record.status == "trusted"
    assert record.believed_uncertainty == record.uncertainty
    doubted = record.model_copy(update={"status": "not_trusted", "reasons": ("why",), "topics": ("rivals",)})
    pages = []
    for calibration in (record, doubted):
        write_calibration(calibration, tmp_path / "c.yaml")
        pages.append(page_of(street, tmp_path / "c.yaml", tmp_path))
    assert read_calibration(tmp_path / "c.yaml").uncertainty == record.uncertainty
    shown = (
        "(95 %)",
        "at the worst place",
        "In the image",
        "two standard errors:",
        'class="band"',
        "1 pixel and fx and fy",
    )
    assert [[text in page for text in shown] for page in pages] == [[True] * 6, [False] * 6]
    assert [NOT_BELIEVED in page for page in pages] == [False, True]
