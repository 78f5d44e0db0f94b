"""Volumes cut further: sound pieces, laws that do not see the cuts, and the same solution."""

import method_case as case
import numpy as np
import pytest

from orchestrator.config.model import Config
from orchestrator.errors import InputError
from orchestrator.scene.build import build_scene
from orchestrator.scene.mesh.faces import faces_of, pieces
from orchestrator.scene.mesh.sources import bricks

CONTACT = {"law": "contact", "friction": 0.2}


def split(above, **changes) -> Config:
    """A changed configuration whose volumes are cut further; None leaves them whole."""
    return case.config(**changes, subdomains="groups" if above is None else {"groups": True, "split_above": above})


def arch(path, cells=(6, 6, 6)):
    """Two volumes on top of each other that meet in a curved surface; the lower one is three times as thick."""
    mesh = bricks(np.array([2.0, 2.0, 2.0]), np.array(cells), "box")
    centre = mesh.nodes[mesh.cells].mean(axis=1)
    mesh.volume = (centre[:, 2] > 4 / 3).astype(int)
    x, y, z = mesh.nodes.T
    mesh.nodes[:, 2] += 0.15 * np.sin(2 * x + 1) * np.cos(1.5 * y) * z * (2 - z)
    return case.saved(mesh, path)


def pressed(mesh, above, **changes):
    """The arch pressed and dragged; a law by volume."""
    return split(above, mesh=mesh, boundary=[
        {"on": {"plane": "z", "at": 0.0}, "displacement": [0, 0, 0]},
        {"on": {"plane": "z", "at": 2.0}, "displacement": [[0, 0, -0.02], [0.01, 0, -0.02], [0.02, 0.01, -0.02]]}],
        method={"tolerance": {"law": 1e-10}, "max_iterations": 600}, **changes)


def test_pieces_are_connected_named_and_small_enough(tmp_path):
    mesh = case.layered(tmp_path / "bar.mesh", [0, 1, 1, 1], cells=(16, 4, 4))
    whole = build_scene(split(None, mesh=mesh))
    assert [3 * len(s.nodes) for s in whole.subdomains] == [375, 975]
    made = build_scene(split(400, mesh=mesh))
    small, *rest = made.subdomains
    big = whole.subdomains[1].name
    assert small.name == small.body == whole.subdomains[0].name
    assert [s.name for s in rest] == [f"{big}.{i + 1}" for i in range(len(rest))] and len(rest) >= 3
    assert {s.body for s in rest} == {big}
    assert max(3 * len(s.nodes) for s in made.subdomains) <= 400
    assert pieces(faces_of(made.mesh.cells, len(made.mesh.nodes)), made.cell_subdomain)[0] == len(made.subdomains)
    assert all((made.mesh.volume[s.cells] == (s.body == big)).all() for s in made.subdomains)
    assert sum(len(s.cells) for s in made.subdomains) == len(made.mesh.cells)


def test_laws_are_those_of_the_bodies(tmp_path):
    mesh = arch(tmp_path / "arch.mesh")
    base, cap = (s.name for s in build_scene(pressed(mesh, None)).subdomains)
    for law in ({}, {"between": [cap, base]}, {"between": [base, "*"]}, {"between": ["*.1", f"{cap}*"]}):
        made = build_scene(pressed(mesh, 250, interfaces=[{**CONTACT, **law}]))
        assert len(made.subdomains) > 4
        within = [i for i in made.interfaces if len({made.subdomains[e].body for e in i.subdomains}) == 1]
        between = [i for i in made.interfaces if i not in within]
        assert len(within) >= 3 and all(i.law.perfect for i in within)
        contact = [i for i in between if i.law.name == "contact"]
        if ".1" in str(law):  # one piece named by itself
            assert 0 < len(contact) < len(between)
        else:
            assert len(contact) == len(between) > 1


def test_law_between_pieces_of_one_body_is_refused(tmp_path):
    mesh = arch(tmp_path / "arch.mesh")
    base = build_scene(pressed(mesh, None)).subdomains[0].name
    with pytest.raises(InputError) as caught:
        build_scene(pressed(mesh, 250, interfaces=[{**CONTACT, "between": [f"{base}.1", f"{base}.*"]}]))
    (problem,) = caught.value.problems
    assert problem.path == ("interfaces", 0, "between") and "pieces of one body" in problem.found
    build_scene(pressed(mesh, 250, interfaces=[{"law": "perfect", "between": [f"{base}.1", f"{base}.*"]}]))
