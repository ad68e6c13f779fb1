"""Every page in a browser: what it holds that someone could not see, read or use."""

import pytest
from pages import serious_findings, show
from selenium import webdriver

SOUND = """<!doctype html><html lang="en"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>sound</title><body style="background: #fff; color: #333"><p>Text</p>
<label>Number <input type="number" value="1"></label>{}</body></html>"""


@pytest.mark.parametrize(
    ("content", "finding"),
    [
        ("", None),
        ("<script>console.info('said')</script>", "console: INFO"),
        ("<p style='color: #777'>pale</p>", "contrast 4.48: 'pale' in p"),
        ("<p style='color: #777; font-size: 24px'>pale and large</p>", None),
        ("<p style='opacity: .6'>pale</p>", "contrast 3.71: 'pale' in p"),
        ("<div style='background: #000c'><p style='color: #fff'>on a shade</p></div>", None),
        ("<details><summary>more</summary><p style='color: #eee'>folded</p></details>", "'folded' in p"),
        ("<p hidden style='color: #fff'>never seen</p>", None),
        ("<p style='font-size: 8px'>tiny</p>", "letters of 8.0 px: 'tiny' in p"),
        (
            "<svg viewBox='0 0 100 10' width='50'><title>t</title><text y='9' font-size='10'>a</text></svg>",
            "letters of 5.0 px: 'a' in text",
        ),
        ("<svg width='50'><title>t</title><text y='20'>far too long for it</text></svg>", "cut: 'far"),
        ("<p style='width: 500px'>wide</p>", "phone, dark: the page is"),
        ("<div style='overflow-x: auto'><p style='width: 1500px'>wide</p></div>", None),
        ("<div style='overflow: hidden'><p style='width: 1500px'>wide</p></div>", "1500 px in"),
        ("<select><option>a</option></select>", "no name: select"),
        ("<input id='x' type='range'>", "no name: input#x"),
        ("<canvas class='c'></canvas>", "no name: canvas.c"),
        ("<img src='data:image/gif;base64,R0lGODlhAQABAAAAACw=' alt=''>", "no name: img"),
        ("<svg width='50'></svg>", "no name: svg"),
        ("<i id='a'></i><i id='a'></i>", "found twice: #a"),
        ("<img src='file:///nowhere.png' alt='a'>", "from elsewhere: file:///nowhere.png"),
    ],
)
def test_what_is_wrong_is_found(content: str, finding: str | None, browser: webdriver.Chrome) -> None:
    show(browser, SOUND.format(content))
    found = serious_findings(browser)
    if finding is None:
        assert found == []
    else:
        assert any(finding in each for each in found), found
