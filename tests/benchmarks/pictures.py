"""Makes the images of the README and of the docs: the terminal, and every page on a desk and on a telephone.

    python tests/benchmarks/pictures.py -o docs/pictures

Needs chromium and chromedriver. With --program the images are those of another version of semcal; what that one
cannot do is left out.
"""

import io
import os
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

DESK, PHONE, TERMINAL = (1400, 900), (390, 844), (820, 600)
QUALITY = 70
WIDEST = 1000
"""Columns of an image in the docs."""
OFF_DEG, OFF_M = 0.6, 0.01


class Pictures:
    """Runs the commands in a folder, and makes images of what they print and write."""

    def __init__(self, output: Path, work: Path, program: str, suffix: str) -> None:
        self.output, self.work, self.program, self.suffix = output, work, program, suffix
        self.made = list[str]()

    def make(self, frames: int, width: int) -> None:
        """Make all images."""
        self.run("demo", "demo")
        self.keep("overlay", cv2.imread(str(self.work / "demo" / "overlay.png")))
        size = ["--frames", str(frames), "--width", str(width), "--height", str(width * 9 // 16)]
        self.run("synth", "drive", *size, "--seed", "3", "--force")
        printed = self.run("calibrate", "drive", "-o", "calibration.yaml", "--report", "report.html")
        self.terminal("terminal", "semcal calibrate drive -o calibration.yaml --report report.html", printed)
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

    def run(self, *arguments: str) -> str:
        """Run a command as on a terminal of 80 columns, and return what it prints."""
        as_terminal = {"COLUMNS": "80", "FORCE_COLOR": "1", "TTY_INTERACTIVE": "0", "TERM": "xterm-256color"}
        environment = os.environ | as_terminal
        command = [self.program, *arguments]
        done = subprocess.run(
            command,
            cwd=self.work,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
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
                    self.shoot("view", address, DESK)
                    self.shoot("view_phone", address, PHONE)
            finally:
                served.kill()  # leaving the block waits for its end

    def page(self, name: str, path: Path) -> None:
        """Make images of a page, if there is one, on a desk and on a telephone."""
        if path.exists():
            self.shoot(name, path.resolve().as_uri(), DESK)
            self.shoot(f"{name}_phone", path.resolve().as_uri(), PHONE)

    def terminal(self, name: str, command: str, printed: str) -> None:
        """Make an image of what a command prints."""
        from rich.console import Console
        from rich.text import Text

        console = Console(record=True, width=80, file=io.StringIO(), force_terminal=True)
        console.print(Text.from_ansi(f"$ {command}\n{printed.rstrip()}"))
        path = self.work / f"{name}.svg"
        console.save_svg(str(path), title="semcal")
        self.shoot(name, path.resolve().as_uri(), TERMINAL)

    def shoot(self, name: str, address: str, size: tuple[int, int]) -> None:
        """Make an image of an address as a window of this size shows it."""
        try:
            shot = screenshot(address, size)
        except (WebDriverException, HTTPError):  # a browser that hangs: once more in another one
            shot = screenshot(address, size)
        self.keep(name, shot)

    def keep(self, name: str, image: np.ndarray) -> None:
        """Write an image, no wider than needed."""
        if image.shape[1] > WIDEST:
            high = round(image.shape[0] * WIDEST / image.shape[1])
            image = cv2.resize(image, (WIDEST, high), interpolation=cv2.INTER_AREA)
        path = self.output / f"{name}{self.suffix}.webp"
        cv2.imwrite(str(path), image, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
        self.made.append(f"{path}: {path.stat().st_size / 1000:.0f} kB")


def screenshot(address: str, size: tuple[int, int]) -> np.ndarray:
    """What a browser of its own shows at this address."""
    width, height = size
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
    with headless.chromium("--hide-scrollbars") as chrome:
        chrome.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        chrome.get(address)
        time.sleep(1.0)  # points are drawn when their image is in sight
        return cv2.imdecode(np.frombuffer(chrome.get_screenshot_as_png(), np.uint8), cv2.IMREAD_COLOR)


def main(
    *,
    output: Path,
    work: Path = Path("semcal_images"),
    program: str = "semcal",
    suffix: str = "",
    frames: int = 8,
    width: int = 1280,
    real: Path | None = None,
) -> Iterator[str]:
    """Make the images, whose names get a suffix; what they show is kept in the folder `work`.

    With --real, a folder of KITTI object, only those of its drive are made.
    """
    output.mkdir(parents=True, exist_ok=True)
    work.mkdir(parents=True, exist_ok=True)
    if headless.missing():
        sys.exit(headless.missing())
    pictures = Pictures(output, work, program, suffix)
    if real is None:
        pictures.make(frames, width)
    else:
        pictures.make_real(real)
    yield from pictures.made


if __name__ == "__main__":
    script(main)
