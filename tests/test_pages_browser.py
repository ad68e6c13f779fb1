"""Every page in a browser: what it holds that someone could not see, read or use."""

from pathlib import Path

import pytest
from click.testing import Result
from commands import invoke
from fleets import line, series_of, write_summary
from pages import serious_findings, show
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

pytestmark = pytest.mark.slow

SOUND = """<!doctype html><html lang="en"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>sound</title><body style="background: #fff; color: #333"><p>Text</p>
<label>Number <input type="number" value="1"></label>{}</body></html>"""


@pytest.mark.parametrize(
    ("content", "finding"),
    [
        ("", None),
        ("<script>console.info('said')</script>", "console: INFO"),
        ("<p style='color: #777'>pale</p>", "contrast 4.48: 'pale' in p"),
        ("<div style='background: #000c'><p style='color: #fff'>on a shade</p></div>", None),
        ("<details><summary>more</summary><p style='color: #eee'>folded</p></details>", "'folded' in p"),
        ("<p style='font-size: 8px'>tiny</p>", "letters of 8.0 px: 'tiny' in p"),
        ("<svg width='50'><title>t</title><text y='20'>far too long for it</text></svg>", "cut: 'far"),
        ("<p style='width: 500px'>wide</p>", "phone, dark: the page is"),
        ("<div style='overflow-x: auto'><p style='width: 1500px'>wide</p></div>", None),
        ("<input id='x' type='range'>", "no name: input#x"),
        ("<i id='a'></i><i id='a'></i>", "found twice: #a"),
        ("<img src='file:///nowhere.png' alt='a'>", "from elsewhere: file:///nowhere.png"),
    ],
)
def test_what_is_wrong_is_found(content: str, finding: str | None, browser: webdriver.Chrome) -> None:
    show(browser, SOUND.format(content))
    findings = serious_findings(browser)
    if finding is None:
        assert findings == []
    else:
        assert any(finding in message for message in findings), findings


def fleet_page(folder: Path, kind: str, count: int, prefix: str, has_stamps: bool) -> Path:
    """The page of a fleet to which something happened."""
    lines = []
    for drive in series_of(kind, count):
        lines.append(line(drive, drive=f"{prefix}{drive.name}"))
        lines[-1]["stamp"] = drive.stamp if has_stamps else None
    lines[3] |= {"status": "not_trusted", "reasons": ["overlap 3 %"], "topics": ["overlap"], "exit_code": 3}
    page = folder / "fleet.html"
    result = invoke("fleet", write_summary(folder / "batch", lines), "--report", page)
    assert result.exit_code in (0, 3), result.output
    return page


@pytest.mark.parametrize(
    ("kind", "count", "prefix", "has_stamps"),
    [
        ("change", 24, "drives/", True),
        ("change", 24, "a/name_that_is_far_too_long_for_a_telephone_<b>/drive_of_a_rig_", False),
        ("drift", 24, "", False),
        ("outlier", 3000, "", True),
    ],
)
def test_a_fleet_is_read_without_trouble(
    kind: str, count: int, prefix: str, has_stamps: bool, browser: webdriver.Chrome, tmp_path: Path
) -> None:
    page = fleet_page(tmp_path, kind, count, prefix, has_stamps)
    assert page.stat().st_size < 5e6
    browser.get_log("browser")
    browser.get(page.as_uri())
    assert serious_findings(browser) == []
    drawings = browser.find_elements(By.CSS_SELECTOR, "figure svg")
    assert len(drawings) == 6
    # Each change is a line in each drawing.
    assert len(browser.find_elements(By.CSS_SELECTOR, "figure g.change")) == (6 if kind == "change" else 0)
    if kind == "change":
        labels = [element.text for element in browser.find_elements(By.CSS_SELECTOR, "figure .name text")]
        # A short name, or else the number of the drive, one of which is left out.
        name = "015" if prefix == "drives/" else "15"
        sizes = [float(label.removeprefix(f"{name}: ")) for label in labels if label.startswith(f"{name}: ")]
        assert sizes == pytest.approx([-8.0, 0.6], rel=0.1)  # up, cm, and yaw


def test_a_rig_is_read_without_trouble(
    rig: Path, rig_results: tuple[Result, Path], browser: webdriver.Chrome
) -> None:
    assert rig_results[0].exit_code in (0, 3), rig_results[0].output
    browser.get_log("browser")
    browser.get((rig.parents[1] / "rig.html").as_uri())
    assert serious_findings(browser) == []
    labels = browser.find_elements(By.CSS_SELECTOR, ".cloud-label")
    assert [label.get_attribute("textContent") for label in labels] == ["camera_0", "camera_1"]
    canvas = browser.find_element(By.ID, "cloud-view")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", canvas)
    before = [label.location for label in labels if label.is_displayed()]
    assert len(before) == 2
    ActionChains(browser).move_to_element(canvas).click_and_hold().move_by_offset(60, 10).release().perform()
    WebDriverWait(browser, 10).until(lambda _: [label.location for label in labels] != before)
