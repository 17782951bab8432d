"""The page that plays a gait, as far as this machine has a browser."""

import io
import shutil
import time

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import sync_playwright

pytestmark = pytest.mark.slow

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def page(run, tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    result = run("watch", "web=true", "robot=ant", "seconds=3", "fps=10", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    assert result.stdout.endswith(" m/s: ant.html\n")
    return folder / "ant.html"


def test_a_page_is_one_file_that_loads_nothing(page):
    text = page.read_text(encoding="utf-8")
    assert text.lstrip().lower().startswith("<!doctype html")
    assert [path.name for path in page.parent.iterdir()] == ["ant.html"]
    assert 'src="http' not in text
    assert 'href="http' not in text.replace('href="https://github.com', "")


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium; apt install chromium")
def test_a_browser_plays_the_gait_without_network(page, is_like):
    asked = []
    flags = ["--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader"]
    quiet = ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=[*flags, *quiet])
        tab = browser.new_page(viewport={"width": 500, "height": 350})
        tab.on("request", lambda request: asked.append(request.url))
        tab.goto(page.as_uri())

        def pixels():
            picture = Image.open(io.BytesIO(tab.screenshot(timeout=120_000)))
            return np.asarray(picture.convert("RGB"))

        def shows_robot(picture):
            bricks, core = is_like(picture, (45, 90, 160)), is_like(picture, (235, 160, 50))
            return bricks > 30 and core > 5

        deadline = time.monotonic() + 120
        while not shows_robot(pixels()):
            assert time.monotonic() < deadline
        start = pixels()
        while (start == pixels()).all():
            assert time.monotonic() < deadline
        browser.close()
    assert all(url.startswith(("file:", "data:", "blob:")) for url in asked)
