"""What a browser finds wrong with a page, whoever made it."""

import json
from pathlib import Path

from selenium import webdriver

from semcal_cli.drive.document import read_drive
from semcal_cli.report import read_report_input, write_report

PHONE = {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}
DESK = {"width": 1400, "height": 900, "deviceScaleFactor": 1, "mobile": False}

FINDINGS = (Path(__file__).parent / "pages.js").read_text()
"""Function body: the findings in the page as it stands, as strings."""


def page_of(drive: Path, calibration: Path, folder: Path) -> str:
    """The page about a calibration on a drive."""
    write_report(read_report_input(read_drive(drive), calibration), folder / "r.html")
    return (folder / "r.html").read_text()


def serious_findings(browser: webdriver.Chrome) -> list[str]:
    """Name what is wrong with the page that the browser shows, on a desk and on a phone, light and dark.

    A finding is a message on the console since it was read last, a file from elsewhere
    than the page's own server, a page or part of it wider than
    the screen, text that is cut, too small or of too little contrast (WCAG 2.1, level AA), and a control or image
    without a name. What is folded is unfolded for the look. The page is as before afterwards.
    """
    findings = _said(browser)
    for name, metrics in (("desk", DESK), ("phone", PHONE)):
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        for scheme in ("light", "dark"):
            _prefer(browser, scheme)
            # What a script draws anew after a change of the size stands after two frames.
            browser.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
            findings += [f"{name}, {scheme}: {finding}" for finding in browser.execute_script(FINDINGS)]
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    _prefer(browser, "")
    # The console again: what the page says when it is laid out anew counts, too.
    findings += _said(browser)
    return list(dict.fromkeys(findings))


def _said(browser: webdriver.Chrome) -> list[str]:
    """Messages on the console, but for what a software renderer says of its own speed."""
    entries = [entry for entry in browser.get_log("browser") if "GL Driver Message" not in entry["message"]]
    return [f"console: {entry['level']} {entry['message']}" for entry in entries]


def _prefer(browser: webdriver.Chrome, scheme: str) -> None:
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})


def show(browser: webdriver.Chrome, content: str) -> None:
    """Replace what the browser shows by a page of this content, with nothing left on the console."""
    browser.get("about:blank")
    browser.get_log("browser")
    browser.execute_script(f"document.open(); document.write({json.dumps(content)}); document.close();")
