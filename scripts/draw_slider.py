"""Draw docs/latent-slider.png: the latent slider on the page that `LatentExplorer.to_html` writes, in real Chromium."""

import io
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image
from playwright.sync_api import sync_playwright

from benchmarks.jupyter_page import CHROMIUM_OPTIONS, find_chromium
from crfbench import load_responses
from crfbench.files import write_atomically
from crfbench.widgets import LatentExplorer

TARGET = Path(__file__).resolve().parent.parent / "docs/latent-slider.png"


def draw(latent: float = 1.2) -> bytes:
    explorer = LatentExplorer.pretrained(load_responses("opencrf"))
    explorer.latent = latent
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        explorer.to_html(Path(folder) / "slider.html")
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=CHROMIUM_OPTIONS)
        page = browser.new_page(viewport={"width": 760, "height": 900}, device_scale_factor=2)
        page.goto((Path(folder) / "slider.html").as_uri())
        page.locator(".crf canvas").first.wait_for()
        page.wait_for_timeout(500)  # until what is fetched from the page itself is painted
        picture = page.locator(".crf").first.screenshot()
        browser.close()
    buffer = io.BytesIO()
    Image.open(io.BytesIO(picture)).convert("RGB").quantize(128).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


if __name__ == "__main__":
    write_atomically(TARGET, draw())
    print(f"{TARGET.name}: {TARGET.stat().st_size / 1024:.0f} KB")
