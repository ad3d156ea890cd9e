"""Which files are one photograph, in which order they come, how they were exposed, and the series that they make.

Names and headers tell nearly all; beside `read_planned`, only the search for copies and the guess of white read more.
"""

import csv
import filecmp
import os
import re
import unicodedata
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from crfbench.camera.luts import decode_text
from crfbench.camera.reading import IMAGE_SUFFIXES, IMAGES, RAW_SUFFIXES, Exif, read_exif, top_level
from crfbench.camera.worker import WORKER
from crfbench.checks import as_numbers, counted
from crfbench.curves import Array
from crfbench.errors import FormatError, InputError

Source = str | Path | Iterable[str | Path]
Read = TypeVar("Read")
Exposures = str | Path | Sequence[float | str] | ArrayLike | None
#: Files that were left out, and why each, in one sentence.
Problems = dict[Path, str]

# Pixel phones name the two files of one photograph X.RAW-01.COVER.jpg and X.RAW-02.ORIGINAL.dng.
_PIXEL_PART = re.compile(r"\.raw-\d+(\.mp)?\.(cover|original)$")
# Not -2, which tells the photographs of a series apart.
_EDITED = re.compile(r"[-_ ]+\(?(edit(ed)?\d*|enhanced[-\w]*|bearbeitet|copy)\)?$|~2$|(?<=^img_)e(?=\d+$)")
_UNIT = r"(milli|m|micro|[uµμ])?s(?:ecs?|econds?)?"
_PER_SECOND = {"": 1, "m": 1000, "milli": 1000}  # else microseconds
_NUMBER = r"(\d*\.?\d+(?:e[-+]?\d{1,2})?)"
# 1_60s and 1-60 s; 0.5s, exp4ms and 1/60 sec.
_TIME = re.compile(
    rf"(?:(?<![0-9a-z.])|(?<![a-z])(?:exp(?:osure)?|shutter|e?t))"
    rf"(?:(1)[-_](\d+) ?(?=s)|{_NUMBER}(?:/{_NUMBER})? ?){_UNIT}(?![0-9a-z])"
)
_EV = re.compile(r"(?<![a-z])ev[_ ]?([-+]?\d{1,2}(?:\.\d+)?)(?!\d)|(?<![\d.])([-+]?\d{1,2}(?:\.\d+)?)ev(?![a-z])")
# What names the column of times in a list, the surest word first, and where a comment begins: not in "wall #1.png".
_HEADS = ("expo.*time", "expo(?!.*(?:bias|comp|ind|mode|prog|val))", "shutter", "(?<!date)time(?!stamp)", "sec")
_COMMENT = re.compile(r"^[ \t]*#.*|[ \t]#(?!\S*\.[a-zA-Z]).*", re.MULTILINE)


@dataclass(frozen=True)
class Pair:
    """One photograph: its name, its JPEG (or PNG, TIFF, HEIC) and its RAW file, None where there is none.

    A RAW file alone is both, as it holds the preview that its camera developed.
    """

    name: str
    jpeg: Path
    raw: Path | None = None


@dataclass(frozen=True)
class Plan:
    """The photographs of one camera in order, and what is known of them before any pixel is read."""

    pairs: list[Pair]
    exifs: list[Exif]
    times: Array  # of exposure, in seconds where EXIF tells them; NaN where unknown
    stops: Array  # relative to the first one that is known; NaN where unknown
    problems: Problems
    notes: list[str]  # what is assumed, in sentences
    white_level: int | None = None  # of images of 16 bits, where it is not 65535

    def without(self, problems: Problems) -> "Plan":
        """Return the plan without some photographs, and why."""
        keep = [i for i, pair in enumerate(self.pairs) if not {pair.jpeg, pair.raw} & problems.keys()]
        pairs, exifs = [self.pairs[i] for i in keep], [self.exifs[i] for i in keep]
        times, stops = self.times[keep], _relative(self.stops[keep])
        return replace(self, pairs=pairs, exifs=exifs, times=times, stops=stops, problems=self.problems | problems)

    def table(self) -> str:
        """Return a line a photograph: its files, exposure time and, where it is known, stops."""
        files = [[path.name for path in dict.fromkeys((pair.jpeg, pair.raw)) if path] for pair in self.pairs]
        names = [" + ".join(each) for each in files]
        if len(set(names)) < len(names):
            names = [pair.name for pair in self.pairs]
        rows = zip(names, map(_as_text, self.times.tolist()), self.stops.tolist(), strict=True)
        width = max(map(len, names), default=0)
        return "\n".join(
            f"{name:{width}}  {time:>9}" + (f"  {stop:+6.2f} stops" if np.isfinite(stop) else "")
            for name, time, stop in rows
        )


def pair_photographs(source: Source) -> tuple[list[Pair], Problems]:
    """Pair RAW files with JPEGs (or other images) of the same name.

    Upper and lower case are the same, and so are the two names that Pixel phones give. Where a name occurs in several
    folders, partners lie in one. Of several images beside a RAW file the only JPEG is its partner, and without any its
    own preview is. Where there is no RAW file at all, every image stands alone. Edited copies, by their names, are left
    out.

    Parameters
    ----------
    source : path or iterable of path
        Folders, of which everything else than photographs is passed over, and files.

    Returns
    -------
    pairs : list of Pair
        Those of a folder in natural order (img9 before img10), files as given. Their names are as short as tells them
        apart: without the extension, with it, or with folders before it.
    problems : dict of Path to str
        Files that are left out, and why.
    """
    groups: dict[str, list[Path]] = defaultdict(list)
    problems: Problems = {}
    for path in list_photographs(source):
        if path.suffix.lower() in IMAGE_SUFFIXES | RAW_SUFFIXES:
            groups[_key(path)].append(path)
        else:
            problems[path] = _unknown_kind(path)
    for key in list(groups):
        original = _EDITED.sub("", key)
        if original != key and original in groups:
            name = groups[original][0].name
            problems |= {path: f"{path.name} is an edited copy of {name} by its name" for path in groups.pop(key)}
    if any(_is_raw(path) for group in groups.values() for path in group):
        found = [_pair(paths) for group in groups.values() for paths in _by_folder(group)]
    else:
        found = [Pair("", path) for group in groups.values() for path in group]
    pairs = [each for each in found if isinstance(each, Pair)]
    for each in found:
        problems |= {} if isinstance(each, Pair) else each
    names = _names([pair.jpeg for pair in pairs])
    return [replace(pair, name=name) for pair, name in zip(pairs, names, strict=True)], problems


def list_photographs(source: Source) -> list[Path]:
    """Return the files that are given, and those of folders that are photographs by their extension."""
    files: list[Path] = []
    for path in map(Path, [source] if isinstance(source, str | Path) else source):
        if path.is_dir():
            known = (inner for inner in path.iterdir() if inner.suffix.lower() in IMAGE_SUFFIXES | RAW_SUFFIXES)
            shown = (inner for inner in known if inner.is_file() and not inner.name.startswith("."))
            files += sorted(shown, key=_natural)
        else:
            files.append(path)
    return list(dict.fromkeys(files))


def _is_raw(path: Path) -> bool:
    return path.suffix.lower() in RAW_SUFFIXES


def _folded(name: str) -> str:
    # File systems differ in how they write é; the names of a pair must still be the same.
    return unicodedata.normalize("NFC", name).casefold()


def _key(path: Path) -> str:
    return _PIXEL_PART.sub("", _folded(path.stem))


def _natural(path: Path) -> tuple[list[str | int], str]:
    parts = re.split(r"([0-9]+)", _folded(path.name))
    return [int(part) if i % 2 else part for i, part in enumerate(parts)], path.name


def _names(paths: Sequence[Path]) -> list[str]:
    names = [unicodedata.normalize("NFC", path.stem) for path in paths]
    for length in range(1, max((len(path.parts) for path in paths), default=0) + 1):
        counts = Counter(names)
        longer = ["/".join(path.parts[-length:]) for path in paths]
        names = [name if counts[name] == 1 else long for name, long in zip(names, longer, strict=True)]
    return names


def _by_folder(paths: list[Path]) -> Iterable[list[Path]]:
    """Divide files of one name by their folders, unless they are one RAW file and one image."""
    folders: dict[Path, list[Path]] = defaultdict(list)
    for path in paths:
        folders[path.parent].append(path)
    return [paths] if len(paths) == 2 and _is_raw(paths[0]) != _is_raw(paths[1]) else folders.values()


def _pair(paths: list[Path]) -> Pair | Problems:
    raws = [path for path in paths if _is_raw(path)]
    images = [path for path in paths if not _is_raw(path)]
    jpegs = [path for path in images if path.suffix.lower() in (".jpg", ".jpeg", ".jpe")]
    if len(raws) == 1 and 1 in (len(images), len(jpegs)):
        return Pair("", (images if len(images) == 1 else jpegs)[0], raws[0])
    if len(raws) > 1 or len(images) > 1:
        files = ", ".join(sorted(path.name for path in paths))
        return {path: f"{path.name} has more than one partner among {files}" for path in paths}
    if raws:
        return Pair("", raws[0], raws[0])
    return {path: f"{path.name} has no RAW file of the same name" for path in paths}


def plan_photographs(
    source: Source, exposures: Exposures = None, paired: bool = True, white_level: int | None = None
) -> Plan:
    """Put photographs in order and find their exposures, and the white level of those of 16 bits, if none is given.

    An ISO speed or f-number that files do not tell is taken as constant, if all that tell it agree. Where no file tells
    a time but every name does (or that of its folder), or each an EV, the names count: as in ``a_1_60s.png``,
    ``b-1-60sec.png``, ``4ms/a.png``, ``a 0.5s.tif`` and ``scene_EV-2.png``. Of several camera models the one with most
    photographs is kept.

    `exposures` are times above 0, one a photograph in their order: numbers or texts such as "1/60" and "4 ms", or one
    text of them with commas. "names": those in the names, ``1_60.jpg`` and ``EV-2`` among them. Or a file of times, or
    of lines with a name and its time (1/time if it is called ``list.txt``, as OpenCV's): the last word, or the column
    that a header such as ``exposure_ms`` tells. ``#`` begins a comment; where ``;`` or tabs divide, decimals may have
    commas. By default EXIF's. Unless `paired`, RAW files are passed over.
    """
    given = [source] if isinstance(source, str | Path) else list(source)
    files = list_photographs(given)
    pairs, problems = pair_photographs(files if paired else [path for path in files if not _is_raw(path)])
    known = {*map(str, files), str(exposures)}  # a list of times may lie beside the photographs
    inner = [path for path in map(Path, given) if path.is_dir()]
    passed = [path for folder in inner for path in sorted(folder.iterdir()) if str(path) not in known]
    passed = [path for path in passed if path.name[0] != "."]
    others = ", ".join(path.name for path in (*passed, *problems))[:300]
    times, notes = _given_times(exposures, pairs, f"; left out are {others}" if others else "")
    exifs = []
    for pair in pairs:
        try:
            exifs.append(WORKER.run(read_exif, pair.jpeg, pair.raw))
        except FormatError as error:
            exifs.append(Exif())
            problems[pair.jpeg] = str(error)
    if times is None and not any(exif.exposure_time for exif in exifs):
        named = _named_times(pairs)
        if not np.isnan(named).any():
            times = named
            notes = ["no file tells its exposure time by EXIF; times, or their EV, are those in the names"]
    if times is None:
        times, stops = np.array([exif.exposure_time or np.nan for exif in exifs]), exposure_steps(exifs)
        notes = _constants(exifs) if np.isfinite(stops).any() else []
    else:
        stops = exposure_steps([Exif(time) for time in times.tolist()])
    if white_level is None:
        white_level, guess = find_white_level([pair.jpeg for pair in pairs])
        notes = notes + guess
    twice = (path for path, count in Counter(map(Path, given)).items() if count > 1)
    notes = [*notes, *(f"{path.name} is given more than once and counts once" for path in twice)]
    plan = Plan(pairs, exifs, times, stops, {}, notes, white_level).without(problems)
    # With so few, what lies in folders beside the photographs may be what was meant.
    unknown = {path: _unknown_kind(path) for path in passed if len(pairs) < 2}
    return plan.without(_other_cameras(plan) | _copies(plan) | unknown)


def exposure_steps(exifs: Sequence[Exif]) -> Array:
    """Return exposures in stops relative to the first photograph that tells its own.

    A stop more is twice the light: log2(t ISO / N^2) with exposure time t, f-number N. NaN where one is missing, but
    for an ISO speed or f-number on which all that tell it agree: it counts as constant.
    """
    stated = [(e.exposure_time or np.nan, e.iso or np.nan, e.f_number or np.nan) for e in exifs]
    time, *others = np.array(stated, dtype=np.float64).reshape(-1, 3).T
    iso, f_number = (each if len(np.unique(each[~np.isnan(each)])) > 1 else np.ones_like(time) for each in others)
    return _relative(np.log2(time * iso / f_number**2))


def _relative(stops: Array) -> Array:
    known = stops[np.isfinite(stops)]
    return np.asarray(stops - known[0]) if known.size else stops


def _constants(exifs: Sequence[Exif]) -> list[str]:
    """Say what some files do not tell and counts as constant."""
    kinds = {"ISO speed": [exif.iso for exif in exifs], "f-number": [exif.f_number for exif in exifs]}
    return [
        f"{values.count(None)} of {len(values)} files do not tell the {kind}, which is taken as constant"
        for kind, values in kinds.items()
        if None in values and len(set(values)) <= 2
    ]


def _other_cameras(plan: Plan) -> Problems:
    """Name the photographs of other cameras than the one with most."""
    models = Counter(exif.model for exif in plan.exifs if exif.model)
    most = max(models, key=models.__getitem__, default="")
    rest = f"and {models[most]} are by {most}; calibrate one camera"
    both = zip((pair.jpeg for pair in plan.pairs), plan.exifs, strict=True)
    return {p: f"{p.name} is by {exif.model}, {rest}" for p, exif in both if exif.model not in (None, most)}


def _copies(plan: Plan) -> Problems:
    """Name the photographs that are copies of earlier ones, byte for byte, and would count twice."""
    problems: Problems = {}
    alike: dict[tuple[int, str], list[Path]] = defaultdict(list)
    for path, stop in zip((pair.jpeg for pair in plan.pairs), plan.stops, strict=True):
        others = alike[path.stat().st_size, str(stop)]  # where other exposures are given, who knows
        if original := next((other for other in others if filecmp.cmp(other, path, shallow=False)), None):
            problems[path] = f"{path.name} is a copy of {original.name}"
        else:
            others.append(path)
    return problems


def _unknown_kind(path: Path) -> str:
    if path.is_dir():
        return f"{path.name} is a folder; give it by itself, or several cameras' folders with --each"
    return f"{path.name} is neither RAW nor {IMAGES} by its extension"


def _given_times(exposures: Exposures, pairs: Sequence[Pair], also: str = "") -> tuple[Array | None, list[str]]:
    """Return the times that are given, NaN where a list has none for a photograph, and how the list was read."""
    if exposures is None:
        return None, []
    if isinstance(exposures, str) and exposures == "names":
        return _named_times(pairs, bare=True), []
    if isinstance(exposures, str | Path):
        if os.path.isfile(exposures):  # where a long text is no name, Path has an error of the system
            return _listed_times(Path(exposures), pairs, also)
        exposures = str(exposures).split(";" if ";" in str(exposures) else ",")
    return as_times(exposures, [pair.jpeg.name for pair in pairs], also), []


def _named_times(pairs: Sequence[Pair], bare: bool = False) -> Array:
    """Return the seconds that names tell, of files or else, where there are several, of folders; NaN where none does.

    A whole name such as 1_60 may be a number in a row too, and counts only if `bare`. Where no name tells a time and
    each an EV, as scene_EV-2 and +1.0EV do, times are 2^EV.
    """
    stems = [re.sub(r"^(1[-_]\d+)$", r"\1s", pair.jpeg.stem) if bare else pair.jpeg.stem for pair in pairs]
    folders = [pair.jpeg.parent.name for pair in pairs]
    several = len(set(folders)) > 1
    both = zip(stems, folders, strict=True)
    times = [_named_time(stem) or (several and _named_time(folder)) or np.nan for stem, folder in both]
    values = [_EV.findall(stem.lower().replace(",", ".")) for stem in stems]
    if np.isnan(times).all() and all(len(found) == 1 for found in values):
        times = [2 ** float("".join(found)) for (found,) in values]
    return np.array(times)


def _named_time(name: str) -> float | None:
    found = _TIME.findall(name.lower().replace(",", "."))
    if len(found) != 1:
        return None
    one, under, number, divisor, unit = found[0]
    below = float(under or divisor or 1) * _PER_SECOND.get(unit, 1_000_000)
    return float(one or number) / below if below else None


def _listed_times(path: Path, pairs: Sequence[Pair], also: str) -> tuple[Array, list[str]]:
    names = [pair.jpeg.name for pair in pairs]
    lines = [line for line in _COMMENT.sub("", decode_text(path.read_bytes())).split("\n") if any(_cells(line))]
    rows = [_cells(line) for line in lines]
    if rows and not any(re.match(r"[-+.\d]", cell) or _folded(cell) in map(_folded, names) for cell in rows[0]):
        head = rows.pop(0)  # it names the columns
        if re.search("[;\t,]", lines[0]):
            rows = [_as_long(row, head, path) for row in rows]
            if not head[0]:  # the index that pandas writes
                head, rows = head[1:], [row[1:] for row in rows]
        column, per_second = _time_column(head if any(len(row) > 1 for row in rows) else [" ".join(head)])
    else:
        column, per_second, rows = -1, 1, [[cell for cell in row if cell] for row in rows]
    if len(rows) == 1 or all(len(row) == 1 for row in rows):
        return as_times([_seconds(cell, per_second) for row in rows for cell in row], names, also), []
    times: dict[str, float] = {}
    for row in rows:
        before = row[:column] or row[1:] or [""]
        try:
            time = _seconds(row[column] if len(row) >= -column else "", per_second)
        except InputError as error:
            raise InputError(f"{path.name}, line {' '.join(row)[:60]!r}: {error}") from None
        for name in (before[0], " ".join(before)):  # a name may hold spaces, and other columns may follow it
            parts = re.split(r"[/\\]", _folded(name))
            times |= {"/".join(parts[i:]): time for i in range(len(parts))}
    keys = ([pair.name] if "/" in pair.name else [pair.jpeg.name, pair.jpeg.stem] for pair in pairs)
    found = np.array([next((times[key] for key in map(_folded, each) if key in times), np.nan) for each in keys])
    if np.isnan(found).all():
        raise InputError(f"{path.name} names none of the photographs ({', '.join(names)}); use lines: name time{also}")
    inverse = path.name.lower() == "list.txt"
    read = "1/time, as in OpenCV's list.txt" if inverse else "time"
    return (1 / found if inverse else found), [f"{path.name} is read as lines of name and {read}"]


def _cells(line: str) -> list[str]:
    """Divide a line of a list at ; or tabs, else at commas, else at white space that no unit follows."""
    line = line.lstrip(" ").rstrip(" \t")[:100_000]  # more than that csv refuses
    if divider := next((mark for mark in ";\t," if mark in line), None):
        return [cell.strip() for cell in next(csv.reader([line], delimiter=divider, skipinitialspace=True))]
    return re.sub(rf"(?<=\d) +(?={_UNIT}(?:\s|$))", "", line).split()


def _as_long(row: list[str], head: list[str], path: Path) -> list[str]:
    """Return the cells of a row, as many as its header has, or refuse one with more."""
    if any(row[len(head) :]):
        cells = f"has {len(row)} cells below {len(head)} names; use as many, with decimal points"
        raise InputError(f"{path.name}, line {', '.join(row)[:60]!r} {cells}")
    return [*row, *[""] * (len(head) - len(row))][: len(head)]


def _time_column(head: list[str]) -> tuple[int, int]:
    """Return which column holds times, counted from the last, -1, and how many of its units a second has."""
    named = (i for word in _HEADS for i, cell in enumerate(head) if re.search(word, cell.lower()))
    column = next(named, len(head) - 1) - len(head)
    unit = re.search(rf"(?<![a-z]){_UNIT}(?![a-z])", head[column].lower())
    return column, _PER_SECOND.get(unit[1] or "", 1_000_000) if unit else 1


def as_times(exposures: Any, names: list[str], also: str = "") -> Array:
    """Return the exposure times of the photographs of those names; one is above 0 for each, or `InputError`."""
    if re.match("<U|object|str", str(getattr(exposures, "dtype", ""))):  # texts in an array or a column of pandas
        exposures = exposures.tolist()
    if isinstance(exposures, Sequence) and any(isinstance(each, str) for each in exposures):
        exposures = [_seconds(each) for each in exposures]
    times = as_numbers("exposures", exposures)
    if times.shape != (len(names),) or not (np.isfinite(times) & (times > 0)).all():
        photographs = f"{counted(len(names), 'photograph')} ({', '.join(names)})"
        raise InputError(f"exposures={times.tolist()} do not match {photographs}; use one time above 0 for each{also}")
    return times


def _seconds(text: Any, per_second: int = 1) -> float:
    said = re.sub(r"^1[-_](?=\d+$)", "1/", str(text).strip().lower().replace(",", "."))
    over, _, under = said.partition("/")
    with suppress(ValueError, ZeroDivisionError):
        time = (_named_time(said) or 0) if _TIME.fullmatch(said) else float(over) / float(under or 1) / per_second
        if 1e-30 < time < 1e30 and not re.search("^-|_", said):
            return time
    kinds = "times above 0 such as 0.5 or 1/60, a file of them that is there, exif, estimate or names"
    raise InputError(f"{str(text)[:40]!r} is not an exposure time; use {kinds}")


def _as_text(time: float) -> str:
    part = round(1 / time) if 0 < time < 0.5 else 1
    return "unknown" if np.isnan(time) else f"1/{part}" if part > 1 and abs(time * part - 1) < 0.01 else f"{time:.3g}"


def find_white_level(paths: Iterable[Path]) -> tuple[int | None, list[str]]:
    """Guess the white level of images with 16 bits a value from their greatest level, and say so.

    Where that is the greatest number of 8, 10, 12 or 14 bits, or up to a tenth less and held by a thousandth of all
    values of an image, as saturated ones are, it is white. Of several images, where none needs more than 14 bits, the
    greatest number of the bits that they need is. None means 65535.
    """
    tops = [(0, 0.0)]
    for path in paths:
        with suppress(FormatError):  # what is damaged is named where its pixels are needed
            tops.append(WORKER.run(top_level, path))
    (level, share), several = max(tops), len(tops) > 2  # beside the one that stands for none
    for full in (255, 1023, 4095, 16383):
        if level == full or (0.9 * full < level < full and share >= 1e-3):
            return level, [f"values of 16 bits end at {level}, which is taken as white; --white-level sets another"]
        if several and 0 < level < full:
            return full, [f"values of 16 bits end at {level}: white is taken as {full}; --white-level sets another"]
    unsure = f"values of 16 bits end at {level}; if white is lower than 65535, give --white-level"
    return None, [unsure] if 0 < level < 16383 else []


def read_planned(plan: Plan, read: Callable[[Path, int | None], Read]) -> tuple[list[Read], Plan]:
    """Read the images of a plan; what is a `FormatError`, not exposed as told or unlike most is left out and named."""
    images: dict[Path, Read] = {}
    problems: Problems = {}
    for pair, stop in zip(plan.pairs, plan.stops, strict=True):
        try:
            if np.isnan(stop):
                give = "give times (--exposures 1/60,1/30,...), or names that hold one, such as a_1_60s.jpg"
                raise FormatError(f"{pair.jpeg.name} does not tell its exposure; {give}")
            images[pair.jpeg] = WORKER.run(read, pair.jpeg, plan.white_level)
        except FormatError as error:
            problems[pair.jpeg] = str(error)
    kinds = {path: _kind(image) for path, image in images.items()}
    most = max(kinds.values(), key=list(kinds.values()).count, default="")
    odd = {path: kind for path, kind in kinds.items() if kind != most}
    problems |= {path: f"{path.name} is {kind}, and most are {most}; use one kind" for path, kind in odd.items()}
    kept = plan.without(problems)
    return [images[pair.jpeg] for pair in kept.pairs], kept


def _kind(image: Any) -> str:
    height, width, *colour = image.shape
    return f"{width} x {height} pixels of {8 * image.dtype.itemsize} bits, {'colour' if colour else 'grey'}"
