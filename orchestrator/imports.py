"""Modules that are imported when they are first used, though someone else asks for them before."""

from __future__ import annotations

import importlib.util
import sys

# scipy clones all of numpy's public names, its Fortran wrapper generator and its test kit among them: a tenth of the
# time that a run's imports take, for what no run uses.
UNUSED = ("numpy.f2py", "numpy.testing", "numpy.ma")


def put_off(names: tuple[str, ...] = UNUSED) -> None:
    """Makes these submodules lazy, by the recipe of importlib's documentation; to be called before they are imported."""
    for name in names:
        if name in sys.modules:
            continue
        spec = importlib.util.find_spec(name)
        spec.loader = importlib.util.LazyLoader(spec.loader)
        module = sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        package, _, own = name.rpartition(".")
        setattr(sys.modules[package], own, module)
