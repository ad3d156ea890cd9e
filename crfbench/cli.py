"""The command line: one command a verb, from ``data`` and ``fetch`` to ``calibrate`` and ``lab``."""

import datetime
import io
import json
import math
import re
import sys
import textwrap
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

import crfbench
from crfbench.errors import CrfbenchError, InputError

if TYPE_CHECKING:
    from pandas import DataFrame, Series

    from crfbench.camera import Passport

_CAMERA, _PAPER, _DATA = _PANELS = ("Your own camera", "The paper", "Data and models")
app = typer.Typer(
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="A workbench for camera response functions.",
)
table_app = typer.Typer(no_args_is_help=True, help="Print a table of the paper, computed here.")
app.add_typer(table_app, name="table", rich_help_panel=_PAPER)

#: Models that had another name before one spelling held everywhere; these names work for one release more.
FORMER_NAMES = {
    "slr": "SLR-ldl-3",
    "slr-1": "SLR-ldl-1",
    "monotone": "SLR-monotone-3",
    "emor": "EMoR-3",
    "ggcm": "GGCM-3",
    "polynomial": "Polynomial-3",
    "ppisp": "PPISP-4",
}
_FORMER_NETWORK = re.compile(r"((?:baseline|ldl|auc|aae|vae|monotone|open)-[13])(?:-inverse|(-forward))")

FormatName = Annotated[
    str | None, typer.Option(help="Of the response, such as opencv or pcalib; default: as its content tells.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON rows instead of text.")]
Wide = Annotated[bool, typer.Option("--wide", help="Print every column, whatever the width of the terminal.")]
Alone = Annotated[bool, typer.Option("--alone", help="Models as they are, without a discrepancy for what they miss.")]


@app.callback(invoke_without_command=True)
def _version(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        typer.echo(crfbench.__version__)
        raise typer.Exit


@app.command(rich_help_panel=_DATA)
def data(as_json: AsJson = False) -> None:
    """List every data set: what it is, its licence, whether it is here, and where."""
    from crfbench.datasets import registry

    rows = registry.status()
    if as_json:
        typer.echo(json.dumps(rows, indent=1))
        return
    for row in rows:
        typer.echo(f"{row['key']}: {row['present']}\n  {row['what']}\n  licence: {row['licence']}")
        typer.echo(f"  in {row['where']}" if row["where"] else f"  get it with: crfbench fetch {row['key']}")


@app.command(rich_help_panel=_DATA)
def fetch(
    which: Annotated[str, typer.Argument(metavar="WHICH", help="dorf, emor, middlebury or all")],
    folder: Annotated[Path | None, typer.Option(help="Where to; default $CRFBENCH_DATA or the user cache.")] = None,
    mirror: Annotated[str | None, typer.Option(help="Base address to fetch from instead.")] = None,
) -> None:
    """Download a data set, checking every file; what is already there is kept."""
    from crfbench.datasets.fetch import fetch as fetch_files

    paths = fetch_files(which, folder=folder, mirror=mirror)
    done = f"{len(paths)} files are complete and checked; see them with: crfbench data"
    typer.echo(done if paths else f"{which} is bundled with crfbench; there is nothing to fetch")


@table_app.command()
def fitting(
    data: Annotated[str, typer.Option(help="auto, dorf or opencrf")] = "auto",
    direction: Annotated[str, typer.Option(help="forward, inverse or both")] = "both",
    wide: Wide = False,
    as_json: AsJson = False,
) -> None:
    """Table 1: how well each model fits response curves, in sample and held out (minutes with DoRF)."""
    from crfbench.checks import check_choice
    from crfbench.paper.fitting import DIRECTIONS, fitting_tables

    check_choice("direction", direction, (*DIRECTIONS, "both"))
    wanted = [side for side in DIRECTIONS if direction in (side, "both")]
    found = fitting_tables(data, wanted, progress=True)
    _print_tables(found, as_json, wide or ("model", "split", "mean_rmse", "p95_rmse", "paper", "verdict"))


@table_app.command()
def latents(wide: Wide = False, as_json: AsJson = False) -> None:
    """Latents of the bundled SLR models: how near each constraint brings them to N(0, 1)."""
    from crfbench.paper.results import latent_table

    title = "latents of the training curves, bundled models; best_...: with the best latent of each curve"
    shown = ("model", "mean", "sd", "kl", "ks", "best_rmse", "encoder_mse")
    _print_tables({title: latent_table()}, as_json, wide or shown)


@table_app.command()
def calibration(
    patches: Annotated[str, typer.Option(help="3 (greys), 24 or random (triples)")] = "3",
    method: Annotated[str, typer.Option(help="map, posterior, lm or paper (minutes)")] = "map",
    channel: Annotated[str, typer.Option(help="intensity, r, g or b")] = "intensity",
    alone: Alone = False,
    wide: Wide = False,
    as_json: AsJson = False,
) -> None:
    """Table 3: 14 cameras calibrated on one illumination and tested on the other, both ways."""
    from crfbench.paper.calibration import calibration_table
    from crfbench.paper.verdicts import CALIBRATION_COLUMNS

    shown = ["mean", "coverage" if method == "posterior" else "separate", "by_paper"]
    if method == "paper":
        shown = list(CALIBRATION_COLUMNS)
    title = f"RMSE against RAW of the other illumination, {patches} patches, {channel}, method {method}"
    table = calibration_table(patches, method, channel, discrepancy=not alone, progress=True)
    _print_tables({title: table}, as_json, wide or ("model", *shown, "paper_mean", "verdict"))


@table_app.command()
def stability(
    camera: Annotated[str, typer.Option(help="Which camera to show by itself.")] = "CanonPowerShotG9",
    alone: Alone = False,
    wide: Wide = False,
    as_json: AsJson = False,
) -> None:
    """Table 2: how far inverse responses from 3, 6, 12 and 24 patches lie apart (minutes)."""
    from crfbench.paper.stability import DEFINITION, stability_table

    shown = ("model", "method", "camera", "subsets", "total_variance", "rmse", "paper")
    table = stability_table(camera, discrepancy=not alone, progress=True)
    _print_tables({DEFINITION: table}, as_json, wide or shown)


@table_app.command("chart-free")
def chart_free(
    method: Annotated[str, typer.Option(help="map or posterior")] = "posterior",
    alone: Alone = False,
    wide: Wide = False,
    as_json: AsJson = False,
) -> None:
    """Calibration from exposure steps alone, beside OpenCV's Debevec and Robertson."""
    from crfbench.paper.calibration import chart_free_table

    title = "RMSE against RAW of the other illumination, channel by channel, up to scale; four exposures of 24 patches"
    shown = ("model", "mean", "median", "below_debevec", "below_robertson", "monotone", "seconds")
    _print_tables({title: chart_free_table(method, discrepancy=not alone, progress=True)}, as_json, wide or shown)


@app.command("paper", rich_help_panel=_PAPER)
def where(
    item: Annotated[
        str | None, typer.Argument(help='"Table 1" and such for its numbers, or "4.5" for a section.')
    ] = None,
    wide: Wide = False,
    as_json: AsJson = False,
) -> None:
    """Say where each figure, table, equation and claim of the paper is rebuilt, and what we judge of it."""
    from crfbench.paper.claims import claims_table
    from crfbench.paper.findings import paper_map
    from crfbench.paper.verdicts import RULES

    if item:
        claims = claims_table()
        there = claims["where"].str.contains(item, regex=False)
        if not there.any():
            raise InputError(f"{item!r} makes no claim; use 'Table 1', 'Table 2', 'Table 3' or a section such as 4.5")
        shown = ("claim", "paper", "ours", "spread", "verdict")
        title = f"{item} of the paper; more with --wide"
        return _print_tables({title: claims[there]}, as_json, wide or shown)
    table = paper_map()
    if as_json or wide:
        return _print_tables({"what the paper numbers, then what it claims": table}, as_json)
    table = table.assign(notebook=table["cell"].str[0], see=table["judged"])
    claims = table["verdict"].isin(list(RULES))
    title = "what the paper numbers (see: section of the claims that judge it; notebook: its number; more with --wide)"
    _print_tables({title: table[~claims]}, False, ("item", "verdict", "see", "notebook", "command"))
    _print_tables({"what it claims": table[claims]}, False, ("item", "what", "verdict", "notebook"))


@app.command(rich_help_panel=_PAPER)
def tables(out: Annotated[Path, typer.Option(help="Folder for tables and figures.")] = Path("results")) -> None:
    """Rebuild every table and figure that exists, without a browser."""
    from crfbench.paper.figures import build_results

    for path in build_results(out):
        typer.echo(path)


@app.command(rich_help_panel=_PAPER)
def report(
    out: Annotated[Path, typer.Option(help="The page to write.")] = Path("report.html"),
    figures: Annotated[
        Path | None, typer.Option(help="Also write the paper's figures, rebuilt, as PDF and PNG into this folder.")
    ] = None,
) -> None:
    """Write the reproduction report: every claim of the paper beside ours, in one page that needs no network."""
    from crfbench.paper.figures import write_figures
    from crfbench.paper.report import write_report

    typer.echo(write_report(out))
    for path in write_figures(figures) if figures else ():
        typer.echo(path)


@app.command(rich_help_panel=_CAMERA)
def calibrate(
    source: Annotated[list[Path], typer.Argument(help="A folder of photographs, or the files.")],
    chart: Annotated[
        str, typer.Option(help="auto, none (RAW files, or an exposure series), or a file of labels")
    ] = "auto",
    exposures: Annotated[
        str, typer.Option(help="exif, estimate, times such as 1/60,1/30,1/15, a file of lines name time, or names")
    ] = "exif",
    model: Annotated[str, typer.Option(help="Name of a model, such as SLR-ldl-3 or PPISP-4.")] = "Kernel-8",
    channels: Annotated[
        str, typer.Option(help="Of a series, or a chart with RAW: rgb, a curve a channel, or shared, one for all.")
    ] = "rgb",
    align: Annotated[str, typer.Option(help="Without a chart: auto, as from the hand, or none.")] = "auto",
    vignette: Annotated[
        bool, typer.Option("--vignette", help="The series shows an evenly lit surface: find the vignetting too.")
    ] = False,
    white_level: Annotated[int | None, typer.Option(help="Of 16-bit images, such as 4095; default: a guess.")] = None,
    out: Annotated[Path, typer.Option(help="Folder for passport, exports and report.")] = Path("calibrated"),
    force: Annotated[bool, typer.Option("--force", help="Replace files that are there.")] = False,
    each: Annotated[
        bool, typer.Option("--each", help="Each folder is a camera of its own; those in OUT count as done.")
    ] = False,
) -> None:
    """Calibrate your camera: from RAW and JPEG files to a response passport."""
    from crfbench import camera
    from crfbench.checks import counted
    from crfbench.files import check_new

    options: dict[str, Any] = {
        "chart": chart,
        "exposures": exposures,
        "model": _current_name(model),
        "created": datetime.date.today().isoformat(),
        "channels": channels,
        "align": align,
        "vignette": vignette,
        "white_level": white_level,
    }
    if each and force:
        raise InputError("--force replaces nothing with --each; remove the folders of OUT that are to be done again")
    if each:
        return _calibrate_each(source, out, options)
    check_new(out / "passport.json", force)  # before minutes of work
    say = partial(typer.echo, err=True)
    result = camera.calibrate(source, say=say, **options)
    for reason in result.problems.values():
        typer.echo(f"left out: {reason}", err=True)
    for path in camera.write_outputs(result, out, force, say):
        typer.echo(path)
    low, high = result.passport.valid_range
    photographs = counted(len(result.photographs), "photograph")
    measured = f"measured from brightness {low:.2f} to {high:.2f}, {photographs}"
    typer.echo(f"{result.passport!r}: {measured}")
    if result.passport.matrix is not None:
        typer.echo(f"colour matrix, RAW to light: {camera.matrix_text(result.passport.matrix)}")
    _warn(result.passport)


def _warn(passport: "Passport") -> None:
    for text in passport.warnings:
        typer.echo(f"warning: {text}")


def _calibrate_each(folders: list[Path], out: Path, options: dict[str, Any]) -> None:
    from crfbench import camera

    failed = 0
    for i, (folder, problem) in enumerate(camera.calibrate_cameras(folders, out, **options)):
        done = out / folder.resolve().name
        typer.echo(f"{i + 1} of {len(folders)}: {f'{folder}: {problem}' if problem else done}")
        failed += bool(problem)
        if (passport := done / "passport.json").exists():
            _warn(camera.read_response(passport))
    if failed:
        raise InputError(f"{failed} of {len(folders)} folders gave no response; see above, and call this again")


@app.command(rich_help_panel=_CAMERA)
def linearise(
    image: Annotated[Path, typer.Argument(help="JPEG, PNG, TIFF, HEIC, AVIF or WebP, 8 or 16 bit.")],
    response: Annotated[Path, typer.Option(help="passport.json, or the response of another program.")],
    out: Annotated[Path, typer.Option(help="What to write: .exr, .tif or .hdr (float).")],
    to: Annotated[str, typer.Option(help="light, or camera: RAW, by a passport with a colour matrix.")] = "light",
    vignette: Annotated[
        bool, typer.Option("--vignette", help="Divide by the passport's vignetting: same lens and f-number.")
    ] = False,
    format: FormatName = None,
    white_level: Annotated[int | None, typer.Option(help="Of a 16-bit image, such as 4095; default: a guess.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there.")] = False,
) -> None:
    """Turn the brightness of an image back into irradiance."""
    from crfbench.camera import linearise_file

    say = partial(typer.echo, err=True)
    options: dict[str, Any] = {"to": to, "vignette": vignette, "format": format, "white_level": white_level}
    typer.echo(linearise_file(image, response, out, force, say=say, **options))


@app.command(rich_help_panel=_CAMERA)
def convert(
    source: Annotated[Path, typer.Argument(help="passport.json, or the response of another program.")],
    out: Annotated[Path, typer.Argument(help="What to write; the end of its name tells the format.")],
    format: FormatName = None,
    to: Annotated[str | None, typer.Option(help="Format of OUT, such as pcalib or opencv.")] = None,
    channel: Annotated[str | None, typer.Option(help="red, green or blue, where OUT holds one curve.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there.")] = False,
) -> None:
    """Turn a response into the format of another program."""
    from crfbench.camera import read_response, write_response

    passport = read_response(source, format)
    for text in passport.warnings:
        typer.echo(f"{source}: {text}", err=True)
    write_response(passport.channel(channel) if channel else passport, out, to, force)
    typer.echo(out)


def _current_name(name: str) -> str:
    """Return the name of a model as it is spelled today, with a hint for a name as it was."""
    network = _FORMER_NETWORK.fullmatch(name)
    current = f"SLR-{network[1]}{network[2] or ''}" if network else FORMER_NAMES.get(name.lower(), name)
    if current != name:
        typer.echo(f"crfbench: {name} is called {current} now; the former name works for this release only", err=True)
    return current


@app.command(rich_help_panel=_DATA)
def train(
    names: Annotated[list[str] | None, typer.Argument(help="Models, such as SLR-ldl-1.")] = None,
    every: Annotated[bool, typer.Option("--all", help="All models that are bundled.")] = False,
    out: Annotated[Path, typer.Option(help="Folder for weights and histories.")] = Path("trained"),
) -> None:
    """Train the SLR models that are bundled, as they were trained (DoRF is needed; PyTorch too)."""
    from crfbench.training import pretrained_keys, train_pretrained

    if not (every or names):
        raise InputError(f"no model is named; use --all or some of: {', '.join(pretrained_keys())}")
    for path in train_pretrained(pretrained_keys() if every else map(_current_name, names or ()), out):
        typer.echo(path)


@app.command(rich_help_panel=_PAPER)
def search(
    strategy: Annotated[str, typer.Option(help="grid, random, halving or optuna")] = "grid",
    m: Annotated[int, typer.Option("--m", help="Of how many most accurate the least complex is chosen.")] = 10,
    data: Annotated[str, typer.Option(help="auto, dorf or opencrf")] = "auto",
    direction: Annotated[str, typer.Option(help="forward or inverse")] = "inverse",
    folds: Annotated[str, typer.Option(help="random, or grouped: near-copies in one fold")] = "random",
    seed: Annotated[int, typer.Option(help="Of the folds and the first weights.")] = 0,
    journal: Annotated[Path, typer.Option(help="Where each result goes as it comes.")] = Path("search.jsonl"),
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a journal that is there.")] = False,
    as_json: AsJson = False,
) -> None:
    """Search the paper's 156 architectures: of the M most accurate, the least complex (PyTorch is needed)."""
    from crfbench.curves import check_direction
    from crfbench.datasets import load_responses
    from crfbench.search import search_architectures

    if journal.exists() and not resume:
        raise InputError(f"{journal} is there already; use --resume to go on with it, or another --journal")
    responses, side = load_responses(data), check_direction(direction)
    try:
        result = search_architectures(
            responses, m=m, strategy=strategy, direction=side, folds=folds, seed=seed, journal=journal, progress=True
        )
    except KeyboardInterrupt:
        typer.echo(f"stopped; {journal} holds what is done: go on with the same command and --resume", err=True)
        raise typer.Exit(130) from None
    title = f"{responses.dataset}: of the {m} most accurate, {result.chosen} is the least complex"
    _print_tables({title: result.table}, as_json)


@app.command(rich_help_panel=_CAMERA, context_settings={"allow_extra_args": True, "ignore_unknown_options": True})
def lab(
    context: typer.Context,
    folder: Annotated[Path, typer.Argument(help="Your copy of the notebooks.")] = Path("crfbench-notebooks"),
) -> None:
    """Copy the notebooks to a folder of yours and open them; further options go to JupyterLab."""
    from crfbench.lab import copy_notebooks, open_lab

    options = context.args
    if str(folder).startswith("-"):  # an option for JupyterLab, with no folder before it
        folder, options = Path("crfbench-notebooks"), [str(folder), *options]
    copied = copy_notebooks(folder)
    typer.echo(f"{len(copied)} notebooks copied to {folder}" if copied else f"the notebooks in {folder} are kept")
    open_lab(folder.resolve(), options)


def _print_tables(
    tables: "Mapping[str, DataFrame]", as_json: bool, columns: Literal[True] | Sequence[str] = True
) -> None:
    """Print as text every table under its title, with what is the same in all rows; as JSON the rows of the first.

    As text with the given columns, True for all; those of which nothing is known are left out.
    """
    from crfbench.paper.results import to_rows
    from crfbench.paper.verdicts import COLOURS

    if as_json:
        typer.echo(json.dumps(to_rows(next(iter(tables.values()))), indent=1))
        return
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    # Rich colours a terminal only, where NO_COLOR is not set; without a terminal a line has 80 characters.
    console = Console(width=1000 if columns is True else None, highlight=False)
    for title, frame in tables.items():
        told = frame.dropna(axis=1, how="all")
        shown = told if columns is True else told[[name for name in columns if name in told]]
        same = [name for name in shown if len(shown) > 1 and shown[name].nunique(dropna=False) == 1]
        shown = shown.drop(columns=same)
        typer.echo("\n".join([*textwrap.wrap(title, 80), *(f"{name}: {told[name].iloc[0]}" for name in same)]))
        printed = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
        for name in shown:
            text = shown[name].dtype.kind == "O"
            phrases = text and shown[name].str.contains(" ").any()
            printed.add_column(name, justify="left" if text else "right", no_wrap=not phrases)
        for row in shown.apply(_aligned).astype(str).itertuples(index=False, name=None):
            printed.add_row(*(Text(cell, COLOURS.get(cell, "")) for cell in row))
        console.print(printed)
        typer.echo()


def _aligned(column: "Series[Any]") -> "Series[Any]":
    """Write the numbers of a column with digits that give the largest three, or the least, or as the paper: 3.60E-2."""
    from crfbench.paper.verdicts import scientific

    if column.dtype.kind != "f" or not column.any():
        return column
    sizes = column.abs()[column != 0].dropna()
    wide = sizes.max() > 30 * sizes.min()
    digits = max(0, 2 - math.floor(math.log10(sizes.min() if wide else sizes.max())))
    write = scientific if wide and sizes.min() < 0.01 else f"{{:.{digits}f}}".format
    return column.map(write, na_action="ignore").fillna("-")


app.registered_commands.sort(key=lambda command: _PANELS.index(str(command.rich_help_panel)))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; a mistake in the input is one sentence and exit status 2."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # names of files may hold what it cannot write
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        app(arguments)
    except CrfbenchError as error:
        sentence = str(error)
    except OSError as error:
        sentence = f"{error.filename} cannot be used: {error.strerror}" if error.filename else str(error)
    except ModuleNotFoundError as error:
        if error.name != "torch":
            raise
        sentence = "PyTorch is not installed, and this command needs it: pip install torch"
    typer.echo(f"crfbench: {_with_options(sentence)}", err=True)
    sys.exit(2)


def _with_options(sentence: str) -> str:
    """Name options as they are typed where a sentence names arguments of Python, as in ``white_level=3``."""
    group: Any = typer.main.get_command(app)
    commands = [*group.commands.values(), *group.commands["table"].commands.values()]
    options = {option.name: max(option.opts, key=len) for command in commands for option in command.params}
    typed = options | {"which": "--data", "key": "WHICH"}
    # What stands in parentheses behind a name is a model or a call, of Python.
    arguments = r"\w+\([^()]*\)|\b(\w+)=(?=\S)"
    return re.sub(arguments, lambda found: f"{typed[found[1]]} " if found[1] in typed else found[0], sentence)
