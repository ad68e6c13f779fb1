"""The page about a calibration: what a browser makes of it."""

import base64
import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from commands import invoke
from pages import PHONE, serious_findings
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import read_drive
from semcal_cli.estimation.adjust.frame_offsets import FrameOffsets
from semcal_cli.formats import read_transform, write_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse
from semcal_cli.geometry.twists import apply_twist
from semcal_cli.observations.cues.cue_table import load_cues
from semcal_cli.observations.reading import load_observations
from semcal_cli.report import read_report_input, write_report
from semcal_cli.report.colors import depth_levels, level_colors
from semcal_cli.report.figures import frame_pixels, pixels_plot
from semcal_cli.report.points import points_in_image

pytestmark = pytest.mark.slow

SCREEN = {"width": 1400, "height": 900, "deviceScaleFactor": 1, "mobile": False}


def pixels(page: webdriver.Chrome, selector: str) -> np.ndarray:
    """Red, green, blue and opacity of what a canvas shows, (H, W, 4)."""
    canvas = page.find_element(By.CSS_SELECTOR, selector)
    uri = page.execute_script("return arguments[0].toDataURL()", canvas)
    return np.array(PIL.Image.open(io.BytesIO(base64.b64decode(uri.partition(",")[2]))).convert("RGBA"))


@pytest.fixture
def page(browser: webdriver.Chrome, made: Path) -> webdriver.Chrome:
    browser.get_log("browser")
    browser.get((made / "r.html").as_uri())
    return browser


def test_it_has_nothing_serious(page: webdriver.Chrome) -> None:
    assert page.title.endswith("c.yaml")
    images = page.find_elements(By.TAG_NAME, "img")
    assert len(images) == 4  # One of each frame.
    assert all(int(image.get_property("naturalWidth")) > 100 for image in images)
    assert serious_findings(page) == []


def drawn(page: webdriver.Chrome, selector: str) -> int:
    """Number of points that a canvas shows, once it is drawn."""
    canvas = page.find_element(By.CSS_SELECTOR, selector)
    page.execute_script("arguments[0].scrollIntoView({block: 'center'})", canvas)
    WebDriverWait(page, 10).until(lambda _: canvas.get_attribute("data-drawn"))
    return int(canvas.get_attribute("data-drawn"))


def test_the_first_screen_tells_what_matters(page: webdriver.Chrome) -> None:
    """Verdict, intervals, the best image with its points, the transform, and its button."""
    page.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", SCREEN)
    for selector in ("h1", ".lead", "#first .look .image", "#notation-1", "#first button.copy", "#worst"):
        element = page.find_element(By.CSS_SELECTOR, selector)
        assert element.is_displayed()
        assert element.rect["y"] + element.rect["height"] <= SCREEN["height"], selector
    assert len(page.find_elements(By.CSS_SELECTOR, "#first button.copy")) == 1
    assert not page.find_element(By.ID, "other-1").is_displayed()
    assert re.fullmatch(
        r"±[\d.]+ (cm|mm), ±[\d.]+ degrees \(95 %\), or [\d.]+ px at 10 m",
        page.find_element(By.CLASS_NAME, "lead").text,
    )
    assert drawn(page, "#first .after") > 1000
    page.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_a_phone_shows_the_first_image_in_the_upper_half(page: webdriver.Chrome) -> None:
    """The figures take a line each, and the colours four at most."""
    page.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", PHONE)
    image = page.find_element(By.CSS_SELECTOR, "#first .look .image")
    assert image.rect["y"] <= PHONE["height"] / 2
    for figure in page.find_elements(By.CSS_SELECTOR, ".figures > div"):
        value = figure.find_element(By.TAG_NAME, "dd")
        assert figure.rect["height"] < 1.5 * value.rect["height"], figure.text
    for legend in page.find_elements(By.CSS_SELECTOR, "#first .legend"):
        lines = {entry.rect["y"] for entry in legend.find_elements(By.TAG_NAME, "li") if entry.is_displayed()}
        assert len(lines) <= 4
    page.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_the_choice_of_colours_draws_all_images_anew(page: webdriver.Chrome) -> None:
    """Points hidden from the camera are shown with the agreement alone."""
    by_class = drawn(page, "#first .after")
    for choice in ("depth", "agreement"):
        page.find_element(By.CSS_SELECTOR, f"input[value={choice}]").click()
        shown = [
            e.text for e in page.find_elements(By.CSS_SELECTOR, ".legend[data-colors]") if e.is_displayed()
        ]
        assert len(shown) == 1
    assert shown == ["agree\ndisagree\nhidden from the camera"]
    assert drawn(page, "#first .after") > by_class


def test_points_are_drawn_where_the_transform_puts_them(
    page: webdriver.Chrome, made: Path, street: Path
) -> None:
    """The pixel on which the nearest point lands has the colour of its depth, and of no other image's."""
    page.find_element(By.CSS_SELECTOR, "input[value=depth]").click()
    drawn(page, "#first .after")
    image = pixels(page, "#first .after").astype(int)
    drive = read_drive(street)
    observations = load_observations(drive)
    name = page.find_element(By.CSS_SELECTOR, "#first figcaption span").text
    number = [Path(frame.points).stem for frame in drive.frames].index(name)
    T = read_transform(made / "c.yaml")
    seen = points_in_image(observations.clouds[number].points, T, drive.camera)
    scale = image.shape[1] / drive.camera.width
    nearest = np.flatnonzero(~seen.is_hidden)[-300:]
    u, v = np.floor((seen.positions[nearest] + 0.5).T * scale).astype(int)
    colors = image[np.minimum(v, len(image) - 1), u, :3]
    expected = level_colors(depth_levels(seen.ranges_m[nearest]))[:, ::-1].astype(int)
    assert (np.abs(colors - expected).max(axis=1) <= 8).mean() > 0.95


def turned_off(made: Path, folder: Path, turn_deg: float) -> Path:
    """Write the transform that was found, with the camera turned about its y axis."""
    twist = np.array([0.0, 0.0, 0.0, 0.0, np.radians(turn_deg), 0.0])
    write_transform(apply_twist(read_transform(made / "c.yaml"), twist), folder / "off.yaml", "semcal")
    return folder / "off.yaml"


def test_the_slider_moves_the_line(
    browser: webdriver.Chrome, made: Path, street: Path, tmp_path: Path
) -> None:
    """Beside a transform that is 2 degrees off."""
    off = turned_off(made, tmp_path, 2.0)
    write_report(read_report_input(read_drive(street), made / "c.yaml", off), tmp_path / "r.html")
    browser.get((tmp_path / "r.html").as_uri())
    assert "Points move by a median of" in browser.find_element(By.CSS_SELECTOR, ".look p").text
    slider = browser.find_element(By.CSS_SELECTOR, ".image input")
    before = browser.find_element(By.CSS_SELECTOR, ".image .before")
    assert "50%" in before.value_of_css_property("clip-path")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", slider)
    width = slider.size["width"]
    ActionChains(browser).move_to_element(slider).click_and_hold().move_by_offset(
        width // 4, 0
    ).release().perform()
    moved = float(re.search(r"([\d.]+)%", before.value_of_css_property("clip-path"))[1])  # type: ignore[index]
    assert moved == pytest.approx(25.0, abs=3.0)


def test_the_page_of_a_verification(
    browser: webdriver.Chrome, made: Path, street: Path, tmp_path: Path
) -> None:
    """Fail, by how much and along which axis, with both transforms on the images."""
    off, drawings = turned_off(made, tmp_path, 0.6), tmp_path / "drawn"
    result = invoke("verify", street, off, "--report", tmp_path / "v.html", "--overlay", drawings)
    assert result.exit_code == 3
    assert sorted(path.name for path in drawings.iterdir()) == [f"00000{i}.png" for i in range(4)]
    browser.get_log("browser")
    browser.get((tmp_path / "v.html").as_uri())
    assert serious_findings(browser) == []
    assert browser.find_element(By.TAG_NAME, "h1").text == "Fail"
    lead = browser.find_element(By.CLASS_NAME, "lead").text
    assert re.match(
        r"rotation off by 0\.[56]\d\d ± 0\.\d{3} degrees, allowed 0\.3 degrees; camera centre off by", lead
    )
    failed = [row.text.split("\n")[0] for row in browser.find_elements(By.CSS_SELECTOR, "tr.fail")]
    assert failed == ["yaw, looks left (about y)", "rotation overall"]
    before, after = agreements(browser)
    assert before + 1.0 < after
    assert drawn(browser, "#first .before") > 1000
    again = tmp_path / "again.html"
    invoke("verify", street, off, "--report", again)
    assert again.read_bytes() == (tmp_path / "v.html").read_bytes()


def agreements(browser: webdriver.Chrome) -> list[float]:
    """Shares, in per cent, in the strip of the first image, at each pose."""
    shares = browser.find_elements(By.CSS_SELECTOR, "#first .look .shares > span")
    return [float(re.findall(r"[\d.]+", element.text)[0]) for element in shares]


def test_the_copy_button_copies(page: webdriver.Chrome, made: Path) -> None:
    origin = {"permissions": ["clipboardReadWrite", "clipboardSanitizedWrite"]}
    page.execute_cdp_cmd("Browser.grantPermissions", origin)
    button = page.find_element(By.CSS_SELECTOR, "button.copy")
    button.click()
    WebDriverWait(page, 10).until(lambda _: button.text == "Copied")
    copied = page.execute_async_script("navigator.clipboard.readText().then(arguments[0])")
    T: Pose = np.array(copied.split(), float).reshape(4, 4)
    np.testing.assert_allclose(T, read_transform(made / "c.yaml"), atol=1e-9)
    assert not np.allclose(T, inverse(T))


def test_the_cloud_is_drawn_and_turns(page: webdriver.Chrome) -> None:
    def has_changed(before: np.ndarray) -> bool:
        now = pixels(page, "#cloud-view")
        return now.shape != before.shape or bool((now != before).any())

    first = pixels(page, "#cloud-view")
    assert (first[..., :3].max(axis=2) > 80).sum() > 2000
    legends = page.find_elements(By.CSS_SELECTOR, "[data-choice]")
    assert [legend.is_displayed() for legend in legends] == [True, False]
    canvas = page.find_element(By.ID, "cloud-view")
    page.execute_script("arguments[0].scrollIntoView({block: 'center'})", canvas)
    ActionChains(page).move_to_element(canvas).click_and_hold().move_by_offset(150, 40).release().perform()
    WebDriverWait(page, 10).until(lambda _: has_changed(first))
    turned = pixels(page, "#cloud-view")
    page.find_element(By.CSS_SELECTOR, "#cloud-colors option:last-child").click()
    WebDriverWait(page, 10).until(lambda _: has_changed(turned))


def test_what_is_folded_is_printed(page: webdriver.Chrome) -> None:
    printed = base64.b64decode(page.print_page())
    assert printed.startswith(b"%PDF")
    assert len(printed) > 100_000
    page.execute_script("dispatchEvent(new Event('beforeprint'))")
    paper = {"width": 700, "height": 1000, "deviceScaleFactor": 1, "mobile": False}  # A4 within its margins
    page.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", paper)
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    cut = (
        "return [...document.querySelectorAll('pre')].filter((e) => e.scrollWidth > e.clientWidth + 1).length"
    )
    assert page.execute_script(cut) == 0
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    page.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert page.execute_script("return document.querySelectorAll('details:not([open])').length") == 0
    page.execute_script("dispatchEvent(new Event('afterprint'))")
    assert page.execute_script("return document.querySelectorAll('details[open]').length") == 0


def test_a_page_without_images_and_before_has_no_complaint(
    browser: webdriver.Chrome, street: Path, tmp_path: Path
) -> None:
    drive = read_drive(street)
    frames = tuple(frame.model_copy(update={"image": None}) for frame in drive.frames)
    bare = read_report_input(drive.model_copy(update={"frames": frames}), street)
    hostile = '</script><script>throw Error("run")</script>'
    write_report(replace(bare, name=hostile), tmp_path / "r.html")
    browser.get((tmp_path / "r.html").as_uri())
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []
    assert hostile in browser.find_element(By.CLASS_NAME, "files").text
    assert not browser.find_elements(By.CSS_SELECTOR, ".image input")


def test_a_page_of_edges_shows_photographs_under_other_colours(
    browser: webdriver.Chrome, made: Path, street: Path, tmp_path: Path
) -> None:
    shown = replace(read_report_input(read_drive(street), made / "c.yaml"))
    observations = load_cues(shown.drive, ("edges",))
    write_report(replace(shown, observations=observations), tmp_path / "r.html")
    browser.get((tmp_path / "r.html").as_uri())
    image = browser.find_element(By.CSS_SELECTOR, ".image")
    ground = image.find_element(By.TAG_NAME, "img")
    edges = ground.get_attribute("src")
    assert "edges" in (image.get_attribute("class") or "").split()
    browser.find_element(By.CSS_SELECTOR, "input[value=depth]").click()
    assert ground.get_attribute("src") == ground.get_attribute("data-photograph") != edges
    assert "photograph" in (image.get_attribute("class") or "").split()
    browser.find_element(By.CSS_SELECTOR, "input[value=edge]").click()
    assert ground.get_attribute("src") == edges


def test_frames_are_measured_in_pixels(street: Path, street_truth: Pose) -> None:
    """A frame whose own pose is turned by 0.1 degrees moves by so many pixels; one without a pose has no bar."""
    drive = read_drive(street)
    observations = load_observations(drive)
    offsets = np.zeros((4, 6))
    offsets[1, 4], offsets[2] = 0.1, np.nan
    frames = FrameOffsets(offsets, np.zeros((4, 6)), np.zeros((4, 6)))
    pixels = frame_pixels(observations, street_truth, frames)
    expected = np.radians(0.1) * core_camera(drive.camera).pixels_per_radian
    assert pixels[0] == 0.0
    assert expected < pixels[1] < 2.5 * expected  # more towards the sides of the image
    assert np.isnan(pixels[2])
    plot = pixels_plot(pixels, ["a", "b", "c", "d"])
    assert "most in b" in plot.note
    assert "--exclude b" in plot.note
