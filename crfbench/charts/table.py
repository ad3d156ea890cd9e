"""From photographs of a chart to the patch table, in the columns that the Middlebury table has."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from crfbench.charts.exif import Exif, exposure_steps, read_exif
from crfbench.charts.finding import find_chart
from crfbench.charts.measuring import PatchValues, measure_chart, orient
from crfbench.charts.pairs import Pair, Problem, check_sizes
from crfbench.charts.reading import Picture, read_image, read_raw
from crfbench.charts.safely import SafeReader
from crfbench.curves import Array
from crfbench.datasets.middlebury import N_PATCHES
from crfbench.errors import CrfbenchError

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = (
    *("photograph", "camera", "exposure_step", "confidence", "patch"),
    *(f"{kind}_{value}" for kind in ("jpeg", "raw") for value in ("r", "g", "b", "clipped", "spread")),
)


class Measured(NamedTuple):
    """One photograph: where its chart lies, how surely, what its patches are in the JPEG and in the RAW file.

    Parameters
    ----------
    corners : ndarray, shape (4, 2)
        In chart order, x and y as fractions of the image.
    confidence : float
    jpeg : PatchValues
    raw : PatchValues or None
    exif : Exif
    """

    corners: Array
    confidence: float
    jpeg: PatchValues
    raw: PatchValues | None
    exif: Exif


class ChartTable(NamedTuple):
    """The patch table, the photographs that it lacks, and what was measured in each of the others by its name.

    Parameters
    ----------
    patches : DataFrame
        With the columns `COLUMNS`, a row a patch.
    problems : list of Problem
    measured : dict of str to Measured
    """

    patches: "pd.DataFrame"
    problems: list[Problem]
    measured: dict[str, Measured]


def measure_photograph(jpeg: Path, raw: Path | None = None, corners: ArrayLike | None = None) -> Measured:
    """Measure the chart in one photograph; the files are decoded in this process, see `SafeReader`.

    Parameters
    ----------
    jpeg : path
        JPEG, PNG or TIFF file.
    raw : path, optional
        RAW file of the same photograph; the chart is sought in the JPEG and lies at the same place.
    corners : array_like, shape (4, 2), optional
        Corners marked by hand, clockwise, from any corner on; else the chart is sought.

    Returns
    -------
    Measured

    Raises
    ------
    FormatError
        If a file cannot be read, or the two differ in size.
    InputError
        If no chart is found, or the corners are not those of one.
    """
    picture, exif = read_image(jpeg), read_exif(jpeg)
    found = find_chart(picture.pixels) if corners is None else orient(picture.pixels, corners)
    values = measure_chart(picture.pixels, found.corners)
    return Measured(*found, values, _measure_raw(Path(jpeg), picture, raw, found.corners), exif)


def chart_table(pairs: Sequence[Pair], labels: Mapping[str, ArrayLike] | None = None) -> ChartTable:
    """Measure the chart in every photograph; one that cannot be measured is reported, the rest goes on.

    Parameters
    ----------
    pairs : sequence of Pair
        See `pair_photographs`; without a RAW file, its columns are NaN.
    labels : mapping of str to array_like, shape (4, 2), optional
        Corners by the name of the photograph (`load_labels`); in the other photographs the chart is sought.

    Returns
    -------
    ChartTable
        One row a photograph and patch (1 to 24). ``{jpeg,raw}_{r,g,b,clipped,spread}`` are the `PatchValues`,
        ``exposure_step`` is in stops relative to the first photograph that tells its exposure (`exposure_steps`),
        ``camera`` the model by EXIF.
    """
    import pandas as pd

    measured: dict[str, Measured] = {}
    problems = []
    with SafeReader() as reader:
        for pair in pairs:
            corners = (labels or {}).get(pair.name)
            try:
                measured[pair.name] = reader.run(measure_photograph, pair.jpeg, pair.raw, corners)
            except CrfbenchError as error:
                problems.append(Problem(pair.jpeg, str(error)))
    steps = exposure_steps([photograph.exif for photograph in measured.values()])
    parts = [_rows(name, *entry) for (name, *entry) in zip(measured, measured.values(), steps, strict=True)]
    frame = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=list(COLUMNS))
    return ChartTable(frame, problems, measured)


def _measure_raw(jpeg: Path, picture: Picture, raw: Path | None, corners: Array) -> PatchValues | None:
    if raw is None:
        return None
    pixels = read_raw(raw).pixels
    (height, width), (raw_height, raw_width) = picture.pixels.shape[:2], pixels.shape[:2]
    check_sizes(jpeg, (width, height), Path(raw), (raw_width, raw_height))
    return measure_chart(pixels, corners)


def _rows(name: str, photograph: Measured, step: float) -> "pd.DataFrame":
    import pandas as pd

    common = (name, photograph.exif.model, step, photograph.confidence)
    values = np.column_stack([_columns(photograph.jpeg), _columns(photograph.raw)])
    rows = [(*common, patch + 1, *row) for patch, row in enumerate(values.tolist())]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _columns(values: PatchValues | None) -> Array:
    if values is None:
        return np.full((N_PATCHES, 5), np.nan)
    return np.column_stack([values.means, values.clipped, values.spread])
