"""A form of the user's in FreeFEM's language: its matter and its loads, against a solution by hand, and what is refused."""

import numpy as np
import pytest
from quick import late, quick
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from method_case import CLAMP, PULL

from orchestrator.blackbox.codes.freefem.code import FreeFem
from orchestrator.config.load import config_from
from orchestrator.errors import BlackBoxError, InputError
from orchestrator.run import solve
from orchestrator.scene.build import build_scene

ISOTROPIC = """
real myE = 200e3, myNu = .3;
real myLambda = myE*myNu/((1 + myNu)*(1 - 2*myNu)), myMu = myE/(2*(1 + myNu));
macro div3(w) (dx(w#x) + dy(w#y) + dz(w#z)) // EOM
macro Density(u, v) (myLambda*div3(u)*div3(v) + myMu*(2*dx(u#x)*dx(v#x) + 2*dy(u#y)*dy(v#y) + 2*dz(u#z)*dz(v#z)
    + (dy(u#x) + dx(u#y))*(dy(v#x) + dx(v#y)) + (dz(u#x) + dx(u#z))*(dz(v#x) + dx(v#z))
    + (dz(u#y) + dy(u#z))*(dz(v#y) + dy(v#z)))) // EOM
"""
PLAIN = ISOTROPIC + "macro Stiffness(u, v) int3d(Th, mine, qfV = qfV2)(Density(u, v)) // EOM\n"

# a turned orthotropic law, graded in space, heated more and more
_E, _G, _NU = np.array([140e3, 10e3, 40e3]), np.array([3.5e3, 5e3, 7e3]), np.array([0.3, 0.25, 0.28])  # ν12, ν13, ν23
_ALPHA = np.array([1e-6, 30e-6, 12e-6])


def hooke() -> tuple[np.ndarray, np.ndarray]:
    """(6, 6) stiffness and (6,) thermal strains in engineering notation, turned by 30° about z."""
    compliance = np.diag(np.concatenate([1 / _E, 1 / _G]))
    for (i, j), nu in zip(((0, 1), (0, 2), (1, 2)), _NU):
        compliance[i, j] = compliance[j, i] = -nu / _E[i]
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    pairs = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
    strains = np.zeros((6, 6))  # of the matter's axes, from those of the global ones
    for column, (i, j) in enumerate(pairs):
        epsilon = np.zeros((3, 3))
        epsilon[i, j] = epsilon[j, i] = 1.0 if i == j else 0.5
        local = turn @ epsilon @ turn.T
        strains[:, column] = [local[k, k] if k == m else 2 * local[k, m] for k, m in pairs]
    stiff = strains.T @ np.linalg.inv(compliance) @ strains
    return (stiff + stiff.T) / 2, np.linalg.solve(strains, np.concatenate([_ALPHA, np.zeros(3)]))


def grade(x):
    return 1 + 0.2 * x[..., 0] + 0.1 * x[..., 1]


def warmth(x):
    return 80 + 4 * x[..., 0] - 3 * x[..., 2]


def text() -> str:
    stiff, alpha = hooke()
    rows = ", ".join("[" + ", ".join(f"{v:.17g}" for v in row) + "]" for row in stiff)
    heat = ", ".join(f"{v:.17g}" for v in stiff @ alpha)
    return f"""
func myGrade = 1. + .2*x + .1*y;
func myWarmth = step*(80. + 4.*x - 3.*z);      // twice as warm at the second load step
macro eps(w) [dx(w#x), dy(w#y), dz(w#z), dy(w#z) + dz(w#y), dx(w#z) + dz(w#x), dx(w#y) + dy(w#x)] // EOM
macro Hooke [{rows}] // EOM
macro HookeAlpha [{heat}] // EOM
macro Stiffness(u, v) int3d(Th, mine, qfV = qfV5)(myGrade*(eps(v)'*(Hooke*eps(u)))) // EOM
macro Loads(v) int3d(Th, mine, qfV = qfV5)(myGrade*myWarmth*(HookeAlpha'*eps(v))) // EOM
"""


def by_hand(scene) -> np.ndarray:
    """(steps, n, 3) of the whole mesh of four-node tets, by numpy."""
    mesh, (stiff, alpha) = scene.mesh, hooke()
    corners = mesh.nodes[mesh.cells]
    edges = corners[:, 1:] - corners[:, :1]
    volume, inverse = np.linalg.det(edges) / 6, np.linalg.inv(edges)
    gradient = np.concatenate([-inverse.sum(axis=2)[:, :, None], inverse], axis=2)  # (m, 3, 4)
    B = np.zeros((len(volume), 6, 4, 3))
    for row, terms in enumerate((((0, 0),), ((1, 1),), ((2, 2),), ((1, 2), (2, 1)), ((0, 2), (2, 0)), ((0, 1), (1, 0)))):
        for direction, component in terms:
            B[:, row, :, component] = gradient[:, direction]
    B = B.reshape(len(volume), 6, 12)
    centre = corners.mean(axis=1)
    local = np.einsum("mip,ij,mjq,m->mpq", B, stiff, B, volume * grade(centre))  # a linear grade: its mean
    inner = (5 - np.sqrt(5)) / 20 * np.ones((4, 4)) + (1 - 4 * (5 - np.sqrt(5)) / 20) * np.eye(4)
    points = np.einsum("ab,mbx->max", inner, corners)
    heat = np.einsum("mip,i,m->mp", B, stiff @ alpha, volume * (grade(points) * warmth(points)).mean(axis=1))
    dofs = (3 * mesh.cells[:, :, None] + np.arange(3)).reshape(-1, 12)
    K = sp.csr_array((local.ravel(), (np.repeat(dofs, 12, axis=1).ravel(), np.tile(dofs, (1, 12)).ravel())),
                     shape=(mesh.nodes.size,) * 2)
    own = np.bincount(dofs.ravel(), heat.ravel(), mesh.nodes.size)
    free, u = np.flatnonzero(~scene.fixed), np.zeros((scene.steps, mesh.nodes.size))
    for step in range(scene.steps):
        load = scene.loads[step].ravel() + (step + 1) * own
        u[step, free] = spla.spsolve(sp.csc_array(K[free][:, free]), load[free])
    return u.reshape(scene.steps, -1, 3)


def problem(form, **changes) -> dict:
    return {"name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
            "subdomains": {"slices": {"axis": "x", "count": 4}}, "materials": [{"young": 40e3, "poisson": 0.3}],
            "boundary": [CLAMP, {**PULL, "history": "press"}], "histories": {"press": [1.0, 0.5]},
            "blackbox": {"code": "freefem", "workers": 1, **({"form": str(form)} if form else {}), **changes},
            "method": {"tolerance": {"error": 1e-10}}}


def written(tmp_path, content):
    (tmp_path / "my_form.idp").write_text(content)
    return tmp_path / "my_form.idp"


def test_a_turned_orthotropic_graded_heated_form(tmp_path):
    config = config_from(problem(written(tmp_path, text())))
    exact = by_hand(build_scene(config))
    solution = solve(config, reference=True)
    assert solution.summary["converged"]
    assert np.abs(solution.displacement - exact).max() < 1e-9 * np.abs(exact).max()
    assert solution.summary["true_error"] <= solution.error_bound <= 5 * solution.summary["true_error"]
    assert solution.summary["discretisation_error"] is None
    clamp, pull = np.array(solution.summary["reactions"])
    assert np.abs(clamp + pull).max() < 1e-8 * np.abs(pull).max()  # heat is in balance with itself


@pytest.mark.parametrize("element, transport", [late("P1", "pipe"), ("P2", "pipe"), late("P1", "file")])
def test_the_shipped_law_as_a_form_is_the_same(tmp_path, element, transport):
    form = written(tmp_path, PLAIN)
    own, shipped = (solve(config_from(problem(f, element=element, transport=transport) | {
        "materials": [{"young": 200e3, "poisson": 0.3}]})) for f in (form, None))
    assert own.summary["iterations"] == shipped.summary["iterations"]
    assert np.abs(own.displacement - shipped.displacement).max() < 1e-12 * np.abs(shipped.displacement).max()


def test_a_form_that_varies_and_says_uniform_is_found_out(tmp_path):
    graded = PLAIN.replace("real myE", "func myGrade = 1 + .1*x;\nreal myE", 1).replace("(Density(u, v))", "(myGrade*Density(u, v))")
    with pytest.raises(BlackBoxError, match="varies from place to place and says that it does not: leave uniform: true out"):
        solve(config_from(problem(written(tmp_path, graded), uniform=True)))


WRONG = {
    "not symmetric": (ISOTROPIC + "macro Stiffness(u, v) int3d(Th, mine, qfV = qfV2)(Density(u, v) + 1e-3*myE*dy(u#x)*v#z) // EOM\n",
                      "not symmetric"),
    "everywhere": (ISOTROPIC + "macro Stiffness(u, v) int3d(Th, qfV = qfV2)(Density(u, v)) // EOM\n", "int3d.Th, mine"),
    "a bedding": (ISOTROPIC + "macro Stiffness(u, v) int3d(Th, mine, qfV = qfV2)(Density(u, v) + 1e-2*myE*u#x*v#x) // EOM\n",
                  "rigid motions cost force"),
    "an indefinite law": (PLAIN.replace("(Density(u, v))", "(Density(u, v) - 1.001*myMu*(dy(u#z) + dz(u#y))*(dy(v#z) + dz(v#y)))"),
                          "stiffness that is not positive: displacements near .* give energy away"),
    "a modulus below zero": (PLAIN.replace("(Density(u, v))", "((2.5 - x)*Density(u, v))"), "not positive: to move a node near"),
    "a function of the mesh": (PLAIN.replace("(Density(u, v))", "((1. + .01*Th.nt)*Density(u, v))"), "no sum over tets"),
    "a slip of the pen": (ISOTROPIC + "macro Stiffness(u, v) int3d(Th, mine, qfV = qfV2)(Densty(u, v)) // EOM\n", "compile error"),
}


def test_a_modulus_below_zero_that_harms_nothing_is_left_alone(tmp_path):
    """A corner of one tet, where the tet around it stays positive; the bound holds."""
    form = written(tmp_path, PLAIN.replace("(Density(u, v))", "((3.98 - x)*Density(u, v))").replace("qfV2", "qfV5"))
    found = solve(config_from(problem(form) | {"method": {"tolerance": {"error": 1e-6}}}), reference=True)
    assert found.converged and found.summary["true_error"] <= found.error_bound


@pytest.mark.parametrize("what", quick(WRONG, "not symmetric", "an indefinite law", "a slip of the pen"))
def test_forms_that_would_spoil_the_result_end_the_run(tmp_path, what):
    content, words = WRONG[what]
    with pytest.raises(BlackBoxError, match=words):
        solve(config_from(problem(written(tmp_path, content))))


_VOLUME = "int3d(Th, mine, qfV = qfV2)(Density(u, v))"
REFUSED = {  # text of the form, words of the message
    "a skin": (ISOTROPIC + f"macro Stiffness(u, v) {_VOLUME} + int2d(Th, 3)(myE*dx(u#x)*dx(v#x)) // EOM\n", ":8: int2d.*no labelled faces"),
    "a bedding in an include": (f'include "more.idp"\n{ISOTROPIC}macro Stiffness(u, v) {_VOLUME} + Bedding(u, v) // EOM\n',
                                "in a file that it includes: int2d"),
    "edges": (ISOTROPIC + f"macro Stiffness(u, v) {_VOLUME} + int1d(Th)(u#x*v#x) // EOM\n", ":8: int1d"),
    "a jump": (ISOTROPIC + f"macro Stiffness(u, v) {_VOLUME} + intallfaces(Th)(jump(dx(u#x))*jump(dx(v#x))) // EOM\n",
               ":8: jump.*another subdomain"),
    "a support": (ISOTROPIC + f"macro Stiffness(u, v) {_VOLUME} + on(1, u#x = 0) // EOM\n", ":8: on.*would hold nothing"),
    "a pressure": (PLAIN + "macro Loads(v) int2d(Th, 2)(5.*v#z) // EOM\n", ":9: int2d.*entries of boundary"),
    "a slip of the pen": (PLAIN.replace("(Density", "(Densty"), "FreeFEM says: .*Densty does not exist"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_terms_that_would_vanish_are_refused_before_anything_is_solved(tmp_path, what):
    """FreeFEM itself finds them, however deep in macros and includes."""
    content, words = REFUSED[what]
    (tmp_path / "more.idp").write_text("macro Bedding(u, v) int2d(Th)(u#x*v#x) // EOM\n")
    entry = config_from(problem(written(tmp_path, content))).codes[0]
    with pytest.raises(InputError, match=f"(?s){words}") as caught:
        FreeFem(entry).check()
    assert caught.value.problems[0].path == ("blackbox", "form")


@pytest.mark.parametrize("transport", ["pipe", "file"])
def test_a_run_refuses_them_too(tmp_path, transport):
    with pytest.raises(InputError, match=":8: int2d"):
        solve(config_from(problem(written(tmp_path, REFUSED["a skin"][0]), transport=transport)))


@pytest.mark.parametrize("content, words", [
    ("real myE = 1;\n", "without a macro Stiffness"),
    ("\n// a comment\nreal seconds = 1;\n" + PLAIN, ":3: a name of the form's, seconds"), (None, "No such file")])
def test_forms_that_cannot_be_read(tmp_path, content, words):
    form = tmp_path / "nowhere.idp" if content is None else written(tmp_path, content)
    with pytest.raises(InputError, match=words) as caught:
        solve(config_from(problem(form)))
    assert caught.value.problems[0].path == ("blackbox", "form")


def test_a_tolerance_from_the_meshs_error_is_refused(tmp_path):
    config = config_from(problem(written(tmp_path, PLAIN)) | {"method": {"tolerance": {"error": "auto"}}})
    with pytest.raises(InputError, match="a code whose matter is its own"):
        solve(config)
