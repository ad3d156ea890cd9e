"""The formats of a response, a reader and a writer each; a new one gets its entry in `FORMATS` and joins every test."""

import io
import json
import re
from collections.abc import Callable, Iterable
from dataclasses import fields
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crfbench.camera.luts import (
    END_TOLERANCE,
    decode_text,
    numbers,
    on_grid,
    read_csp,
    read_cube,
    read_spi1d,
    rows_of,
    scaled,
)
from crfbench.camera.passport import Passport
from crfbench.checks import check_choice, unique_names
from crfbench.curves import GRID, N_SAMPLES, Array, Direction, evaluate, resample
from crfbench.datasets import load_emor_basis
from crfbench.datasets.dorf import parse_dorf_text
from crfbench.errors import FormatError, InputError, MissingDataError
from crfbench.files import write_new
from crfbench.models.emor import EMoR


class Format(NamedTuple):
    """How a program stores a response.

    Where its reader does not say otherwise, it keeps red, green and blue, the direction is always inverse, curves are
    straight between its samples, and the rest is lost, such as the band.
    """

    suffix: str  # the end of its files' names, in small letters; without a dot before it, the whole name
    sign: bytes  # a pattern of what the beginning of a file shows, whatever its name; of several the first counts
    read: Callable[[bytes], Passport]  # raises `InputError` or `FormatError` for bytes of another kind
    write: Callable[[Passport], bytes] | None = None
    channels: tuple[int, ...] = ()  # how many curves it can hold; none: it is only read


_KIND = "crfbench response passport"
_VERSION = 1
_NAMES = tuple(field.name for field in fields(Passport))
# Which the first passports did not hold.
_LATER = {"warnings": (), **dict.fromkeys(("white_level", "matrix", "soft", "told", "vignetting"))}


def _write_json(passport: Passport) -> bytes:
    content = {"format": _KIND, "schema": _VERSION, **{name: getattr(passport, name) for name in _NAMES}}
    return json.dumps(content, default=np.ndarray.tolist, allow_nan=False).encode()


def _read_json(data: bytes) -> Passport:
    """Read the passport itself, version 1: everything, exactly; no entry may be missing, unknown or there twice."""
    try:
        content = json.loads(data, parse_constant=_refuse, object_pairs_hook=unique_names)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"it is not JSON as a passport holds ({str(error)[:80]})") from None
    if not isinstance(content, dict) or content.get("format") != _KIND:
        raise FormatError(f"it does not say that its format is {_KIND!r}; use a passport that crfbench wrote")
    if content.get("schema") != _VERSION:
        raise FormatError(f"its schema is {str(content.get('schema'))[:20]!r}; this crfbench reads {_VERSION}")
    values = {name: value for name, value in content.items() if name not in ("format", "schema")}
    if note := values.pop("note", None):  # as one warning was called
        values["warnings"] = [note]
    if odd := {**_LATER, **values}.keys() ^ set(_NAMES):
        raise FormatError(f"these entries are missing or unknown: {', '.join(sorted(odd))[:100]}")
    return Passport(**values)


def _refuse(constant: str) -> float:
    raise FormatError(f"it holds {constant}; use finite numbers")


_AXES: dict[Direction, tuple[str, str]] = {
    "inverse": ("brightness", "irradiance"),
    "forward": ("irradiance", "brightness"),
}
_CSV_ENDINGS = {1: ("",), 3: ("_r", "_g", "_b")}


def _head(direction: Direction, c: int) -> str:
    first, second = _AXES[direction]
    return ",".join([first, *(f"{second}{ending}" for ending in _CSV_ENDINGS[c])])


def _write_csv(passport: Passport) -> bytes:
    rows = np.column_stack([GRID, *passport.curves]).tolist()
    lines = [_head(passport.direction, len(passport.curves)), *(",".join(map(repr, row)) for row in rows)]
    return ("\n".join(lines) + "\n").encode()


def _read_csv(data: bytes) -> Passport:
    """Read a table below ``brightness,irradiance`` (inverse response) or ``irradiance,brightness`` (response).

    Three curves have ``_r``, ``_g`` and ``_b`` after the name of the second quantity; spaces and quotes about the names
    do no harm. Two or more rows, whose first column rises from 0 to 1. Keeps the direction and every digit.
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
    if (np.diff(x) <= 0).any() or max(abs(x[0]), abs(x[-1] - 1.0)) > END_TOLERANCE:
        raise FormatError(f"its first column runs from {x[0]:.4g} to {x[-1]:.4g}; let it rise strictly from 0 to 1")
    return Passport(heads[name], np.array([np.interp(GRID, x, y) for y in table.T[1:]]))


# The head as NumPy writes it, of plain real numbers. NumPy's own reader tries to make sense of damaged heads.
_HEAD = re.compile(
    rb"\x93NUMPY(?:\x01\x00..|[\x02\x03]\x00....)\{'descr': '(?P<kind>[<>|](?:f[248]|[iu][1248]))', "
    rb"'fortran_order': (?P<fortran>False|True), 'shape': \((?P<shape>[\d, ]{,40})\), \} *\n",
    re.DOTALL,
)


def _write_npy(passport: Passport) -> bytes:
    curves = passport.in_direction("inverse")
    return _save_array(curves if len(curves) > 1 else curves[0])


def _read_npy(data: bytes) -> Passport:
    """Read a NumPy file of samples on the grid, (1024,) for one curve or (3, 1024), to the last digit."""
    return Passport("inverse", _load_array(data))


def _save_array(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array, allow_pickle=False)
    return file.getvalue()


def _load_array(data: bytes) -> np.ndarray:
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


def _write_cube(passport: Passport) -> bytes:
    # On the grid, a single curve three times, to nine decimals.
    title = " ".join(passport.camera.replace('"', "'").split()) or "inverse response"
    columns = np.broadcast_to(passport.in_direction("inverse"), (3, N_SAMPLES)).T
    head = f'TITLE "{title}"\nLUT_1D_SIZE {N_SAMPLES}\nDOMAIN_MIN 0.0 0.0 0.0\nDOMAIN_MAX 1.0 1.0 1.0\n'
    return (head + "".join(f"{r:.9f} {g:.9f} {b:.9f}\n" for r, g, b in columns.tolist())).encode(errors="replace")


_LEVELS = 256
_EVEN: Array = np.linspace(0.0, 1.0, _LEVELS)
_SHAPES = [(_LEVELS, 1, 3), (_LEVELS, 1, 1), (_LEVELS, 3), (_LEVELS, 1), (_LEVELS,)]
_MATRIX = re.compile(r'opencv-matrix\b.*?\bdata\b["\s:>]*\[?([^\]<]*)', re.DOTALL)


def _write_opencv(passport: Passport) -> bytes:
    # Merging takes the logarithm, and irradiance 0 has none: it takes the first value above, as OpenCV's default does.
    samples = evaluate(passport.in_direction("inverse"), _EVEN).T
    samples = np.maximum(samples, np.where(samples > 0, samples, np.inf).min(axis=0))
    return _save_array(np.broadcast_to(samples, (_LEVELS, 3))[:, None, ::-1].astype(np.float32, order="C"))


def _read_opencv(data: bytes) -> Passport:
    """Read the response of OpenCV's HDR merging: float32, shape (256, 1, 3), blue, green, red, of any scale.

    ``cv2.createMergeDebevec().process(images, times, numpy.load(path))`` takes what is written as it is, and what
    ``cv2.createCalibrateDebevec()`` gives can be saved as it is (https://docs.opencv.org, module photo), by
    ``numpy.save``, by ``numpy.savetxt`` as rows of three, or by ``cv2.FileStorage``. An entry is the irradiance of an
    8-bit brightness; values below 0 are its logarithm, Debevec's g. The curve is let begin at 0.
    """
    return _from_black(_load_levels(data)[:, ::-1])


def _read_debevec(data: bytes) -> Passport:
    """Read Debevec and Malik's g, the logarithm of exposure at 256 brightnesses: an array or rows of text, red first.

    Debevec and Malik 1997, "Recovering high dynamic range radiance maps from photographs", doi:10.1145/258734.258884.
    g has values far below 0; an array of the same shape without them, as colour-hdri saves its responses
    (https://github.com/colour-science/colour-hdri), holds exposures themselves.
    """
    return _from_black(_load_levels(data))


def _load_levels(data: bytes) -> Array:
    """Read exposures of 256 brightnesses, (256, 1) or (256, 3), or their g, from an array, OpenCV's matrix or text."""
    if data.startswith(b"\x93NUMPY"):
        values = _load_array(data).astype(np.float64)
    elif matrix := _MATRIX.search(text := decode_text(data)):
        values = numbers([matrix.group(1).replace(",", " ").split()], "the matrix").reshape(-1)
        values = values.reshape(_LEVELS, 3) if values.size == 3 * _LEVELS else values
    else:
        values = numbers(rows_of(text.replace(",", " ")), "the table")
    if values.shape not in _SHAPES:
        raise FormatError(f"it has shape {values.shape}; use (256, 1, 3), (256, 3) or (256,)")
    g = values.reshape(_LEVELS, -1)
    return np.exp(g - g[-1]) if g.min() < -0.05 * g.max() else g


def _from_black(samples: Array) -> Passport:
    """Make the passport of irradiances of even brightnesses, (m, c); a solver's value for black gives way to 0."""
    return scaled(on_grid(np.vstack([np.zeros_like(samples[:1]), samples[1:]])))


def _read_pfstools(data: bytes) -> Passport:
    """Read the response file of pfstools (pfscalibration) and Luminance HDR, ``.m``, of matrices in Octave's text.

    What ``pfshdrcalibrate --save-response`` writes (https://pfstools.sourceforge.net): a matrix a channel (IR, IG, IB,
    or IY for luminance) with the columns log10 of irradiance, brightness from 0 up to any number, and irradiance of any
    scale; then the weights of the brightnesses. Irradiance 0 above black is that of a brightness never seen.
    """
    _, *parts = re.split(r"^# name:\s*(\w+)", decode_text(data), flags=re.MULTILINE)
    matrices = dict(zip(parts[::2], parts[1::2], strict=True))
    names = [name for name in ("IY", "IR", "IG", "IB") if name in matrices]
    if len(names) not in (1, 3):
        raise FormatError(f"it has the channels {', '.join(names) or 'none'}; use IR, IG and IB, or IY")
    tables = [numbers([row[1:] for row in rows_of(matrices[name])], f"the matrix {name}") for name in names]
    shape, levels = tables[0].shape, np.arange(len(tables[0]), dtype=np.float64)
    if shape[1] != 2 or not all(each.shape == shape and (each[:, 0] == levels).all() for each in tables):
        raise FormatError(
            f"its matrices begin with shape ({shape[0]}, {shape[1] + 1}); use 3 columns, the second from 0 up"
        )
    seen = [each[(each[:, 1] > 0) | (levels == 0)] for each in tables]
    return _from_black(np.array([np.interp(levels, each[:, 0], each[:, 1], right=0.0) for each in seen]).T)


def _read_radiance(data: bytes) -> Passport:
    """Read the response file of hdrgen, for Radiance, ``.rsp``: a polynomial a channel, brightness to irradiance.

    Ward's hdrgen (https://www.anyhere.com) by Mitsunaga and Nayar 1999, doi:10.1109/CVPR.1999.786966: a line a channel,
    red first, of the degree and the coefficients, that of the highest power first; brightness from 0 to 1.
    """
    lines = [numbers([row], "a line")[0] for row in rows_of(decode_text(data))]
    if len(lines) not in (1, 3) or any(line[0] != len(line) - 2 for line in lines):
        raise FormatError(f"it has {len(lines)} lines; use one or three of a degree n and n + 1 coefficients")
    return _from_black(np.array([np.polyval(line[1:], GRID) for line in lines]).T)


def _read_respfcns(data: bytes) -> Passport:
    """Read the ``jpg2raw_respFcns.txt`` of in-camera models: a line of four numbers, 256 rows of red, green and blue.

    Kim et al. 2012, "A new in-camera imaging model for color computer vision and its application",
    doi:10.1109/TPAMI.2012.58, as ReversiblePipeline keeps them (https://github.com/mbuckler/ReversiblePipeline). A
    ``raw2jpg_respFcns.txt`` looks the same and holds responses: cameras brighten, so those lie above the diagonal.
    """
    first, *rows = rows_of(decode_text(data)) or [[]]
    table = numbers(rows, "the table")
    if len(first) != 4 or table.shape != (_LEVELS, 3):
        raise FormatError(f"it has shape {table.shape} below a line of {len(first)}; use (256, 3) below one of 4")
    return scaled(on_grid(table), "forward" if table.mean() > 0.5 * table[-1].mean() else "inverse")


_DORF_ENDINGS = {1: ("",), 3: ("Red", "Green", "Blue")}


def _write_dorf(passport: Passport) -> bytes:
    name = " ".join(passport.camera.split()) or "camera"
    curves = passport.in_direction("forward")
    x = " ".join(map(repr, GRID.tolist()))
    records = [
        f"{name}{ending}\ngraph lin-lin\nI =\n{x}\nB =\n{' '.join(map(repr, curve))}\n"
        for ending, curve in zip(_DORF_ENDINGS[len(curves)], curves.tolist(), strict=True)
    ]
    return "".join(records).encode("latin-1", "replace")


def _read_dorf(data: bytes) -> Passport:
    """Read records of the DoRF text, one or three, red first, as `crfbench.datasets.dorf.parse_dorf_text` does.

    Irradiance and brightness may have any unit. Keeps the camera's name and every digit; always forward.
    """
    names, irradiance, brightness = parse_dorf_text(data.decode("latin-1"))
    curves = np.array([resample(x, y) for x, y in zip(irradiance, brightness, strict=True)])
    ending = _DORF_ENDINGS.get(len(curves), ("",))[0]
    return Passport("forward", curves, camera=names[0].removesuffix(ending))


_LETTERS = "abcde"
_NUMBER = r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)"


def _write_hugin(passport: Passport) -> bytes:
    coefficients = _emor().fit(passport.in_direction("forward"))[0]
    words = [f"R{letter}{value:.9g}" for letter, value in zip(_LETTERS, coefficients.tolist(), strict=True)]
    return f"# EMoR response: put these five into the image lines of a project\ni {' '.join(words)}\n".encode()


def _read_hugin(data: bytes) -> Passport:
    """Read Hugin's five EMoR coefficients, ``Ra`` to ``Re``, from the first image line of a project (``.pto``).

    Hugin's response is f0 + Ra h1 + ... + Re h5, of the published forward basis (no logarithm; irradiance and
    brightness from 0 to 1), here the nearest monotone curve to it. That basis is not bundled: ``crfbench fetch emor``
    gets it. What is written is an image line with the five alone: put them into the image lines of your project.

    Keeps one curve, as near as five components come; always forward.
    """
    line = next((line for line in decode_text(data).splitlines() if line.startswith("i ")), "")
    found = [re.findall(rf"(?<= )R{letter}{_NUMBER}(?= |$)", line) for letter in _LETTERS]
    if not all(len(values) == 1 for values in found):
        raise FormatError("it has no image line with Ra, Rb, Rc, Rd and Re; use a project of Hugin")
    coefficients = numbers([[values[0] for values in found]], "the image line")
    return Passport("forward", _emor().nearest_valid(coefficients[0]), model="EMoR", params=coefficients)


def _emor() -> EMoR:
    mean, components = load_emor_basis("forward")
    return EMoR(mean, np.asarray(components), n_params=len(_LETTERS), direction="forward")


_LEAST_STEP = 1e-4  # six times what single precision, which DSO reads with, can tell at 255


def _write_pcalib(passport: Passport) -> bytes:
    ramp = _LEAST_STEP * np.arange(_LEVELS)
    values = np.maximum.accumulate(255.0 * evaluate(passport.in_direction("inverse")[0], _EVEN) - ramp) + ramp
    return (" ".join(f"{value:.6f}" for value in values) + "\n").encode()


def _read_pcalib(data: bytes) -> Passport:
    """Read the calibration ``pcalib.txt`` of the TUM monoVO data set and of DSO: one line of 256 or more values.

    Value i is the irradiance of brightness i, from 0 to 255 in 8 bits, here shifted and scaled to run from 0 to 1 as
    DSO does. Engel, Usenko and Cremers 2016, "A photometrically calibrated benchmark for monocular visual odometry",
    arXiv:1607.02555. DSO takes 256 values or more and refuses those that do not rise strictly, so each that is written
    is at least 0.0001 above the one before.

    Keeps one curve, to 4e-7 where it rises.
    """
    lines = decode_text(data).splitlines() or [""]
    values = numbers([lines[0].split()], "the first line")[0]
    if len(values) < _LEVELS or not (np.diff(values) > 0).all():
        raise FormatError(f"its first line has {len(values)} values; use {_LEVELS} or more that rise strictly")
    return Passport("inverse", resample(np.arange(len(values)), values))


def _shaped(shape: bytes) -> bytes:
    return rb"\A\x93NUMPY[^\n]{2,99}'shape': \(%s\)" % shape


_VALUE = rb"[-+.\deE]+"
_THREE = rb"[ \t]*%s(?:[ \t,]+%s){2}[ \t]*\r?\n" % (_VALUE, _VALUE)
_FOUR = _THREE.replace(b"{2}", b"{3}")
_OPENCV = _shaped(rb"256, 1, [13]") + rb"|opencv[-_](?:matrix|storage)|"
_ANY = (1, 3)
#: Every format by its name. Rows of text that begin below 0 hold logarithms, which are Debevec's.
FORMATS: dict[str, Format] = {
    "passport": Format(".json", rb'(?s)\A\s*\{.*"%s"' % _KIND.encode(), _read_json, _write_json, _ANY),
    "csv": Format(
        ".csv", rb'(?i)\A(?:\xef\xbb\xbf)?[\s"]*(?:brightness|irradiance)[\s"]*,', _read_csv, _write_csv, _ANY
    ),
    "npy": Format(".npy", _shaped(rb"(?:[13], )?1024,?"), _read_npy, _write_npy, _ANY),
    "opencv": Format(".opencv.npy", _OPENCV + rb"\A(?!\s*-)" + 2 * _THREE, _read_opencv, _write_opencv, _ANY),
    "dorf": Format(".dorf.txt", rb"(?m)^[ \t]*I[ \t]*=[ \t\r]*$", _read_dorf, _write_dorf, _ANY),
    "cube": Format(".cube", rb"(?im)^[ \t]*LUT_[13]D_SIZE\b", read_cube, _write_cube, _ANY),
    "hugin": Format(".pto", rb"(?m)^i (?:[^\n]* )?Ra", _read_hugin, _write_hugin, (1,)),
    "pcalib": Format("pcalib.txt", rb"\A\s*(?:%s[ \t]+){255}%s" % (_VALUE, _VALUE), _read_pcalib, _write_pcalib, (1,)),
    "debevec": Format(".g.npy", _shaped(rb"256,(?: [13])?") + rb"|\A(?=\s*-)" + 2 * _THREE, _read_debevec),
    "pfstools": Format(".m", rb"(?m)^# (?:Camera response curve|data layout: log10\(response\))", _read_pfstools),
    "radiance": Format(
        ".rsp", rb"\A(?:[ \t]*[1-9]\d?(?:[ \t]+%s){2,}[ \t]*(?:\r?\n|\Z)){1,3}\s*\Z" % _VALUE, _read_radiance
    ),
    "respfcns": Format("respfcns.txt", rb"\A" + _FOUR + 2 * _THREE, _read_respfcns),
    "spi1d": Format(".spi1d", rb"(?i)\A\s*Version\s+\d+\s+(?:From|Length|Components)\b", read_spi1d),
    "csp": Format(".csp", rb"\A(?:\xef\xbb\xbf)?\s*CSPLUTV100\b", read_csp),
}

_MOST_BYTES = 32 * 2**20
_HEAD_BYTES = 2**16


def write_response(passport: Passport, path: str | Path, to: str | None = None, overwrite: bool = False) -> None:
    """Write the response for another program.

    For "hugin" the published EMoR basis must have been fetched, else this is a `MissingDataError`.

    Parameters
    ----------
    passport : Passport
        Of as many curves as the format's `channels` say.
    path : path
    to : str, optional
        A name in `crfbench.camera.FORMATS` of a format that has `channels`; by default by the end of the file's name.
    overwrite : bool
    """
    written = {name: each.write for name, each in FORMATS.items() if each.write}
    name = _by_ending(path, written) if to is None else check_choice("to", to, written)
    if name is None:
        ends = ", ".join(FORMATS[each].suffix for each in written)
        raise InputError(f"the name {path} tells no format that is written; let it end in one of {ends}")
    channels = FORMATS[name].channels
    if (held := len(passport.curves)) not in channels:
        use = "passport.channel('green') or --channel green"
        raise InputError(f"this passport has {held} curves and the format {name!r} holds one curve; use {use}")
    write_new(path, written[name](passport), overwrite)


def read_response(path: str | Path, format: str | None = None) -> Passport:
    """Read a response that `write_response` or another program wrote.

    A path that leads nowhere is a `MissingDataError`, a file of another format a `FormatError`.

    Parameters
    ----------
    path : path
    format : str, optional
        A name in `crfbench.camera.FORMATS`; by default the content tells it, and the end of the file's name where the
        content fits several or none.

    Returns
    -------
    Passport
        What the format does not carry stays unknown; `warnings` say what had to be repaired.
    """
    if format is not None:
        check_choice("format", format, FORMATS)
    if not Path(path).is_file():
        raise MissingDataError(f"there is no file {path}; use one that holds a response")
    if Path(path).stat().st_size > _MOST_BYTES:
        raise FormatError(f"{path} has more than {_MOST_BYTES} bytes; a response has fewer")
    data = Path(path).read_bytes()
    fitting = [name for name, each in FORMATS.items() if re.search(each.sign, data[:_HEAD_BYTES])]
    name = format or _by_ending(path, fitting) or next(iter(fitting), None) or _by_ending(path, FORMATS)
    if name is None:
        raise FormatError(f"{path} is no response in a format that is known; use one of {', '.join(FORMATS)}")
    try:
        return decode(name, data)
    except FormatError as error:
        raise FormatError(f"{path}: {error}") from None


def decode(name: str, data: bytes) -> Passport:
    """Turn the content of a file of that format into a passport; `FormatError` for bytes that are not of the format."""
    try:
        with np.errstate(all="ignore"):  # what overflows is not finite, which Passport refuses
            return FORMATS[name].read(data)
    except (InputError, FormatError) as error:
        said = f"{said[:200]} ... {said[-90:]}" if len(said := str(error)) >= 300 else said
        raise FormatError(f"this is not a response in the format {name!r}: {said}") from None


def _by_ending(path: str | Path, names: Iterable[str]) -> str | None:
    """Return that of some formats whose suffix, the longest such one, the file's name has."""
    matching = [name for name in names if Path(path).name.lower().endswith(FORMATS[name].suffix)]
    return max(matching, key=lambda name: len(FORMATS[name].suffix), default=None)
