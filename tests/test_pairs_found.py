"""Faces that lie on each other, found whatever their meshes: against conforming meshes, on curves, in time."""

import re
from math import cos, pi, sin

import gmsh
import numpy as np
import pytest
from boxes import boxed
from quick import late
from yaml_case import call

from orchestrator.config.load import config_from
from orchestrator.config.mesh import MeshEntry as Section, Move
from orchestrator.errors import InputError
from orchestrator.scene.build import build_scene
from orchestrator.scene.cautions import scene_cautions
from orchestrator.scene.inspection import ROOM, pairs_of_mesh
from orchestrator.scene.mesh.faces import faces_of
from orchestrator.scene.mesh.geometry import areas
from orchestrator.scene.mesh.gmsh_session import session
from orchestrator.scene.mesh.sources import make_mesh, moved
from orchestrator.scene.mesh.mesh import Mesh


def section(**keys) -> Section:
    return Section.model_validate(keys)


def found(mesh: Mesh) -> dict[tuple[str, str], float]:
    """Common area by pair."""
    areas: dict[tuple[str, str], float] = {}
    for row in (row for row in pairs_of_mesh(mesh, faces_of(mesh.cells, len(mesh.nodes))) if row.meshes != ROOM):
        pair = tuple(sorted((row.one, row.two)))
        areas[pair] = areas.get(pair, 0.0) + row.area
    return areas


@pytest.fixture(scope="module")
def flange(tmp_path_factory) -> str:
    """Two flanges, the upper one threaded on a sleeve that fits, and four bolts: shanks in holes with room, heads on top,
    nuts below that fit the shanks."""
    path = str(tmp_path_factory.mktemp("cad") / "flange.brep")
    with session():
        occ = gmsh.model.occ
        places = [(35 * cos(pi * i / 2 + 0.3), 35 * sin(pi * i / 2 + 0.3)) for i in range(4)]
        def holes():
            return [(3, occ.addCylinder(x, y, -20, 0, 0, 40, 5)) for x, y in places] + [(3, occ.addCylinder(0, 0, -20, 0, 0, 40, 20))]
        for z in (-10, 0):
            occ.cut([(3, occ.addCylinder(0, 0, z, 0, 0, 10, 50))], holes())
        occ.cut([(3, occ.addCylinder(0, 0, -10, 0, 0, 20, 20))], [(3, occ.addCylinder(0, 0, -10, 0, 0, 20, 15))])
        for x, y in places:
            occ.fuse([(3, occ.addCylinder(x, y, -16, 0, 0, 26, 4))], [(3, occ.addCylinder(x, y, 10, 0, 0, 5, 8))])
            occ.cut([(3, occ.addCylinder(x, y, -16, 0, 0, 6, 8))], [(3, occ.addCylinder(x, y, -16, 0, 0, 6, 4))])
        occ.synchronize()
        gmsh.write(path)
    return path


@pytest.mark.parametrize("sizes", [late(7), {"*": 9, "solid_[12]": 5}], ids=["same size", "sizes by solid"])
def test_pairs_are_those_of_the_conforming_mesh(sizes, flange):
    """All of them, and no false one: bolts in nuts that fit, of any chords; shanks in holes with room are none."""
    one, _ = make_mesh(section(step=flange, h=7))
    apart, _ = make_mesh(section(step=flange, h=sizes, conforming=False))
    expected, got = found(one), found(apart)
    assert len(expected) == 15 and set(got) == set(expected)
    for pair, area in expected.items():
        assert got[pair] == pytest.approx(area, rel=0.2), pair


READ = {"law": "contact", "gap": "geometry"}


@pytest.mark.parametrize("gap, cells, entry", [
    late(2.0, 2, READ), (2.0, 3, READ), late(2.5, 2, {**READ, "within": 2.5}), late(3.7, 3, {**READ, "within": 3.7}),
    late(1e-3, 2, {"law": "contact"}),
    late(0.2, 3, {"law": "perfect", "tolerance": 0.3}), late(-0.2, 3, {"law": "contact", "gap": -0.2, "tolerance": 0.3})],
    ids=["twice the size", "twice the size, not matching", "a length", "a length, not matching", "nodes that coincide", "a tolerance", "a press fit"])
def test_faces_at_a_limit_are_paired_however_axes_lie(gap, cells, entry):
    """All of them: a distance that is the limit rounds to either side of it."""
    for k in range(12):
        rotate = {"axis": [1, k, 3 - k], "degrees": 17 * k}
        place = moved(np.array([[0.0, 0.0, 1 + gap]]), Move.model_validate({"rotate": rotate}))[0].tolist()
        scene = build_scene(config_from({
            "name": "limit", "subdomains": "groups", "materials": [{"young": 1.0, "poisson": 0.3}], "interfaces": [{**entry, "between": ["a", "b"]}],
            "parts": [boxed("a", [2, 2, 1], [2, 2, 1], move={"rotate": rotate}),
                      boxed("b", [2, 2, 1], [cells, cells, 1], move={"rotate": rotate, "translate": place})],
            "boundary": [{"on": face, "displacement": [0, 0, 0]} for face in ("a/zmin", "b/zmax")]}))
        (interface,) = scene.interfaces
        assert areas(scene.mesh.nodes[interface.global_nodes], interface.triangles).sum() == pytest.approx(4.0), k


def test_a_file_is_inspected(tmp_path, flange):
    done = call("inspect", flange, "--h", "9")
    assert done.exit_code == 0 and "11 volumes" in done.stdout
    rows = [line for line in done.stdout.splitlines() if " | " in line]
    room = [row for row in rows if "with room" in row]
    assert len(room) >= 4 and all(re.search(r"  1 +with room", row) for row in room)  # shanks in holes of the flanges
    rows = [row for row in rows if row not in room]
    assert len(rows) == 15 and sum("not matching" in row for row in rows) >= 12
    path = tmp_path / "two.yaml"
    slab = "{box: {size: [1, 1, 0.5], cells: [4, 4, 2]}}"
    path.write_text(f"name: two\nparts:\n  - {{name: base, mesh: {slab}}}\n"
                    f"  - {{name: lid, mesh: {slab}, move: {{translate: [0, 0, 0.5]}}}}\n"
                    "subdomains: groups\nmaterials: [{young: 1, poisson: 0.3}]\ninterfaces: [{between: auto, law: contact}]\n"
                    "boundary: [{on: base/zmin, displacement: [0, 0, 0]}, {on: lid/zmax, displacement: [0, 0, 0]}]\n")
    done = call("inspect", path)
    assert done.exit_code == 0 and "base | lid" in done.stdout and "matching" in done.stdout and "lid/zmax" in done.stdout
    checked = call("check", path)
    assert checked.exit_code == 0 and "base | lid" in checked.stdout
    path.write_text(path.read_text().replace("base/zmin", "base/zmni"))
    done = call("inspect", path)
    assert done.exit_code == 0 and "no scene yet, 1 problem" in done.stdout and "base/zmin" in done.stdout
    assert call("inspect", tmp_path / "nothing.msh").exit_code == 2
    for command in (["inspect"], ["init", tmp_path / "new.yaml"]):
        folder = call(*command, tmp_path)
        (tmp_path / "summary.json").touch()
        results = call(*command, tmp_path)
        (tmp_path / "summary.json").unlink()
        assert folder.exit_code == results.exit_code == 2
        assert "a folder\n" in folder.stderr and "a mesh, STEP or BREP file" in folder.stderr
        assert f"orchestrator report {tmp_path}" in results.stderr


# --- what is wrong ----------------------------------------------------------------------------------------

SLAB = {"box": {"size": [1, 1, 0.5], "cells": [4, 4, 2]}}
OTHER = {"box": {"size": [1, 1, 0.5], "cells": [3, 3, 1]}}
AUTO = {"between": "auto", "law": "contact", "friction": 0.2}


def slabs(lift: float, *entries, aside: float = 0.0, **changes) -> dict:
    """A slab above another one, its mesh another one, both held."""
    return {"name": "slabs", "parts": [{"name": "base", "mesh": SLAB},
                                       {"name": "lid", "mesh": OTHER, "move": {"translate": [aside, 0, 0.5 + lift]}}],
            "subdomains": "groups", "materials": [{"young": 1.0, "poisson": 0.3}], "interfaces": list(entries or [AUTO]),
            "boundary": [{"on": "base/zmin", "displacement": [0, 0, 0]}, {"on": "lid/zmax", "displacement": [0, 0, 0]}],
            **changes}


@pytest.mark.parametrize("made, words, cure", [
    (slabs(0.1), ["look at each other 0.1 apart", "nothing connects"], "exclude: [[base, lid]]"),
    (slabs(2.0), ["base has no pair: the nearest other part is 'lid', 2 from node to node"], "exclude: [[base, '*']]"),
    (slabs(-0.2), ["inside each other by about 0.2"], "move the parts"),
    (slabs(-0.02), ["penetrate each other", "by up to 0.02"], "press fit"),
    (slabs(0.0, {**AUTO, "exclude": [["base", "ldi"]]}), ["'ldi' matches no"], "did you mean lid?"),
    (slabs(0.0, {**AUTO, "slave": "bse"}), ["'bse' matches no"], "did you mean base?"),
], ids=["beyond reach", "alone", "overlap", "penetration", "exclude", "slave"])
def test_what_is_wrong_with_pairs(made, words, cure):
    with pytest.raises(InputError) as caught:
        build_scene(config_from(made))
    found = [p for p in caught.value.problems if all(word in p.found for word in words)]
    assert found and any(cure in p.cure for p in found), str(caught.value)
    assert all(p.path[:2] == ("interfaces", 0) for p in found)


def test_loads_on_faces_that_lie_on_another_part_are_told():
    """A plane takes the faces of both parts."""
    for on, words in (({"plane": "z", "at": 0.5}, "50 faces of base, lid"), ("lid/zmax", "")):
        made = slabs(0.0, boundary=[{"on": "base/zmin", "displacement": [0, 0, 0]}, {"on": on, "pressure": 1.0},
                                    {"on": "lid/xmin", "displacement": [0, 0, 0]}])
        warnings = scene_cautions(build_scene(config_from(made)))
        assert [words in w and "lie on another part" in w for w in warnings] == ([True] if words else [])
