"""A run with an accuracy that is killed: ``python accuracy_case.py PLACE FOLDER`` ends itself with SIGKILL there."""

import os
import signal
import sys
from importlib import import_module
from pathlib import Path
from unittest.mock import patch

from in_process import IN_PROCESS

from orchestrator.accuracy.loop import run
from orchestrator.accuracy.passes import GOOD
from orchestrator.config.load import Loaded, config_from

# What it is killed at: a function of a module, or of a class there, and at which call of it after the first mesh's results were set aside
PLACES = {"while results are set aside": ("shutil", "copy2", 2), "before sizes are written": ("numpy", "savez_compressed", 1),
          "in the mesher": ("orchestrator.solving", "build_scene", 1), "in the solve": ("orchestrator.results.record.Record", "iteration", 3),
          "while results are written": ("orchestrator.results.solution", "write_fields", 1)}


def bent(accuracy, **more):
    """A short cantilever: stresses without limit along its clamped edges."""
    return {
        "name": "bent", "mesh": {"beam": {"size": [20, 10, 10], "h": 5}}, "subdomains": {"slices": {"axis": "x", "count": 2}},
        "materials": [{"young": 200e3, "poisson": 0.3}], "output": {"figures": False}, "blackbox": {**IN_PROCESS, "element": "P2"},
        "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax", "traction": [0, 0, 10]}],
        "method": {"accuracy": accuracy}, **more,
    }


def killed(place: str, folder: Path) -> None:
    """Runs until there."""
    module, name, number = PLACES[place]
    try:
        owner = import_module(module)
    except ModuleNotFoundError:
        module, _, inside = module.rpartition(".")
        owner = getattr(import_module(module), inside)
    real, calls = getattr(owner, name), []

    def dying(*given, **options):
        if (folder / GOOD).exists() or name == "copy2":
            calls.append(name)
        if len(calls) == number:
            os.kill(os.getpid(), signal.SIGKILL)
        return real(*given, **options)

    with patch.object(owner, name, dying):
        run(Loaded(config_from(bent(0.07))), output=folder, quiet=True)


if __name__ == "__main__":
    killed(sys.argv[1], Path(sys.argv[2]))
