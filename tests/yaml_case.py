"""Small configurations as files, solved in process, for tests of commands."""

import json
from pathlib import Path

from in_process import IN_PROCESS
from typer.testing import CliRunner

from orchestrator.cli import app


def call(*words: object):
    """Calls the command line with these words; what it says and ends with."""
    return CliRunner().invoke(app, list(map(str, words)))


def blocks(folder: Path, **changes: object) -> Path:
    """Two blocks, one on the other, pressed and then sheared, in frictional contact: a YAML file."""
    data = {"name": "blocks", "mesh": {"box": {"size": [1, 1, 1], "cells": [2, 2, 4]}}, "subdomains": {"slices": {"axis": "z", "count": 2}},
            "materials": [{"young": 200e3, "poisson": 0.3}],
            "boundary": [{"on": {"plane": "z", "at": 0.0}, "displacement": [0, 0, 0]},
                         {"on": {"plane": "z", "at": 1.0}, "displacement": [[0, 0, -0.001], [0.0006, 0, -0.001]]}],
            "interfaces": [{"law": "contact", "friction": 0.2}], "method": {"tolerance": {"law": 1e-6}},
            "blackbox": IN_PROCESS, "output": {"figures": False, "directory": str(folder / "results")}}
    path = folder / "blocks.yaml"
    path.write_text(json.dumps({**data, **changes}, indent=1))
    return path


def bar(folder: Path, name: str = "bar", pull: float = 10.0) -> Path:
    """A bar of four bonded slices, pulled: a YAML file, with a results folder of its own beside it."""
    data = {"name": name, "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}}, "subdomains": {"slices": {"axis": "x", "count": 4}},
            "materials": [{"young": 200e3, "poisson": 0.3}],
            "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax", "traction": [pull, 0, 0]}], "blackbox": IN_PROCESS,
            "output": {"figures": False, "directory": str(folder / name), "probes": [{"name": "tip", "at": [4, 0.5, 0.5]}]}}
    path = folder / f"{name}.yaml"
    path.write_text(json.dumps(data, indent=1))
    return path
