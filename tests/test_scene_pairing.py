"""Interfaces of parts that share no faces: coincident nodes, gaps from the geometry, and what does not match."""


import numpy as np
import pytest
from contact_case import contact, converged, written

from orchestrator.config.model import Config
from orchestrator.errors import InputError
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.cautions import scene_cautions
from orchestrator.scene.mesh.sources import bricks
from orchestrator.scene.mesh.mesh import Mesh

HELD = {"on": "lower zmin", "displacement": [0, 0, 0]}
PATH = [[0.0, 0.0, -0.005], [0.01, 0.0, -0.005], [0.0, 0.002, -0.004]]
MOVED = {"on": "upper zmax", "displacement": PATH}
MEASURED = {"law": "contact", "friction": 0.3, "gap": "geometry"}


def two_parts(move=lambda x: x, cells=(4, 4, 2), upper=(4, 4, 2)) -> Mesh:
    """Two boxes of 1 × 1 × 0.5, one on the other, each with its own nodes; the upper one's are moved."""
    low, top = (bricks(np.array([1.0, 1.0, 0.5]), np.array(c), "box") for c in (cells, upper))
    count = len(low.nodes)
    surfaces = {f"lower {n}": t for n, t in low.surfaces.items()} | {f"upper {n}": t + count for n, t in top.surfaces.items()}
    return Mesh(np.r_[low.nodes, move(top.nodes + [0, 0, 0.5])], np.r_[low.cells, top.cells + count],
                np.repeat([0, 1], [len(low.cells), len(top.cells)]), ["lower", "upper"], surfaces)


def joined(mesh: Mesh) -> Mesh:
    """The same mesh with coincident nodes made one."""
    nodes, new = np.unique(np.round(mesh.nodes, 12), axis=0, return_inverse=True)
    new = new.ravel()
    return Mesh(nodes, new[mesh.cells], mesh.volume, mesh.volumes, {n: new[t] for n, t in mesh.surfaces.items()})


def made(folder, mesh, law, boundary=(HELD, MOVED), **changes):
    name = f"{len(list(folder.iterdir()))}.msh"
    return contact(law=[law], mesh=written(folder / name, mesh), subdomains="groups", boundary=list(boundary), **changes)


def problems(config):
    with pytest.raises(InputError) as caught:
        build_scene(config)
    return caught.value.problems


LAWS = {"perfect": {"law": "perfect"}, "friction": {"law": "contact", "friction": 0.3},
        "press fit": {"law": "contact", "friction": 0.3, "gap": -0.001}, "jump": {"law": "jump", "jump": [0.001, 0, 0.002]}}


@pytest.mark.parametrize("name, kind", [("perfect", "symmetric"), ("friction", "springs"), ("friction", "symmetric"),
                                        ("press fit", "springs"), ("jump", "springs")])
@pytest.mark.long
def test_coincident_nodes_are_as_good_as_shared_ones(name, kind, tmp_path):
    """Whatever the law and the sole: the same displacement of either part, the same forces."""
    sole = {"sole": {"kind": "layer" if kind == "springs" else kind, "contact": kind}}
    method = {"tolerance": {"error" if name == "perfect" else "law": 1e-10}, "max_iterations": 1000, **sole}
    parts = two_parts()
    apart, one = (converged(made(tmp_path, m, LAWS[name], method=method)) for m in (parts, joined(parts)))
    (interface,) = apart.scene.interfaces
    assert len(interface.global_nodes) == 25 and type(interface.law) is type(one.scene.interfaces[0].law)
    for a, b, u, v in zip(apart.scene.subdomains, one.scene.subdomains, apart.parts, one.parts):
        x, y = apart.scene.mesh.nodes[a.nodes], one.scene.mesh.nodes[b.nodes]
        same = np.argmin(np.linalg.norm(x[:, None] - y, axis=2), axis=1)
        assert np.abs(u - v[:, same]).max() <= 1e-8 * 0.01
    force = np.array(one.summary["reactions"])
    assert np.abs(np.array(apart.summary["reactions"]) - force).max() <= 1e-8 * np.abs(force).max()


@pytest.mark.parametrize("change, law, words", [
    (lambda x: x + [0, 0, 2.0], MEASURED, ["nearest nodes are 2 apart", "within 0.5"]),
    (lambda x: x + [0, 0, 0.2], {**MEASURED, "within": 0.1}, ["nearest nodes are 0.2 apart", "within 0.1"]),
    (lambda x: x - [0, 0, 0.02], MEASURED, ["penetrate each other", "by up to 0.02"]),
], ids=["far", "within", "penetration"])
def test_gaps_that_cannot_be_measured(change, law, words, tmp_path):
    found = problems(made(tmp_path, two_parts(change), {"between": ["lower", "upper"], **law}))
    wrong = next(p for p in found if p.path == ("interfaces", 0, "gap"))
    assert all(word in wrong.found + wrong.expected for word in words), str(wrong)


def test_what_nothing_holds(tmp_path):
    """A part is held through its pair; without the pair it is named."""
    pushed = {"on": "upper zmax", "pressure": 1.0}
    build_scene(made(tmp_path, two_parts(), LAWS["friction"], (HELD, pushed)))
    apart, wrong = problems(made(tmp_path, two_parts(lambda x: x + [0, 0, 0.01]), LAWS["friction"], (HELD, pushed)))
    assert apart.path == ("interfaces", 0, "between")
    assert wrong.path == ("boundary",) and wrong.found.startswith("upper (one of 2 separate bodies")


def test_pairs_prescribed_on_one_side_only(tmp_path):
    side = {"on": "lower xmin", "displacement": [0, None, None]}
    (interface,) = build_scene(made(tmp_path, two_parts(), LAWS["friction"], (HELD, side, MOVED))).interfaces
    assert interface.free.all(), "the other side is free"
    both = {"on": {"plane": "x", "at": 0.0}, "displacement": [0, None, None]}
    scene = build_scene(made(tmp_path, two_parts(), LAWS["friction"], (HELD, both)))
    assert (~scene.interfaces[0].free[:, 0]).sum() == 5 and scene.interfaces[0].free[:, 1:].all()


# --- near without an interface ----------------------------------------------------------------------------

ALL = {"law": "contact", "friction": 0.1}
NAMED = {"between": ["lower", "upper"], **ALL}


def moved_corner(by):
    """Moves the node in the middle of the upper part's lower face."""
    return lambda x: x + np.where((x == [0.5, 0.5, 0.5]).all(axis=1)[:, None], by, 0.0)


@pytest.mark.parametrize("mesh, law, path, words", [
    (two_parts(lambda x: x + [0, 0, 0.01]), ALL, ("interfaces", 0, "between"), ["nearest nodes are 0.01 apart"]),
    (two_parts(lambda x: x + [0, 0, 0.01]), NAMED, ("interfaces", 0, "between"), ["nearest nodes are 0.01 apart"]),
    (two_parts(moved_corner([0, 0, 0.01])), {"law": "perfect"}, ("interfaces", 0), ["6 faces of", "up to 0.01"]),
    (two_parts(moved_corner([0, 0, 0.01])), None, ("mesh",), ["6 faces of", "up to 0.01"]),
    (two_parts(lambda x: x - [0, 0, 0.19]), None, ("mesh",), ["inside each other by about 0.19"]),
    (two_parts(lambda x: x * [0.5, 0.5, 1] + [0.25, 0.25, -0.3]), None, ("mesh",), ["inside each other by about"]),
], ids=["gap", "gap, named", "node off", "node off, no entry", "deep", "small in large"])
def test_what_is_near_without_an_interface(mesh, law, path, words, tmp_path):
    wrong = problems(made(tmp_path, mesh, law) if law else unasked(tmp_path, mesh))[0]
    assert wrong.path == path and all(word in wrong.found for word in words), str(wrong)


@pytest.mark.parametrize("mesh, law, points, gap", [
    (two_parts(upper=(3, 3, 2)), ALL, 16, 0.0),
    (two_parts(moved_corner([0.02, 0, 0])), ALL, 25, 0.0),
    (two_parts(lambda x: x + [0.11, 0, 0.01]), NAMED | MEASURED, 25, 0.01),
], ids=["meshed apart", "node aside", "sideways"])
def test_what_does_not_match_has_operators(mesh, law, points, gap, tmp_path):
    """One node aside is enough: no part of the faces is left to pairs of nodes."""
    (interface,) = build_scene(made(tmp_path, mesh, law)).interfaces
    assert len(interface.mortar) == points and np.abs(interface.mortar.gap - gap).max() < 1e-12
    assert np.abs(interface.law.distance - gap).max() < 1e-12


def unasked(folder, mesh):
    """Without a word on interfaces."""
    data = made(folder, mesh, ALL).model_dump(exclude={"interfaces"}, exclude_unset=True)
    return Config.model_validate(data)


@pytest.mark.parametrize("change, words", [
    (lambda x: x + [0, 0, 0.01], "touch, at"), (lambda x: x + [0, 0, 0.1], "are 0.1 apart, at"),
    (lambda x: x + [0, 0, 0.7], ""), (lambda x: x, "")], ids=["a hundredth", "a tenth", "far", "joined"])
def test_parts_merely_near_are_told(change, words, tmp_path):
    warnings = [w for w in scene_cautions(build_scene(unasked(tmp_path, two_parts(change)))) if "apart" in w or "interface" in w]
    assert len(warnings) == bool(words)
    assert not words or warnings[0].startswith(f"'lower' and 'upper' {words}")


@pytest.mark.parametrize("by, words", [(0.05, []), (0.2, ["pass through each other by about 0.1 at load step 2"])])
def test_parts_that_pass_through_each_other(by, words, tmp_path):
    """Blocks 0.1 apart without an interface, the upper one pushed down."""
    moved = {"on": "upper zmax", "displacement": [[0, 0, -0.02], [0, 0, -by], [0, 0, 0]]}
    data = unasked(tmp_path, two_parts(lambda x: x + [0, 0, 0.1])).model_dump(exclude_unset=True)
    warnings = solve(Config.model_validate({**data, "boundary": [HELD, moved]})).summary["warnings"]
    found = [text for text in warnings if "pass through" in text and "load step" in text]
    assert len(found) == len(words) and all(word in text for word, text in zip(words, found))
