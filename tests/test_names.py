"""Names mean themselves, whatever characters they have; only what names nothing is a wildcard."""

import meshio
import numpy as np
import pytest

from orchestrator import build_scene, config_from
from orchestrator.scene.interfaces.search import Laws
from orchestrator.scene.mesh.gmsh_session import leave_out
from orchestrator.scene.mesh.cad import Sizing, sizes_of
from orchestrator.scene.mesh.sources import bricks
from orchestrator.scene.names import look_alike, matching

# pairs of which the first, read as a wildcard, means the second too, or the second instead
PAIRS = [("v[1]", "v1"), ("M8*20", "M8x20"), ("a?", "ab"), ("rod", "rod/head"), ("v[!1]", "v2"), ("[", "("), ("Rod", "rod")]


@pytest.mark.parametrize("one, other", PAIRS)
def test_a_name_means_itself_alone(one, other):
    """Wherever names are written: the pairs are taken as two plain names are."""
    both = [other, one]
    assert matching(one, both) == [one] and matching(other, both) == [other] and matching("*", both) == both
    assert leave_out("bolt.stp", both, [one], both) == [0]
    assert sizes_of(both, {"*": 1.0, one: 2.0}) == {other: Sizing(1.0), one: Sizing(2.0)}
    laws = Laws([config_from(bar(interfaces=[{"law": "contact", "between": [one, "c"]}])).interfaces[0]], [*both, "c"])
    assert laws.between([one], ["c"]) == 0 and laws.between([other], ["c"]) == -1


@pytest.mark.parametrize("pattern, names, meant", [
    ("base", ["base/rod", "base/nut", "baseplate"], ["base/rod", "base/nut"]), ("b*", ["base/rod", "lid"], ["base/rod"]),
    ("v[1]", ["v[1]/a", "v1/a"], ["v[1]/a"]), ("v[12]", ["v1", "v2", "v3"], ["v1", "v2"]), ("*/rod", ["a/rod", "a/nut"], ["a/rod"]),
    ("*", ["*", "a"], ["*", "a"]), ("[*]", ["*", "a"], ["*"]), ("rod ", ["rod"], [])])
def test_what_names_nothing_is_a_part_or_a_wildcard(pattern, names, meant):
    assert matching(pattern, names) == meant


@pytest.mark.parametrize("names, said",
                         [(["v[1]", "v1"], "'v[1]'"), (["*", "a"], "* means all of them"), (["Rod", "rod"], "by case or blanks"),
                                         (["rod 1", "rod1 "], "'rod1 '"), (["v[1]", "v2", "rod", "rod/a"], None)])
def test_names_that_look_alike_are_told(names, said):
    assert [said in text for text in look_alike(names, "volume")] == ([True] if said else [])


def bar(**changes) -> dict:
    return {"name": "bar", "mesh": {"box": {"size": [2, 1, 1], "cells": [2, 1, 1]}}, "subdomains": {"groups": True},
            "materials": [{"young": 1000.0, "poisson": 0.3}], "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}], **changes}


def test_a_scene_of_such_names_is_that_of_plain_ones(tmp_path):
    """Materials, loads, supports, laws, slaves, codes and probes, of a file with volumes v[1] and v1 as of one with a and b."""
    def scene(one, other):
        mesh = bricks(np.array([2.0, 1.0, 1.0]), np.array([2, 1, 1]), "box")
        tags = [1 + (mesh.nodes[mesh.cells].mean(axis=1)[:, 0] > 1), np.repeat([3, 4], 2)]
        meshio.Mesh(mesh.nodes, [("tetra", mesh.cells), ("triangle", np.r_[mesh.surfaces["xmin"], mesh.surfaces["xmax"]])],
                    cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
                    field_data={one: np.array([1, 3]), other: np.array([2, 3]), f"{one}e": np.array([3, 2]), f"{other}e": np.array([4, 2])},
                    ).write(tmp_path / "two.msh", file_format="gmsh22", binary=False)
        return build_scene(config_from(bar(
            mesh={"file": str(tmp_path / "two.msh")}, materials=[{"young": 1.0, "poisson": 0.3}, {"young": 2.0, "poisson": 0.3, "on": one}],
            boundary=[{"on": f"{one}e", "displacement": [0, 0, 0]}, {"on": f"{other}e", "traction": [1, 0, 0]}],
            loads=[{"on": one, "body_force": [1, 0, 0]}],
            interfaces=[{"law": "elastic", "stiffness_n": 3.0, "stiffness_t": 3.0, "between": [one, other]}],
            blackbox=[{"code": "freefem"}, {"code": "calculix", "on": one}],
            output={"figures": False, "probes": [{"at": [1, 0, 0], "part": one, "quantity": "displacement"}]})))

    plain, odd = scene("a", "b"), scene("v[1]", "v1")
    assert [s.code for s in odd.subdomains] == [s.code for s in plain.subdomains] == [1, 0]
    assert [i.law.name for i in odd.interfaces] == ["elastic"] and odd.probes[0].cell == plain.probes[0].cell
    for one, two in ((odd.cell_material, plain.cell_material), (odd.loads, plain.loads), (odd.fixed, plain.fixed)):
        assert np.array_equal(one, two)
    assert len(odd.warnings) == 2 and not plain.warnings, odd.warnings
