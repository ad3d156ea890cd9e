"""The formats of a response, a small class each; a new one gets its line in `FORMATS` and joins every test."""

import io
import json
import re
from abc import ABC, abstractmethod
from dataclasses import fields
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from crfbench.camera.passport import Passport
from crfbench.checks import check_choice
from crfbench.curves import GRID, N_SAMPLES, Array, Direction, evaluate, resample
from crfbench.datasets import load_emor_basis
from crfbench.datasets.dorf import parse_dorf_text
from crfbench.errors import FormatError, InputError, MissingDataError
from crfbench.files import write_new
from crfbench.models.emor import EMoR


class Format(ABC):
    """How a program stores a response."""

    suffix: ClassVar[str]  # the end of its files' names
    channels: ClassVar[tuple[int, ...]] = (1, 3)  # how many curves it can hold

    @staticmethod
    @abstractmethod
    def write(passport: Passport) -> bytes:
        """Return the content of a file."""

    @staticmethod
    @abstractmethod
    def read(data: bytes) -> Passport:
        """Read the content of a file; `InputError` or `FormatError` for bytes of another kind."""


_KIND = "crfbench response passport"
_VERSION = 1
_NAMES = tuple(field.name for field in fields(Passport))


class Json(Format):
    """The passport itself as JSON, version 1: carries everything, exactly."""

    suffix = ".json"

    @staticmethod
    def write(passport: Passport) -> bytes:
        """Write every field under its name; the bytes depend on the passport alone."""
        values = {name: getattr(passport, name) for name in _NAMES}
        return json.dumps(
            {"format": _KIND, "schema": _VERSION, **values}, default=np.ndarray.tolist, allow_nan=False
        ).encode()

    @staticmethod
    def read(data: bytes) -> Passport:
        """Read a passport; an entry that is missing, unknown or there twice is a `FormatError`."""
        content = _parse(data)
        if not isinstance(content, dict) or content.get("format") != _KIND:
            raise FormatError(f"it does not say that its format is {_KIND!r}; use a passport that crfbench wrote")
        if content.get("schema") != _VERSION:
            raise FormatError(f"its schema is {str(content.get('schema'))[:20]!r}; this crfbench reads {_VERSION}")
        values = {name: value for name, value in content.items() if name not in ("format", "schema")}
        if odd := {"white_level": None, **values}.keys() ^ set(_NAMES):  # which the first passports did not hold
            raise FormatError(f"these entries are missing or unknown: {', '.join(sorted(odd))[:100]}")
        return Passport(**values)


def _parse(data: bytes) -> object:
    try:
        return json.loads(data, parse_constant=_refuse, object_pairs_hook=_unique)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"it is not JSON ({str(error)[:80]})") from None


def _refuse(constant: str) -> float:
    raise FormatError(f"it holds {constant}; use finite numbers")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    # JSON allows a name twice and readers differ in which one they take.
    content = dict(pairs)
    if len(content) != len(pairs):
        raise FormatError("it has two entries of one name")
    return content


_AXES: dict[Direction, tuple[str, str]] = {
    "inverse": ("brightness", "irradiance"),
    "forward": ("irradiance", "brightness"),
}
_CSV_ENDINGS = {1: ("",), 3: ("_r", "_g", "_b")}
_END_TOLERANCE = 1e-6


class Csv(Format):
    """A table with a head: ``brightness,irradiance`` for an inverse response, ``irradiance,brightness`` for a response.

    Three curves have ``_r``, ``_g`` and ``_b`` after the name of the second quantity. Keeps direction and channels, to
    the last digit; loses the rest of the passport, such as the band.
    """

    suffix = ".csv"

    @staticmethod
    def write(passport: Passport) -> bytes:
        """Write 1024 rows below the head."""
        rows = np.column_stack([GRID, *passport.curves]).tolist()
        lines = [_head(passport.direction, len(passport.curves)), *(",".join(map(repr, row)) for row in rows)]
        return ("\n".join(lines) + "\n").encode()

    @staticmethod
    def read(data: bytes) -> Passport:
        """Read two or more rows whose first column rises from 0 to 1, or raise `FormatError`.

        Spaces and quotes about the names do no harm.
        """
        head, *lines = decode_text(data).strip().splitlines() or [""]
        heads = {_head(direction, c): direction for direction in _AXES for c in _CSV_ENDINGS}
        name = "".join(head.lower().replace('"', "").split())
        if name not in heads:
            raise FormatError(f"its head is {head[:60]!r}; use one of {'; '.join(heads)}")
        table = numbers([line.split(",") for line in lines if line.strip()], "the table")
        if table.shape[1] != name.count(",") + 1:
            raise FormatError(f"its rows have {table.shape[1]} values below a head of {name.count(',') + 1}")
        x = table[:, 0]
        if (np.diff(x) <= 0).any() or max(abs(x[0]), abs(x[-1] - 1.0)) > _END_TOLERANCE:
            raise FormatError(f"its first column runs from {x[0]:.4g} to {x[-1]:.4g}; let it rise strictly from 0 to 1")
        return Passport(heads[name], np.array([np.interp(GRID, x, y) for y in table.T[1:]]))


def _head(direction: Direction, c: int) -> str:
    first, second = _AXES[direction]
    return ",".join([first, *(f"{second}{ending}" for ending in _CSV_ENDINGS[c])])


# The head as NumPy writes it, of plain real numbers. NumPy's own reader tries to make sense of damaged heads.
_HEAD = re.compile(
    rb"\x93NUMPY(?:\x01\x00..|[\x02\x03]\x00....)\{'descr': '(?P<kind>[<>|](?:f[248]|[iu][1248]))', "
    rb"'fortran_order': (?P<fortran>False|True), 'shape': \((?P<shape>[\d, ]{,40})\), \} *\n",
    re.DOTALL,
)


class Npy(Format):
    """A NumPy file of float64: the inverse response, shape (1024,) for one curve and (3, 1024) for red, green, blue.

    Keeps the channels, to the last digit. The direction is always inverse; loses the rest, such as the band.
    """

    suffix = ".npy"

    @staticmethod
    def write(passport: Passport) -> bytes:
        """Write the inverse response."""
        curves = passport.in_direction("inverse")
        return save_array(curves if len(curves) > 1 else curves[0])

    @staticmethod
    def read(data: bytes) -> Passport:
        """Read curves; the samples must be on the grid already."""
        return Passport("inverse", load_array(data))


def save_array(array: np.ndarray) -> bytes:
    """Return the content of a ``.npy`` file."""
    file = io.BytesIO()
    np.save(file, array, allow_pickle=False)
    return file.getvalue()


def load_array(data: bytes) -> np.ndarray:
    """Read a ``.npy`` file of real numbers, in which nothing can run code; other bytes are a `FormatError`."""
    head = _HEAD.match(data)
    if not head:
        raise FormatError("it does not begin as a .npy file of real numbers does")
    shape = [int(size) for size in head["shape"].replace(b",", b" ").split()]
    try:
        flat = np.frombuffer(data, head["kind"].decode(), offset=head.end())
        return flat.reshape(shape, order="F" if head["fortran"] == b"True" else "C")
    except (ValueError, OverflowError) as error:
        raise FormatError(f"the .npy file is damaged ({str(error)[:80]})") from None


_SHAPE = (256, 1, 3)


class OpenCV(Format):
    """The response of OpenCV's HDR merging: a NumPy file of float32, shape (256, 1, 3), blue, green, red.

    ``cv2.createMergeDebevec().process(images, times, numpy.load(path))`` takes it as it is, and what
    ``cv2.createCalibrateDebevec()`` gives can be saved as it is (https://docs.opencv.org, module photo). An entry is
    the irradiance of an 8-bit brightness up to a scale common to all, not its logarithm: the merging takes that itself.
    Irradiance 0 has none, so what is 0 takes the first value above it, as in OpenCV's own default response.

    Keeps the channels, a single curve three times. The direction is always inverse, and curves are straight between the
    256 samples; loses the rest, such as the band.
    """

    suffix = ".opencv.npy"

    @staticmethod
    def write(passport: Passport) -> bytes:
        """Write the inverse response at the 256 brightnesses."""
        samples = evaluate(passport.in_direction("inverse"), np.linspace(0.0, 1.0, _SHAPE[0])).astype(np.float32)
        least = np.where(samples > 0, samples, np.float32(np.inf)).min(axis=1, keepdims=True)
        blue_first = np.broadcast_to(np.maximum(samples, least)[::-1], (3, _SHAPE[0]))
        return save_array(np.ascontiguousarray(blue_first.T[:, None, :]))

    @staticmethod
    def read(data: bytes) -> Passport:
        """Read a response of any scale, and let it begin at 0; anything else is a `FormatError`."""
        response = load_array(data).astype(np.float64)
        if response.shape != _SHAPE or not (response > 0).all():
            raise FormatError(f"it has shape {response.shape}; use {_SHAPE} and values above 0")
        samples = response[:, 0, ::-1] / response[-1, 0, ::-1]
        samples[0] = 0.0
        return Passport("inverse", merged(on_grid(samples)))


_DORF_ENDINGS = {1: ("",), 3: ("Red", "Green", "Blue")}
_LABEL = "graph lin-lin"


class DorfText(Format):
    """Records of the DoRF text, six lines a curve, as `crfbench.datasets.dorf.parse_dorf_text` reads them.

    Keeps the camera's name, the channels (a record each, named Red, Green, Blue) and every digit. The direction is
    always forward; loses the rest, such as the band.
    """

    suffix = ".dorf.txt"

    @staticmethod
    def write(passport: Passport) -> bytes:
        """Write the response; letters outside Latin-1 become question marks."""
        name = " ".join(passport.camera.split()) or "camera"
        curves = passport.in_direction("forward")
        records = zip(_DORF_ENDINGS[len(curves)], curves.tolist(), strict=True)
        lines = [line for ending, curve in records for line in _record(name + ending, curve)]
        return ("\n".join(lines) + "\n").encode("latin-1", "replace")

    @staticmethod
    def read(data: bytes) -> Passport:
        """Read one record, or three, red first; irradiance and brightness may have any unit."""
        names, irradiance, brightness = parse_dorf_text(data.decode("latin-1"))
        curves = np.array([resample(x, y) for x, y in zip(irradiance, brightness, strict=True)])
        ending = _DORF_ENDINGS.get(len(curves), ("",))[0]
        return Passport("forward", curves, camera=names[0].removesuffix(ending))


def _record(name: str, curve: list[float]) -> tuple[str, ...]:
    return name, _LABEL, "I =", " ".join(map(repr, GRID.tolist())), "B =", " ".join(map(repr, curve))


_SIZE = re.compile(r"^LUT_1D_SIZE[ \t]+(\d{1,5})[ \t]*$", re.MULTILINE)
_TITLE = re.compile(r'^TITLE[ \t]+"([^"]*)"[ \t]*$', re.MULTILINE)
_WORD = re.compile(r"[A-Z#]")
_DOMAIN = re.compile(r"^DOMAIN_(MIN|MAX)[ \t]+(.*)$", re.MULTILINE)


class Cube(Format):
    """A one-dimensional lookup table in Adobe's (IRIDAS) cube format: applied to an image, it makes it linear.

    Cube LUT Specification 1.0, Adobe Systems 2013. Keeps the channels, red first, a single curve three times, to nine
    decimals, and the camera as its title. The direction is always inverse; loses the rest, such as the band.
    """

    suffix = ".cube"

    @staticmethod
    def write(passport: Passport) -> bytes:
        """Write the inverse response on its grid."""
        title = " ".join(passport.camera.replace('"', "'").split()) or "inverse response"
        columns = np.broadcast_to(passport.in_direction("inverse"), (3, N_SAMPLES)).T
        head = [f'TITLE "{title}"', f"LUT_1D_SIZE {N_SAMPLES}", "DOMAIN_MIN 0.0 0.0 0.0", "DOMAIN_MAX 1.0 1.0 1.0"]
        rows = [f"{r:.9f} {g:.9f} {b:.9f}" for r, g, b in columns.tolist()]
        return ("\n".join(head + rows) + "\n").encode()

    @staticmethod
    def read(data: bytes) -> Passport:
        """Read a table of any size over the domain from 0 to 1; anything else is a `FormatError`."""
        text = "\n".join(decode_text(data).splitlines())
        size, title = _SIZE.findall(text), _TITLE.search(text)
        if len(size) != 1:
            raise FormatError("it has no single line LUT_1D_SIZE; use a one-dimensional table")
        _check_domain(text)
        rows = [line.split() for line in text.splitlines() if line.strip() and not _WORD.match(line.strip())]
        table = numbers(rows, "the table")
        if table.shape != (int(size[0]), 3):
            raise FormatError(f"its table has shape {table.shape}; its head says ({size[0]}, 3)")
        return Passport("inverse", merged(on_grid(table)), camera=title.group(1) if title else "")


def _check_domain(text: str) -> None:
    for end, words in _DOMAIN.findall(text):
        if (numbers([words.split()], f"DOMAIN_{end}") != (end == "MAX")).any():
            raise FormatError(f"its domain has the {end} {words[:40]!r}; use one from 0 to 1")


_LETTERS = "abcde"
_NUMBER = r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)"


class Hugin(Format):
    """Hugin's five EMoR coefficients, ``Ra`` to ``Re`` of an image line of its project files (``.pto``).

    Hugin's response is f0 + Ra h1 + ... + Re h5, of the published forward basis (no logarithm; irradiance and
    brightness from 0 to 1), made monotone. That basis is not bundled: ``crfbench fetch emor`` gets it. What is written
    is an image line with the five alone: put them into the image lines of your project. Projects are read as they are,
    the first image.

    Keeps one curve, as near as five components come. The direction is always forward; loses the rest, such as the band.
    """

    suffix = ".pto"
    channels = (1,)

    @staticmethod
    def write(passport: Passport) -> bytes:
        """Write the coefficients with the least MSE to the response."""
        coefficients = _model().fit(single(passport, "Hugin").in_direction("forward"))[0]
        words = [f"R{letter}{value:.9g}" for letter, value in zip(_LETTERS, coefficients.tolist(), strict=True)]
        return f"# EMoR response: put these five into the image lines of a project\ni {' '.join(words)}\n".encode()

    @staticmethod
    def read(data: bytes) -> Passport:
        """Read the first image line's coefficients; the curve is the nearest monotone one to what they give."""
        coefficients = _coefficients(decode_text(data))
        model = _model()
        return Passport("forward", model.nearest_valid(coefficients), model="EMoR", params=coefficients[None])


def _coefficients(text: str) -> Array:
    line = next((line for line in text.splitlines() if line.startswith("i ")), "")
    found = [re.findall(rf"(?<= )R{letter}{_NUMBER}(?= |$)", line) for letter in _LETTERS]
    if not all(len(values) == 1 for values in found):
        raise FormatError("it has no image line with Ra, Rb, Rc, Rd and Re; use a project of Hugin")
    return numbers([[values[0] for values in found]], "the image line")[0]


def _model() -> EMoR:
    mean, components = load_emor_basis("forward")
    return EMoR(mean, np.asarray(components), n_params=len(_LETTERS), direction="forward")


_LEVELS = 256
_LEAST_STEP = 1e-4  # six times what single precision, which DSO reads with, can tell at 255


class PCalib(Format):
    """The photometric calibration ``pcalib.txt`` of the TUM monoVO data set and of DSO: one line of 256 values.

    Value i is the irradiance of 8-bit brightness i, from 0 to 255. Engel, Usenko and Cremers 2016, "A photometrically
    calibrated benchmark for monocular visual odometry", arXiv:1607.02555. DSO refuses values that do not rise strictly,
    so each is at least 0.0001 above the one before.

    Keeps one curve, to 4e-7 where it rises. The direction is always inverse, and curves are straight between the 256
    samples; loses the rest, such as the band.
    """

    suffix = "pcalib.txt"
    channels = (1,)

    @staticmethod
    def write(passport: Passport) -> bytes:
        """Write the inverse response at the 256 brightnesses."""
        curve = single(passport, "pcalib.txt").in_direction("inverse")[0]
        ramp = _LEAST_STEP * np.arange(_LEVELS)
        values = np.maximum.accumulate(255.0 * evaluate(curve, np.linspace(0.0, 1.0, _LEVELS)) - ramp) + ramp
        return (" ".join(f"{value:.6f}" for value in values) + "\n").encode()

    @staticmethod
    def read(data: bytes) -> Passport:
        """Read the first line, shifted and scaled to run from 0 to 1 as DSO does, or raise `FormatError`."""
        lines = decode_text(data).splitlines() or [""]
        values = numbers([lines[0].split()], "the first line")[0]
        if len(values) != _LEVELS or not (np.diff(values) > 0).all():
            raise FormatError(f"its first line has {len(values)} values; use {_LEVELS} that rise strictly")
        return Passport("inverse", on_grid(((values - values[0]) / (values[-1] - values[0]))[:, None]))


def decode_text(data: bytes) -> str:
    """Decode UTF-8, with or without a byte order mark; other bytes are a `FormatError`."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FormatError(f"it is not UTF-8 text ({error.reason} at byte {error.start})") from None


def numbers(rows: list[list[str]], where: str) -> Array:
    """Turn rows of words, all of one length, into finite numbers, shape (rows, words), or raise `FormatError`."""
    lengths = {len(row) for row in rows}
    if len(lengths) != 1:
        raise FormatError(f"{where} has rows of {sorted(lengths) or 'no'} values; use rows of one length")
    try:
        values = np.array(rows, dtype=np.float64)
    except ValueError as error:
        raise FormatError(f"{where} holds something that is not a number: {str(error)[:80]}") from None
    if not np.isfinite(values).all():
        raise FormatError(f"{where} holds NaN or infinite values; use finite numbers")
    return values


def on_grid(samples: Array) -> Array:
    """Bring two or more even samples of [0, 1], shape (m, c), onto the grid, (c, 1024); one is a `FormatError`."""
    if len(samples) < 2:
        raise FormatError(f"it has {len(samples)} samples; use two or more")
    x = np.linspace(0.0, 1.0, len(samples))
    return np.array([np.interp(GRID, x, column) for column in samples.T])


def merged(curves: Array) -> Array:
    """Return one curve for three equal ones, which is how formats of three columns hold one."""
    return curves[:1] if (curves == curves[:1]).all() else curves


def single(passport: Passport, name: str) -> Passport:
    """Return the passport if it has one curve."""
    if len(passport.curves) != 1:
        raise InputError(f"{name} holds one curve and this passport has 3; use passport.channel('green'), for example")
    return passport


#: Every format by its name.
FORMATS: dict[str, type[Format]] = {
    "passport": Json,
    "csv": Csv,
    "npy": Npy,
    "opencv": OpenCV,
    "dorf": DorfText,
    "cube": Cube,
    "hugin": Hugin,
    "pcalib": PCalib,
}

# A passport of 3 curves with its band takes 0.2 MB, a project file of Hugin little more.
_MOST_BYTES = 32 * 2**20


def write_response(passport: Passport, path: str | Path, format: str | None = None, overwrite: bool = False) -> None:
    """Write the response for another program.

    For "hugin" the published EMoR basis must have been fetched, else this is a `MissingDataError`.

    Parameters
    ----------
    passport : Passport
        Of one curve, where the format holds no more.
    path : path
    format : str, optional
        A name in `crfbench.camera.FORMATS`; by default that of the end of the file's name.
    overwrite : bool
    """
    write_new(path, FORMATS[_format(path, format)].write(passport), overwrite)


def read_response(path: str | Path, format: str | None = None) -> Passport:
    """Read a response that `write_response` or another program wrote.

    A path that leads nowhere is a `MissingDataError`, a file of another format a `FormatError`.

    Parameters
    ----------
    path : path
    format : str, optional
        A name in `crfbench.camera.FORMATS`; by default that of the end of the file's name.

    Returns
    -------
    Passport
        What the format does not carry stays unknown.
    """
    name = _format(path, format)
    if not Path(path).is_file():
        raise MissingDataError(f"there is no file {path}; use one that holds a response")
    if Path(path).stat().st_size > _MOST_BYTES:
        raise FormatError(f"{path} has more than {_MOST_BYTES} bytes; a response has fewer")
    try:
        return decode(name, Path(path).read_bytes())
    except FormatError as error:
        raise FormatError(f"{path}: {error}") from None


def decode(name: str, data: bytes) -> Passport:
    """Turn the content of a file of that format into a passport; `FormatError` for bytes that are not of the format."""
    try:
        with np.errstate(all="ignore"):  # what overflows is not finite, which Passport refuses
            return FORMATS[name].read(data)
    except (InputError, FormatError) as error:
        raise FormatError(f"this is not a response in the format {name!r}: {error}") from None


def _format(path: str | Path, name: str | None) -> str:
    """Choose the format; of several whose suffix the file's name has, that of the longest."""
    if name is not None:
        return check_choice("format", name, FORMATS)
    ends = {key: each.suffix for key, each in FORMATS.items()}
    matching = [key for key, suffix in ends.items() if Path(path).name.lower().endswith(suffix)]
    if not matching:
        raise InputError(f"the name {path} tells no format; let it end in one of {', '.join(ends.values())}")
    return max(matching, key=lambda key: len(ends[key]))
