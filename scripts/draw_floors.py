"""Draw the floors of the package, docs/floors.svg, from the layers of import-linter and the modules' docstrings."""

import ast
import tomllib
from html import escape
from importlib.util import find_spec
from pathlib import Path
from textwrap import wrap

from crfbench.files import write_atomically

ROOT = Path(__file__).resolve().parent.parent
TARGET = ROOT / "docs/floors.svg"

_WIDTH, _GAP, _MARGIN = 960, 8, 12  # pixels, as all lengths here
_LINE, _PAD = 16, 8
_LETTER = 6.4  # of the text, on the wide side
_STYLE = """
  rect { fill: #ffffff; } .box { fill: #eef3f8; stroke: #7a8ea3; } text { fill: #1b2530; font: 12px sans-serif; }
  .name { font: bold 14px monospace; }
  @media (prefers-color-scheme: dark) {
    rect { fill: #14191f; } .box { fill: #222c36; stroke: #6d8196; } text { fill: #e4ebf2; }
  }
"""


def floors_of_the_package() -> list[list[str]]:
    """Return the layers of pyproject.toml, the highest first, each with its modules."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (contract,) = settings["tool"]["importlinter"]["contracts"]
    return [[name.strip() for name in layer.split("|")] for layer in contract["layers"]]


def first_sentence(module: str) -> str:
    """Return what a module says of itself: the first paragraph of its docstring, in one line."""
    source = Path(str(find_spec(module).origin)).read_text(encoding="utf-8")  # type: ignore[union-attr]  # it is there
    return (ast.get_docstring(ast.parse(source)) or "").split("\n\n")[0].replace("\n", " ")


def draw() -> str:
    """Return the picture: a row a floor, the highest first, a box a module with its name and first sentence."""
    floors, y = [], _MARGIN
    for floor in floors_of_the_package():
        boxes, height = _row(floor, y)
        floors.append(boxes)
        y += height + _GAP
    told = "; ".join(", ".join(floor) for floor in floors_of_the_package())
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {y + _MARGIN - _GAP}" role="img" '
        'aria-labelledby="title desc">\n<title id="title">The floors of crfbench</title>\n'
        f'<desc id="desc">A module imports only from lower floors. From the highest to the lowest: {told}.</desc>\n'
        f'<style>{_STYLE}</style>\n<rect width="100%" height="100%"/>\n{"".join(floors)}</svg>\n'
    )


def _row(floor: list[str], y: int) -> tuple[str, int]:
    """Return the boxes of a floor, side by side and of one height, and that height."""
    width = (_WIDTH - 2 * _MARGIN - _GAP * (len(floor) - 1)) // len(floor)
    letters = int((width - 2 * _PAD) / _LETTER)
    sentences = [wrap(first_sentence(f"crfbench.{name}").replace("`", ""), letters) for name in floor]
    height = _LINE * (1 + max(map(len, sentences))) + 2 * _PAD
    boxes = ""
    for i, (name, lines) in enumerate(zip(floor, sentences, strict=True)):
        x = _MARGIN + i * (width + _GAP)
        boxes += f'<rect class="box" x="{x}" y="{y}" width="{width}" height="{height}" rx="4"/>\n'
        boxes += _text(x, y, name, "name") + "".join(
            _text(x, y + _LINE * j, line) for j, line in enumerate(lines, start=1)
        )
    return boxes, height


def _text(x: int, y: int, line: str, kind: str = "says") -> str:
    return f'<text class="{kind}" x="{x + _PAD}" y="{y + _PAD + 12}">{escape(line)}</text>\n'


if __name__ == "__main__":
    write_atomically(TARGET, draw().encode())
