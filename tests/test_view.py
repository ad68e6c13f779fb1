"""The page that moves points by hand: its session, its server, and what a browser makes of it."""

import http.client
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
from commands import invoke
from pages import serious_findings
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.actions.action_builder import ActionBuilder
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import WebDriverWait

from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.reading import read_clouds
from semcal_cli.report.points import points_in_image
from semcal_cli.report.view.pairs import Panorama
from semcal_cli.report.view.server import HOST, ViewServer
from semcal_cli.report.view.session import MovedPose, Session

ZERO = [0.0] * 6


@contextmanager
def serving(session: Session) -> Iterator[ViewServer]:
    server = ViewServer(session)
    thread = threading.Thread(target=server.answer_until_ended, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.ended.set()
        thread.join()


@pytest.fixture
def server(session: Session) -> Iterator[ViewServer]:
    with serving(session) as server:
        yield server


# The server.


def request(server: ViewServer, path: str, body: object = None, **headers: str) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection(HOST, server.server_port, timeout=60)
    content = None if body is None else json.dumps(body) if not isinstance(body, str) else body
    connection.request("GET" if body is None else "POST", path, content, headers)
    answer = connection.getresponse()
    response = answer.status, answer.read()
    connection.close()
    return response


def test_only_who_knows_the_word_gets_an_answer(server: ViewServer, T_off: Pose) -> None:
    asked = {"base": T_off.tolist(), "offsets": ZERO, "frame": 0}
    own = f"/{server.token}/"
    assert request(server, own)[0] == 200
    assert request(server, own + "points", asked)[0] == 200
    assert request(server, own + "points", "x" * 20_000)[0] == 413
    for path in ("", "points", server.token, f"{server.token[:-1]}/", f"{'x' * len(server.token)}/"):
        assert request(server, f"/{path}")[0] == 404
    for headers in ({"Host": "evil.example"}, {"Origin": "http://evil.example"}):
        assert request(server, own, **headers)[0] == 404
        assert request(server, own + "save", asked, **headers)[0] == 404
    assert server.server_address[0] == "127.0.0.1"


@pytest.mark.parametrize(
    "body", ["", "[", "[1]", "null", '{"base": NaN}', "[" * 9000, f'{{"base": {"9" * 4000}}}']
)
def test_a_body_that_is_no_question_is_answered_in_one_line(server: ViewServer, body: str) -> None:
    status, content = request(server, f"/{server.token}/points", body)
    assert status == 400
    assert json.loads(content)["error"].startswith("view: found no ")


def test_an_image_is_the_frame_s(server: ViewServer, street: Path, capfd: pytest.CaptureFixture[str]) -> None:
    drive = read_drive(street)
    status, content = request(server, f"/{server.token}/image/1")
    assert status == 200
    shown = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR).astype(int)
    stored = cv2.imread(str(drive.resolve(drive.frames[1].image or ""))).astype(int)
    assert np.abs(shown - stored).mean() < 4.0
    assert request(server, f"/{server.token}/image/99")[0] == 400
    assert request(server, f"/{server.token}/image/x")[0] == 404
    assert request(server, f"/{server.token}/edges/1")[1] == server.session.image(1, by_edge=True) != content
    assert capfd.readouterr() == ("", "")


def test_a_port_that_is_taken_is_said_to_be(server: ViewServer, session: Session) -> None:
    with pytest.raises(InputError, match=r"--port \d+: address already in use, expected a free port"):
        ViewServer(session, server.server_port)


# The browser.


@pytest.fixture
def page(browser: webdriver.Chrome, server: ViewServer) -> webdriver.Chrome:
    browser.get_log("browser")
    browser.get(server.address)
    wait_for_move(browser, 0)
    return browser


def wait(browser: webdriver.Chrome, is_done: Callable[[], object], seconds: float = 10) -> None:
    WebDriverWait(browser, seconds).until(lambda _: is_done())


def shown(browser: webdriver.Chrome) -> int:
    return int(browser.find_element(By.ID, "image").get_attribute("data-shown") or 0)


def wait_for_move(browser: webdriver.Chrome, before: int) -> None:
    wait(browser, lambda: shown(browser) > before, 20)


def pose(browser: webdriver.Chrome) -> Pose:
    return np.array(browser.find_element(By.ID, "transform").text.split(), float).reshape(4, 4)


def type_offset(browser: webdriver.Chrome, index: int, value: str) -> None:
    field: WebElement = browser.find_elements(By.CSS_SELECTOR, ".motion input[type=number]")[index]
    before = shown(browser)
    field.send_keys(Keys.CONTROL + "a")
    field.send_keys(value, Keys.TAB)
    wait_for_move(browser, before)


def test_the_page_has_nothing_serious(page: webdriver.Chrome) -> None:
    assert serious_findings(page) == []


def test_dragging_a_slider_moves_points(page: webdriver.Chrome, T_off: Pose) -> None:
    """And the image with them: a turn about y by dx moves all points by dx times the focal length."""
    np.testing.assert_allclose(pose(page), T_off, atol=1e-9)
    drawing = "return document.getElementById('points').toDataURL()"
    before, count = page.execute_script(drawing), shown(page)
    slider = page.find_element(By.ID, "motion-4")
    ActionChains(page).drag_and_drop_by_offset(slider, 20, 0).perform()
    wait_for_move(page, count)
    wait(page, lambda: page.execute_script(drawing) != before)
    number = page.find_elements(By.CSS_SELECTOR, ".motion input[type=number]")[4]
    turned_deg = float(number.get_attribute("value") or 0)
    assert abs(turned_deg) > 0.1
    expected = MovedPose(T_off, np.array([0.0, 0.0, 0.0, 0.0, turned_deg, 0.0])).T_camera_lidar
    wait(page, lambda: np.allclose(pose(page), expected, atol=1e-5))


def test_a_change_of_reach_keeps_the_pose(page: webdriver.Chrome) -> None:
    """A slider steps on from where it stands, however far that is; and what was left can be had again."""
    type_offset(page, 4, "8")
    page.find_element(By.CSS_SELECTOR, "input[value=fine]").click()
    count = shown(page)
    page.find_element(By.ID, "motion-4").send_keys(Keys.ARROW_RIGHT)
    wait_for_move(page, count)
    number = page.find_elements(By.CSS_SELECTOR, ".motion input[type=number]")[4]
    assert float(number.get_attribute("value") or 0) == pytest.approx(8.0, abs=0.2)
    moved = pose(page)
    page.find_element(By.ID, "reset").click()
    wait(page, lambda: not np.allclose(pose(page), moved, atol=1e-3))
    page.find_element(By.ID, "back").click()
    wait(page, lambda: np.allclose(pose(page), moved, atol=1e-9))


def test_arrow_keys_turn_the_camera(page: webdriver.Chrome, T_off: Pose) -> None:
    count = shown(page)
    page.find_element(By.ID, "image").send_keys(Keys.ARROW_LEFT)
    wait_for_move(page, count)
    assert 0.1 < compare_poses(pose(page), T_off).rotation_deg < 2.0


def test_dragging_the_image_carries_the_points_along(
    page: webdriver.Chrome, session: Session, T_off: Pose
) -> None:
    """Far points follow the mouse: their displacement is that of the pointer."""
    image = page.find_element(By.ID, "image")
    count = shown(page)
    dx, dy = 30, -12
    ActionChains(page).move_to_element(image).click_and_hold().move_by_offset(dx, dy).release().perform()
    wait_for_move(page, count)
    camera = session.data.drive.camera
    scale = camera.width / image.size["width"]
    far = np.array([0.0, 0.0, 1000.0, 1.0])

    def moved() -> np.ndarray:
        p = pose(page) @ np.linalg.inv(T_off) @ far
        K = np.array(camera.K)
        return (K @ (p[:3] / p[2]) - K @ [0.0, 0.0, 1.0])[:2]

    wait(page, lambda: np.allclose(moved(), [dx * scale, dy * scale], atol=1.5))


def test_saving_gives_the_pose_on_the_page(page: webdriver.Chrome, session: Session) -> None:
    type_offset(page, 3, "-0.25")
    type_offset(page, 0, "3.5")
    page.find_element(By.ID, "save").click()
    message = page.find_element(By.ID, "message")
    wait(page, lambda: message.text.startswith("Saved to"))
    assert session.output is not None
    assert str(session.output) in message.text
    np.testing.assert_allclose(read_transform(session.output), pose(page), atol=1e-9)


def test_refining_ends_where_calibrate_does(
    page: webdriver.Chrome, session: Session, street: Path, tmp_path: Path
) -> None:
    """From the saved pose, to the last digit of the page; and back again."""
    type_offset(page, 4, "-1.0")
    before = pose(page)
    page.find_element(By.ID, "save").click()
    message = page.find_element(By.ID, "message")
    wait(page, lambda: message.text.startswith("Saved to"))
    page.find_element(By.ID, "refine").click()
    wait(page, lambda: "\u00b1" in message.text, 60)
    assert "trusted" in (message.get_attribute("class") or "")
    arguments = ["calibrate", street, "--init", session.output, "-o", tmp_path / "c.yaml"]
    result = invoke(*arguments)
    assert result.exit_code in (0, 3)
    T = read_transform(tmp_path / "c.yaml")
    wait(page, lambda: not np.allclose(pose(page), before, atol=1e-4))
    np.testing.assert_allclose(pose(page), T, atol=1e-9)
    page.find_element(By.ID, "back").click()
    wait(page, lambda: np.allclose(pose(page), before, atol=1e-9))


def test_frames_and_colours_change(page: webdriver.Chrome) -> None:
    name = page.find_element(By.ID, "frame-name")
    assert "(1 of 4)" in name.text
    page.find_element(By.ID, "next").click()
    wait(page, lambda: "(2 of 4)" in name.text)
    drawing = "return document.getElementById('points').toDataURL()"
    seen = [page.execute_script(drawing)]
    for choice in ("depth", "intensity", "agreement"):
        page.find_element(By.CSS_SELECTOR, f"input[value={choice}]").click()
        seen.append(page.execute_script(drawing))
    assert len(set(seen)) == 4


def test_save_and_end_ends_the_server(page: webdriver.Chrome, server: ViewServer) -> None:
    page.find_element(By.ID, "end").click()
    assert server.ended.wait(timeout=10)
    wait(page, lambda: "The server has stopped" in page.find_element(By.TAG_NAME, "body").text)


def test_without_a_start_mountings_are_offered(browser: webdriver.Chrome, session: Session) -> None:
    bare = Session(session.data, read_clouds(session.data.drive), session.config)
    with serving(bare) as server:
        browser.get(server.address)
        wait_for_move(browser, 0)
        assert serious_findings(browser) == []
        # Forward, along x, as the menu says.
        np.testing.assert_allclose(pose(browser)[2, :3], [1, 0, 0], atol=1e-9)
        browser.find_element(By.CSS_SELECTOR, "#mounting option:nth-child(3)").click()
        # Back, against x.
        wait(browser, lambda: np.allclose(pose(browser)[2, :3], [-1, 0, 0], atol=1e-9))


def click_at(browser: webdriver.Chrome, element: WebElement, x: float, y: float) -> None:
    """Click with the mouse at a place of an element, in shares of its width and height."""
    at = browser.execute_script(
        "const [element, x, y] = arguments, around = element.parentElement;"
        "element.scrollIntoView({ block: 'center' });"
        "around.scrollLeft = x * element.clientWidth - around.clientWidth / 2;"
        "const box = element.getBoundingClientRect();"
        "return [Math.round(box.left + x * box.width), Math.round(box.top + y * box.height)]",
        *(element, float(x), float(y)),
    )
    mouse = ActionBuilder(browser)
    mouse.pointer_action.move_to_location(*at).click()
    mouse.perform()


@pytest.mark.parametrize(("count", "off_deg"), [(2, 3.0), (6, 1.0)])
def test_pairs_that_are_clicked_give_the_pose(
    browser: webdriver.Chrome, session: Session, street_truth: Pose, count: int, off_deg: float
) -> None:
    """Four clicks turn a camera that looks to the left until it looks forward; more find its position, too."""
    bare = Session(session.data, read_clouds(session.data.drive), session.config)
    camera = session.data.drive.camera
    points = session.observations.clouds[0].points
    seen = points_in_image(points, street_truth, camera)
    is_far = (~seen.is_hidden) & (seen.ranges_m > 15.0) & (seen.ranges_m < 60.0)
    candidates = np.flatnonzero(is_far)
    candidates = candidates[np.argsort(seen.positions[candidates, 0])]
    chosen = candidates[(np.linspace(0.05, 0.95, count) * len(candidates)).astype(int)]
    panorama = Panorama.of_points(points)
    with serving(bare) as server:
        browser.get_log("browser")
        browser.get(server.address)
        wait_for_move(browser, 0)
        browser.find_element(By.CSS_SELECTOR, "#mounting option:nth-child(2)").click()  # left, along y
        wait(browser, lambda: np.allclose(pose(browser)[2, :3], [0, 1, 0], atol=1e-9))
        start = pose(browser)
        assert compare_poses(start, street_truth).rotation_deg > 80.0
        browser.find_element(By.CSS_SELECTOR, "#picking summary").click()
        sweep, image = (browser.find_element(By.ID, name) for name in ("sweep", "image"))
        shown_width = "return document.getElementById('panorama').naturalWidth"
        wait(browser, lambda: browser.execute_script(shown_width) == 1440)
        status = browser.find_element(By.ID, "num-pairs")
        for number, index in enumerate(chosen, start=1):
            at = np.flatnonzero((panorama.points == points[seen.indices[index]]).all(axis=1))[0]
            column, row = panorama.positions[at]
            click_at(browser, sweep, column / 1440.0, row / panorama.rows)
            wait(browser, lambda: "now click" in status.text)
            u, v = seen.positions[index]
            click_at(browser, image, (u + 0.5) / camera.width, (v + 0.5) / camera.height)
            wait(browser, lambda number=number: f"{number} pair" in status.text)
        assert serious_findings(browser) == []
        browser.find_element(By.ID, "use-pairs").click()
        wait(browser, lambda: not np.allclose(pose(browser), start, atol=1e-6))
        assert compare_poses(pose(browser), street_truth).rotation_deg < off_deg
        assert "pixels from its pixel" in browser.find_element(By.ID, "message").text


def test_edges_are_drawn_on_edges_and_other_colours_on_the_image(
    browser: webdriver.Chrome, by_edge: Session
) -> None:
    with serving(by_edge) as server:
        browser.get_log("browser")
        browser.get(server.address)
        wait_for_move(browser, 0)
        background, image = (browser.find_element(By.ID, name) for name in ("background", "image"))
        drawn = "return Number(document.getElementById('points').dataset.drawn)"
        num_edges = browser.execute_script(drawn)
        assert background.get_attribute("src") == f"{server.address}edges/0"
        assert "photograph" not in (image.get_attribute("class") or "").split()
        assert background.value_of_css_property("filter") == "none"  # the drawing is dark already
        assert serious_findings(browser) == []
        browser.find_element(By.CSS_SELECTOR, "input[value=depth]").click()
        assert background.get_attribute("src") == f"{server.address}image/0"
        assert "photograph" in (image.get_attribute("class") or "").split()
        assert 100 < num_edges < 0.7 * browser.execute_script(drawn)
        browser.find_element(By.CSS_SELECTOR, "input[value=edge]").click()
        count = shown(browser)
        browser.find_element(By.ID, "next").click()
        wait_for_move(browser, count)
        assert background.get_attribute("src") == f"{server.address}edges/1"


# The command.


@pytest.mark.parametrize(
    ("options", "exit_code", "complaint"),
    [
        (("{tmp}/none.yaml",), 1, "none.yaml"),
        (("-o", "{drive}/drive.yaml"), 1, "choose another name"),
        (("-o", "{tmp}/x.txt"), 1, "x.txt: found suffix"),
        (("--cue", "features"), 2, ""),
        (("-o", "-"), 2, ""),  # the address goes to standard output
    ],
)
def test_the_command_refuses_before_it_serves(
    options: tuple[str, ...], exit_code: int, complaint: str, street: Path, tmp_path: Path
) -> None:
    arguments = [option.format(tmp=tmp_path, drive=street) for option in options]
    result = invoke("view", street, *arguments)
    assert result.exit_code == exit_code
    assert complaint in f"{result.output}{result.exception}"


def test_a_missing_image_is_told_before_a_drive_is_served(drive: Path) -> None:
    image = next((drive / "images").iterdir())
    image.unlink()
    assert image.name in str(invoke("view", drive).exception)
