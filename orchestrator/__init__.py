"""Multiscale LATIN domain decomposition around an untouched finite element code.

Data flows one way: configuration → laws → scene → black box → method → results.

From Python, a problem is a configuration, and its solution an object:

>>> import orchestrator
>>> config = orchestrator.config_from({
...     "name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
...     "subdomains": {"slices": {"axis": "x", "count": 4}},
...     "materials": [{"young": 200e3, "poisson": 0.3}],
...     "boundary": [{"on": "xmin", "displacement": [0, 0, 0]},
...                  {"on": "xmax", "traction": [0, 0, 1]}]})
>>> orchestrator.solve(config)
Solution(bar: converged after 7 iterations, error bound ...e-07)

What is public is listed in ``__all__`` and imported when it is first asked for.
"""

import os
from importlib import import_module

# The cores belong to the black box: numpy's threads would only spin against its processes.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

__version__ = "0.1.0"

# Public name → the module that it stands in. Servers of codes import this package too: they get
# none of it.
_PUBLIC = {
    "Config": "orchestrator.config.model", "load_config": "orchestrator.config.load",
    "config_from": "orchestrator.config.load",
    "Scene": "orchestrator.scene.model", "build_scene": "orchestrator.scene.build",
    "solve": "orchestrator.solving", "sweep": "orchestrator.sweeps.sweep",
    "Solution": "orchestrator.results.solution",
    "Subscriber": "orchestrator.method.events", "Iteration": "orchestrator.method.events",
    "Finished": "orchestrator.method.events",
    "Law": "orchestrator.laws.base", "LAWS": "orchestrator.registry",
    "Code": "orchestrator.blackbox.codes.code",
    "PythonCode": "orchestrator.blackbox.codes.python_code",
    "CodeSettings": "orchestrator.config.blackbox", "CODES": "orchestrator.registry",
    "OrchestratorError": "orchestrator.errors", "InputError": "orchestrator.errors",
    "Problem": "orchestrator.errors",
    "BlackBoxError": "orchestrator.errors",
}

__all__ = ["__version__", *_PUBLIC]


def __getattr__(name: str) -> object:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'orchestrator' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_PUBLIC[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_PUBLIC})
