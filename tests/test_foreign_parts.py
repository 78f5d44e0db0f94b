"""Parts whose mesh is another program's: stiffness matrices and CalculiX decks, beside parts of our own."""

import shutil
import subprocess

import meshio
import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from boxes import boxed
from foreign_case import HEAT, SIZE, STEEL, elements, more_inside, numbered, restart_displacements, stiffness, tets, write_deck, write_matrix
from in_process import IN_PROCESS
from quick import late

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.inspect import checked
from orchestrator.registry import FOREIGN
from orchestrator.results.fields.files import write_fields
from orchestrator.results.figures.figures import write_figures
from orchestrator.results.folder import ResultsFolder
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.foreign.surfaces import of_plane
from orchestrator.scene.foreign.joints import read_joints
from orchestrator.scene.mesh.geometry import area_vectors

CALCULIX = pytest.mark.skipif(shutil.which("ccx") is None, reason="no CalculiX here")
BLOCK = boxed("block", SIZE, [2, 1, 1], [2, 0, 0])


def data(part, error=1e-9, **changes) -> dict:
    """The part, and a block of ours on its joint, pulled."""
    return {"name": "joined", "parts": [part, BLOCK], "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}],
            "blackbox": IN_PROCESS, "boundary": [{"on": "block/xmax", "traction": [10, 0, 5]}],
            "interfaces": [{"between": ["hull", "block"], "law": "perfect"}], "method": {"tolerance": {"error": error}}, **changes}


def matrix(folder, **keys) -> dict:
    """The part of ``write_matrix``."""
    files = {"stiffness": "K.mtx", "nodes": "nodes.csv", "facets": "facets.csv", "loads": "f.mtx"}
    own = {key: str(folder / file) for key, file in files.items()} | {"held": True} | keys
    return {"name": "hull", "matrix": {k: v for k, v in own.items() if v is not None}, "material": {"young": 200e3, "poisson": 0.3}}


def deck(folder, **keys) -> dict:
    """The part of ``write_deck``."""
    own = {"calculix": str(folder / "part.inp"), "loads": str(folder / "loads.inp"), "joints": "FLANGE"} | keys
    return {"name": "hull", "deck": {k: v for k, v in own.items() if v is not None}}


def block_of(solution) -> tuple:
    """Its subdomain and displacements."""
    own = next(s for s in solution.scene.subdomains if s.name == "block")
    return own, solution.parts[own.index]


def test_a_matrix_is_a_part(tmp_path):
    """Against one system of both by hand; nine digits are told, and the bound covers what they cost."""
    K, x, f = write_matrix(tmp_path)
    fine = solve(config_from(data(matrix(tmp_path), 1e-10)))
    block, u = block_of(fine)
    y = fine.scene.mesh.nodes[block.nodes]
    n, far = len(x), np.flatnonzero(y[:, 0] > 2)
    place = np.r_[[np.flatnonzero(np.linalg.norm(x - p, axis=1) < 1e-9)[0] if p[0] == 2 else -1 for p in y]]
    place[far] = n + np.arange(len(far))
    P = sp.csr_array((np.ones(3 * len(y)), (np.arange(3 * len(y)), (3 * place[:, None] + np.arange(3)).ravel())),
                     shape=(3 * len(y), 3 * (n + len(far))))
    whole = sp.block_diag([K, sp.csr_array((3 * len(far),) * 2)]) + P.T @ stiffness(y, block.connectivity) @ P
    exact = P @ spla.spsolve(sp.csc_matrix(whole), np.r_[f, np.zeros(3 * len(far))] + P.T @ block.loads[0].ravel())
    size = np.abs(exact).max()
    assert np.abs(u.ravel() - exact).max() <= 1e-10 * size
    assert fine.converged and fine.scene.interfaces[0].matching

    write_matrix(tmp_path, digits=9)
    with pytest.raises(InputError, match="too few digits"):
        solve(config_from(data(matrix(tmp_path), 1e-9)))
    rough = solve(config_from(data(matrix(tmp_path), 1e-6)))
    own, v = block_of(rough)
    off = (v.ravel() - exact)[None]
    energy = [float(w.ravel() @ (P @ (whole @ spla.lsqr(P, w.ravel())[0]))) for w in (off, exact[None])]
    assert 1e-9 <= np.sqrt(energy[0] / energy[1]) <= rough.error_bound <= 1e-6
    near = solve(config_from(data(matrix(tmp_path), 1e-7)))  # what the digits cost, 7.5e-8, is most of it
    assert near.converged and near.iterations <= rough.iterations + 5 and 7e-8 <= near.error_bound <= 1e-7


def test_loads_of_a_part_load_the_scene(tmp_path):
    """A matrix alone bears the loads: nobody says that nothing does; without them everybody does."""
    for forces in ((1.0, 2.0, -3.0), (0.0, 0.0, 0.0)):
        write_matrix(tmp_path, loads=forces)
        made = config_from(data(matrix(tmp_path, loads=str(tmp_path / "f.mtx")), 1e-9, boundary=[]))
        told = [*checked(made), *solve(made).summary["warnings"]]
        assert any("nothing loads the scene" in text for text in told) == (not any(forces))
    made = config_from(data(matrix(tmp_path, loads=None), 1e-9, boundary=[]))
    assert any("nothing loads the scene" in text for text in checked(made))


def test_a_held_part_bonded_to_one_that_is_moved(tmp_path):
    """Rigid motions cost energy where supports are inside: the energy is the work of what is prescribed, and the bound holds."""
    write_matrix(tmp_path, loads=(0.0, 0.0, 0.0))
    moved = np.array([[0.003, -0.002, 0.0], [0.0, 0.0, 0.01]])
    found = solve(config_from(data(matrix(tmp_path), 1e-9, boundary=[{"on": "block/xmax", "displacement": moved.tolist()}])))
    assert found.converged and found.error_bound <= 1e-9
    np.testing.assert_allclose(found.summary["energy"], np.sum(moved * found.reactions[0], axis=1) / 2, rtol=1e-6)


def test_condensed_by_whoever_made_it(tmp_path):
    """The Schur complement with the joint's nodes alone, flat and without faces, is the same part."""
    K, x, f = write_matrix(tmp_path)
    whole = solve(config_from(data(matrix(tmp_path), 1e-10)))
    on = np.flatnonzero(x[:, 0] == 2)
    joint = (3 * on[:, None] + np.arange(3)).ravel()
    rest, K = np.setdiff1d(np.arange(3 * len(x)), joint), K.toarray()
    across = np.linalg.solve(K[np.ix_(rest, rest)], np.c_[K[np.ix_(rest, joint)], f[rest]])
    np.savetxt(tmp_path / "nodes.csv", np.c_[1 + on, x[on]], "%.17g")
    import scipy.io

    scipy.io.mmwrite(tmp_path / "K.mtx", K[np.ix_(joint, joint)] - K[np.ix_(joint, rest)] @ across[:, :-1], precision=17)
    forces = (f[joint] - K[np.ix_(joint, rest)] @ across[:, -1]).reshape(-1, 3)
    np.savetxt(tmp_path / "f.csv", np.c_[1 + on, forces][::-1], "%.17g", delimiter=",", header="id, fx, fy, fz")  # in any order
    alone = solve(config_from(data(matrix(tmp_path, facets=None, outward=[1, 0, 0], loads=str(tmp_path / "f.csv")), 1e-10)))
    assert np.abs(block_of(alone)[1] - block_of(whole)[1]).max() <= 1e-9 * np.abs(block_of(whole)[1]).max()


def _turned(K, table):
    """Rows of the table in another order than the matrix's."""
    return K, table[np.random.default_rng(0).permutation(len(table))]


def _exchanged(one, two, columns=slice(None)):
    """Two nodes of the joint have changed places in the table, or their ids alone."""
    def change(K, table):
        joint = np.flatnonzero(table[:, 1] == 2)[[one, two]]
        table[joint[:, None], np.arange(4)[columns]] = table[joint[::-1][:, None], np.arange(4)[columns]]
        return K, table
    return change


def _few(K, table):
    """Four digits."""
    return sp.csr_array((np.array([float(f"{v:.2e}") for v in K.data]), K.indices, K.indptr), K.shape), table


WRONG_MATRICES = {
    "unsymmetric": (dict(change=lambda K, t: (K + 0.01 * sp.triu(K), t)), {}, "not symmetric"),
    "order of nodes": (dict(change=_turned, clamp=False), {"held": False}, "another order"),
    "units of nodes": (dict(change=lambda K, t: (K, t * [1, 1000, 1000, 1000])), {}, "meets no other part"),
    "hidden supports": ({}, {"held": False}, "supports that hold it are inside"),
    "no supports": (dict(clamp=False), {"held": True}, "rigid motions cost nothing"),
    "lost digits": (dict(change=_few, clamp=False), {"held": False}, "rigid motions cost force"),
    "a node twice": (dict(change=lambda K, t: (K, np.vstack([t, t[:1]]))), {}, "a second time"),
    "a place twice": (dict(change=lambda K, t: (K, np.vstack([t, t[:1] + [100, 0, 0, 0]]))), {}, "at one place"),
    "a node missing": (dict(change=lambda K, t: (K, t[:-1])), {}, r"in the table of nodes|rows and columns"),
    "another size": (dict(change=lambda K, t: (K[:-3][:, :-3], t)), {}, "rows and columns"),
    "a wrong sign": (dict(change=lambda K, t: (-K, t)), {}, "gives way|no stiffness"),
    "not finite": (dict(change=lambda K, t: (K * np.nan, t)), {}, "not finite"),
    **{f"two {kind}{' of a held part' * clamp}": (dict(change=_exchanged(*nodes, columns), clamp=clamp, cells=(3, 3, 3)), {"held": clamp},
                                                  words)
       for kind, nodes, columns, words in (("rows exchanged", (5, 10), slice(None), "rotations cost force"),
                                           ("rows beside each other", (0, 1), slice(None), "rotations cost force"),
                                           ("ids exchanged", (5, 10), slice(1), "lie on each other"),
                                           ("ids at the border", (0, 3), slice(1), "lie on each other")) for clamp in (True, False)},
    "order of nodes of a held part": (dict(change=_turned, cells=(4, 2, 2)), {}, "another order"),
    "a thousand times": (dict(change=lambda K, t: (1000 * K, t)), {}, "a factor of"),
    "a thousandth": (dict(change=lambda K, t: (K / 1000, t), clamp=False), {"held": False}, "a factor of"),
    "no faces": ({}, {"facets": None}, "neither facets nor outward"),
    "faces turned over": (dict(turned=True), {}, "anticlockwise"),
    "not flat": ({}, {"facets": None, "outward": [0, 0, 1]}, "off a plane"),
}


@pytest.mark.parametrize("without", [(), (8,), (0,), (0, 1, 2), (8, 9)], ids=str)
@pytest.mark.parametrize("bulge", [0.0, 0.05], ids=["flat", "curved"])
def test_faces_that_seem_to_be_missing(tmp_path, without, bulge):
    """At the border and inside, one and several, on the corner; of a curved joint those inside."""
    def change(K, table):
        table[:, 1] += bulge * np.sin(3 * table[:, 2] + 2 * table[:, 3])
        return K, table

    write_matrix(tmp_path, change=change, cells=(2, 3, 3), without=without)
    joints = read_joints(config_from(data(matrix(tmp_path))).parts[0].foreign, ("parts", 0, "matrix"), "hull")
    told = [text for text in joints.remarks if "are faces missing?" in text]
    assert len(told) == (bool(without) and (not bulge or without in ((8,), (8, 9))))


VOIDS = {"two feet": ([[0, 1, 2], [6, 7, 8]], [0, 1, 2], "may be a void"),
         "feet nearer": ([[0, 1, 2], [4, 5, 6]], [0, 1, 2], "2 of it in faces"),
         "a frame": ([[0, 1, 5, 6]], [0, 1, 5, 6], "may be a void"), "a grid": ([[0, 1, 2]], [0, 1, 2, 3], ""),
         "a stretched grid": ([[0, 10, 20]], [0, 0.1, 0.2, 0.3], ""), "graded": ([[0, 1, 2.5, 4.7]], [0, 1, 2.5, 4.7], ""),
         "a line": ([[0, 1, 2]], [0], "all on one line")}


@pytest.mark.parametrize("kind", VOIDS)
def test_flat_joints_without_faces(tmp_path, kind):
    """What area is made between nodes is told, and refused where faces would be much larger than those beside them."""
    columns, rows, message = VOIDS[kind]
    at = np.array([(x, y, 0.0) for own in columns for x in own for y in rows])
    if kind == "a frame":
        at = at[(np.abs(at[:, 0] - 3) > 2.5) | (np.abs(at[:, 1] - 3) > 2.5)]
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    if "void" in message or "line" in message:
        with pytest.raises(InputError, match=message):
            of_plane(at @ turn.T, turn[:, 2], (), "it")
        return
    (triangles,), (remark,) = of_plane(at @ turn.T, turn[:, 2], (), "it")
    normals = area_vectors(at @ turn.T, triangles) @ turn[:, 2]
    assert (normals > 0).all() and np.isclose(normals.sum(), np.prod(np.ptp(at[:, :2], axis=0)))
    assert f"{normals.sum():.4g} of area" in remark and ("in faces more than" in remark) == bool(message)


@pytest.mark.parametrize("text, message", [("1,2,3\n", "3 numbers"), ("5,1,0,0\n5,1,0,0\n", "a second time"), ("99,1,0,0\n", "node 99"),
                                           ("5,1,0,0,1,0,0\n", "2 columns of loads for 1"),
                                           ("5,1,0,0\n6,x,0,0\n", ":2: field 2 is no number")])
def test_wrong_tables_of_forces(tmp_path, text, message):
    write_matrix(tmp_path)
    (tmp_path / "f.csv").write_text(text)
    refused(data(matrix(tmp_path, loads=str(tmp_path / "f.csv"))), message)


@pytest.mark.parametrize("kind", WRONG_MATRICES)
def test_wrong_matrices(tmp_path, kind):
    written, keys, message = WRONG_MATRICES[kind]
    write_matrix(tmp_path, **written)
    refused(data(matrix(tmp_path, **keys)), message)


def refused(wrong: dict, message: str) -> None:
    """By its message, before anything is iterated; and from where in the YAML."""
    config = config_from({**wrong, "boundary": [{"on": "block/xmax", "displacement": [0, 0, 0]}]})
    with pytest.raises(InputError, match=message) as caught:
        build_scene(config)
        FOREIGN[config.codes[-1].code](config.codes[-1]).condensed()
    assert all(p.path[:1] in (("parts",), ("interfaces",)) and p.expected and p.cure for p in caught.value.problems)


@CALCULIX
@pytest.mark.parametrize("kind, cells", [late("C3D8", (3, 1, 1)), ("C3D20R", (2, 2, 2)), late("C3D10", (2, 2, 1))])
def test_a_deck_is_a_part(tmp_path, kind, cells):
    """Orthotropic, turned and heated; against one CalculiX run of both, joined by *EQUATION with the same operators. Where
    nodes match, one of the joint's is held by the deck, and there are shells and an equation inside."""
    x = write_deck(tmp_path, kind, cells, HEAT, heat=True, more=more_inside if kind == "C3D8" else "")
    solution = solve(config_from(data(deck(tmp_path), 2e-10)))
    block, u = block_of(solution)
    exact, inside = in_one_run(tmp_path, solution, block, len(x))
    assert solution.converged and solution.scene.interfaces[0].matching == (kind == "C3D8")
    assert np.abs(u[0] - exact).max() <= 1e-9 * np.abs(exact).max()
    own = own_fields(solution, "hull")
    assert own.blocks[0][0] == {"C3D8": "hexahedron", "C3D20R": "hexahedron20", "C3D10": "tetra10"}[kind]
    assert np.abs(own.displacement[0, : len(x)] - inside).max() <= 1e-9 * np.abs(inside).max()
    assert kind == "C3D8" or np.abs(own.force[0].sum(axis=0) - [10, 0, 5]).max() <= 1e-7
    assert np.abs(solution.reactions[0, 0] - [10, 0, 5]).max() <= 1e-12  # the load, and nothing of what the deck holds


def own_fields(solution, name):
    """What the part ends with, on its own mesh."""
    own = next(s for s in solution.scene.subdomains if s.name == name)
    stand = next(s for s in solution.scene.mesh.foreign if solution.scene.mesh.volumes[s.volume] == name)
    entry = config_from(solution.summary["config"]).codes[own.code]
    return FOREIGN[entry.code](entry).own_fields(*(x[own.index][:, : stand.joints] for x in (solution.parts, solution.joints)))


def in_one_run(folder, solution, block, count) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) displacements of the block, and (count, 3) of the part, in a deck that includes the part's."""
    scene = solution.scene
    interface, first = scene.interfaces[0], 10_000
    slave = [scene.subdomains[e].name for e in interface.subdomains].index("hull")
    joint = np.flatnonzero(np.array([line.count("NSET=FLANGE") for line in (folder / "part.inp").read_text().splitlines()]))[0]
    lines = (folder / "part.inp").read_text().splitlines()[joint + 1 :]
    ids = np.sort([int(line.rstrip(",")) for line in lines[: next(i for i, line in enumerate(lines) if line.startswith("*"))]])
    number = [(ids if side == slave else first + np.arange(len(block.nodes)))[np.asarray(nodes)]
              for side, nodes in enumerate(interface.nodes)]
    one, two = ((interface.mortar.first, interface.mortar.second) if interface.mortar else (sp.eye_array(3 * len(number[0])),) * 2)
    text = "*INCLUDE,INPUT=part.inp\n*NODE\n" + "".join(
        f"{first + i},{p[0]!r},{p[1]!r},{p[2]!r}\n" for i, p in enumerate(scene.mesh.nodes[block.nodes].tolist()))
    text += "*ELEMENT,TYPE=C3D4,ELSET=TETS\n" + "".join(
        f"{5000 + i}," + ",".join(str(first + n) for n in c) + "\n" for i, c in enumerate(block.connectivity))
    text += "*MATERIAL,NAME=STEEL\n*ELASTIC\n200e3,.3\n*SOLID SECTION,ELSET=TETS,MATERIAL=STEEL\n"
    one, two = sp.csr_array(one), sp.csr_array(two)
    for row in range(one.shape[0]):
        terms = [(number[side][d // 3], d % 3 + 1, sign * v) for side, (G, sign) in enumerate(((one, 1.0), (two, -1.0)))
                 for d, v in zip(G[[row]].indices, G[[row]].data) if abs(v) > 1e-14]
        terms.sort(key=lambda term: abs(term[2] - 1.0) > 1e-9)  # the slave's own dof is the dependent one
        text += f"*EQUATION\n{len(terms)}\n" + "".join(f"{n},{c},{v:.13e}\n" for n, c, v in terms)
    loaded = np.argwhere(block.loads[0] != 0)
    text += "*STEP\n*RESTART,WRITE\n*STATIC\n*INCLUDE,INPUT=loads.inp\n*CLOAD\n"
    text += "".join(f"{first + i},{c + 1},{block.loads[0, i, c]:.12e}\n" for i, c in loaded) + "*END STEP\n"
    (folder / "one.inp").write_text(text)
    done = subprocess.run(["ccx", "-i", "one"], cwd=folder, capture_output=True, text=True)
    assert not done.returncode and "*ERROR" not in done.stdout, done.stdout[-1000:]
    found = restart_displacements(folder / "one.rout", "WOOD")
    return found[first - 1 + np.arange(len(block.nodes))], found[:count]


@CALCULIX
@pytest.mark.long
def test_two_decks_and_nothing_else(tmp_path):
    """Bonded across faces that do not match; the floating one hangs on the other. Of our own there is nothing to draw."""
    for name, kind, cells, at in (("hull", "C3D20R", (1, 1, 1), (0, 0, 0)), ("tail", "C3D10", (2, 2, 1), (2, 0, 0))):
        (tmp_path / name).mkdir()
        write_deck(tmp_path / name, kind, cells, at=at, clamp="ROOT,1,3\n" * (name == "hull"), loads="*CLOAD\nFLANGE,3,-1.\n")
    two = [{**deck(tmp_path / "hull", loads=None)}, {**deck(tmp_path / "tail", joints="ROOT"), "name": "tail"}]
    solution = solve(config_from(data(two[0], parts=two, boundary=[], interfaces=[{"between": ["hull", "tail"], "law": "perfect"}])))
    forces = [own_fields(solution, name).force[0].sum(axis=0) for name in ("tail", "hull")]
    count = 15  # nodes of the loaded end
    assert solution.converged and np.abs(forces[0] - [0, 0, count]).max() <= 1e-7 and np.abs(forces[0] + forces[1]).max() <= 1e-7
    write_fields(ResultsFolder(tmp_path), solution.fields, beside=[own_fields(solution, name) for name in ("hull", "tail")])
    assert len(meshio.read(tmp_path / "fields" / "hull_0001.vtu").points) == 20
    drawn = write_figures(ResultsFolder(tmp_path), solution.summary, {}, solution.fields)
    assert "deformed.png" not in [path.name for path in drawn]


def two_decks(folder, kinds, turned, length=2) -> dict:
    """One clamped, as long as that, and one of 2 pulled, of cells of one size."""
    for name, kind, at, own, clamp in zip(("hull", "tail"), kinds, (0, length), (length, 2), ("ROOT,1,3\n", "")):
        (folder / name).mkdir()
        write_deck(folder / name, kind, (own, 2, 2), at=(at, 0, 0), size=(float(own), 1.0, 1.0), clamp=clamp,
                   loads="*CLOAD\nFLANGE,3,-1.\n", turned=turned and name == "tail")
    two = [{**deck(folder / "hull", loads=None)}, {**deck(folder / "tail", joints="ROOT"), "name": "tail"}]
    return data(two[0], parts=two, boundary=[], interfaces=[{"between": ["hull", "tail"], "law": "perfect"}])


@pytest.mark.parametrize("kinds", [("C3D20R", "C3D20R"), ("C3D20", "C3D20R"), ("C3D8", "C3D8"), ("C3D8", "C3D4"), ("C3D4", "C3D8")],
                         ids="-".join)
def test_nodes_that_coincide_are_paired(tmp_path, kinds):
    """Whatever diagonals the numbering of a quadrilateral suggests."""
    for turned in (False, True):
        (tmp_path / str(turned)).mkdir()
        scene = build_scene(config_from(two_decks(tmp_path / str(turned), kinds, turned)))
        assert [i.matching for i in scene.interfaces] == [True] and not scene.warnings


@pytest.mark.parametrize("length, cells", [late(6, (6, 1, 1)), late(20, (20, 2, 2)), (200, (100, 1, 1))])
def test_slender_parts_are_held_or_not(tmp_path, length, cells):
    """What is said to be held is believed where rigid motions cost anything, and where they cost nothing it is not."""
    for clamp in (True, False):
        write_matrix(tmp_path, cells=cells, size=(length, 1.0, 1.0), clamp=clamp)
        for held in (True, False):
            entry = config_from(data(matrix(tmp_path, held=held, loads=None))).codes[-1]
            if held == clamp:
                FOREIGN[entry.code](entry).condensed()
                continue
            with pytest.raises(InputError, match="supports that hold it are inside" if clamp else "rigid motions cost nothing"):
                FOREIGN[entry.code](entry).condensed()
    write_matrix(tmp_path, cells=cells, size=(length, 1.0, 1.0), digits=4)
    with pytest.raises(InputError, match="digits tell|still move"):
        entry = config_from(data(matrix(tmp_path, loads=None))).codes[-1]
        FOREIGN[entry.code](entry).condensed()


@CALCULIX
@pytest.mark.parametrize("kind, length", [("C3D20R", 2), late("C3D8", 12)])
def test_two_decks_are_one(tmp_path, kind, length):
    """Their faces cut along different diagonals, one of them slender, against the deck of both with its nodes shared."""
    solution = solve(config_from(two_decks(tmp_path, (kind, kind), True, length)))
    tail, size, cells = own_fields(solution, "tail"), (length + 2.0, 1.0, 1.0), (length + 2, 2, 2)
    write_deck(tmp_path, kind, cells, size=size, loads="*CLOAD\nFLANGE,3,-1.\n")
    (tmp_path / "whole.inp").write_text("*INCLUDE,INPUT=part.inp\n*STEP\n*RESTART,WRITE\n*STATIC\n*INCLUDE,INPUT=loads.inp\n*END STEP\n")
    subprocess.run(["ccx", "-i", "whole"], cwd=tmp_path, capture_output=True, check=True)
    x = elements(kind, cells, size=size)[0]
    place = [int(np.argmin(np.linalg.norm(x - p, axis=1))) for p in tail.points]
    exact = restart_displacements(tmp_path / "whole.rout", "STEEL")[place]
    assert np.abs(tail.displacement[0] - exact).max() <= 1e-8 * np.abs(exact).max()


@pytest.mark.parametrize("faces, matching", [([[0, 1, 2], [0, 2, 3]], True), ([[0, 1, 3], [1, 2, 3]], False),
                                             ([[0, 1, 2, 3]], True), ([[1, 2, 3, 0]], True), (None, True)])
def test_other_faces_between_the_same_nodes(tmp_path, faces, matching):
    """Triangles that are the part's own stay as they are, which is told; the other side's say how quadrilaterals are cut, and
    what is between nodes without faces."""
    _, x, _ = write_matrix(tmp_path)
    ids = np.loadtxt(tmp_path / "nodes.csv", delimiter=",", skiprows=1)[:, 0].astype(int)
    ring = [int(ids[np.argmin(np.linalg.norm(x - [2, y, z], axis=1))]) for y, z in ((0, 0), (1, 0), (1, 1), (0, 1))]
    (tmp_path / "facets.csv").write_text("".join(" ".join(str(ring[i]) for i in face) + "\n" for face in faces or []))
    keys = {} if faces else {"facets": None, "outward": [1, 0, 0], "nodes": str(tmp_path / "joint.csv")}
    np.savetxt(tmp_path / "joint.csv", np.c_[ring, [[2, 0, 0], [2, 1, 0], [2, 1, 1], [2, 0, 1]]], "%.17g")
    scene = build_scene(config_from(data(matrix(tmp_path, **keys))))
    assert [i.matching for i in scene.interfaces] == [matching]
    assert bool(scene.warnings) == (not matching or not faces)
    assert matching or "faces between them are cut otherwise" in scene.warnings[0]


@CALCULIX
@pytest.mark.long
def test_a_deck_rubs(tmp_path):
    """Four load steps with reversal, on a slab of another mesh: as the same block in our own mesh."""
    x, t = tets((2, 2, 2), (0.5, 0.5, 1), (1, 1, 1))
    text = "*NODE\n" + numbered(x) + "*ELEMENT,TYPE=C3D4,ELSET=EALL\n"
    text += "".join(",".join(map(str, row)) + "\n" for row in np.c_[np.arange(len(t)), t] + 1)
    text += "*NSET,NSET=SOLE\n" + "".join(f"{i},\n" for i in 1 + np.flatnonzero(x[:, 2] == 1))
    (tmp_path / "part.inp").write_text(text + "*MATERIAL,NAME=M\n*ELASTIC\n1e5,.3\n*SOLID SECTION,ELSET=EALL,MATERIAL=M\n")
    pulls = [[0.0, 0.0, -50.0], [8.0, 0.0, -50.0], [11.0, 0.0, -50.0], [-5.0, 8.0, -50.0]]
    common = data(BLOCK, interfaces=[{"between": ["base", "block"], "law": "contact", "friction": 0.3}],
                  method={"tolerance": {"error": 1e-6}})
    base = boxed("base", [2, 2, 1], [3, 3, 1])
    ours = boxed("block", at=[0.5, 0.5, 1], material={"young": 100e3, "poisson": 0.3})
    held = {"on": "base/zmin", "displacement": [0, 0, 0]}
    mine = solve(config_from({**common, "parts": [base, ours], "boundary": [held, {"on": "block/zmax", "traction": pulls}]}))
    forces = next(s for s in mine.scene.subdomains if s.name == "block").loads
    order = next(s for s in mine.scene.subdomains if s.name == "block").nodes
    number = [1 + int(np.argmin(np.linalg.norm(x - p, axis=1))) for p in mine.scene.mesh.nodes[order]]
    files = [tmp_path / f"loads{step}.inp" for step in range(4)]
    for file, own in zip(files, forces):
        file.write_text("*CLOAD\n" + "".join(f"{number[i]},{c + 1},{own[i, c]:.12e}\n" for i, c in np.argwhere(own != 0)))
    theirs = {"name": "block", "deck": {"calculix": str(tmp_path / "part.inp"), "loads": [str(f) for f in files], "joints": "SOLE"}}
    other = solve(config_from({**common, "parts": [base, theirs], "boundary": [held]}))
    one, two = (np.array([s.summary["status_counts"][k] for k in ("open", "stick", "slip")]) for s in (mine, other))
    assert other.converged and np.abs(one - two).max() <= 1  # a pair may be on the edge
    assert sum(mine.summary["status_counts"]["slip"]) > 0 < sum(mine.summary["status_counts"]["stick"])
    assert np.abs(other.reactions[0] - mine.reactions[0]).max() <= 1e-3 * 50


KEPT_LOADS = {
    "a force that ends": (["*CLOAD\nFLANGE,3,-5.\n*CLOAD\n5,1,2.\n", "*CLOAD\nFLANGE,3,-5.\n"], "says nothing of 5, 1 under \\*CLOAD"),
    "pressure that ends": (["*DLOAD\nEALL,P4,1.\n", "*CLOAD\nFLANGE,3,-5.\n"], "nothing of EALL, P4 under \\*DLOAD"),
    "heat that ends": (["*TEMPERATURE\nNALL,70.\n", "*CLOAD,OP=NEW\nFLANGE,3,-5.\n"], "nothing of NALL under \\*TEMPERATURE"),
    "supports taken away": (["*BOUNDARY,OP=NEW\nROOT,1,3,.1\n", "*BOUNDARY\nROOT,1,3,.2\n"], "supports away"),
    "time that runs on": (["*AMPLITUDE, NAME=A, TIME=TOTAL TIME\n0.,0.,2.,1.\n*CLOAD\nFLANGE,3,1.\n"], "runs on from load step to load step"),
    "elements taken away": (["*MODEL CHANGE,TYPE=ELEMENT,REMOVE\nEALL\n", "*CLOAD\nFLANGE,3,1.\n"], "MODEL CHANGE"),
    "softer when warm": (["*TEMPERATURE\nNALL,20.\n", "*TEMPERATURE\nNALL,80.\n"], "do not move them as its stiffness says"),
}


@CALCULIX
@pytest.mark.parametrize("kind", KEPT_LOADS)
def test_loads_of_a_later_step(tmp_path, kind):
    """What CalculiX would keep is said again; what the first load step does not show is looked for in the others."""
    loads, message = KEPT_LOADS[kind]
    write_deck(tmp_path, matter=STEEL.replace("200e3,.3\n", "200e3,.3,20.\n50e3,.3,200.\n"), heat=True)
    files = [tmp_path / f"{i}.inp" for i in range(2)]
    for file, text in zip(files, loads):
        file.write_text(text)
    config = config_from(data(deck(tmp_path, loads=[str(f) for f in files]),
                              boundary=[{"on": "block/xmax", "traction": [[1, 0, 0], [2, 0, 0]]}]))
    with pytest.raises(InputError, match=message):
        FOREIGN[config.codes[-1].code](config.codes[-1]).condensed()


@CALCULIX
@pytest.mark.parametrize("kind", ["normals", "zeros left out", "a surface of shells"])
def test_decks_as_calculix_reads_them(tmp_path, kind):
    """Nodes with normals, nodes without their last coordinates, a surface that no joint asks for: the same part."""
    write_deck(tmp_path)
    codes = [config_from(data(deck(tmp_path))).codes[-1]]
    head, *lines = (tmp_path / "part.inp").read_text().split("*ELEMENT", 1)[0].splitlines()
    rest = "*ELEMENT" + (tmp_path / "part.inp").read_text().split("*ELEMENT", 1)[1]
    plain = FOREIGN[codes[0].code](codes[0]).condensed()
    if kind == "normals":
        lines = [line + ",0.,0.,1." for line in lines]
    elif kind == "zeros left out":
        lines = [line.replace(",0.0", ",").rstrip(",") for line in lines]
    else:
        rest += "*ELEMENT,TYPE=S4,ELSET=SKIN\n77,1,2,4,3\n*SURFACE,NAME=OUT\nSKIN,SPOS\n*SHELL SECTION,ELSET=SKIN,MATERIAL=STEEL\n1e-6\n"
    (tmp_path / "other.inp").write_text("\n".join([head, *lines]) + "\n" + rest)
    own = config_from(data(deck(tmp_path, calculix=str(tmp_path / "other.inp")))).codes[-1]
    other = FOREIGN[own.code](own).condensed()
    np.testing.assert_array_equal(other.joints.points, plain.joints.points)
    apart = np.abs(other.stiffness - plain.stiffness).max() / np.abs(plain.stiffness).max()
    assert apart <= (1e-3 if "shells" in kind else 1e-12)  # a skin of a millionth


WRONG_DECKS = {
    "dependent": (dict(more="*EQUATION\n2\n12,1,1.,9,1,-1.\n", kind="C3D8"), {"joints": "FLANGE"}, "depend on others"),
    "transform": (dict(more="*TRANSFORM,NSET=FLANGE,TYPE=R\n0.,1.,0.,-1.,0.,0.\n"), {}, r"\*TRANSFORM"),
    "nlgeom": (dict(loads="*STEP,NLGEOM\n*CLOAD\nFLANGE,3,-5.\n"), {}, "NLGEOM"),
    "a step": (dict(more="*STEP\n*STATIC\n*END STEP\n"), {}, r"\*STEP"),
    "a step in loads": (dict(loads="*STATIC\n*CLOAD\nFLANGE,3,-5.\n"), {}, r"\*STATIC"),
    "supports in loads": (dict(loads="*BOUNDARY\nFLANGE,3,3\n*CLOAD\n5,3,-5.\n"), {}, "its stiffness would be another"),
    "plasticity": (dict(matter=HEAT + "*PLASTIC\n200.,0.\n"), {}, "nonlinear"),
    "no such set": ({}, {"joints": "RIM"}, "no node set RIM"),
    "no face": (dict(more="*NSET,NSET=ONE\n1,2\n"), {"joints": "ONE"}, "no face of an element"),
    "half a face": (dict(more="*NSET,NSET=MORE\nFLANGE,5\n"), {"joints": "MORE"}, "on no face"),
    "no matter": (dict(matter=""), {}, "CalculiX says"),
    "no such node": (dict(more="*NSET,NSET=FAR\nFLANGE,999\n"), {"joints": "FAR"}, "node 999"),
    "not linear": (dict(matter=HEAT.replace("*SOLID",
                                            "*MATERIAL,NAME=SOFT\n*ELASTIC\n200e3,.3,20.\n50e3,.3,200.\n*EXPANSION\n1e-5\n*SOLID").replace(
        "MATERIAL=WOOD,ORIENTATION=TURNED", "MATERIAL=SOFT"), heat=True), {}, "do not move them as its stiffness says"),
    "held by nothing": ({"clamp": ""}, {"held": True}, "rigid motions cost nothing"),
    "not said to be held": ({}, {"held": False}, "supports that hold it are inside"),
}


@CALCULIX
@pytest.mark.parametrize("kind", WRONG_DECKS)
def test_wrong_decks(tmp_path, kind):
    written, keys, message = WRONG_DECKS[kind]
    write_deck(tmp_path, **written)
    refused(data(deck(tmp_path, **keys)), message)


@pytest.mark.parametrize("kind, cells", [("C3D8", (1, 4, 4)), late("C3D20", (1, 3, 3)),
                                         late("C3D4", (1, 4, 4)), ("C3D10", (1, 3, 3))])
def test_nodes_forgotten_in_a_joint(tmp_path, kind, cells):
    """Each node of the joint in turn; joints that end in a plane, or round a corner, are sound."""
    x = write_deck(tmp_path, kind, cells)
    text = (tmp_path / "part.inp").read_text()
    plane = np.flatnonzero(x[:, 0] == SIZE[0])

    def told(nodes):
        head, tail = text.split("*NSET,NSET=FLANGE\n")
        (tmp_path / "part.inp").write_text(head + "*NSET,NSET=FLANGE\n" + "".join(f"{i + 1},\n"
            for i in nodes) + tail[tail.index("*NSET"):])
        return read_joints(config_from(data(deck(tmp_path))).parts[0].foreign, ("parts", 0), "hull").remarks

    y, z = x[plane, 1:].T
    for sound in (plane, np.flatnonzero((x[:, 0] == SIZE[0]) | (x[:, 1] == 0)), plane[y <= 0.7], plane[(y <= 0.7) | (z <= 0.7)]):
        assert told(sound) == []
    for lost in plane:
        said = told(np.setdiff1d(plane, lost))
        assert len(said) == 1 and f"but not {lost + 1}: are these forgotten?" in said[0]


@pytest.mark.parametrize("own, block, material, told", [
    (200e9, 200e3, None, "1e+06"), (70e9, 210e3, None, "3.33e+05"), (200, 200e3, None, "0.001"), (200e9, 200e3, 200e3, "1e+06"),
    (200e9, 200e3, 210e9, None), (200e3, 70e3, None, None), (10, 200e3, None, None), (200e3, 1.5, None, None), (200e3, 20, None, None)])
def test_units_of_a_decks_moduli(tmp_path, own, block, material, told):
    """Rubber on steel is no other unit; what `material` says is asked before the neighbours."""
    write_deck(tmp_path, matter=STEEL.replace("200e3", f"{own!r}"))
    part = deck(tmp_path) | ({"material": {"young": material, "poisson": 0.3}} if material else {})
    scene = build_scene(config_from(data(part, materials=[{"young": block, "poisson": 0.3}])))
    said = [text for text in scene.warnings if "as between units" in text]
    assert len(said) == (told is not None) and (told is None or f"{told} times" in said[0]), scene.warnings
