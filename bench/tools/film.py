"""Film a live page for README, and press its buttons: python -m bench.film. It needs Chromium."""

import io
import os
import shutil
import sys
import tempfile

from PIL import Image
from playwright.sync_api import sync_playwright

import rigidmc
from bench.tools.readme import ROOT

PAGE, WIDTH, COLOURS = {"width": 1000, "height": 890}, 640, 96
FRAME = 80  # ms of the page, and of the film
BUTTONS = {0: "cusps", 60: "loops", 120: "waves"}  # pressed before these frames
FRAMES, SPEED = 180, "0.1"


def screenshots(address):
    """Yield a picture of the page for every frame of the film."""
    program = next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome")))
    )
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        page = browser.new_page(viewport=PAGE)
        page.clock.install(time=0)
        page.goto(address)
        page.clock.pause_at(10_000)  # frames are at equal times, however long a screenshot takes
        page.select_option("#speed", SPEED)
        for number in range(FRAMES):
            if number in BUTTONS:
                page.get_by_role("button", name=BUTTONS[number]).click()
            page.clock.run_for(FRAME)
            page.wait_for_timeout(30)
            yield Image.open(io.BytesIO(page.screenshot())).convert("RGB")
        browser.close()


def main(path):
    with tempfile.TemporaryDirectory() as folder:
        file = os.path.join(folder, "live.html")
        scene = rigidmc.Scene.load("heavy_top", {"run.members": 1})
        rigidmc.live(scene, file)
        pictures = [
            picture.resize(
                (WIDTH, WIDTH * PAGE["height"] // PAGE["width"]), Image.Resampling.LANCZOS
            )
            for picture in screenshots(f"file://{file}")
        ]
    palette = pictures[-1].quantize(COLOURS)
    first, *rest = [
        picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures
    ]
    first.save(path, save_all=True, append_images=rest, duration=FRAME, loop=0, optimize=True)
    print(f"{path}: {os.path.getsize(path) / 1e6:.2f} MB")


if __name__ == "__main__":
    main(*(sys.argv[1:] or [os.path.join(ROOT, "bench", "pictures", "live.gif")]))
