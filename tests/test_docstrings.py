"""Every public module, class and function says what it is, and its sections are those of its signature."""

import ast
import inspect
import re
from pathlib import Path

import pytest

import crfbench
from crfbench import errors

ROOT = Path(__file__).resolve().parent.parent / "crfbench"
FILES = sorted(path for path in ROOT.rglob("*.py") if path.name != "cli.py")
#: Errors that a docstring names where they are raised; that a bad argument is an InputError goes without saying.
NAMED = {name for name in vars(errors) if name.endswith("Error")} - {"CrfbenchError", "InputError"}


def sections(text: str) -> dict[str, str]:
    """Return the text below each underlined heading."""
    parts = re.split(r"^(\w+)\n-+$", text, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def documented(text: str) -> list[str]:
    """Return the names of the section Parameters, in order."""
    entries = re.findall(r"^(\S.*)$", sections(text).get("Parameters", ""), flags=re.MULTILINE)
    return [name.strip(" *") for entry in entries for name in entry.split(" : ")[0].split(",")]


def taken(node: ast.FunctionDef) -> list[str]:
    """Return the names of a function's arguments, in order."""
    given = node.args
    plain = [*given.posonlyargs, *given.args, given.vararg, *given.kwonlyargs, given.kwarg]
    return [each.arg for each in plain if each is not None and each.arg not in {"self", "cls"}]


def fields(node: ast.ClassDef) -> list[str]:
    """Return what a class is built from: the arguments of its constructor, or its fields."""
    for member in node.body:
        if isinstance(member, ast.FunctionDef) and member.name == "__init__":
            return taken(member)
    kinds = [ast.unparse(kind) for kind in (*node.decorator_list, *node.bases)]
    if not any("dataclass" in kind or kind == "NamedTuple" for kind in kinds):
        return []
    members = [member for member in node.body if isinstance(member, ast.AnnAssign)]
    return [member.target.id for member in members if "ClassVar" not in ast.unparse(member.annotation)]


def raised(node: ast.AST) -> set[str]:
    """Return the errors of ours, other than those of a bad argument, that a function raises itself."""
    calls = [each.exc.func for each in ast.walk(node) if isinstance(each, ast.Raise) and isinstance(each.exc, ast.Call)]
    return {ast.unparse(call) for call in calls} & NAMED


def complaints(node: ast.AST) -> list[str]:
    """Check the public members of a module or class."""
    found = []
    for member in ast.iter_child_nodes(node):
        if not isinstance(member, ast.ClassDef | ast.FunctionDef) or member.name.startswith("_"):
            continue
        if any("setter" in ast.unparse(decorator) for decorator in member.decorator_list):
            continue
        text = ast.get_docstring(member) or ""
        if not text and not any(ast.unparse(each).startswith("claim(") for each in member.decorator_list):
            found.append(f"{member.name} has no docstring")
        if isinstance(member, ast.ClassDef):
            given = fields(member) if "Parameters" in sections(text) else []
            builders = [each for each in member.body if getattr(each, "name", "") in {"__init__", "__post_init__"}]
            errors = set().union(*map(raised, builders))
            found += complaints(member)
        else:
            given = taken(member) if "Parameters" in sections(text) else []
            errors = raised(member)
        if given != documented(text):
            found.append(f"{member.name} takes {given} and documents {documented(text)}")
        found += [f"{member.name} raises {error} and does not say so" for error in errors if error not in text]
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_docstrings_are_those_of_the_code(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert ast.get_docstring(tree)
    assert complaints(tree) == []


@pytest.mark.parametrize("name", sorted({*crfbench.__all__} - {"camera", "paper", "plots", "widgets"}))
def test_what_users_import_documents_all_that_it_takes(name):
    thing = getattr(crfbench, name)
    takes = [parameter for parameter in inspect.signature(thing).parameters if parameter != "self"]
    assert documented(inspect.getdoc(thing) or "") == takes


def test_a_gap_is_found():
    code = (
        'def f(a, b):\n    """F.\n\n    Parameters\n    ----------\n    a : int\n    """\n    raise FormatError("x")\n'
    )
    assert complaints(ast.parse(code)) == [
        "f takes ['a', 'b'] and documents ['a']",
        "f raises FormatError and does not say so",
    ]
    assert complaints(ast.parse("class A:\n    def __init__(self, a): ...\n")) != []
