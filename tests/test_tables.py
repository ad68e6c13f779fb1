"""A calibration in the terminal: lines of 80 columns, the verdict at the end, figures for experts on request."""

import io
import re
from dataclasses import replace

import pytest
from test_calibration import POSE, make_calibration

from semcal_cli.cli.tables import COLUMNS, hypothesis_lines, summary_lines, verdict_lines, wrapped
from semcal_cli.errors import mismatch
from semcal_cli.estimation.search.mounting import Mounting
from semcal_cli.readable import for_people, lengths
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.refined_camera import CheckedIntrinsics, Intrinsic

LONG = (
    "a mounting 30 degrees away explains the labels almost as well: only 1.82 standard errors worse, needed at "
    "least 2: " * 3
)
PATH = "/".join(["a-folder-of-a-long-name"] * 6)
EXPERTS = re.compile(r"\bnats\b|MI\b|held out|agree with their pixels")


def with_words(**values: object) -> CalibrationDocument:
    return make_calibration(POSE).model_copy(update=values)


@pytest.mark.parametrize("label", ["doubt", "note", "95 % interval", ""])
def test_long_texts_are_wrapped_by_words_under_their_label(label: str) -> None:
    first, *rest = wrapped(label, LONG)
    assert first.startswith(f"{label:<17}a mounting 30")
    assert rest
    assert all(line[:17] == " " * 17 and line[17] != " " for line in rest)
    assert all(len(line) <= COLUMNS for line in (first, *rest))
    assert " ".join(line[17:] for line in (first, *rest)) == LONG.strip()


@pytest.mark.parametrize("width", range(40, 60))
def test_no_line_ends_within_a_figure(width: int) -> None:
    text = (
        "these frames confirm fx to +-0.67 %, fy to +-1.8 %, and the yaw by 0.60 +- 0.013 degrees (+- 0.02)"
    )
    lines = wrapped("note", text, COLUMNS - width)
    for whole in ("0.67 %", "1.8 %", "0.60 +- 0.013", "(+- 0.02)"):
        assert any(whole in line or for_people(whole) in line for line in lines), lines


def test_paths_are_never_broken() -> None:
    assert wrapped("note", f"{PATH} is missing") == [f"{'note':<17}{PATH}", f"{'':<17}is missing"]


@pytest.mark.parametrize("verbose", [False, True])
def test_a_summary_fits_and_figures_for_experts_are_on_request(verbose: bool) -> None:
    calibration = with_words(reasons=(LONG, LONG), notes=(LONG,), status="not_trusted")
    lines = summary_lines(calibration, verbose=verbose)
    assert max(map(len, lines)) <= COLUMNS
    assert any(EXPERTS.search(line) for line in lines) == verbose
    labels = [line[:17].strip() for line in lines]
    assert labels.count("doubt") == 2
    assert labels.index("note") < labels.index("doubt")


@pytest.mark.parametrize(
    ("status", "reasons", "uncertain", "lines"),
    [
        (
            "trusted",
            0,
            True,
            [
                "verdict          trusted: ±2.0 mm, ±0.10 degrees (95 %), or 0.0026 px at 10 m,",
                "                 if K is right, which these frames do not show",
            ],
        ),
        (
            "not_trusted",
            3,
            False,
            [
                "verdict          not trusted: 3 doubts, see above",
            ],
        ),
        (
            "not_assessed",
            0,
            False,
            [
                "verdict          not assessed: a rough start, not refined yet",
            ],
        ),
    ],
)
def test_the_verdict_says_how_good(status: str, reasons: int, uncertain: bool, lines: list[str]) -> None:
    calibration = with_words(status=status, reasons=(LONG,) * reasons)
    if not uncertain:
        calibration = calibration.model_copy(update={"uncertainty": None})
    assert verdict_lines(calibration) == lines
    assert max(map(len, lines)) <= COLUMNS


def test_a_camera_that_the_frames_confirm_is_not_in_question() -> None:
    intrinsic = Intrinsic(given=320.0, found=320.0, sigma=1.0, half_width_95=2.0, is_determined=True)
    checked = CheckedIntrinsics(intrinsics={"cx": intrinsic}, is_confirmed=True)
    calibration = with_words(status="trusted").model_copy(update={"checked_intrinsics": checked})
    assert verdict_lines(calibration) == [
        "verdict          trusted: ±2.0 mm, ±0.10 degrees (95 %), or 0.0026 px at 10 m"
    ]


def test_an_answer_that_no_check_applies_to_says_so() -> None:
    stage = make_calibration(POSE).stages["initial"]
    refined = with_words(stages={"initial": stage, "refined": stage}, uncertainty=None)
    assert verdict_lines(refined) == ["verdict          not assessed: its uncertainty is not known"]


@pytest.mark.parametrize("verbose", [False, True])
def test_hypotheses_fit(verbose: bool) -> None:
    best = Mounting(
        T_camera_lidar=POSE,
        mutual_information_nats=2.0,
        bias_nats=0.0,
        sigma_nats=0.3,
        overlap=0.75,
        num_pairs=1_234_567,
        num_inliers=None,
        rotation_from_best_deg=0.0,
    )
    other = replace(best, mutual_information_nats=1.0, rotation_from_best_deg=173.4, sigma_nats=0.4)
    head, first, second = hypothesis_lines([best, other], verbose=verbose)
    assert max(map(len, (head, first, second))) <= COLUMNS
    assert ("nats" in head) == verbose
    if verbose:
        assert "2.0000 +- 0.3000" in first
        assert first.split()[-2:] == ["1,234,567", "-"]
    else:
        assert second.endswith("173.4 deg         2.0 sigma")


@pytest.mark.parametrize(
    ("encoding", "line"), [("utf-8", "off by 2.9 ± 1.0 cm (±3)"), ("ascii", "off by 2.9 +- 1.0 cm (+- 3)")]
)
def test_a_terminal_without_plus_minus_signs_gets_plain_ones(
    encoding: str, line: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stderr", io.TextIOWrapper(io.BytesIO(), encoding))
    assert for_people("off by 2.9 +- 1.0 cm (+- 3)") == line


@pytest.mark.parametrize(
    ("expected", "sentence"),
    [
        ("a list", "found 3, expected a list"),
        ("at most 2", "found 3, needed at most 2"),
        ("4 numbers", "found 3, needed 4 numbers"),
        ("(N, 3)", "found 3, needed (N, 3)"),
    ],
)
def test_only_what_a_person_compares_is_needed(expected: str, sentence: str) -> None:
    assert str(mismatch(3, expected)) == sentence


@pytest.mark.parametrize(
    ("values_m", "text"),
    [([0.0065], "6.5 mm"), ([0.065, 0.0261, 0.004], "6.5 2.6 0.40 cm"), ([0.01], "1.0 cm"), ([0.0], "0 mm")],
)
def test_the_lengths_of_a_line_have_one_unit(values_m: list[float], text: str) -> None:
    assert lengths(values_m) == text
