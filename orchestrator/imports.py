"""What makes a program's imports quick: modules that are loaded when they are first used, and no looking around."""

from __future__ import annotations

import gc
import os
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


# pydantic looks through everything that is installed for plugins of its own: a tenth of what the configuration's imports take.
_PLUGINS, _NONE = "PYDANTIC_DISABLE_PLUGINS", "__all__"
# New objects after which Python looks for cycles: among modules there are hardly any.
_IMPORTING, _RUNNING = 500_000, 50_000


def put_off() -> None:
    """For programs of their own, before they import what is to be put off: the first attribute of it loads it."""
    if _Later not in sys.meta_path:
        sys.meta_path.insert(0, _Later)


def hurry() -> None:
    """Before the program's own modules are imported: nothing is looked for in between."""
    gc.set_threshold(_IMPORTING)
    os.environ.setdefault(_PLUGINS, _NONE)


def all_there() -> None:
    """Takes back ``hurry`` after the imports, before anything large is made and before codes of the user's start."""
    if gc.get_threshold()[0] == _IMPORTING:
        gc.freeze()  # modules stay to the end
        gc.set_threshold(_RUNNING)
        if os.environ.get(_PLUGINS) == _NONE:
            del os.environ[_PLUGINS]
