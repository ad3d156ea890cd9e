"""Damaged photographs: whatever the bytes, one file gives pixels or one FormatError, and the next file is read."""

import re
from pathlib import Path

import cv2
import numpy as np
import pillow_heif
import pytest
import tifffile
from PIL import Image

from crfbench.camera.reading import read_exif, read_image, read_raw
from crfbench.camera.worker import Worker
from crfbench.curves import GRID
from crfbench.datasets import registry
from crfbench.errors import FormatError
from tests.support.photographs import write_pair, write_raw
from tests.support.scenes import render_chart


@pytest.fixture(scope="module")
def originals(tmp_path_factory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("originals")
    scene = render_chart(GRID, size=(64, 48))
    paths = [*write_pair(folder, "a", scene), folder / "a.png", folder / "a.tif"]
    cv2.imwrite(str(paths[2]), scene.jpeg)
    cv2.imwrite(str(paths[3]), (scene.raw * 65535).astype(np.uint16))
    planes = np.moveaxis(scene.jpeg, 2, 0) * np.uint16(257)
    tifffile.imwrite(folder / "a.tiff", planes, photometric="rgb", planarconfig="separate")
    pillow_heif.from_pillow(Image.fromarray(scene.jpeg)).save(folder / "a.heic")
    Image.fromarray(scene.jpeg).save(folder / "a.webp")
    Image.fromarray(scene.jpeg).save(folder / "a.avif")
    paths += [folder / f"a.{suffix}" for suffix in ("tiff", "heic", "webp", "avif")]
    write_raw(folder / "b.dng", np.tile(scene.raw, (7, 7, 1)), np.tile(scene.jpeg, (7, 7, 1))).rename(folder / "b.nef")
    paths.append(folder / "b.nef")  # of which the preview is read
    second = Image.fromarray(scene.jpeg[..., 1])  # as of a gain map
    Image.fromarray(scene.jpeg).save(folder / "a.jpeg", "MPO", save_all=True, append_images=[second])
    paths.append(folder / "a.jpeg")
    if real := registry.find("raw/RAW_KODAK_DC50.KDC"):
        paths.append(real)
    return {path.suffix.lower(): path.read_bytes() for path in paths}


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """Cut it, drop or repeat a part, or set some bytes, in half of all cases in the first ones, where headers are."""
    data = bytearray(content)
    if rng.random() < 0.3:
        start, other = rng.integers(len(data), size=2)
        return bytes(data[:start] + data[other:] if rng.random() < 0.5 else data[:start])
    reach = min(len(data), 600) if rng.random() < 0.5 else len(data)
    for position in rng.integers(0, reach, rng.integers(1, 12)):
        data[position] = rng.choice([0, 1, 0x7F, 0x80, 0xFF, rng.integers(256)])
    return bytes(data)


def read_everything(path: Path) -> tuple[tuple[int, ...], bool]:
    """Read exposure and pixels; say of the pixels their shape and whether they are as promised."""
    read_exif(path)
    pixels = read_raw(path) if path.suffix in (".dng", ".kdc") else read_image(path)
    return pixels.shape, bool((pixels >= 0).all() and (pixels <= 1).all())


@pytest.mark.parametrize("n_files", [6, pytest.param(50, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "suffix", [".jpg", ".jpeg", ".png", ".tif", ".tiff", ".dng", ".nef", ".kdc", ".heic", ".webp", ".avif"]
)
def test_damaged_files(tmp_path, originals, suffix, n_files, capfd):
    if suffix not in originals:
        pytest.skip("the real RAW file is absent: set CRFBENCH_DATA to the folder that holds raw/RAW_KODAK_DC50.KDC")
    rng = np.random.default_rng(2)
    refused = 0
    worker = Worker()
    for number in range(n_files):
        path = tmp_path / f"{number}{suffix}"
        path.write_bytes(damaged(originals[suffix], rng))
        try:
            shape, promised = worker.run(read_everything, path)
            assert promised
            assert shape[2:] in ((3,), ())  # a DNG file may become one of a monochrome sensor
        except FormatError as error:
            assert path.name in str(error)  # noqa: PT017
            refused += 1
    path.write_bytes(originals[suffix])
    assert worker.run(read_everything, path)[1]
    worker.close()
    # Every byte of a PNG file is under a checksum; the other formats let some damage to pixels through.
    assert refused == n_files if suffix == ".png" else 0 < refused < n_files
    assert not re.search("Traceback|Warning", capfd.readouterr().err)
