"""The built documentation in a browser: widths, and what the search finds first.

`python -m bench.site docs/_build/html [--shots FOLDER]` prints what is wrong, and exits 1 then.
"""

import argparse
import functools
import http.server
import shutil
import sys
import threading
from pathlib import Path
from urllib.parse import quote

from playwright.sync_api import sync_playwright

BROWSERS = "chromium", "chromium-browser", "google-chrome"
WIDTHS = 1280, 390  # [px]
LEGIBLE = 600  # [px]: narrower pictures have letters of less than 7 px
# {what a reader types: the pages of which one is to come first}
SEARCHES = {
    "Dzhanibekov": ("tutorials/tennis_racket",),
    "tennis racket": ("tutorials/tennis_racket",),
    "gyroscope": ("tutorials/heavy_top", "theory/heavy_top"),
    "spinning top": ("tutorials/heavy_top", "theory/heavy_top"),
    "tumbling": ("tutorials/satellites", "study"),
    "intermediate axis": ("tutorials/tennis_racket", "theory/free_body"),
    "precession": ("tutorials/heavy_top", "theory/heavy_top"),
    "nutation": ("tutorials/heavy_top", "theory/heavy_top"),
    "Euler angles": ("theory/conventions", "theory/heavy_top"),
    "inertia tensor": ("theory/rigid_body",),
    "reaction wheel": ("theory/gyrostat",),
    "cubesat": ("tutorials/satellites",),
    "detumble": ("tutorials/satellites",),
    "Lyapunov": ("theory/chaos", "tutorials/chaotic_tops"),
    "Poincare section": ("how_to/sections",),
    "Monte Carlo": ("ensembles", "first_ensemble"),
    "GPU": ("how_to/devices",),
    "CUDA": ("how_to/devices",),
    "resume": ("how_to/long_runs",),
    "pandas": ("how_to/results",),
    "rare event": ("how_to/rare",),
    "Sobol indices": ("how_to/sensitivity",),
    "symplectic": ("theory/integrators",),
    "simulate": ("reference/api/rigidmc.simulate",),
}
WIDE = """() => [...document.querySelectorAll('body *')].filter(one => {
    const box = one.getBoundingClientRect(), wide = window.innerWidth + 1;
    for (let at = one; at; at = at.parentElement)
        if (['auto', 'scroll', 'hidden'].includes(getComputedStyle(at).overflowX)) return false;
    return box.width && box.right > wide && getComputedStyle(one).position !== 'fixed';
}).map(one => one.tagName + '.' + one.className).slice(0, 3)"""
PICTURES = """() => [...document.querySelectorAll('article img')].filter(one => {
    return one.naturalWidth > LEGIBLE && one.getBoundingClientRect().width < LEGIBLE;
}).map(one => one.src.split('/').pop())""".replace("LEGIBLE", str(LEGIBLE))


RESULT = "#search-results ul.search > li > a:first-of-type"
SEARCHED = "() => /Search finished|did not match/.test(document.body.innerText)"


class Quiet(http.server.SimpleHTTPRequestHandler):
    """A server of files that prints nothing."""

    def log_message(self, *words):
        pass


def served(folder):
    """The address at which a folder is served, until the process ends."""
    handler = functools.partial(Quiet, directory=folder)
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return f"http://127.0.0.1:{server.server_address[1]}"


def too_wide(page, address, names, shots):
    """Lines about what leaves the window, and pictures that are too small to read."""
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 900})
        for name in names:
            page.goto(f"{address}/{name}.html")
            if wide := page.evaluate(WIDE):
                yield f"{name}: at {width} px wider than the window: {', '.join(wide)}"
            if width < LEGIBLE and (small := page.evaluate(PICTURES)):
                yield f"{name}: at {width} px too small to read: {', '.join(small)}"
            if shots:
                name = name.replace("/", "-")
                page.screenshot(path=Path(shots, f"{name}-{width}.png"), full_page=False)


def misses(page, address):
    """Lines about words whose first result is another page than it should be."""
    for words, wanted in SEARCHES.items():
        page.goto(f"{address}/search.html?q={quote(words)}")
        page.wait_for_function(SEARCHED, timeout=20_000)
        found = page.eval_on_selector_all(RESULT, "all => all.map(one => one.href)")
        first = found[0].split("#")[0].split("?")[0] if found else "nothing"
        at = first.removeprefix(f"{address}/").removesuffix(".html")
        if at not in wanted:
            yield f"search {words!r}: {at} comes first, not {' or '.join(wanted)}"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder")
    parser.add_argument("--shots", help="folder of screenshots")
    options = parser.parse_args()
    folder = Path(options.folder)
    names = sorted(
        path.relative_to(folder).with_suffix("").as_posix()
        for path in folder.rglob("*.html")
        if not {"_static", "pages", "_modules"} & set(path.parts)
        and path.stem not in ("search", "genindex", "py-modindex")
    )
    if options.shots:
        Path(options.shots).mkdir(parents=True, exist_ok=True)
    path = next(filter(None, map(shutil.which, BROWSERS)))
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=path, args=["--no-sandbox"])
        page, address = browser.new_page(), served(folder)
        page.route("**/pages/*", lambda route: route.abort())  # pages in frames of a page
        lines = [*misses(page, address), *too_wide(page, address, names, options.shots)]
        browser.close()
    print("\n".join(lines))
    print(f"{len(names)} pages at {WIDTHS} px, {len(SEARCHES)} searches: {len(lines)} mistakes")
    sys.exit(bool(lines))


if __name__ == "__main__":
    main()
