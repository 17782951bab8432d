"""Films and pages, as far as this machine can draw."""

import io
import shutil
import subprocess
import sys
import time

import av
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import sync_playwright

from locomotion.rendering.graphics import has_graphics

WATCH = [sys.executable, "-m", "locomotion.watch"]
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


def watch(*arguments, **keywords):
    return subprocess.run(
        [*WATCH, *arguments], capture_output=True, text=True, timeout=300, **keywords
    )


def is_like(pixels, colour, tolerance=50):
    """How many pixels have a colour, roughly."""
    return (np.abs(pixels.astype(int) - colour).max(-1) < tolerance).sum()


@pytest.mark.skipif(not has_graphics(), reason="no OpenGL; apt install libegl1 libgl1-mesa-dri")
def test_a_film_shows_the_robot_its_path_and_a_caption(tmp_path):
    result = watch("seconds=2", "width=320", "height=180", "fps=10", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("gecko walks at 0.")
    assert result.stdout.endswith(" m/s: gecko.mp4, gecko.webp\n")
    with av.open(str(tmp_path / "gecko.mp4")) as film:
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
        assert film.streams.video[0].average_rate == 10
    assert len(frames) == 20
    assert frames[0].shape == (180, 320, 3)
    # The camera follows: the core's orange stays near the middle, and the path grows behind it.
    for frame in (frames[0], frames[-1]):
        assert is_like(frame[45:135, 80:240], (220, 140, 40)) > 10
        assert is_like(frame[:20, :120], (255, 255, 255)) > 20  # letters
    with Image.open(tmp_path / "gecko.webp") as small:
        assert small.n_frames == 20
    assert (tmp_path / "gecko.webp").stat().st_size < 500_000


@pytest.mark.skipif(not has_graphics(), reason="no OpenGL; apt install libegl1 libgl1-mesa-dri")
@pytest.mark.parametrize("ending", ["webp", "gif"])
def test_a_moving_picture_alone_is_as_large_and_as_fluent_as_asked_for(tmp_path, ending):
    options = ["seconds=1", "width=128", "height=96", "fps=20", f"output=gait.{ending}"]
    result = watch(*options, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert [path.name for path in tmp_path.iterdir()] == [f"gait.{ending}"]
    with Image.open(tmp_path / f"gait.{ending}") as picture:
        assert picture.size == (128, 96)
        assert picture.n_frames == 20
        picture.seek(19)
        picture.load()
        assert picture.info["duration"] == 50  # ms


def test_without_opengl_the_line_names_the_package(tmp_path):
    code = (
        "import ctypes.util, sys; ctypes.util.find_library = lambda name: None;"
        "import locomotion.watch as watch; sys.argv = ['watch', 'seconds=1']; watch.main()"
    )
    result = subprocess.run(
        [sys.executable, "-c", code],
        env={"PATH": "/usr/bin:/bin", "HOME": str(tmp_path)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    assert "apt install libegl1 libgl1-mesa-dri" in result.stderr
    assert not list(tmp_path.glob("gecko*"))


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a screen")
def test_the_viewer_needs_a_screen(tmp_path):
    result = watch("live=true", env={"PATH": "/usr/bin:/bin"}, cwd=tmp_path)
    assert result.returncode == 2
    assert result.stderr == "error: live=true needs a screen; a film or web=true does not\n"


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    result = watch("web=true", "robot=ant", "seconds=3", "fps=10", cwd=folder)
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
def test_a_browser_plays_the_gait_without_network(page):
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
