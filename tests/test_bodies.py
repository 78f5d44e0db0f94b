"""A condition belongs to the body whose face it is on: what is prescribed does not leak where an interface opens."""

import numpy as np
import pytest
from contact_case import contact, converged, monolithic, start_from, written
from quick import quick

from orchestrator.scene.mesh.sources import bricks
from orchestrator.scene.mesh.mesh import Mesh

CELLS = (4, 2, 2)
UNDERSIDE, END = {"box": [[0, 0, 0], [1, 1, 0]]}, "xmin"
LAWS = {"frictionless": {"law": "contact", "friction": 0}, "friction": {"law": "contact", "friction": 0.3},
        "press fit": {"law": "contact", "friction": 0.3, "gap": -1e-3}, "jump": {"law": "jump", "jump": [1e-3, 0, 2e-3]},
        "springs": {"law": "elastic", "stiffness_n": 1e5, "stiffness_t": 2e4}}


def halves(shared: bool) -> Mesh:
    """A box of 2 × 1 × 1 in two volumes, whose nodes in the middle are shared or numbered separately."""
    mesh = bricks(np.array([2.0, 1.0, 1.0]), np.array(CELLS), "box")
    mesh.volume = (mesh.nodes[mesh.cells].mean(axis=1)[:, 0] > 1).astype(int)
    mesh.volumes = ["left", "right"]
    if not shared:
        middle = np.flatnonzero(mesh.nodes[:, 0] == 1)
        copy = np.arange(len(mesh.nodes))
        copy[middle] = len(mesh.nodes) + np.arange(len(middle))
        mesh.nodes = np.r_[mesh.nodes, mesh.nodes[middle]]
        right = mesh.volume == 1
        mesh.cells[right] = copy[mesh.cells[right]]
        for name, triangles in mesh.surfaces.items():
            right = mesh.nodes[triangles][:, :, 0].mean(axis=1) > 1
            mesh.surfaces[name] = np.where(right[:, None], copy[triangles], triangles)
    return mesh


def scene_of(folder, law, shared=True, held=UNDERSIDE, element="P1", **changes):
    """The left half held on a face, the right one's end moved towards it and down."""
    path = folder / "halves.msh"
    return contact(law=[law], mesh=written(path, halves(shared)), subdomains="groups", **{
        "boundary": [{"on": held, "displacement": [0, 0, 0]}, {"on": "xmax", "displacement": [-1e-3, 0, -1e-2]}],
        "blackbox": {"code": "in-process", "workers": 1, "element": element}, "poisson": 0.0, **changes})


@pytest.mark.parametrize("held", quick([UNDERSIDE, END], END), ids=["underside", "end"])
@pytest.mark.parametrize("shared", [True, False], ids=["shared", "separate"])
def test_nothing_carries_shear_where_nothing_rubs(tmp_path, shared, held):
    reactions = np.array(converged(scene_of(tmp_path, LAWS["frictionless"], shared, held)).reactions)[:, 0]
    assert np.abs(reactions[:, 1:]).max() <= 1e-8 * reactions[0, 0] and reactions[0, 0] > 90
    assert reactions.sum(axis=0) == pytest.approx(0, abs=1e-8 * reactions[0, 0])


@pytest.mark.parametrize("name, element",
                         [("frictionless", "P1"), ("friction", "P1"), ("press fit", "P1"), ("jump", "P1"), ("friction", "P2"),
                                           ("jump", "P2"), ("frictionless", "P2"), ("press fit", "P2")])
@pytest.mark.long
def test_one_piece_says_the_same(tmp_path, name, element):
    """Every law against what is prescribed on the other side, that moves as well: the monolithic solution."""
    made = scene_of(tmp_path, LAWS[name], element=element, poisson=0.3, boundary=[
        {"on": UNDERSIDE, "displacement": [5e-4, 0, -1e-3]},
        {"on": "xmax", "displacement": [-1e-3, 0, -1e-2]}])
    solved = converged(made)
    whole = monolithic(solved)
    (step,) = whole.solve(start_from(solved))
    assert step.converged
    for ours, exact in zip(solved.parts, step.parts):
        assert np.abs(ours[0] - exact).max() <= 1e-7 * 1e-2
    (interface,) = solved.scene.interfaces
    held = [s.fixed[own] for s, own in zip(solved.scene.subdomains, interface.nodes)]
    assert held[0].any() and not held[1].any()
    assert interface.free.all() or element == "P2"  # in contact corners alone have points
    exact = whole.reactions(0, step.parts, step.force)
    ours = np.array(solved.reactions)[:, 0]
    left = solved.scene.mesh.nodes[:, 0] <= 1
    for reaction, there in zip(ours, (left, ~left)):
        assert reaction == pytest.approx(exact[there].sum(axis=0), abs=1e-7 * np.abs(ours).max())
