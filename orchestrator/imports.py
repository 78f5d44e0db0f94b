"""Modules that are loaded when they are first used, though others import them before."""

from __future__ import annotations

import sys
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader

# scipy clones all of numpy's public names, its Fortran wrapper generator and its test kit among them: a tenth of the
# time that a run's imports take, for what no run uses.
UNUSED = ("numpy.f2py", "numpy.testing", "numpy.ma")


class _Later:
    """Finds the modules of these names where Python does, and has them loaded later."""

    @staticmethod
    def find_spec(name: str, path: list[str] | None = None, target: object = None) -> ModuleSpec | None:
        if name not in UNUSED:
            return None
        spec = PathFinder.find_spec(name, path)
        if spec is not None and spec.loader is not None:
            spec.loader = LazyLoader(spec.loader)
        return spec


def put_off() -> None:
    """For programs of their own, before they import what is to be put off: the first attribute of it loads it."""
    if _Later not in sys.meta_path:
        sys.meta_path.insert(0, _Later)
