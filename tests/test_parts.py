"""Several meshes in one scene: parts with meshes of their own, and CAD assemblies meshed solid by solid."""

import gmsh
import pytest
from in_process import IN_PROCESS

from orchestrator.config.load import config_from
from orchestrator.config.mesh import MeshEntry
from orchestrator.errors import InputError
from orchestrator.scene.build import build_scene
from orchestrator.scene.mesh.gmsh_session import session
from orchestrator.scene.mesh.sources import make_mesh

SLAB = {"box": {"size": [1, 1, 0.5], "cells": [4, 4, 2]}}
STEEL, SOFT = {"young": 200e3, "poisson": 0.3}, {"young": 1e3, "poisson": 0.2}
BASE, LID = {"name": "base", "mesh": SLAB}, {"name": "lid", "mesh": SLAB, "move": {"translate": [0, 0, 0.5]}}
AS1 = "gmsh:as1-tu-203.stp"


def data(parts=(BASE, LID), **changes) -> dict:
    """A slab on a slab, pulled."""
    return {"name": "parts", "parts": list(parts), "subdomains": "groups", "materials": [STEEL], "blackbox": IN_PROCESS,
            "boundary": [{"on": "base/zmin", "displacement": [0, 0, 0]}, {"on": "lid/zmax", "traction": [1, 0, 10]}], **changes}


def problems(changed: dict) -> list:
    with pytest.raises(InputError) as caught:
        build_scene(config_from(changed))
    return caught.value.problems


@pytest.mark.parametrize("change, path, words", [
    ({"mesh": SLAB}, ("parts",), "mesh and parts together"),
    ({"parts": [BASE, BASE]}, ("parts", 1, "name"), "a second part called 'base'"),
    ({"parts": [{**BASE, "h": 1}]}, ("parts", 0, "h"), "not from step"),
    ({"parts": [BASE, {**LID, "element": "P2"}], "blackbox": {"element": "P1"}}, ("parts", 1, "element"), "P2 beside P1"),
    ({"parts": [BASE, {**LID, "name": "a/b"}]}, ("parts", 1, "name"), "a/b"),
    ({"parts": [BASE, {**LID, "mesh": {}}]}, ("parts", 1, "mesh"), "none of beam"),
    ({"parts": [BASE, {**LID, "mesh": {**SLAB, "exclude": ["x"]}}]}, ("parts", 1, "mesh", "exclude"), "exclude without step"),
    ({"parts": [BASE, {**LID, "mesh": {"step": AS1, "h": {"*": 5}}}]}, ("parts", 1, "mesh", "h"), "share their faces"),
    ({"parts": [BASE, {**LID, "move": {"rotate": {"axis": [0, 0, 0], "degrees": 1}}}]},
     ("parts", 1, "move", "rotate", "axis"), "[0, 0, 0]"),
    ({"materials": None, "parts": [{**BASE, "material": SOFT}, LID]}, ("materials",), "no material of lid"),
    ({"parts": [BASE, {**LID, "mesh": {"file": "nowhere.msh"}}]}, ("parts", 1, "mesh", "file"), "no such file"),
    ({"parts": [BASE, {**LID, "mesh": {"step": AS1}, "h": 1e9}]}, ("parts", 1, "h"), "h = 1e+09"),
])
def test_what_is_wrong_with_parts(change, path, words):
    found = problems(data(**change))
    assert any(p.path == path and words in p.found for p in found), found


def test_an_element_said_by_parts_holds_for_the_code():
    assert config_from(data([{**BASE, "element": "P2"}, LID], blackbox={"code": "freefem"})).codes[0].element == "P2"
    assert config_from({k: v for k, v in data([{**BASE, "element": "P2"}, LID]).items() if k != "blackbox"}).codes[0].element == "P2"


# --- solid by solid ---------------------------------------------------------------------------------------


def section(**keys) -> MeshEntry:
    return MeshEntry.model_validate({"step": AS1, "conforming": False, **keys})


@pytest.fixture(scope="module")
def dirty(tmp_path_factory) -> str:
    """A box that lacks a face, a whole one, a tiny one, and a face of nothing."""
    path = str(tmp_path_factory.mktemp("cad") / "dirty.brep")
    with session():
        occ = gmsh.model.occ
        box = occ.addBox(0, 0, 0, 1, 1, 1)
        occ.synchronize()
        faces = [tag for _, tag in gmsh.model.getBoundary([(3, box)], oriented=False)]
        occ.remove([(3, box)])
        occ.addVolume([occ.addSurfaceLoop(faces[:5])])
        occ.remove([(2, faces[5])], recursive=True)
        occ.addBox(2, 0, 0, 1, 1, 1)
        occ.addBox(4, 0, 0, 1e-3, 1e-3, 1e-3)
        occ.addRectangle(0, 0, 5, 1, 1)
        occ.synchronize()
        gmsh.write(path)
    return path


def test_dirty_models_are_told_by_solid_and_face(dirty):
    def told(**keys):
        with pytest.raises(InputError) as caught:
            make_mesh(section(step=dirty, **keys))
        return caught.value.problems

    (loose,) = told(h=0.3)
    assert "close no solid" in loose.found and "exclude: [shell_1]" in loose.cure and "(0.5, 0.5, 5)" in loose.found
    (wrong,) = told(h=0.3, exclude=["shell_1"])
    assert "solid_1 cannot be meshed: its faces do not close" in wrong.found and "solid_1:1" in wrong.found
    assert "exclude: [solid_1]" in wrong.cure
    mesh, _ = make_mesh(section(step=dirty, h=0.3, exclude=["shell_1", "solid_1"]))
    assert mesh.volumes == ["solid_2", "solid_3"]
    (remark,) = mesh.remarks
    assert remark.startswith("solid_3 is small") and "solid_3:1" in remark
    assert told(h=0.3, exclude=["sold_1"])[0].path == ("mesh", "exclude")
    assert told(h={"solid_1": 1}, exclude=["shell_1"])[0].found.startswith("no element size for solid_2")
