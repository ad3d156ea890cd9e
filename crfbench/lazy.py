"""Names of a package that are found when first used, so that importing it costs next to nothing."""

import sys
from collections.abc import Callable, Mapping
from importlib import import_module


def found_when_used(package: str, names: Mapping[str, str]) -> Callable[[str], object]:
    """Return the ``__getattr__`` of a package that takes `names`, listed by module of crfbench; by "" are modules."""
    home = {name: module for module, listed in names.items() for name in listed.split()}

    def find(name: str) -> object:
        if name in home:
            found = import_module(f"crfbench.{home[name] or name}")
            return getattr(found, name) if home[name] else found
        public = ", ".join(sys.modules[package].__all__)
        raise AttributeError(f"module {package!r} has no attribute {name!r}; it has {public}")

    return find
