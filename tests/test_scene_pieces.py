"""Scenes that ranks make together: to the bit the parts that are cut of the whole, which nobody has; or none, where one has to judge."""

from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from ranks_case import CASES
from threads import among

from orchestrator.config.load import config_from
from orchestrator.scene.build import build_scene
from orchestrator.scene.part import overview, part_of
from orchestrator.scene.pieces.make import make

# whether any face is bent is told of own ones; of neighbours' nodes away from the interface nobody asks for forces, and cells that give them may be missing; the rest is told apart
ELSEWHERE = (".loads", ".bent", ".rank_of", ".overview.length")


def differing(ours, other, place=""):
    """Where two objects are not the same."""
    if type(ours) is not type(other):
        yield place
    elif isinstance(ours, np.ndarray):
        if ours.shape != other.shape or not np.array_equal(ours, other, equal_nan=ours.dtype.kind == "f"):
            yield place
    elif is_dataclass(ours):
        for f in fields(ours):
            yield from differing(getattr(ours, f.name), getattr(other, f.name), f"{place}.{f.name}")
    elif isinstance(ours, (list, tuple)):
        if len(ours) != len(other):
            yield place
        for k, pair in enumerate(zip(ours, other)):
            yield from differing(*pair, f"{place}[{k}]")
    elif hasattr(ours, "__dict__"):
        yield from differing(vars(ours), vars(other), place)
    elif isinstance(ours, dict):
        for key in ours.keys() | other.keys():
            yield from differing(ours.get(key), other.get(key), f"{place}.{key}")
    elif ours != other:
        yield place


@pytest.mark.parametrize("case", ["mono-scale", "soft modes", "blocks"])
def test_a_rank_makes_what_it_would_be_handed(case):
    config = config_from({"name": "pieces", **CASES[case]})
    whole = build_scene(config)
    known = overview(whole)

    def of_rank(team):
        part = make(config, team)
        rank_of = part.overview.rank_of
        dealt = part_of(whole, np.flatnonzero(rank_of == team.rank), known)
        assert np.bincount(rank_of, minlength=3).min() > 0
        wrong = differing(part, dealt)
        own = [f".subdomains[{e}].loads" for e in np.flatnonzero(rank_of == team.rank)]
        return [place for place in wrong if place in own or not place.endswith(ELSEWHERE)], \
            part.overview.length - known.length

    for found in among(3, of_rank):
        assert not isinstance(found, Exception), found
        assert found[0] == [] and abs(found[1]) <= 1e-14 * known.length


BLOCK = {"mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}}, "subdomains": {"slices": {"axis": "x", "count": 4}},
         "materials": [{"young": 200e3, "poisson": 0.3}],
         "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax", "traction": [10, 0, 0]}]}


@pytest.mark.parametrize("change", [
    {"boundary": [{"on": {"plane": "x", "at": 0.01}, "displacement": [0, 0, 0]}, BLOCK["boundary"][1]]},  # no face lies there
    {"boundary": [{"on": "xmin", "displacement": [0, 0, None]}, BLOCK["boundary"][1]]},  # it may move
    {"boundary": [BLOCK["boundary"][0], {"on": "xmax", "displacement": [0.1, 0, 0]},
                  {"on": {"plane": "x", "at": 4}, "displacement": [0.2, None, None]}]},  # which contradict each other
    {"subdomains": {"slices": {"axis": "x", "count": 100}}},  # some of them empty
    {"boundary": [*BLOCK["boundary"], {"on": "ymin", "foundation": {"normal": 1.0}}]},  # a ground
    {"boundary": [*BLOCK["boundary"], {"on": "ymin", "resultant": {"force": [0, 1, 0]}}]},  # by the area of all
    {"interfaces": [{"law": "contact"}]}, {"output": {"probes": [{"at": [1, 0.5, 0.5]}]}}, {"subdomains": {"metis": 4}},
    {"blackbox": {"element": "P2"}}])
def test_what_one_has_to_judge_is_left_to_it(change):
    config = config_from({"name": "pieces", **BLOCK, **change})
    assert among(2, lambda team: make(config, team)) == [None, None]


def test_a_piece_is_little_more_than_its_share():
    config = config_from({"name": "pieces", **BLOCK, "mesh": {"box": {"size": [16, 1, 1], "cells": [256, 2, 2]}},
                          "subdomains": {"slices": {"axis": "x", "count": 16}}})
    cells = among(4, lambda team: len(make(config, team).mesh.cells))
    assert max(cells) <= 6 * 4 * (256 // 4 + 2)
