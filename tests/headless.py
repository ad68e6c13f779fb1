"""Chromium without a display, as Debian's packages chromium and chromium-driver have it."""

import os
import shutil
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from selenium import webdriver

ANSWER_S = 60
"""A browser that answers nothing for so long hangs, seconds. Selenium waits for ever if not told otherwise."""


def missing() -> str:
    """Name what has to be installed, or nothing."""
    found = shutil.which("chromedriver") and shutil.which("chromium")
    return "" if found else "no chromium and chromedriver: install Debian's chromium-driver"


@contextmanager
def chromium(*arguments: str) -> Iterator[webdriver.Chrome]:
    """Start Chromium with these arguments; at the end nothing of it is left, whether it still answers or not."""
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    # Containers often run as root and without the kernel's sandbox; the page is ours.
    quiet = ("--disable-background-networking", "--disable-component-update")
    for argument in ("--headless=new", "--no-sandbox", "--enable-unsafe-swiftshader", *quiet, *arguments):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.ChromeService(shutil.which("chromedriver"), popen_kw={"start_new_session": True})
    chrome = webdriver.Chrome(options=options, service=driver)
    chrome.command_executor.client_config.timeout = ANSWER_S
    group = driver.process.pid
    try:
        yield chrome
        chrome.quit()
    finally:
        with suppress(ProcessLookupError):
            os.killpg(group, signal.SIGKILL)
