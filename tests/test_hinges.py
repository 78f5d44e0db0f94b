"""Bodies that hang together by an edge or a corner alone, cut there: what one mesh holds stays together."""

import numpy as np
import pytest
from boxes import boxed
from method_case import config, method, saved, solved
from quick import late

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.scene.build import build_scene
from orchestrator.scene.mesh.sources import bricks
from orchestrator.scene.mesh.mesh import Mesh

BASE = [(i, j, 0) for i in range(2) for j in range(2)]
EDGE = [*BASE, (0, 0, 1), (1, 1, 1)]  # two voxels on a base, that share an edge
CORNER = [(0, 0, 0), (0, 1, 0), (1, 1, 1), (0, 1, 1), (0, 0, 2), (0, 1, 2), (1, 0, 2), (1, 0, 3), (0, 0, 3)]  # a frame, a corner in it
AROUND = [(i, j, 0) for i in range(3) for j in range(3)] + [(0, 0, 1), (1, 1, 1), (2, 2, 1), (0, 2, 1), (2, 0, 1)]
HELD = {"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]}


def voxels(filled, cells=1, volume=lambda centre: np.zeros(len(centre), dtype=int)) -> Mesh:
    """Unit cubes of cells³ bricks each that share the nodes where they touch."""
    shape = np.max(filled, axis=0) + 1
    box = bricks(shape.astype(float), shape * cells, "voxels")
    there = np.zeros(shape, dtype=bool)
    there[tuple(np.transpose(filled))] = True
    kept = box.cells[there[tuple(box.nodes[box.cells].mean(axis=1).astype(int).T)]]
    used, cells = np.unique(kept, return_inverse=True)
    cells, nodes = cells.reshape(kept.shape), box.nodes[used]
    return Mesh(nodes, cells, volume(nodes[cells].mean(axis=1)), ["all"])


def pulled(filled) -> list[dict]:
    """Held below, pulled and sheared above."""
    return [HELD, {"on": {"plane": "z", "at": float(np.max(filled, axis=0)[2] + 1)}, "traction": [1, -2, 3]}]


def assert_bounded(solution) -> None:
    error, bound = solution.summary["true_error"], solution.error_bound
    assert solution.converged and error <= bound <= 5 * error + 1e-10, (error, bound)


@pytest.mark.parametrize("filled, cells, cut, element", [
    (EDGE, 1, {"metis": 2}, "P1"), late(EDGE, 2, {"slices": {"axis": "x", "count": 2}}, "P1"), late(EDGE, 1, {"metis": 3}, "P2"),
    (AROUND, 1, {"slices": {"axis": "x", "count": 3}}, "P1"), late(CORNER, 1, {"metis": 9}, "P1"),
])
def test_a_cut_through_an_edge_or_a_corner_leaves_it_whole(tmp_path, filled, cells, cut, element):
    """The answer is that of the mesh in one piece, and the bound holds."""
    made = dict(mesh=saved(voxels(filled, cells), tmp_path / "voxels.mesh"), subdomains=cut, boundary=pulled(filled),
                blackbox={"code": "in-process", "workers": 1, "element": element}, **method(tolerance={"error": 1e-6}))
    assert any(not len(i.triangles) for i in build_scene(config(**made)).interfaces)
    assert_bounded(solved(**made))


def test_a_law_that_opens_does_nothing_along_an_edge(tmp_path):
    """Between two volumes that share an edge: bonded unless an entry says otherwise; contact there is refused by name."""
    mesh = saved(voxels(EDGE, volume=lambda centre: (centre[:, 2] > 1) * (1 + (centre[:, 0] > 1))), tmp_path / "voxels.mesh")
    made = dict(mesh=mesh, subdomains="groups", boundary=pulled(EDGE))
    names = build_scene(config(**made)).mesh.volumes

    def bare(*entries):
        scene = build_scene(config(**made, interfaces=list(entries)))
        return [i.name for i in scene.interfaces if not len(i.triangles)]

    on_base = {"between": [names[0], "*"], "law": "contact"}
    assert bare() == bare(on_base) == [f"{names[1]} | {names[2]}"]
    assert bare({"between": ["*", "*"], "law": "contact"}) == []
    with pytest.raises(InputError, match="no interface between .*: they share no face"):
        bare({"between": names[1:], "law": "contact"})


SPRINGS = {"law": "elastic", "stiffness_n": 1e5, "stiffness_t": 1e5}


def pads(at, law, cells=(2, 2, 1), size=(2, 2, 1)):
    """A slab on cubes that are held, of which each has a corner under it."""
    names = [f"p{i}" for i in range(len(at))]
    return config_from({
        "name": "pads", "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}],
        "parts": [boxed("slab", size, cells, [0, 0, 1]), *(boxed(name, cells=(1, 1, 1), at=[*xy, 0]) for name, xy in zip(names, at))],
        "boundary": [{"on": f"{name}/zmin", "displacement": [0, 0, 0]} for name in names] + [{"on": "slab/zmax", "traction": [1, 0, -1]}],
        "interfaces": [{"between": ["slab", name], **law} for name in names]})


@pytest.mark.parametrize("law", [{"law": "perfect"}, {"law": "jump", "jump": [0, 0, 0.1]}, SPRINGS], ids=lambda law: law["law"])
@pytest.mark.parametrize("at", [[(1.7, 1.7)], [(1.7, 1.7), (-0.7, -0.7)]], ids=["one corner", "two corners"])
def test_few_points_of_meshes_that_do_not_match_are_hinges(law, at):
    """What overlaps on a corner of a facet is carried by one point or two: it turns about them, and is told before a run."""
    with pytest.raises(InputError, match="slab .*can still move as a rigid body: rotation") as caught:
        build_scene(pads(at, law))
    assert "so little in common beside the size of their facets that" in str(caught.value) and "mesh both finer there" in str(caught.value)


@pytest.mark.parametrize("made", [pads([(1.7, 1.7), (-0.7, -0.7), (1.7, -0.7)], {"law": "perfect"}),
                                  pads([(1.7, 1.7)], {"law": "contact", "friction": 0.3}),
                                  pads([(1.0, 0.7)], {"law": "perfect"})], ids=["three corners", "contact", "a whole side"])
def test_points_that_hold_together_are_enough(made):
    build_scene(made)
