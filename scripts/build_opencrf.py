"""Build data/opencrf.npz, the open set of response curves, from two pinned packages.

    pip install colour-science==0.4.7
    pip install --no-deps spectral-film-lut==0.18.13
    python scripts/build_opencrf.py            # write the file
    python scripts/build_opencrf.py --check    # compare a rebuild with the bundled file

The film data need none of spectral-film-lut's own dependencies (a GUI toolkit among them), hence --no-deps.
"""

import argparse
import importlib
import json
import os
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from crfbench.curves import GRID, Array, evaluate
from crfbench.metrics import rmse

OUTPUT = Path(__file__).resolve().parent.parent / "data" / "opencrf.npz"

PINNED = {"colour-science": "0.4.7", "spectral-film-lut": "0.18.13"}
LICENCES = {"colour-science": "BSD-3-Clause", "spectral-film-lut": "MIT"}

# Published curves of cameras, by colour-science's names. Curves of working spaces and of displays are left out.
LOG_ENCODINGS = (
    "Apple Log Profile",
    "ARRI LogC4",
    "Canon Log",
    "Canon Log 2",
    "Canon Log 3",
    "Cineon",
    "D-Log",
    "F-Log",
    "F-Log2",
    "Filmic Pro 6",
    "L-Log",
    "Log3G10",
    "Log3G12",
    "Mi-Log",
    "N-Log",
    "Panalog",
    "Protune",
    "REDLog",
    "REDLogFilm",
    "S-Log",
    "S-Log2",
    "S-Log3",
    "T-Log",
    "V-Log",
    "ViperLog",
    "Blackmagic Film Generation 5",
)
LOGC3_EXPOSURE_INDICES = (160, 200, 250, 320, 400, 500, 640, 800, 1000, 1280, 1600)
GAMMA_LIKE_ENCODINGS = (
    "ITU-R BT.709",
    "SMPTE 240M",
    "ITU-T H.273 Log",
    "ITU-T H.273 Log Sqrt",
    "ARIB STD-B67",
    "sRGB",
    "ROMM RGB",
    "RIMM RGB",
    "Gamma 2.2",
    "Gamma 2.4",
    "Gamma 2.6",
)

WHITE = 0.99  # share of the charted brightness range at which a film is taken to be white
STEEP = 0.40  # brightness that a curve of the tier "hdr" exceeds at 1 % of white
NEAR_DUPLICATE = 0.001  # RMSE below which the later of two curves is dropped

NORMALISATION = {
    "film": (
        "density over log10 exposure, shape-preserving cubic through the charted points; brightness is opacity "
        "10^D for negatives and transmittance 10^-D for reversal film, made non-decreasing by a running maximum; "
        "exposure 1 is the lowest at which brightness has covered 99 % of its charted range, exposure 0 is no light "
        "(the chart's dark end is held below it); brightness is shifted and scaled to run from 0 to 1; "
        "one curve a colour layer"
    ),
    "transfer function": (
        "irradiance 1 is the light that gives code value 1.0; code values below 0 are clipped; code is shifted and "
        "scaled to run from 0 to 1; tier hdr holds the curves whose brightness at 1 % of white exceeds 0.40"
    ),
    "both": "a curve within RMSE 0.001 of an earlier one is dropped; values are rounded to float32",
}


@dataclass(frozen=True)
class Entry:
    """One response curve, shape (1024,), and what the file says of it."""

    curve: Array
    name: str
    unit: str
    family: str
    tier: str
    source: str


def to_unit_range(values: Array) -> Array:
    """Shift and scale values so that the first is exactly 0 and the last exactly 1."""
    first, last = float(values[0]), float(values[-1])
    return (values - first) / (last - first)


def film_response(log_exposure: Array, density: Array) -> Array:
    """Turn one characteristic curve of a film into a response curve.

    Parameters
    ----------
    log_exposure : ndarray, shape (m,)
        log10 of the exposure, increasing.
    density : ndarray, shape (m,)
        Optical density; it rises with exposure on a negative and falls on reversal film.

    Returns
    -------
    ndarray, shape (1024,)
    """
    decades = np.linspace(log_exposure[0], log_exposure[-1], 8192)
    sign = 1.0 if density[-1] > density[0] else -1.0
    brightness = np.maximum.accumulate(10.0 ** (sign * PchipInterpolator(log_exposure, density)(decades)))
    white = decades[np.argmax(to_unit_range(brightness) >= WHITE)]
    return to_unit_range(np.interp(GRID, 10.0 ** (decades - white), brightness))


def camera_films() -> Iterator[Any]:
    """Yield each camera film of spectral-film-lut once; print materials are not cameras."""
    stocks = importlib.import_module("spectral_film_lut").FILM_STOCKS
    yield from {film.name: film for film in stocks if film.stage == "camera"}.values()


def is_unreliable(film: Any) -> bool:
    """Say whether the film's own record calls its data unreliable."""
    return "unreliable" in (film.comment or "").lower()


def film_family(film: Any) -> str:
    """Name the family of a film."""
    if film.density_measure == "bw":
        return "film-bw"
    return "film-reversal" if film.film_type == "positive" else "film-negative"


def film_entries() -> Iterator[Entry]:
    """Yield a curve for each layer of each reliable camera film."""
    for film in camera_films():
        if is_unreliable(film):
            continue
        stock = film.name.replace("Trix-X", "Tri-X")
        layers = film.sensiometric_curve
        for suffix, layer in zip([""] if len(layers) == 1 else [" R", " G", " B"], layers, strict=True):
            exposure, density = np.array(sorted(layer.items()), dtype=np.float64).T
            curve = film_response(exposure * np.log10(film.exposure_base), density)
            yield Entry(curve, stock + suffix, stock, film_family(film), "core", "spectral-film-lut")


def transfer_entry(name: str, registry_name: str, family: str, **options: float) -> Entry:
    """Normalise a published transfer function to white at code value 1.0."""
    models = importlib.import_module("colour.models")
    # colour evaluates both branches of a function everywhere, and some logarithms are -inf for no light.
    with np.errstate(divide="ignore", invalid="ignore"):
        white = float(models.CCTF_DECODINGS[registry_name](1.0, **options))
        code = np.asarray(models.CCTF_ENCODINGS[registry_name](GRID * white, **options), dtype=np.float64)
    curve = to_unit_range(np.maximum.accumulate(np.maximum(code, 0.0)))
    if evaluate(curve, [0.01])[0] > STEEP:
        return Entry(curve, name, name, f"{family}-hdr", "hdr", "colour-science")
    return Entry(curve, name, name, family, "core", "colour-science")


def use_double_precision() -> None:
    """Set colour's number type, which the film package sets to float32 for the whole process, back to float64.

    Its own function looks into every loaded module, and some load others when looked into, which ends it.
    """
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] == "colour" and "DTYPE_FLOAT_DEFAULT" in vars(module):
            vars(module)["DTYPE_FLOAT_DEFAULT"] = np.float64
    importlib.import_module("colour.utilities").CACHE_REGISTRY.clear_all_caches()


def transfer_entries() -> Iterator[Entry]:
    """Yield a curve for each published transfer function of a camera."""
    use_double_precision()
    for name in LOG_ENCODINGS:
        yield transfer_entry(name, name, "video-log")
    for index in LOGC3_EXPOSURE_INDICES:
        yield transfer_entry(f"ARRI LogC3 EI{index}", "ARRI LogC3", "video-log", EI=index)
    for name in GAMMA_LIKE_ENCODINGS:
        yield transfer_entry(name, name, "oetf")


def drop_near_duplicates(candidates: Iterable[Entry]) -> tuple[list[Entry], dict[str, str]]:
    """Keep the first of curves that all but coincide; return the kept and {dropped: kept} names."""
    kept: list[Entry] = []
    dropped: dict[str, str] = {}
    for entry in candidates:
        distances = rmse([other.curve for other in kept], entry.curve) if kept else np.ones(1)
        nearest = int(np.argmin(distances))
        if distances[nearest] < NEAR_DUPLICATE:
            dropped[entry.name] = kept[nearest].name
        else:
            kept.append(entry)
    return kept, dropped


def build() -> dict[str, np.ndarray]:
    """Return the arrays of the file by name."""
    entries, duplicates = drop_near_duplicates([*film_entries(), *transfer_entries()])
    provenance = {
        "packages": PINNED,
        "normalisation": NORMALISATION,
        "unreliable films": [film.name for film in camera_films() if is_unreliable(film)],
        "near-duplicates": duplicates,
    }
    return {
        "curves": np.array([entry.curve for entry in entries], dtype=np.float32),
        **{key: np.array([getattr(entry, key) for entry in entries]) for key in ("name", "unit", "family", "tier")},
        "source": np.array([f"{entry.source} {PINNED[entry.source]}" for entry in entries]),
        "licence": np.array([LICENCES[entry.source] for entry in entries]),
        "provenance": np.array([json.dumps(provenance)]),
    }


def write(arrays: Mapping[str, np.ndarray], path: Path) -> None:
    """Write the arrays so that a crash leaves either the old file or the new one."""
    part = path.with_suffix(".part")
    with part.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)
    os.replace(part, path)


def differences(built: Mapping[str, np.ndarray], bundled: Mapping[str, np.ndarray]) -> list[str]:
    """Say in words where two files' arrays differ; nothing if they agree bit for bit."""
    found = [f"{key}: only in one of the two" for key in sorted(set(built) ^ set(bundled))]
    for key in sorted(set(built) & set(bundled)):
        a, b = built[key], bundled[key]
        if a.shape != b.shape or a.dtype != b.dtype:
            found.append(f"{key}: rebuilt {a.shape} {a.dtype}, bundled {b.shape} {b.dtype}")
        elif rows := [row for row in range(len(a)) if a[row].tobytes() != b[row].tobytes()]:
            found.append(f"{key}: {len(rows)} of {len(a)} rows differ, the first is row {rows[0]}")
    return found


def summary(arrays: Mapping[str, np.ndarray]) -> str:
    """Count the curves and the units of each tier and family."""
    kinds = list(zip(arrays["tier"].tolist(), arrays["family"].tolist(), strict=True))
    units = Counter(kind for kind, _ in set(zip(kinds, arrays["unit"].tolist(), strict=True)))
    lines = [f"{tier} {family}: {n} curves of {units[tier, family]}" for (tier, family), n in Counter(kinds).items()]
    return "\n".join([*lines, f"in all: {len(kinds)} curves of {units.total()}"])


def missing_packages() -> list[str]:
    """Return the pinned packages that are not installed in their pinned version."""

    def installed(name: str) -> str | None:
        try:
            return version(name)
        except PackageNotFoundError:
            return None

    return [f"{name}=={pin}" for name, pin in PINNED.items() if installed(name) != pin]


def check(arrays: Mapping[str, np.ndarray], path: Path) -> int:
    """Compare a rebuild with the file at `path`; return the exit status."""
    if not path.exists():
        print(f"{path.name} is not there to compare with; build it first, without --check", file=sys.stderr)
        return 1
    with np.load(path, allow_pickle=False) as bundled:
        found = differences(arrays, dict(bundled))
    for line in found:
        print(f"{path.name} is not what this script builds: {line}", file=sys.stderr)
    return 1 if found else 0


def main(arguments: list[str] | None = None) -> int:
    """Run the script; return the exit status."""
    parser = argparse.ArgumentParser(description="Build data/opencrf.npz from its pinned sources.")
    parser.add_argument("--check", action="store_true", help="compare a rebuild with the file instead of writing it")
    parser.add_argument("--output", type=Path, default=OUTPUT, help="the file (default: %(default)s)")
    options = parser.parse_args(arguments)
    if missing := missing_packages():
        print(f"install first: pip install --no-deps {' '.join(missing)}", file=sys.stderr)
        return 1
    arrays = build()
    if options.check:
        return check(arrays, options.output)
    write(arrays, options.output)
    print(f"{summary(arrays)}\n{options.output.name}: {options.output.stat().st_size / 1000:.0f} KB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
