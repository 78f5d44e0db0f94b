"""Scenes that ranks make together: the parts that are cut of the whole, which nobody has; or none, where one has to judge."""

import itertools
import threading
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace

import gmsh
import meshio
import numpy as np
import pytest
from meshes.bar import bar
from quick import late, quick, quick_sets
from boxes import boxed
from in_process import IN_PROCESS
from ranks_case import CASES
from threads import among

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.mesh.files import read
from orchestrator.scene import body
from orchestrator.scene.mesh import grain_meshes, solids as solid_meshes
from orchestrator.scene.mesh.gmsh_session import session
from orchestrator.scene.mesh.grain_meshes import GrainMesher
from orchestrator.scene.build import build_scene
from orchestrator.scene.cautions import scene_cautions
from orchestrator.scene.conditions.probes import Surface
from orchestrator.scene.part import overview, part_of
from orchestrator.scene.mesh.sources import bricks
from orchestrator.scene.pieces.make import make
from orchestrator.solving import Ranks, scene_of

# nobody asks for numbers of nodes and cells of faces to slide on once operators are made; of
# neighbours' nodes away from the interface nobody asks for forces, and cells that give them may be missing; the rest is told apart
ELSEWHERE = (".loads", ".rank_of", *(f".surfaces.{name}[{side}]" for name in ("nodes", "cells") for side in (0, 1)))


def exactly(ours, other):
    return np.array_equal(ours, other, equal_nan=ours.dtype.kind == "f")


def to_rounding(ours, other):
    """Products of a matrix with a vector round by where a row stands among the rows, on some processors."""
    size = np.abs(other[np.isfinite(other)]).max(initial=0.0)
    return ours.shape == other.shape and np.allclose(ours, other, rtol=0.0, atol=1e-13 * size, equal_nan=True)


def differing(ours, other, place=""):
    """Where two objects are not the same."""
    if type(ours) is not type(other):
        yield place
    elif isinstance(ours, np.ndarray):
        if not (exactly if place.endswith(".nodes") or ours.dtype.kind != "f" else to_rounding)(ours, other):
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


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A folder with a bar in nine partitions, in one file; in five, in files; and one whose files are a partition's of another cut."""
    folder = tmp_path_factory.mktemp("saved")
    with session():
        bar(folder, 9, 0.35, one=True)
        for name, partitions in (("five", 5), ("mixed", 4), ("short", 4)):
            (folder / name).mkdir()
            bar(folder / name, partitions)
    write_groups(folder)
    write_ell(folder / "ell.msh")
    (folder / "mixed/bar_5.msh").write_bytes((folder / "five/bar_5.msh").read_bytes())
    (folder / "short/bar_2.msh").unlink()
    return folder


def write_groups(folder):
    """The bar in nine partitions as a file that has groups, and no partitions."""
    mesh = read(folder / "bar.msh")
    count, triangles = len(mesh.volumes), np.concatenate([*mesh.surfaces.values()])
    tags = [mesh.volume + 1, count + 1 + np.repeat([0, 1], [len(t) for t in mesh.surfaces.values()])]
    names = {name: np.array([i + 1, 3 if i < count else 2]) for i, name in enumerate([*mesh.volumes, *mesh.surfaces])}
    meshio.write(folder / "whole.msh", meshio.Mesh(mesh.nodes, [("tetra", mesh.cells), ("triangle", triangles)], field_data=names, cell_data={
        "gmsh:physical": tags, "gmsh:geometrical": tags}), "gmsh22")


def write_ell(file):
    """Of one volume."""
    with session():
        occ = gmsh.model.occ
        occ.cut([(3, occ.addBox(0, 0, 0, 2, 2, 1))], [(3, occ.addBox(1, 1, 0, 1, 1, 1))])
        occ.synchronize()
        gmsh.model.addPhysicalGroup(3, [1], name="ell")
        gmsh.model.addPhysicalGroup(2, [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(-0.1, -0.1, -0.1, 0.1, 2.1, 1.1, 2)], name="wall")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.3)
        gmsh.model.mesh.generate(3)
        gmsh.write(str(file))


PIECES = ["mono-scale", "soft modes", "blocks", "partitions", "one file", "whole file", "parts bonded", "parts apart", "parts in contact",
          "slides far", "contact on ten nodes", "loose grains", "grounds", "contact"]


# Corners are among the nodes of ten-node tets; four-node ones are tried of a box, a file and parts.
@pytest.mark.parametrize("case, element", quick_sets(itertools.product(PIECES, ["P1", "P2"]), *((case, "P2") for case in sorted(PIECES)[::2]), (
    "blocks", "P1"), ("partitions", "P1"), ("parts in contact", "P1")))
def test_a_rank_makes_what_it_would_be_handed(case, element, saved):
    names = {"one file": "bar.msh", "whole file": "whole.msh"}
    file = {"mesh": {"file": str(saved / names[case]), "scale": 2.0}} if case in names else {}
    config = config_from({"name": "pieces", **CASES["partitions" if file else case], **file, "blackbox": {"element": element}})
    same_as_one(config, 3)


BETWEEN = [{"law": "contact", "between": ["*", "bar_1"]}, {"law": "pretension", "between": ["bar_2", "*"], "force": 3.0}]


@pytest.mark.parametrize("element", ["P1", late("P2")])
@pytest.mark.parametrize("file, subdomains, interfaces", [
    late(None, {"metis": 9}, []), (None, {"metis": 17}, [{"law": "contact", "friction": 0.2}, {"law": "perfect", "between": ["part 1?", "*"]}]),
    late("ell.msh", {"metis": 12}, [{"law": "contact"}]), ("ell.msh", {"grid": [3, 1, 2]}, []),
    late("ell.msh", {"slices": {"axis": "y", "count": 5}}, []), late("ell.msh", {"groups": True, "split_above": 300}, []),
    late("whole.msh", {"metis": 14}, BETWEEN), late("bar.msh", {"grid": [4, 2, 1]}, [{"law": "contact"}]),
    ("five/bar_*.msh", {"groups": True, "split_above": 90}, BETWEEN)])
def test_a_mesh_that_one_rank_cuts_for_all(file, subdomains, interfaces, element, saved):
    """A box by METIS, a file of one volume in any way, and files of several: which have laws between them, not within."""
    mesh = {"file": str(saved / file), "scale": 0.5} if file else {"box": {"size": [2, 2, 1], "cells": [6, 5, 3]}}
    config = config_from({
        "name": "cut", "mesh": mesh, "subdomains": subdomains, "materials": [{"young": 200e3, "poisson": 0.3}],
        **({"interfaces": interfaces} if interfaces else {}), "blackbox": {"element": element},
        "boundary": [{"on": "wall" if file else "xmin", "displacement": [0, 0, 0]}, {"on": {"plane": "z", "at": 0}, "traction": [1, 0, -1]},
                     {"on": {"plane": "y", "at": 0}, "foundation": {"normal": 1e4, "tangential": 1e3}}],
        "output": {"probes": [{"at": [0.21, 0.33, 0.27]}, {"on": {"plane": "y", "at": 0}, "quantity": "resultant"},
                              {"on": {"plane": "z", "at": 0}, "quantity": "max", "of": "stress"}]}})
    same_as_one(config, 3)


GRAINS = {"grains": 12, "size": 1.0, "h": 0.15}


def grains(**entry):
    """In contact."""
    return config_from({"name": "grains", "mesh": {"polycrystal": {**GRAINS, **entry}}, "subdomains": "groups", "interfaces": [{"law": "contact"}],
                        "materials": [{"young": 200e3, "poisson": 0.3}], "boundary": [{"on": "zmin", "displacement": [0, 0, 0]},
                                                                                      {"on": "zmax", "displacement": [0, 0, -0.01]}]})


@pytest.mark.long
@pytest.mark.parametrize("seed, again", [late(1, False), (12, True)])
def test_ranks_make_grains_of_their_own(seed, again, monkeypatch):
    """Each of them is meshed once, but for those around bad tets, which whoever has one of them mends."""
    meshed, of = [], GrainMesher._grain

    def told(mesher, grain):
        meshed.append(grain)
        return of(mesher, grain)

    monkeypatch.setattr(GrainMesher, "_grain", told)
    whole = build_scene(grains(seed=seed))
    assert sorted(meshed) == [*range(12)] and any("mended" in warning for warning in whole.warnings) == again
    meshed.clear()
    same_as_one(grains(seed=seed), 3)
    twice = np.bincount(meshed) - 1  # that one made all of them first, too
    assert (twice >= 1).all() and (twice > 1).any() == again and (twice > 1).sum() < 9


def as_known(part, mine):
    """A part with what is asked of others alone: of interfaces elsewhere the least and largest gap."""
    for i in part.interfaces:
        here = mine[list(i.subdomains)]
        if not here.any() and np.ndim(i.law.distance):
            i.law = replace(i.law, gap=np.array([i.law.gap.min(), i.law.gap.max()]))
            i.law_at_steps = [replace(law, gap=np.array([law.gap.min(), law.gap.max()])) for law in i.law_at_steps]
        if not here.any() and i.law.on_ground:
            i.law, i.law_at_steps = i.law.elsewhere(), [law.elsewhere() for law in i.law_at_steps]
    return part


def assert_left(made):
    """To one process, for one reason."""
    assert len(set(made)) == 1 and isinstance(made[0], str), made


def same_as_one(config, ranks):
    """The parts that ranks make are those that one process would hand out."""
    whole = build_scene(config)
    known = overview(whole)
    assert len(whole.subdomains) >= 4

    def of_rank(team):
        part = make(config, team)
        rank_of = part.overview.rank_of
        dealt = part_of(whole, np.flatnonzero(rank_of == team.rank), known)
        assert np.bincount(rank_of, minlength=ranks).min() > 0
        for one, other in zip(part.probes, dealt.probes):  # sums over all faces
            for name in ("total", "centre", "about") if isinstance(one, Surface) else ():
                assert np.allclose(getattr(one, name), getattr(other, name), rtol=1e-13, atol=1e-13)
                object.__setattr__(one, name, getattr(other, name))
        wrong = [*differing(as_known(part, rank_of == team.rank), as_known(dealt, rank_of == team.rank))]
        own = [f".subdomains[{e}].loads" for e in np.flatnonzero(rank_of == team.rank)]
        return [place for place in wrong if place in own or not place.endswith(ELSEWHERE)]

    for found in among(ranks, of_rank):
        assert not isinstance(found, Exception), found
        assert found == []


BLOCK = {"mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}}, "subdomains": {"slices": {"axis": "x", "count": 4}},
         "materials": [{"young": 200e3, "poisson": 0.3}],
         "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax", "traction": [10, 0, 0]}]}


@pytest.mark.parametrize("change", [
    {"boundary": [{"on": {"plane": "x", "at": 0.01}, "displacement": [0, 0, 0]}, BLOCK["boundary"][1]]},  # no face lies there
    {"boundary": [{"on": "xmin", "displacement": [0, 0, None]}, BLOCK["boundary"][1]]},  # it may move
    {"boundary": [BLOCK["boundary"][0], {"on": "xmax", "displacement": [0.1, 0, 0]},
                  {"on": {"plane": "x", "at": 4}, "displacement": [0.2, None, None]}]},  # which contradict each other
    {"subdomains": {"slices": {"axis": "x", "count": 100}}},  # some of them empty
    {"boundary": [{"on": "ymin", "foundation": {"normal": 1.0}}, BLOCK["boundary"][1]]},  # which holds across it alone
    {"boundary": [*BLOCK["boundary"], {"on": "ymin", "coupling": {"force": [0, 0, 1]}}]},  # of what several subdomains share
    {"bolts": [{"on": "*", "cut": {"plane": "x", "at": 1.4}, "force": 1.0}]},
    {"interfaces": [{"law": "contact", "between": ["*", {"plane": {"at": [0, 0, 1], "normal": [0, 0, -1]}}]}]},
    {"interfaces": [{"law": "contact", "between": ["slice 0", "slice 2"]}]},  # which do not touch
    {"output": {"probes": [{"at": [1, 2, 0.5]}]}}, {"output": {"probes": [{"at": [1, 2, 0.5], "part": "slice 3"}]}},
    {"output": {"probes": [{"at": [1, 0.5, 0.5]}]}, "interfaces": [{"law": "contact"}]},  # where bodies meet
    {"output": {"probes": [{"on": "xmax", "part": "slice 1"}]}}, {"output": {"probes": [{"on": "top"}]}},
    {"output": {"probes": [{"on": "xmax", "part": "nobody"}]}}, {"output": {"probes": [{"section": {"plane": "x", "at": 4}}]}},
    {"output": {"probes": [{"section": {"plane": "x", "at": 1}}]}, "interfaces": [{"law": "contact"}]},
    {"mesh": None, "parts": [boxed("part", [4, 1, 1], [8, 2, 2])], "subdomains": {"metis": 4}, "boundary": [
        {"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]}]}])
def test_what_one_has_to_judge_is_left_to_it(change):
    config = config_from({"name": "pieces", **BLOCK, **change})
    assert_left(among(2, lambda team: make(config, team)))


HELD = [{"on": "wall", "displacement": [0, 0, 0]}]


@pytest.mark.parametrize("folder, told", [("five", None), ("mixed", "different partitions"), ("short", "partition 2 of 4 is in none")])
def test_files_that_do_not_belong_together_are_left_to_one(saved, folder, told):
    """Which says what is wrong."""
    config = config_from({"name": "files", "mesh": {"file": str(saved / folder / "bar_*.msh")}, "subdomains": "groups",
                          "materials": [{"young": 200e3, "poisson": 0.3}], "boundary": HELD})
    found = among(2, lambda team: make(config, team))
    assert [isinstance(part, str) for part in found] == [told is not None] * 2
    if told:
        with pytest.raises(InputError, match=told):
            build_scene(config)


@pytest.mark.parametrize("shift, joined", [(0.0, 2), (0.003, 1), (30.0, 1)])
def test_bodies_of_a_file_that_share_no_nodes(tmp_path, shift, joined):
    """What touches is bonded; of what is near and nothing joins all warn."""
    with session():
        for corner in (0.0, 1.0 + shift):
            gmsh.model.occ.addBox(corner, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        for _, tag in gmsh.model.getEntities(1):
            gmsh.model.mesh.setTransfiniteCurve(tag, 3)
        for dimension, name in ((2, "Surface"), (3, "Volume")):
            for _, tag in gmsh.model.getEntities(dimension):
                getattr(gmsh.model.mesh, f"setTransfinite{name}")(tag)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.partition(4)
        gmsh.write(str(tmp_path / "boxes.msh"))
    ends = [{"on": {"plane": "x", "at": at}, "displacement": [0, 0, 0]} for at in (0.0, 2.0 + shift)]
    config = config_from({"name": "boxes", "mesh": {"file": str(tmp_path / "boxes.msh")}, "subdomains": "groups",
                          "materials": [{"young": 200e3, "poisson": 0.3}], "boundary": ends})
    whole = build_scene(config)
    assert components(*np.array([i.subdomains for i in whole.interfaces]).T, len(whole.subdomains))[0] == 3 - joined
    assert any("without an interface" in text for text in scene_cautions(whole)) == (shift == 0.003)
    same_as_one(config, 2)
    data = config.model_dump(exclude_unset=True) | {"subdomains": {"metis": 8}}  # which may be in each other
    assert_left(among(3, lambda team: make(config_from(data), team)))


# four blocks of a square that meet in a line, and one on top of two of them
FIVE = [boxed("one", at=[0, 0, 0]), boxed("two", at=[1, 0, 0]), boxed("three", at=[1, 1, 0], material={"young": 1e5, "poisson": 0.2}),
        boxed("four", at=[0, 1, 0]), boxed("five", at=[0.5, 0, 1])]


@pytest.mark.parametrize("change", [
    {"interfaces": [{"law": "contact", "exclude": [["one", "nobody"]]}]}, {"interfaces": [{"law": "contact", "slave": "nobody"}]},
    {"interfaces": [{"law": "perfect"}, {"law": "contact", "between": ["one", "three"]}]},  # which meet in an edge
    {"subdomains": {"grid": [2, 2, 1]}}, {"parts": FIVE[:2]},  # fewer than ranks
    {"parts": [boxed("a"), boxed("b", at=[5, 0, 0]), boxed("c") | {"move": {"translate": [10, 0, 0], "rotate": {"axis": "z", "degrees": 90}}}],
     "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]}, {"on": "*/x*", "symmetry": True}]},  # of a plane for each part
    {"parts": [*FIVE, boxed("six", at=[1.5, 0.001, 1])]}, {"parts": [*FIVE, boxed("falls", at=[9, 0, 1])]},
    {"parts": [*FIVE, boxed("inside", at=[0.25, 0.25, 0.25])]}, {"parts": [*FIVE, boxed("inside", [0.1, 0.1, 0.1], at=[0.45, 0.45, 0])]},
    {"parts": [*FIVE, boxed("beside", at=[2.1, 0, 0])], "interfaces": [{"law": "contact"}]},  # which asks for a joint there
    {"parts": [*FIVE, boxed("beside", at=[2.4, 0, 0])], "interfaces": [{"law": "contact", "between": "auto"}]}])
def test_parts_that_one_has_to_judge_are_left_to_it(change):
    config = config_from({"name": "blocks", "parts": FIVE, "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}],
                          "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]}], **change})
    assert_left(among(3, lambda team: make(config, team)))


@pytest.fixture(scope="module")
def solids(tmp_path_factory):
    """Three boxes in a row and a cylinder on two of them, in a CAD model."""
    path = tmp_path_factory.mktemp("cad") / "row.brep"
    with session():
        for k in range(3):
            gmsh.model.occ.addBox(k, 0, 0, 1, 1, 1)
        gmsh.model.occ.addCylinder(1, 0.5, 1, 0, 0, 1, 0.4)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    return {"step": str(path), "h": {"*": 0.5, "solid_2": 0.4}, "conforming": False}


@pytest.fixture(autouse=True)
def one_gmsh(monkeypatch):
    """Threads share gmsh, which real ranks have one each of."""
    one = threading.Lock()

    @contextmanager
    def alone():
        with one, session():
            yield

    for module in (solid_meshes, grain_meshes):
        monkeypatch.setattr(module, "session", alone)


@pytest.mark.parametrize("part", quick([False, True], True))
@pytest.mark.parametrize("element", ["P1", late("P2")])
def test_solids_that_are_meshed_apart_are_made_by_ranks(solids, element, part):
    """Each its own, with the shapes of faces; as a CAD model, or as one of several parts."""
    mesh = {"mesh": {**solids, "rename": {"solid_4": "post"}}} if not part else {
        "parts": [boxed("foot", at=[-1, 0, 0]), {"name": "row", "mesh": solids}, boxed("end", at=[3, 0, 0])]}
    config = config_from({"name": "solids", **mesh, "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}],
                          "interfaces": [{"law": "perfect"}], "blackbox": {"element": element},
                          "boundary": [{"on": {"plane": "x", "at": -1.0 * part}, "displacement": [0, 0, 0]},
                                       {"on": {"plane": "z", "at": 2}, "traction": [1, 0, -1]}]})
    same_as_one(config, 3)


@pytest.mark.parametrize("mesh, subdomains", [late("solids", "groups"), ("solids", {"groups": True, "split_above": 200}),
                                              late("solids", {"metis": 14}),
                                              late("grains", {"groups": True, "split_above": 150}), ("grains", {"metis": 20})])
@pytest.mark.parametrize("element", ["P1", late("P2")])
def test_solids_that_share_faces_and_grains_that_are_cut(mesh, subdomains, element, solids):
    """One rank meshes them for all, in contact, shapes of faces and all."""
    mesh = {"step": solids["step"], "h": 0.5} if mesh == "solids" else {"polycrystal": {**GRAINS, "grains": 8, "h": 0.25, "seed": 1}}
    same_as_one(config_from({
        "name": "solids", "mesh": mesh, "subdomains": subdomains, "materials": [{"young": 200e3, "poisson": 0.3}], "blackbox": {"element": element},
        "interfaces": [{"law": "contact", "friction": 0.2}],
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 1 + ("step" in mesh)}, "displacement": [0.01, 0, -0.01]}]}), 3)


@pytest.mark.parametrize("count", [6, 1])
def test_a_mesh_that_one_has_to_judge_is_made_once(count, tmp_path, monkeypatch):
    """Of two bodies, which may be in each other; one part of both is wrong, which rank 0 says."""
    made, make_once, box = [], body.make_mesh, bricks([1, 1, 1], [2, 2, 2], "box")
    monkeypatch.setattr(body, "make_mesh", lambda *given: made.append(given) or make_once(*given))
    meshio.write(tmp_path / "two.msh", meshio.Mesh(np.concatenate([box.nodes, box.nodes + 2]), [(
        "tetra", np.concatenate([box.cells, box.cells + len(box.nodes)]))]), "gmsh22")
    config = config_from({"name": "two", "mesh": {"file": str(tmp_path / "two.msh")}, "subdomains": {"metis": count}, "blackbox": IN_PROCESS,
                          "materials": [{"young": 200e3, "poisson": 0.3}], "boundary": [{"on": {"plane": "z", "at": at}, "displacement": [0, 0, 0]}
                                                                                        for at in (0, 2)]})
    whole, other = among(2, lambda team: scene_of(config, Ranks(team)))
    assert (whole.left == "a mesh that one process makes" and other is None) if count == 6 else "1 parts for 2 separate bodies" in str(whole)
    assert len(made) == 1


def test_fewer_solids_than_ranks_are_left_to_one(solids):
    config = config_from({"name": "solids", "mesh": solids, "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}],
                          "interfaces": [{"law": "perfect"}], "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]}]})
    assert_left(among(5, lambda team: make(config, team)))
