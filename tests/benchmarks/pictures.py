"""Makes the images of the README and of the docs: points on an image, and the pages as a browser shows them.

    python tests/benchmarks/pictures.py -o docs/pictures

Needs chromium and chromedriver. With --program the images are those of another version of semcal; what that one
cannot do is left out.
"""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from selenium.common.exceptions import WebDriverException
from urllib3.exceptions import HTTPError

sys.path.insert(0, str(Path(__file__).parents[1]))
import headless
from benchmark import script
from fleets import line, series_of, write_summary

from semcal_cli.formats import read_transform
from semcal_cli.geometry.twists import displace

WINDOW = (1400, 900)
"""Columns and rows of the browser."""
QUALITY = 70
WIDEST = 1000
"""Columns of an image in the docs."""
OFF_DEG, OFF_M = 0.6, 0.01


class Pictures:
    """Runs the commands in a folder, and makes images of what they print and write."""

    def __init__(self, output: Path, work: Path, program: str) -> None:
        self.output, self.work, self.program = output, work, program
        self.made = list[str]()

    def make(self, frames: int, width: int) -> None:
        """Make all images."""
        self.run("demo", "demo")
        self.keep("overlay", cv2.imread(str(self.work / "demo" / "overlay.png")))
        size = ["--frames", str(frames), "--width", str(width), "--height", str(width * 9 // 16)]
        self.run("synth", "drive", *size, "--seed", "3", "--force")
        self.run("calibrate", "drive", "-o", "calibration.yaml", "--report", "report.html")
        self.page("report", self.work / "report.html")
        T_off = displace(
            read_transform(self.work / "calibration.yaml"), OFF_DEG, OFF_M, np.random.default_rng(1)
        )
        (self.work / "stored.yaml").write_text(f"T_camera_lidar: {T_off.tolist()}\n")
        self.run("verify", "drive", "stored.yaml", "--report", "verify.html")
        self.page("verify", self.work / "verify.html")
        lines = [line(member) for member in series_of("change")]
        self.run("fleet", str(write_summary(self.work / "batch", lines).name), "--report", "fleet.html")
        self.page("fleet", self.work / "fleet.html")
        self.view("stored.yaml")

    def make_real(self, real: Path) -> None:
        """Make the images of the calibration of a real drive."""
        self.made.append(f"printed: {self.run('demo', 'kitti', '--real', str(real.resolve()))}")
        self.keep("kitti", cv2.imread(str(self.work / "kitti" / "overlay.png")))
        self.page("kitti_report", self.work / "kitti" / "report.html")
        self.page("maps", self.work / "kitti" / "report.html", "#uncertainty .maps")

    def run(self, *arguments: str) -> str:
        """Run a command, and return what it prints."""
        command = [self.program, *arguments]
        done = subprocess.run(
            command, cwd=self.work, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self.made.append(f"{' '.join(command)}: exit code {done.returncode}")
        return done.stdout

    def view(self, start: str) -> None:
        """Make images of the page on which points are moved by hand."""
        command = [self.program, "view", "drive", start]
        asked = {"cwd": self.work, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        with subprocess.Popen(command, text=True, **asked) as served:
            assert served.stdout is not None
            try:
                if address := served.stdout.readline().strip():
                    self.shoot("view", address)
            finally:
                served.kill()  # leaving the block waits for its end

    def page(self, name: str, path: Path, part: str = "") -> None:
        """Make an image of a page, or of a part of it by its selector, if there is one."""
        if path.exists():
            self.shoot(name, path.resolve().as_uri(), part)

    def shoot(self, name: str, address: str, part: str = "") -> None:
        """Make an image of an address, or of a part of it, as a browser shows it."""
        try:
            shot = screenshot(address, part)
        except (WebDriverException, HTTPError):  # a browser that hangs: once more in another one
            shot = screenshot(address, part)
        self.keep(name, shot)

    def keep(self, name: str, image: np.ndarray) -> None:
        """Write an image, no wider than needed."""
        if image.shape[1] > WIDEST:
            high = round(image.shape[0] * WIDEST / image.shape[1])
            image = cv2.resize(image, (WIDEST, high), interpolation=cv2.INTER_AREA)
        path = self.output / f"{name}.webp"
        cv2.imwrite(str(path), image, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
        self.made.append(f"{path}: {path.stat().st_size / 1000:.0f} kB")


def screenshot(address: str, part: str) -> np.ndarray:
    """What a browser of its own shows at this address, or of the part with this selector."""
    width, height = WINDOW
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    with headless.chromium("--hide-scrollbars") as chrome:
        chrome.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        chrome.get(address)
        time.sleep(1.0)  # points are drawn when their image is in sight
        shot = (
            chrome.find_element("css selector", part).screenshot_as_png
            if part
            else chrome.get_screenshot_as_png()
        )
        return cv2.imdecode(np.frombuffer(shot, np.uint8), cv2.IMREAD_COLOR)


def main(
    *,
    output: Path,
    work: Path = Path("semcal_images"),
    program: str = "semcal",
    frames: int = 8,
    width: int = 1280,
    real: Path | None = None,
) -> Iterator[str]:
    """Make the images; what they show is kept in the folder `work`.

    With --real, a folder of KITTI object, only those of its drive are made.
    """
    output.mkdir(parents=True, exist_ok=True)
    work.mkdir(parents=True, exist_ok=True)
    if headless.missing():
        sys.exit(headless.missing())
    pictures = Pictures(output, work, program)
    if real is None:
        pictures.make(frames, width)
    else:
        pictures.make_real(real)
    yield from pictures.made


if __name__ == "__main__":
    script(main)
