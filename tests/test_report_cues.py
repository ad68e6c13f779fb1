"""Pages of poses that were refined by other cues than labels."""

import base64
import io
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import PIL.Image
import pytest
from pages import page_of

from semcal_cli.config import CueName
from semcal_cli.drive.document import read_drive
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.cues.edges import NO_EDGE
from semcal_cli.observations.observations import NO_CLASS
from semcal_cli.report import read_report_input
from semcal_cli.report.colors import (
    AGREES,
    DISAGREES,
    HIDDEN,
    NO_EDGE_NAME,
    NO_PAIR,
    STEP_COLORS,
    page_colors,
)
from semcal_cli.report.page_images import MAX_POINTS, make_images
from semcal_cli.report.points import View, agreement_kinds, frame_points
from semcal_cli.report.words import polish_sentences
from semcal_cli.result.calibration_document import read_calibration, write_calibration


def by_cues(made: Path, folder: Path, *cues: CueName) -> Path:
    """Write the calibration as if it had been made by other cues."""
    record = read_calibration(made / "c.yaml")
    options = {**record.settings.options, "cues": {cue: {} for cue in cues}}
    settings = record.settings.model_copy(update={"options": options})
    write_calibration(record.model_copy(update={"settings": settings}), folder / "c.yaml")
    return folder / "c.yaml"


@pytest.mark.parametrize(
    ("cues", "by"),
    [
        (("edges",), "edge"),
        (("segments", "edges"), "edge"),
        (("edges", "intensity"), "edge"),
        (("segments", "intensity"), "depth"),
        (("labels", "edges"), "class"),
    ],
)
def test_what_is_shown_is_what_the_pose_was_refined_by(
    made: Path, street: Path, tmp_path: Path, cues: tuple[CueName, ...], by: str
) -> None:
    report_input = read_report_input(read_drive(street), by_cues(made, tmp_path, *cues))
    overlays = report_input.overlays(2)
    assert overlays.by == by
    assert len(overlays.poses) == 2
    assert ("range step 3" in report_input.observations.point_class_names) == (by == "edge")


def test_a_page_of_edges_shows_them_on_those_of_the_image(made: Path, street: Path, tmp_path: Path) -> None:
    file = by_cues(made, tmp_path, "segments", "edges")
    page, report_input = page_of(street, file, tmp_path), read_report_input(read_drive(street), file)
    assert '<input type="radio" name="colors" value="edge" checked>' in page
    assert 'name="colors" value="class"' not in page
    assert page.count('class="image edges"') == 4
    assert page.count('data-photograph="data:image/webp') == 4
    assert 'id="worst"' not in page
    assert "<dt>edges agree</dt>" not in page
    assert "% agree" not in page
    assert "Where that leaves a doubt, both mountings are refined" in page
    assert "needs at least" not in page
    shown = make_images(report_input.overlays(1)).best
    image = np.array(PIL.Image.open(io.BytesIO(base64.b64decode(shown.uri.split(",")[1])))).astype(int)
    assert np.abs(image - image.mean(axis=2, keepdims=True)).max() < 3.0  # grey, but for the encoder


def test_points_without_an_edge_have_no_colour_and_make_room_for_the_others(
    made: Path, street: Path, tmp_path: Path
) -> None:
    report_input = read_report_input(read_drive(street), by_cues(made, tmp_path, "edges"))
    observations = report_input.observations
    table = page_colors(observations, np.zeros(0, np.uint8)).tables["edge"]
    assert table[NO_EDGE] is None
    assert all(color is not None for color in table[NO_EDGE + 1 :])
    points = frame_points(list(report_input.overlays(1).views.values()), 0, np.ones((7, 8), bool))
    num_edges = int(((points.classes != NO_EDGE) & (points.classes != NO_CLASS)).sum())
    assert 100 < num_edges < len(points.classes) < MAX_POINTS
    few = points.thin(num_edges + 10)
    assert len(few.classes) == num_edges + 10
    assert int(((few.classes != NO_EDGE) & (few.classes != NO_CLASS)).sum()) == num_edges
    np.testing.assert_array_equal(few.indices, points.indices[np.isin(points.indices, few.indices)])
    assert len(points.thin(50).classes) == 50


def test_steps_agree_with_the_upper_half_of_the_gradients() -> None:
    levels = np.array([[0, 3, 4, 7, 7, NO_CLASS, 5, 5]], np.uint8)
    steps = np.array([1, 2, 3, 4, NO_EDGE, 5, 6, NO_CLASS], np.uint8)
    observations = SimpleNamespace(
        point_class_names=(NO_EDGE_NAME, *STEP_COLORS),
        image_class_names=tuple(f"gradient {level}" for level in range(8)),
        clouds=[SimpleNamespace(classes=steps)],
        images=[SimpleNamespace(classes=levels)],
    )
    seen = SimpleNamespace(
        indices=np.arange(8),
        pixels=np.column_stack([np.arange(8), np.zeros(8, int)]),
        is_hidden=np.arange(8) == 6,
    )
    kinds = agreement_kinds(observations, 0, seen, np.ones((7, 8), bool))  # type: ignore[arg-type]
    assert kinds.tolist() == [DISAGREES, DISAGREES, AGREES, AGREES, NO_PAIR, NO_PAIR, HIDDEN, NO_PAIR]


def test_steps_agree_with_strong_gradients_and_less_where_the_pose_is_off(
    made: Path, street: Path, street_truth: Pose, T_off: Pose, tmp_path: Path
) -> None:
    report_input = read_report_input(read_drive(street), by_cues(made, tmp_path, "edges"))
    observations = report_input.observations
    views = [View(observations, T) for T in (T_off, street_truth)]
    points = frame_points(views, 0, report_input.overlays(2).is_associated)
    is_step = (points.classes != NO_EDGE) & (points.classes != NO_CLASS)
    off, right = points.poses
    for pose in (off, right):
        assert (pose.kinds[~is_step & pose.is_visible] == NO_PAIR).all()
    assert right.agreement is not None
    assert off.agreement is not None
    # By chance, half of them would.
    assert right.agreement > 0.6
    assert off.agreement < right.agreement - 0.05


def test_what_edges_gained_is_in_nats(made: Path, tmp_path: Path) -> None:
    """They are what segments beside them are not: refined by."""
    for cues, unit in ((("segments", "edges"), "nats"), (("segments", "intensity"), "AMI")):
        record = read_calibration(by_cues(made, tmp_path, *cues))
        assert record.polish is not None
        polish = record.polish.model_copy(update={"held_out_sigma_nats": 0.01})
        assert unit in polish_sentences(record.model_copy(update={"polish": polish}))[0]


def test_a_page_of_edges_explains_what_it_shows(made: Path, street: Path, tmp_path: Path) -> None:
    """What would contradict a trusted result is said with its reason, or not at all."""
    file = by_cues(made, tmp_path, "segments", "edges")
    record = read_calibration(file)
    assert record.polish is not None
    loss = {"accepted": True, "held_out_gain_nats": -0.0017, "held_out_sigma_nats": 0.0006}
    lost = record.model_copy(update={"polish": record.polish.model_copy(update=loss)})
    (sentence,) = polish_sentences(lost)
    assert "of which 5 standard errors are allowed, since these data took part in the choice" in sentence
    page = page_of(street, file, tmp_path)
    assert "intervals contain the result" not in page
    assert "the result rests on all, and is known far better" in page
    assert '<tr><td>initial</td><td class="n">-</td>' in page
    assert "<dt>information lost if turned by 5 degrees</dt>" in page
