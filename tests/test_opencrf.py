import hashlib
import importlib.util
import io
import json
import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator
from scipy.optimize import bisect

from crfbench.curves import GRID, as_valid_curves
from crfbench.datasets.responses import load_opencrf
from crfbench.errors import FormatError, InputError
from crfbench.files import bundled
from crfbench.metrics import rmse

ROOT = Path(__file__).parent.parent


def load_script():
    spec = importlib.util.spec_from_file_location("build_opencrf", ROOT / "scripts" / "build_opencrf.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


script = load_script()

needs_sources = pytest.mark.skipif(
    bool(script.missing_packages()), reason=f"not installed: {', '.join(script.missing_packages())}"
)


@pytest.fixture(scope="module")
def rebuilt():
    return script.build()


@pytest.fixture(scope="module")
def stored():
    with np.load(bundled("data/opencrf.npz"), allow_pickle=False) as file:
        return dict(file)


def curve_named(name):
    responses = load_opencrf("all")
    return responses.curves[responses.names.index(name)]


def test_counts_by_tier():
    assert {tier: len(load_opencrf(tier)) for tier in ("core", "hdr", "all")} == {"core": 151, "hdr": 16, "all": 167}
    assert repr(load_opencrf()) == "151 responses from opencrf, 73 units"


def test_counts_by_family():
    assert Counter(load_opencrf("core").families) == {
        "film-negative": 94,
        "film-reversal": 24,
        "film-bw": 9,
        "video-log": 13,
        "oetf": 11,
    }
    assert Counter(load_opencrf("hdr").families) == {"video-log-hdr": 16}


def test_films_are_49_stocks_of_one_to_three_layers():
    films = Counter(
        unit
        for unit, family in zip(load_opencrf().units, load_opencrf().families, strict=True)
        if family.startswith("film")
    )
    assert len(films) == 49
    assert set(films.values()) <= {1, 2, 3}


def test_source_and_licence_of_every_curve():
    responses = load_opencrf("all")
    assert Counter(zip(responses.sources, responses.licences, strict=True)) == {
        ("spectral-film-lut 0.18.13", "MIT"): 127,
        ("colour-science 0.4.7", "BSD-3-Clause"): 40,
    }


def test_names_are_unique():
    assert len(set(load_opencrf("all").names)) == 167


def test_every_curve_is_valid_to_the_last_bit():
    curves = as_valid_curves(load_opencrf("all").curves, tolerance=0.0)
    assert curves.dtype == np.float64
    np.testing.assert_array_equal(curves[:, [0, -1]], np.tile([0.0, 1.0], (167, 1)))


def test_no_near_duplicate():
    curves = load_opencrf("all").curves
    for row in range(1, len(curves)):
        assert rmse(curves[:row], curves[row]).min() >= 0.001 - 1e-7


def test_only_the_hdr_tier_is_steeper_than_measured_responses():
    at_one_percent = {tier: [np.interp(0.01, GRID, c) for c in load_opencrf(tier).curves] for tier in ("core", "hdr")}
    assert max(at_one_percent["core"]) < 0.40 < min(at_one_percent["hdr"])


def test_inverses_are_responses_too():
    as_valid_curves(load_opencrf("all").in_direction("inverse"))


def srgb(light):
    """IEC 61966-2-1."""
    return light * 12.92 if light <= 0.0031308 else 1.055 * light ** (1 / 2.4) - 0.055


def bt709(light):
    """ITU-R BT.709-6, item 1.2."""
    return light * 4.5 if light < 0.018 else 1.099 * light**0.45 - 0.099


def v_log(light):
    """Panasonic V-Log/V-Gamut reference manual, 2014; white is where the code is 1."""
    reflectance = light * (10 ** ((1 - 0.598206) / 0.241514) - 0.00873)
    code = 5.6 * reflectance + 0.125 if reflectance < 0.01 else 0.241514 * np.log10(reflectance + 0.00873) + 0.598206
    return (code - 0.125) / (1 - 0.125)


@pytest.mark.parametrize(
    ("name", "formula"),
    [("sRGB", srgb), ("Gamma 2.2", lambda x: x ** (1 / 2.2)), ("ITU-R BT.709", bt709), ("V-Log", v_log)],
)
def test_transfer_function_equals_its_published_formula(name, formula):
    np.testing.assert_allclose(curve_named(name), [formula(x) for x in GRID], atol=1e-6)


@pytest.mark.parametrize("slope", [0.6, 1.0, -0.5])
def test_a_straight_characteristic_curve_gives_a_power_law(slope):
    """D = slope log10 H means brightness H^|slope|, above the chart's dark end."""
    log_exposure = np.array([-4.0, -2.5, -1.0, 1.0])
    curve = script.film_response(log_exposure, 2.0 + slope * log_exposure)
    dark, bright = (10.0 ** (abs(slope) * end) for end in (-4.0, 1.0))
    white = dark + 0.99 * (bright - dark)
    irradiance = np.maximum(GRID * white ** (1 / abs(slope)), 1e-4)
    expected = (irradiance ** abs(slope) - dark) / (white - dark)
    np.testing.assert_allclose(curve, expected, atol=1e-3)


@needs_sources
@pytest.mark.parametrize(
    ("stock", "layer", "suffix", "sign"),
    [
        ("Kodak Portra 400", 1, " G", 1),
        ("Fuji Provia 100F", 0, " R", -1),
        ("Fuji Velvia 50", 1, " G", -1),
        ("Kodak Tri-X 400", 0, "", 1),
        ("Kodak Portra 800 @1600", 2, " B", 1),
    ],
)
def test_film_agrees_with_a_recomputation_from_the_charted_points(stock, layer, suffix, sign):
    """Evaluate the charted points light by light and search white by bisection: no grid of exposures between."""
    import spectral_film_lut

    film = next(film for film in spectral_film_lut.FILM_STOCKS if film.name == stock)
    points = {film.exposure_base**x: density for x, density in sorted(film.sensiometric_curve[layer].items())}
    density_at = PchipInterpolator([math.log10(light) for light in points], list(points.values()))

    def brightness(light):
        return 10 ** (sign * float(density_at(math.log10(max(light, min(points))))))

    dark, brightest = min(points), max(points, key=brightness)
    target = brightness(dark) + 0.99 * (brightness(brightest) - brightness(dark))
    white = bisect(lambda light: brightness(light) - target, dark, brightest)
    expected = [(brightness(x * white) - brightness(dark)) / (target - brightness(dark)) for x in GRID]
    np.testing.assert_allclose(curve_named(stock + suffix), expected, atol=1e-3)


@needs_sources
def test_rebuild_equals_the_bundled_file_bit_for_bit(rebuilt, stored):
    assert script.differences(rebuilt, stored) == []


@needs_sources
def test_check_accepts_the_bundled_file(capsys):
    assert script.main(["--check"]) == 0
    assert capsys.readouterr().err == ""


@needs_sources
def test_writing_twice_gives_the_same_bytes_and_leaves_nothing_else(rebuilt, tmp_path):
    digests = set()
    for name in ("a.npz", "b.npz"):
        script.write(rebuilt, tmp_path / name)
        digests.add(hashlib.sha256((tmp_path / name).read_bytes()).hexdigest())
    assert len(digests) == 1
    assert {path.name for path in tmp_path.iterdir()} == {"a.npz", "b.npz"}


def test_check_names_a_changed_row(stored, tmp_path, monkeypatch, capsys):
    altered = stored | {"curves": stored["curves"].copy()}
    altered["curves"][5, 100] += 0.01
    script.write(altered, tmp_path / "x.npz")
    monkeypatch.setattr(script, "build", lambda: stored)
    monkeypatch.setattr(script, "missing_packages", list)
    assert script.main(["--check", "--output", str(tmp_path / "x.npz")]) == 1
    assert "curves: 1 of 167 rows differ, the first is row 5" in capsys.readouterr().err
    assert script.main(["--check", "--output", str(tmp_path / "none.npz")]) == 1
    assert "not there" in capsys.readouterr().err


def test_build_writes_the_file_and_a_summary(stored, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(script, "build", lambda: stored)
    monkeypatch.setattr(script, "missing_packages", list)
    assert script.main(["--output", str(tmp_path / "x.npz")]) == 0
    assert "core film-negative: 94 curves of 32" in capsys.readouterr().out
    with np.load(tmp_path / "x.npz", allow_pickle=False) as written:
        assert script.differences(dict(written), stored) == []


def test_differences_tell_of_shape_type_and_missing_arrays():
    a = {"curves": np.zeros((2, 3)), "name": np.array(["a", "b"]), "tier": np.array(["core"])}
    b = {"curves": np.zeros((2, 3), dtype=np.float32), "name": np.array(["a", "c"])}
    assert script.differences(a, b) == [
        "tier: only in one of the two",
        "curves: rebuilt (2, 3) float64, bundled (2, 3) float32",
        "name: 1 of 2 rows differ, the first is row 1",
    ]


def test_missing_packages_are_named(monkeypatch, capsys):
    monkeypatch.setattr(script, "PINNED", {"numpy": "0.0.1", "no-such-package": "1.0"})
    assert script.main([]) == 1
    assert "pip install --no-deps numpy==0.0.1 no-such-package==1.0" in capsys.readouterr().err


def test_provenance_says_what_was_used_and_dropped(stored):
    provenance = json.loads(str(stored["provenance"][0]))
    assert provenance["packages"] == script.PINNED
    assert provenance["unreliable films"] == ["Kodak 5247", "Kodak 5248", "Kodak 5250"]
    assert len(provenance["near-duplicates"]) == 10
    assert not set(provenance["near-duplicates"]) & set(load_opencrf("all").names)
    sources = bundled("data/SOURCES.md").read_text(encoding="utf-8")
    for name in [*provenance["unreliable films"], *provenance["near-duplicates"]]:
        assert name in sources


def test_unknown_tier_lists_the_ones_that_fit():
    with pytest.raises(InputError, match=r"tier='gpl'.*core, hdr, all"):
        load_opencrf("gpl")


def without_member(data, name):
    with np.load(io.BytesIO(data)) as file:
        kept = {key: file[key] for key in file if key != name}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **kept)
    return buffer.getvalue()


def flipped(data, position):
    return data[:position] + bytes([data[position] ^ 1]) + data[position + 1 :]


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: b"",
        lambda data: b"not a zip file",
        lambda data: data[:1000],
        lambda data: data[:-1],
        lambda data: flipped(data, 134),
        lambda data: flipped(data, 300_000),
        lambda data: flipped(data, len(data) - 2500),
        lambda data: without_member(data, "licence"),
        lambda data: without_member(data, "curves"),
    ],
)
def test_a_damaged_file_is_named(damage, tmp_path, monkeypatch):
    path = tmp_path / "opencrf.npz"
    path.write_bytes(damage(bundled("data/opencrf.npz").read_bytes()))
    monkeypatch.setattr("crfbench.datasets.responses.bundled", lambda name: path)
    with pytest.raises(FormatError, match=r"opencrf\.npz is missing or damaged"):
        load_opencrf()


def test_a_missing_file_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("crfbench.datasets.responses.bundled", lambda name: tmp_path / "opencrf.npz")
    with pytest.raises(FormatError, match=r"opencrf\.npz is missing"):
        load_opencrf()
