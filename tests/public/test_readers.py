"""Files in: what they say is read right, or refused with file and line."""

import codecs
import math
import subprocess
import sys
from pathlib import Path

import gmsh
import meshio
import numpy as np
import orchestrator
import pytest
import pyvista
import scipy.io
import scipy.sparse as sp
from helpers import HELD, STEEL, bricks, call, on, rollers, solved

CUBE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
TET = "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 0, 1, 0\n4, 0, 0, 1\n"


def scene(problem: dict) -> orchestrator.Scene:
    """Return the scene of a problem, whose base is held where nothing else is said."""
    given = {"name": "read", "subdomains": "groups", "materials": [STEEL],
             "boundary": [{"on": on("z", 0), "displacement": HELD}], **problem}
    return orchestrator.build_scene(orchestrator.config_from(given))


def mesh_of(path: Path, text: str | bytes, **more: object):
    """Return the mesh that is read of a file with this content."""
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return scene({"mesh": {"file": str(path)}, **more}).mesh


def volume(mesh) -> float:
    """Return the volume of all tets."""
    a, b, c, d = np.moveaxis(mesh.nodes[mesh.cells[:, :4]], 1, 0)
    return float(np.abs(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)).sum() / 6)


def refused(problem: dict | None = None, path: Path | None = None, text: str = "") -> str:
    """Return what is said of a problem, or a file, that is refused."""
    with pytest.raises(orchestrator.InputError) as caught:
        scene(problem) if path is None else mesh_of(path, text)
    return str(caught.value)


# Tables

def stiffness(nodes: np.ndarray, tets: np.ndarray) -> sp.csr_array:
    """Return the stiffness (3n, 3n) of four-node tets of steel."""
    mu, la = (STEEL["young"] / (2 * (1 + 0.3)), STEEL["young"] * 0.3 / (1.3 * 0.4))
    law = la * np.kron([[1, 0], [0, 0]], np.ones((3, 3))) + np.diag([2 * mu] * 3 + [mu] * 3)
    rows, columns, entries = [], [], []
    for tet in tets:
        inverse = np.linalg.inv(np.c_[np.ones(4), nodes[tet]])
        B = np.zeros((6, 12))
        for k, (x, y, z) in enumerate(inverse[1:].T):
            B[:, 3 * k:3 * k + 3] = [[x, 0, 0], [0, y, 0], [0, 0, z], [y, x, 0], [0, z, y],
                                     [z, 0, x]]
        dofs = (3 * tet[:, None] + np.arange(3)).ravel()
        rows.append(np.repeat(dofs, 12))
        columns.append(np.tile(dofs, 12))
        entries.append((B.T @ law @ B / abs(np.linalg.det(inverse)) / 6).ravel())
    found = [np.concatenate(each) for each in (entries, rows, columns)]
    return sp.csr_array((found[0], (found[1], found[2])), shape=(3 * len(nodes),) * 2)


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    """Return what runs a block that is a matrix, on a base, loaded as a table says: reaction."""
    folder = tmp_path_factory.mktemp("block")
    nodes, tets = bricks([10, 10, 10], [1, 1, 1])
    nodes = nodes + [0, 0, 10]
    scipy.io.mmwrite(folder / "K.mtx", sp.csc_matrix(stiffness(nodes, tets)), symmetry="general")
    np.savetxt(folder / "nodes.csv", np.c_[np.arange(1, 9), nodes], delimiter=",")
    faces = {tuple(sorted(t[list(f)])): t[list(f)] for t in tets for f in
             ([0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3])}
    low = [face + 1 for face in faces.values() if (nodes[face, 2] == 10).all()]
    np.savetxt(folder / "facets.csv", low, fmt="%d", delimiter=",")
    top = int(np.flatnonzero(nodes[:, 2] == 20)[0]) + 1

    def reaction(table: str | bytes) -> float:
        table = table.encode() if isinstance(table, str) else table
        (folder / "loads.csv").write_bytes(table.replace(b"TOP", str(top).encode()).replace(
            b"T\0O\0P\0", str(top).encode("utf-16-le")).replace(b"NEXT", str(top + 2).encode()))
        matrix = {"stiffness": "K.mtx", "nodes": "nodes.csv", "facets": "facets.csv",
                  "loads": "loads.csv"}
        found = solved({
            "name": "block", "subdomains": "groups", "materials": [STEEL],
            "parts": [{"name": "base",
                       "mesh": {"box": {"size": [10, 10, 10], "cells": [1, 1, 1]}}},
                      {"name": "block", "material": STEEL,
                       "matrix": {key: str(folder / file) for key, file in matrix.items()}}],
            "interfaces": [{"between": ["*", "*"], "law": "perfect"}],
            "boundary": [{"on": "base/zmin", "displacement": HELD}]})
        return found.summary["reactions"][0][0][2]

    return reaction


TWO = "TOP,0,0,-500\nNEXT,0,0,-500\n"


@pytest.mark.parametrize("table", [
    TWO, codecs.BOM_UTF8 + TWO.encode(), codecs.BOM_UTF16_LE + TWO[:13].encode("utf-16-le"),
    "Nodal loads of step 1\nid,fx,fy,fz\n-,N,N,N\n" + TWO, TWO.replace("-500", "-5.0D+02"),
    "node;fx;fy;fz\r\nTOP;0;0,0;-500,0\r\n", '"TOP","0","0","-500"\n', "TOP,0,0,-500,\n\n,,,,\n",
    "# loads\nTOP 0 0 -500 # N\n"],
    ids=["plain", "mark", "utf16", "units", "D", "semicolons", "quotes", "trailing", "blanks"])
def test_tables_are_read_from_their_first_row(table, block):
    rows = 2 if b"NEXT" in (table if isinstance(table, bytes) else table.encode()) else 1
    assert block(table) == pytest.approx(500 * rows, rel=1e-4)


@pytest.mark.parametrize("table, words", [
    ("TOP,0,0,-500 N\nNEXT,0,0,-500\n", "loads.csv:1: field 4 is no number"),
    ("TOP,0,0,-500,tip\nNEXT,0,0,-500,\n", "loads.csv:1: field 5 is no number"),
    ("nTOP,0,0,-500\nNEXT,0,0,-500\n", "loads.csv:1: field 1 is no number"),
    (TWO + "all in N\n", "loads.csv:3: field 1 is no number"),
    ("TOP,,0,-500\n", "loads.csv:1: field 2 is empty"),
    ("TOP 0,5 0,0 -500,0\n", "loads.csv:1: "),
    ('TOP,"0,5","0","-500"\n', "loads.csv:1: a comma within quotation marks"),
    ("TOP;0,5;0.5;-500\n", "loads.csv:1: decimal commas beside decimal points"),
    ("TOP,0,0,nan\n", "loads.csv:1: a number that is not finite"),
    (TWO.encode("utf-16-le"), "loads.csv: no text")])
def test_rows_that_are_no_numbers_are_refused_by_their_line(table, words, block):
    with pytest.raises(orchestrator.InputError, match=words):
        block(table)


# Abaqus and CalculiX

ONE = "*ELEMENT, TYPE=C3D4, ELSET=BODY\n1, 1, 2, 3, 4\n"
PART = f"*Part, name=P\n{TET}{ONE}*End Part\n"


@pytest.mark.parametrize("deck, volumes, surfaces", [
    # a reference point of the assembly has the number of a node of the part
    (PART + "*Assembly, name=A\n*Instance, name=P-1, part=P\n*End Instance\n*Node\n2, 9., 9., 9.\n"
     "*Nset, nset=BASE, instance=P-1\n1, 2, 3\n*Nset, nset=RP\n2,\n*End Assembly\n",
     {"BODY"}, {"BASE"}),
    # an instance with a mesh of its own, and a part that is not in the model
    (PART.replace("name=P", "name=Q") + "*Part, name=P\n*End Part\n*Assembly, name=A\n"
     f"*Instance, name=P-1, part=P\n{TET}{ONE}*End Instance\n*End Assembly\n", {"BODY"}, set()),
    # sets of two instances at one name
    (PART + PART.replace("name=P", "name=Q").replace("0, 0, 1", "0, 0, -1").replace("2, 3", "3, 2")
     + "*Assembly, name=A\n*Instance, name=P-1, part=P\n*End Instance\n"
     "*Instance, name=Q-1, part=Q\n*End Instance\n*End Assembly\n", {"P-1.BODY", "Q-1.BODY"}, set()),
    # sets that serve surfaces, or Abaqus itself
    (TET + ONE + "*ELSET, ELSET=Aux_S1\n1\n*SURFACE, NAME=BASE\nAux_S1, S1\n", {"BODY"}, {"BASE"}),
    (TET + ONE + "*ELSET, ELSET=_BASE_S1, INTERNAL\n1\n*SURFACE, NAME=BASE\n_BASE_S1, S1\n",
     {"BODY"}, {"BASE"}),
    # a face's set has its nodes, and the elements beside it
    (TET + ONE + "*NSET, NSET=BASE\n1, 2, 3\n*ELSET, ELSET=BASE\n1\n", {"BODY"}, {"BASE"}),
    (TET + ONE + "*NSET, NSET=BODY\n1, 2, 3, 4\n*NSET, NSET=BASE, GENERATE\n1, 3, 1\n",
     {"BODY"}, {"BASE"})])
def test_parts_and_sets_of_a_deck(deck, volumes, surfaces, tmp_path):
    mesh = mesh_of(tmp_path / "deck.inp", deck)
    assert set(mesh.volumes) == volumes and set(mesh.surfaces) == surfaces
    assert volume(mesh) == pytest.approx(len(volumes) / 6)
    for name in surfaces:
        assert (mesh.nodes[mesh.surfaces[name]][..., 2] == 0).all()


@pytest.mark.parametrize("deck, words", [
    (TET + "2, 5, 5, 5\n" + ONE, "deck.inp:6: node 2 a second time"),
    (TET + ONE + "1, 1, 2, 3, 4\n", "deck.inp:8: element 1 a second time"),
    (PART + "*Assembly, name=A\n*Instance, name=P-1, part=P\n1., 0., 0.\n*End Instance\n",
     "deck.inp:12: *INSTANCE, which moves nodes"),
    (PART + "*Assembly, name=A\n*Instance, name=P-1, part=P\n*End Instance\n"
     "*Instance, name=P-2, part=P\n*End Instance\n", "deck.inp:13: a second instance of a part")])
def test_numbers_that_are_there_twice_are_refused(deck, words, tmp_path):
    assert words in refused(path=tmp_path / "deck.inp", text=deck)


FAR = 999_999_999
MSH2 = ("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n5\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n"
        f"{FAR} 5 5 5\n$EndNodes\n$Elements\n1\n1 4 2 1 1 1 2 3 4\n$EndElements\n")
MSH4 = ("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n0 0 0 1\n1 0 0 0 1 1 1 0 0\n"
        f"$EndEntities\n$Nodes\n1 5 1 {FAR}\n3 1 0 5\n1\n2\n3\n4\n{FAR}\n0 0 0\n1 0 0\n0 1 0\n"
        "0 0 1\n5 5 5\n$EndNodes\n$Elements\n1 1 1 1\n3 1 4 1\n1 1 2 3 4\n$EndElements\n")
GRIDS = ("BEGIN BULK\nGRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nGRID,3,,0.,1.,0.\nGRID,4,,0.,0.,1.\n"
         f"GRID,{FAR // 10},,5.,5.,5.\nCTETRA,1,1,1,2,3,4\nENDDATA\n")


def test_memory_does_not_follow_the_largest_number(tmp_path):
    """An array by number would take gigabytes: here is half of one beyond what is taken anyway."""
    far = {"far.inp": f"{TET}{FAR}, 5, 5, 5\n{ONE}*NSET, NSET=ALL, GENERATE\n1, {FAR}, 1\n",
           "far_elements.inp": TET + ONE.replace("\n1,", f"\n{FAR},"),
           "far2.msh": MSH2, "far4.msh": MSH4, "far.bdf": GRIDS}
    for name, text in far.items():
        (tmp_path / name).write_text(text)
    code = ("import orchestrator, resource, sys\n"
            "for name in sys.argv[1:]:\n"
            "    data = {'name': 'far', 'mesh': {'file': name}, 'subdomains': 'groups',"
            "'materials': [{'young': 1.0, 'poisson': 0.3}],"
            "'boundary': [{'on': {'plane': 'z', 'at': 0}, 'displacement': [0, 0, 0]}]}\n"
            "    print(orchestrator.build_scene(orchestrator.config_from(data)).mesh.cells.shape)\n"
            "    both = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)\n"
            "    print(max(resource.getrusage(who).ru_maxrss for who in both))\n")
    # a process begins with the peak of the one that it is forked from: a shell's is small
    by_shell = ["sh", "-c", '"$@"; exit $?', "sh"]
    done = subprocess.run([*by_shell, sys.executable, "-c", code, *(tmp_path / name for name in far)],
                          capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    for name, shape, kilobytes in zip(far, lines[::2], lines[1::2], strict=True):
        assert shape == "(1, 4)" and int(kilobytes) < 700_000, (name, lines)


# Other formats

@pytest.mark.parametrize("cards, line", [
    ("GRID           1       6      0.      0.      0.\n", 2),
    ("GRID*                  1               6              0.              0.\n*  0.\n", 2),
    ("GRDSET                 6\nGRID           1              0.      0.      0.\n", 2),
    ("GRID,1,,0.,0.,0.\nGRID,2,7,1.,0.,0.\n", 3), ("INCLUDE 'rest.bdf'\n", 2)])
def test_cards_of_nastran_that_move_nodes_are_refused(cards, line, tmp_path):
    said = refused(path=tmp_path / "mesh.bdf", text=f"BEGIN BULK\n{cards}ENDDATA\n")
    assert f"mesh.bdf:{line}" in said and "basic system" in said or "INCLUDE" in cards


@pytest.fixture(scope="module")
def named(tmp_path_factory):
    """Two cubes that share a face; a volume and a face have one name."""
    folder = tmp_path_factory.mktemp("named")
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    one, two = (gmsh.model.occ.addBox(x, 0, 0, 1, 1, 1) for x in (0, 1))
    gmsh.model.occ.fragment([(3, one)], [(3, two)])
    gmsh.model.occ.synchronize()
    base = gmsh.model.getEntitiesInBoundingBox(-0.01, -0.01, -0.01, 0.01, 1.01, 1.01, 2)
    for dimension, tags, name in ((3, [1], "left"), (3, [2], "right"), (2, [base[0][1]], "left")):
        gmsh.model.addPhysicalGroup(dimension, tags, name=name)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.7)
    gmsh.model.mesh.generate(3)
    gmsh.write(str(folder / "new.unv"))
    gmsh.write(str(folder / "mesh.med"))
    for version in (2.2, 4.1):
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.write(str(folder / f"mesh{version}.msh"))
    gmsh.finalize()
    for dataset in ("2467", "2452"):
        text = (folder / "new.unv").read_text().replace("\n  2477\n", f"\n  {dataset}\n")
        (folder / f"old{dataset}.unv").write_text(text)
    return folder


@pytest.mark.parametrize("name", ["mesh2.2.msh", "mesh4.1.msh", "new.unv", "old2467.unv",
                                  "old2452.unv", "mesh.med"])
def test_one_name_in_two_dimensions_is_kept(name, named):
    mesh = scene({"mesh": {"file": str(named / name)}}).mesh
    assert sorted(mesh.volumes) == ["left", "right"] and list(mesh.surfaces) == ["left"]
    assert (np.abs(mesh.nodes[mesh.surfaces["left"]][..., 0]) < 1e-12).all()


@pytest.mark.parametrize("corners, size", [
    ([0, 1, 2, 2, 4, 5, 6, 6], 1 / 2), ([0, 1, 2, 3, 4, 4, 4, 4], 1 / 3),
    ([0, 1, 2, 2, 4, 4, 4, 4], 1 / 6), ([0, 1, 2, 3, 4, 5, 5, 4], 1 / 2),
    ([0, 0, 2, 3, 4, 4, 6, 7], 1 / 2)])
def test_collapsed_hexahedra_keep_their_volume_and_faces(corners, size, tmp_path):
    rows = "".join(f"{i}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(CUBE, 1))
    deck = (f"*NODE\n{rows}*ELEMENT, TYPE=C3D8, ELSET=BODY\n1, "
            + ", ".join(str(c + 1) for c in corners) + "\n*NSET, NSET=ALL\n1, 2, 3, 4, 5, 6, 7, 8\n"
            + "".join(f"*SURFACE, NAME=S{k}\nBODY, S{k}\n" for k in range(1, 7)))
    mesh = mesh_of(tmp_path / "deck.inp", deck)
    assert volume(mesh) == pytest.approx(size)
    triangles = np.concatenate([mesh.surfaces[f"S{k}"] for k in range(1, 7)
                                if f"S{k}" in mesh.surfaces])
    a, b, c = np.moveaxis(mesh.nodes[triangles], 1, 0)
    vectors = np.cross(b - a, c - a) / 2
    assert (np.linalg.norm(vectors, axis=1) > 0).all() and np.abs(vectors.sum(axis=0)).max() < 1e-12
    assert len(mesh.surfaces["ALL"]) == len(triangles)


def test_nodes_that_are_not_merged_are_told_with_a_cure_that_works(tmp_path):
    nodes, tets = bricks([20, 10, 10], [2, 1, 1])
    both = meshio.Mesh(np.concatenate([nodes, nodes + [20, 0, 0]]),
                       [("tetra", np.concatenate([tets, tets + len(nodes)]))])
    both.write(tmp_path / "twice.vtu")
    problem = {"mesh": {"file": str(tmp_path / "twice.vtu")},
               "boundary": [{"on": on("x", 0), "displacement": HELD}],
               "subdomains": {"slices": {"axis": "x", "count": 2}}}
    said = refused(problem)
    assert "another piece of the same volume" in said and "grid.clean()" in said
    pyvista.read(tmp_path / "twice.vtu").clean().save(tmp_path / "once.vtu")
    once = scene({**problem, "mesh": {"file": str(tmp_path / "once.vtu")}}).mesh
    assert len(once.nodes) == 2 * len(nodes) - 4


@pytest.mark.parametrize("unit, factor, words", [
    ("SI_UNIT(.MILLI.,.METRE.)", 1.0, ""), ("SI_UNIT($,.METRE.)", 1000.0, "is the metre"),
    ("SI_UNIT(.CENTI.,.METRE.)", 10.0, "is the centi metre")])
def test_lengths_of_step_files_are_mm(unit, factor, words, tmp_path):
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.occ.addBox(0, 0, 0, 1, 2, 3)
    gmsh.model.occ.synchronize()
    gmsh.write(str(tmp_path / "box.step"))
    gmsh.finalize()
    text = (tmp_path / "box.step").read_text()
    assert "SI_UNIT(.MILLI.,.METRE.)" in text
    (tmp_path / "box.step").write_text(text.replace("SI_UNIT(.MILLI.,.METRE.)", unit))
    made = scene({"mesh": {"step": str(tmp_path / "box.step"), "h": factor}})
    assert np.ptp(made.mesh.nodes, axis=0) == pytest.approx(factor * np.array([1, 2, 3]))
    told = [sentence for sentence in made.warnings if "unit of length" in sentence]
    assert bool(told) == bool(words) and words in str(told)
    assert f"the file's unit of length {words or 'is the mm'}" in call("inspect", tmp_path / "box.step", "--h", factor).out


@pytest.mark.parametrize("length, force, young, poisson, meant", [
    ("mm", "N", 210, 0.3, "2.1e+05"), ("mm", "N", 2.1e11, 0.3, "2.1e+05"),
    ("m", "N", 210e3, 0.3, "2.1e+11"), ("m", "kN", 2.1e11, 0.3, "2.1e+08"),
    ("in", "lbf", 2.1e11, 0.3, "3.046e+07"), ("mm", "N", 210e3, 0.3, None),
    ("m", "N", 210e9, 0.3, None), ("m", "kN", 210e6, 0.3, None), ("in", "lbf", 30e6, 0.3, None),
    ("mm", "N", 5.0, 0.49, None), ("ell", "N", 5.0, 0.3, None)])
def test_moduli_that_no_matter_has_in_the_units_are_told(length, force, young, poisson, meant):
    made = scene({"mesh": {"box": {"size": [1, 1, 1], "cells": [1, 1, 1]}},
                  "materials": [{"young": young, "poisson": poisson}],
                  "output": {"units": {"length": length, "force": force}}})
    told = [sentence for sentence in made.warnings if "young" in sentence]
    assert bool(told) == (meant is not None) and (meant or "") in str(told)


# Geometry

def test_no_pair_reaches_through_a_thin_layer():
    """Plates of steel about a gasket of rubber: u = p t / E_oed of the gasket and the plates."""
    plate = {"box": {"size": [1, 0.8, 0.5], "cells": [3, 2, 2]}}
    found = solved({
        "name": "gasket", "subdomains": "groups", "parts": [
            {"name": "lower", "mesh": plate, "material": STEEL},
            {"name": "gasket", "mesh": {"box": {"size": [1, 0.8, 0.005], "cells": [4, 3, 1]}},
             "move": {"translate": [0, 0, 0.5]}, "material": {"young": 20, "poisson": 0.3}},
            {"name": "upper", "mesh": {"box": {"size": [1, 0.8, 0.5], "cells": [4, 4, 2]}},
             "move": {"translate": [0, 0, 0.505]}, "material": STEEL}],
        "interfaces": [{"between": "auto", "law": "perfect"}],
        "boundary": [*({"on": on(a, 0), "symmetry": True} for a in "xyz"),
                     {"on": "upper/zmax", "pressure": 0.02}],
        "method": {"tolerance": {"error": 1e-4}},
        "output": {"figures": False, "probes": [{"name": "top", "on": "upper/zmax"}]}})
    assert len(found.scene.interfaces) == 2
    oedometric = 20 * 0.7 / (1.3 * 0.4)
    assert -0.02 * 0.005 / 20 < found.summary["probes"][0]["values"]["uz"][0] < 0.9 * -0.02 \
        * 0.005 / oedometric


@pytest.mark.parametrize("gap, tilt", [(0.0, 0), (0.05, 0), (0.2, 0), (0.2, 30)])
def test_bonds_over_a_gap_transfer_a_constant_stress(gap, tilt):
    """And let both parts be as they are drawn."""
    turn = {"rotate": [{"axis": "y", "degrees": tilt}]} if tilt else {}
    low = {"name": "low", "mesh": {"box": {"size": [1, 1, 0.5], "cells": [3, 3, 2]}}, "move":
           {"translate": [0, 0, 0], **turn}}
    up = {"name": "up", "mesh": {"box": {"size": [1, 1, 0.5], "cells": [4, 5, 2]}}}
    angle = math.radians(tilt)
    way = (0.5 + gap) * np.array([math.sin(angle), 0, math.cos(angle)])
    up["move"] = {"translate": way.tolist(), **turn}
    problem = {"name": "tied", "parts": [low, up], "subdomains": "groups",
               "materials": [{"young": 900, "poisson": 0.25}],
               "interfaces": [{"between": ["low", "up"], "law": "perfect", "tolerance": 1}],
               "boundary": [{"on": "low/zmin", "displacement": HELD}]}
    mesh = scene(problem).mesh
    assert volume(mesh) == pytest.approx(1.0, rel=1e-12)
    if not tilt:
        pulled = [*rollers("x", "y"), {"on": "low/zmin", "displacement": [None, None, 0]},
                  {"on": "up/zmax", "traction": [0, 0, -100]}]
        found = solved({**problem, "boundary": pulled,
                        "method": {"tolerance": {"error": 1e-9}}})
        assert found.summary["peak_stress"]["value"] == pytest.approx(100, rel=1e-6)


def drawn(folder: Path, thick: float, law: dict) -> dict:
    """Return a quarter of a ring on a quarter of a shaft that is drawn too thick."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    for name, inner, outer in (("shaft", 10, 20 + thick), ("ring", 20, 30)):
        gmsh.model.add(name)
        tube = gmsh.model.occ.cut(
            [(3, gmsh.model.occ.addCylinder(0, 0, 0, 0, 0, 20, outer, angle=math.pi / 2))],
            [(3, gmsh.model.occ.addCylinder(0, 0, 0, 0, 0, 20, inner, angle=math.pi / 2))])
        assert tube
        gmsh.model.occ.synchronize()
        gmsh.write(str(folder / f"{name}.step"))
    gmsh.finalize()
    return {"parts": [{"name": "shaft", "mesh": {"step": str(folder / "shaft.step"), "h": 4}},
                      {"name": "ring", "mesh": {"step": str(folder / "ring.step"), "h": 4.4}}],
            "interfaces": [{"law": "contact", "friction": 0.1, **law}],
            "boundary": [*rollers("x", "y", "z")]}


@pytest.mark.parametrize("between, thick", [("auto", 0.0025), ("auto", 0.004),
                                            (["shaft", "ring"], 0.0025)])
def test_press_fits_that_are_drawn_are_refused_with_their_number(between, thick, tmp_path):
    said = refused(drawn(tmp_path, thick, {"between": between}))
    assert f"drawn inside each other by about {thick:g}" in said and f"gap: {-thick:g}" in said


@pytest.mark.parametrize("thick, law", [
    (0.0, {"between": "auto"}), (-0.0025, {"between": "auto"}), (0.0, {"between": ["shaft", "ring"]}),
    (0.0025, {"between": "auto", "gap": -0.0025}), (0.0025, {"between": "auto", "gap": 0})])
def test_fits_that_touch_or_have_a_number_are_taken(thick, law, tmp_path):
    assert len(scene(drawn(tmp_path, thick, law)).interfaces) == 1
