"""Doors for models of others: each finds what the same tets find in FreeFEM, and carries as
much."""

import shutil

import numpy as np
import pytest
from helpers import HELD, ROOT, STEEL, bricks, on, run, solved, written
from scipy import sparse
from scipy.io import mmwrite

CALCULIX = pytest.mark.skipif(shutil.which("ccx") is None, reason="no CalculiX here")
ROOT_END, TIP = bricks([2, 1, 1], (3, 2, 2)), bricks([2, 1, 1], (3, 2, 2), lambda x: x + [2, 0, 0])
PULL = [10.0, 0, 5.0]  # traction on the tip
JOINT = np.flatnonzero(ROOT_END[0][:, 0] == 2)
FORM = """
real myE = 200e3, myNu = .3;
real myLambda = myE*myNu/((1 + myNu)*(1 - 2*myNu)), myMu = myE/(2*(1 + myNu));
macro div3(w) (dx(w#x) + dy(w#y) + dz(w#z)) // EOM
macro Density(u, v) (myLambda*div3(u)*div3(v)
    + myMu*(2*dx(u#x)*dx(v#x) + 2*dy(u#y)*dy(v#y) + 2*dz(u#z)*dz(v#z)
    + (dy(u#x) + dx(u#y))*(dy(v#x) + dx(v#y)) + (dz(u#x) + dx(u#z))*(dz(v#x) + dx(v#z))
    + (dz(u#y) + dy(u#z))*(dz(v#y) + dy(v#z)))) // EOM
macro Stiffness(u, v) int3d(Th, mine, qfV = qfV2)(Density(u, v)) // EOM
"""


def stiffness() -> sparse.csr_array:
    """Return the (3n, 3n) matrix of the root's four-node tets, nothing held."""
    nodes, tets = ROOT_END
    young, poisson = STEEL.values()
    shear = young / (2 * (1 + poisson))
    hooke = np.diag([2 * shear] * 3 + [shear] * 3)
    hooke[:3, :3] += young * poisson / ((1 + poisson) * (1 - 2 * poisson))
    edges = nodes[tets[:, 1:]] - nodes[tets[:, :1]]
    slope = np.linalg.inv(edges)
    slope = np.concatenate([-slope.sum(2, keepdims=True), slope], axis=2)  # (m, 3, 4)
    strain = np.zeros((len(tets), 6, 4, 3))
    for row, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]):
        strain[:, row, :, i] += slope[:, j]
        strain[:, row, :, j] += slope[:, i] * (i != j)
    strain = strain.reshape(-1, 6, 12)
    local = strain.transpose(0, 2, 1) @ hooke @ strain * np.linalg.det(edges)[:, None, None] / 6
    dofs = (3 * tets[:, :, None] + np.arange(3)).reshape(-1, 12)
    rows, columns = np.repeat(dofs, 12, axis=1).ravel(), np.tile(dofs, (1, 12)).ravel()
    return sparse.csr_array((local.ravel(), (rows, columns)), shape=(3 * len(nodes),) * 2)


def bar(root: dict, folder, held: bool = True, **changes) -> dict:
    """Return the problem: a root, by whichever door, and a tip that is pulled, bonded to it."""
    tip = {"name": "tip", "mesh": written(folder / "tip.msh", tip=TIP)}
    support = [{"on": {"box": [[0, 0, 0], [0, 1, 1]]}, "displacement": HELD}]
    return {"name": "bar", "parts": [root, tip], "subdomains": "groups", "materials": [STEEL],
            "boundary": [{"on": on("x", 4), "traction": PULL}, *support[:held]],
            "interfaces": [{"between": ["root", "tip"], "law": "perfect"}],
            "method": {"tolerance": {"error": 1e-9}}, **changes}


def ours(folder) -> dict:
    return {"name": "root", "mesh": written(folder / "root.msh", root=ROOT_END)}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Displacements of the tip's nodes, all of it by FreeFEM."""
    folder = tmp_path_factory.mktemp("plain")
    return tip_of(solved(bar(ours(folder), folder)))


def tip_of(solution) -> np.ndarray:
    """(n, 3), of the last part with as many nodes: parts of others come last, with their joints."""
    return next(u[0] for u in reversed(solution.sides) if u.shape[1] == len(TIP[0]))


def assert_same(found, expected, rel=1e-7):
    assert np.abs(tip_of(found) - expected).max() <= rel * np.abs(expected).max()


def beside(folder, **code) -> dict:
    codes = [{"code": "freefem", "workers": 1}, {"workers": 1, "on": "root", **code}]
    return bar(ours(folder), folder, blackbox=codes)


def test_a_form(plain, tmp_path):
    (tmp_path / "steel.idp").write_text(FORM)
    assert_same(solved(beside(tmp_path, code="freefem", form=str(tmp_path / "steel.idp"))), plain)


def test_a_solver_in_python(plain, tmp_path):
    """The template, which is there to be copied."""
    template = ROOT / "orchestrator" / "blackbox" / "codes" / "template.py"
    assert_same(solved(beside(tmp_path, code=str(template))), plain)


@pytest.mark.parametrize("code", ["scikit-fem", pytest.param("calculix", marks=CALCULIX)])
def test_another_finite_element_program(code, plain, tmp_path):
    assert_same(solved(beside(tmp_path, code=code)), plain)


def test_a_matrix(plain, tmp_path):
    """The root as a stiffness matrix with its table of nodes, its end held already."""
    nodes, tets = ROOT_END
    free = np.flatnonzero(nodes[:, 0] > 0)
    dofs = (3 * free[:, None] + np.arange(3)).ravel()
    mmwrite(tmp_path / "K.mtx", stiffness()[dofs][:, dofs].tocoo(), precision=17,
            symmetry="general")
    rows = [f"{1 + i},{','.join(map(repr, nodes[i].tolist()))}" for i in free]
    (tmp_path / "nodes.csv").write_text("\n".join(["id,x,y,z", *rows]))
    faces = np.concatenate([tets[:, [1, 2, 3]], tets[:, [0, 3, 2]], tets[:, [0, 1, 3]],
                            tets[:, [0, 2, 1]]])
    joint = faces[np.isin(faces, JOINT).all(axis=1)]
    (tmp_path / "facets.csv").write_text("\n".join(" ".join(map(str, 1 + face)) for face in joint))
    files = {key: str(tmp_path / file) for key, file in (
        ("stiffness", "K.mtx"), ("nodes", "nodes.csv"), ("facets", "facets.csv"))}
    root = {"name": "root", "matrix": {**files, "held": True}, "material": STEEL}
    assert_same(solved(bar(root, tmp_path, held=False)), plain)


@CALCULIX
def test_a_deck(plain, tmp_path):
    """The root as a CalculiX deck, with a support of its own."""
    nodes, tets = ROOT_END

    def table(rows, first=1):
        return "".join(f"{i},{','.join(map(repr, row.tolist()))}\n" for i,
                       row in enumerate(rows, first))

    sets = "".join(f"*NSET,NSET={name}\n" + "".join(f"{1 + i},\n" for i in which) for name,
                   which in (
        ("FLANGE", JOINT), ("HELD", np.flatnonzero(nodes[:, 0] == 0))))
    (tmp_path / "root.inp").write_text(
        f"*NODE,NSET=NALL\n{table(nodes)}*ELEMENT,TYPE=C3D4,ELSET=EALL\n{table(1 + tets)}{sets}"
        "*MATERIAL,NAME=STEEL\n*ELASTIC\n200e3,.3\n*SOLID SECTION,ELSET=EALL,MATERIAL=STEEL\n"
        "*BOUNDARY\nHELD,1,3\n")
    deck = {"calculix": str(tmp_path / "root.inp"), "joints": "FLANGE"}
    assert_same(solved(bar({"name": "root", "deck": deck}, tmp_path, held=False)), plain)


def test_a_program(tmp_path):
    """A script in FreeFEM with mesh, matter and loads of its own stands on a block, which carries
    them."""
    summary = run(ROOT / "examples" / "programs" / "post.yaml", tmp_path / "out",
                  "method.tolerance.error=1e-8")
    volume = np.array([4, 0, -9.0])  # force per volume at the first step, on a post of side 1
    expected = -np.outer([1, 2, 3], volume)
    assert np.array(summary["reactions"])[0] == pytest.approx(expected, abs=1e-6 * 27)
    assert "program" in {code["code"] for code in summary["codes"]}
