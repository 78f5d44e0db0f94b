"""A solution read from its folder is the one that was written."""

from dataclasses import fields, is_dataclass

import numpy as np
import orchestrator
import pytest
from helpers import HELD, STEEL, box, on, solved

PARTS = [box("low", [1, 1, 1], [2, 2, 2]), box("high", [1, 1, 1], [3, 3, 3], [0, 0, 1])]
PROBES = [{"name": "tip", "at": [0.5, 0.5, 2.0]}, {"name": "line", "along": [[0.5, 0.5, 0], [0.5, 0.5, 3]], "points": 4},
          {"name": "top", "on": "high/zmax", "quantity": "max", "of": "stress"}]
SCENE = {"name": "pair", "subdomains": "groups", "materials": [STEEL], "parts": PARTS, "output": {"probes": PROBES},
         "boundary": [{"on": on("z", 0), "displacement": HELD}, {"on": on("z", 2), "displacement": [[0, 0, -1e-3], [1e-3, 0, -1e-3]]}]}
# of the run alone, in no file
UNWRITTEN = {"directory", "scene", "iterated", "parts", "reference", "met", "resultants", "joints", "config", "points", "index"}


def same(one: object, other: object) -> bool:
    """Whether two are equal to the last bit; what is not a number equals itself."""
    if is_dataclass(one):
        return type(one) is type(other) and all(
            same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one) if f.name not in UNWRITTEN)
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray):
        return one.dtype.kind == other.dtype.kind and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    return one == other


@pytest.mark.parametrize("law", [{"law": "contact", "friction": 0.2}, {"law": "perfect"}], ids=["contact", "bonded"])
def test_what_is_read_is_what_was_solved(tmp_path, law):
    solution = solved(SCENE | {"interfaces": [{"between": "auto", **law}]})
    again = orchestrator.Solution.read(solution.write(tmp_path / "out"))
    assert same(solution, again) and again.tables.keys() == {"extremes.csv", "interfaces.csv", "probes.csv", "paths.csv"}
    other = solved(SCENE | {"interfaces": [{"between": "auto", "law": "contact"}]})
    assert not same(solution, orchestrator.Solution.read(other.write(tmp_path / "other")))
