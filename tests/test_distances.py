"""Distances of facing sides are the geometry's: small clearances, small press fits, meshes of other sizes on either side."""

import numpy as np
import pytest
from boxes import boxed
from in_process import IN_PROCESS
from method_case import config, saved
from quick import late

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.mesh.sources import bricks
from orchestrator.scene.mesh.mesh import Mesh

AUTO = {"between": "auto", "law": "contact"}


def boxes(z: float, down: float, *, low=(3, 3, 2), up=(4, 4, 2), entry=AUTO, size=1.0, **changes) -> dict:
    """A cube at a height z above the ground, on another one of height 1, moved by ``down`` at its top; E = 1000, ν = 0."""
    return {"name": "boxes", "parts": [boxed("low", [size] * 3, low), boxed("up", [size] * 3, up, [0, 0, z * size])],
            "subdomains": "groups", "interfaces": [entry], "materials": [{"young": 1000, "poisson": 0}], "blackbox": IN_PROCESS,
            "method": {"tolerance": {"error": 1e-9}},
            "boundary": [{"on": "low/zmin", "displacement": [0, 0, 0]}, {"on": "up/zmax", "displacement": [0, 0, -down * size]}], **changes}


@pytest.mark.parametrize("z, down, changes, force", [
    late(1.03, 0.05, {}, 10.0), (1.03, 0.05, {"low": (4, 4, 2), "up": (3, 3, 2)}, 10.0),
    late(1.03, 0.05, {"low": (2, 2, 2), "up": (8, 8, 2)}, 10.0),
    late(0.9997, 0.0, {}, 0.15), late(0.9997, 0.0, {"up": (3, 3, 2)}, 0.15), (0.9997, 0.0, {"size": 1e-3}, 0.15), late(0.99999, 0.0, {}, 0.005),
    (0.9997, 0.0, {"entry": {"between": ["low", "up"], "law": "contact", "gap": "geometry"}}, 0.15),
    (1.0003, 0.05, {"up": (3, 3, 2)}, 24.85),
])
def test_the_force_is_that_of_the_geometry(z, down, changes, force):
    """E (down − (z − 1)) / 2 on the area, whichever side is finer."""
    made = config_from(boxes(z, down, **changes))
    scene = build_scene(made)
    assert solve(made, scene).summary["reactions"][0][0][2] == pytest.approx(force * changes.get("size", 1.0) ** 2, rel=1e-6)
    assert [w for w in scene.warnings if "pressed together" in w] == [w for w in scene.warnings if z < 1
                                                                      and "low | up: sides are up to" in w]
    assert bool(scene.warnings) == (z < 1)


@pytest.mark.parametrize("z, up", [(1.0002, (3, 3, 2)), (0.9998, (3, 3, 2)), (1.0002, (4, 4, 2))])
def test_what_counts_as_touching_is_told(z, up):
    """Unless the entry has a word on the gap."""
    named = {"between": ["low", "up"], "law": "contact"}
    told = build_scene(config_from(boxes(z, 0.01, up=up, entry=named))).warnings
    assert len(told) == 1 and f"0.0002 {'apart' if z > 1 else 'inside each other'}" in told[0] and "count as touching" in told[0]
    assert not build_scene(config_from(boxes(z, 0.01, up=up, entry={**named, "gap": 0}))).warnings


@pytest.mark.parametrize("up", [(3, 3, 2), (4, 4, 2)])
def test_parts_that_touch_do_so_wherever_they_are(up):
    """Turned, and far from the origin, where coordinates are rounded."""
    made = boxes(1.0, 0.01, up=up)
    for part, height in zip(made["parts"], (0, 1)):
        part["move"] = {"rotate": {"axis": [1, 2, 3], "degrees": 40, "about": [0, 0, -height]}, "translate": [1000, 0, height]}
    scene = build_scene(config_from(made))
    assert not scene.warnings and not any(i.law.distance.any() for i in scene.interfaces)


def test_parts_that_pass_through_each_other_are_told_however_little():
    """Beyond reach of the pairs that are found, between parts that a third one connects."""
    made = boxes(1.04, 0.05, entry={**AUTO, "friction": 0.0})
    made["parts"].append(boxed("post", [1, 1, 2.04], [2, 2, 4], [1, 0, 0]))
    made["boundary"].append({"on": "post/xmax", "displacement": [0, 0, 0]})
    assert any("'low' and 'up' pass through each other by about 0.01" in w for w in solve(config_from(made)).summary["warnings"])


CUBE = {"box": {"size": [1, 1, 1], "cells": [3, 3, 3]}}


@pytest.mark.parametrize("other, at", [
    (CUBE, [0, 0, 0]), ({"box": {"size": [1, 1, 1], "cells": [4, 4, 4]}}, [0, 0, 0]), (CUBE, [1 / 3, 0, 0]),
    ({"box": {"size": [0.5, 0.5, 0.5], "cells": [2, 2, 2]}}, [0, 0, 0]),
    ({"box": {"size": [0.5, 0.5, 0.5], "cells": [2, 2, 2]}}, [0.2, 0.2, 0.2]),
    ({"box": {"size": [1, 1, 0.02], "cells": [3, 3, 1]}}, [0, 0, 0]),
], ids=["twice", "another mesh", "shifted", "in a corner", "within", "a thin one"])
@pytest.mark.parametrize("entries", [None, [AUTO], [{"between": ["one", "two"], "law": "perfect"}]], ids=["none", "auto", "named"])
def test_two_parts_in_one_place_are_refused(other, at, entries):
    """Though no corner and no face of one is inside the other."""
    with pytest.raises(InputError, match="(are inside|penetrate) each other"):
        build_scene(config_from({
            "name": "twice", "parts": [{"name": "one", "mesh": CUBE}, {"name": "two", "mesh": other, "move": {"translate": at}}],
            "subdomains": "groups", "materials": [{"young": 1, "poisson": 0.3}], **({"interfaces": entries} if entries else {}),
            "boundary": [{"on": f"{part}/xmin", "displacement": [0, 0, 0]} for part in ("one", "two")]}))


@pytest.mark.parametrize("shift, words", [(0.0, "inside each other"), (0.5, "inside each other"), (1.0, "touch")])
def test_pieces_of_one_volume_do_not_meet_unnoticed(tmp_path, shift, words):
    """A body that is there twice in one file, under one name; and one that is not merged with its neighbour."""
    box = bricks(np.ones(3), np.array([2, 2, 2]), "box")
    mesh = Mesh(np.vstack([box.nodes, box.nodes + [shift, 0, 0]]), np.vstack([box.cells, box.cells + len(box.nodes)]),
                np.zeros(2 * len(box.cells), dtype=int), ["all"])
    made = config(mesh=saved(mesh, tmp_path / "twice.mesh"), subdomains={"metis": 2},
                  boundary=[{"on": {"box": [[-1, -1, 0], [9, 9, 0]]}, "displacement": [0, 0, 0]}])
    if words == "touch":
        assert sum("two pieces of 'volume_1' touch" in w for w in build_scene(made).warnings) == 1
    else:
        with pytest.raises(InputError, match=f"two pieces of 'volume_1', which share no faces, are {words}"):
            build_scene(made)
