"""Factorisations of symmetric matrices: whichever solver is there, the solutions are the same."""

from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp

from orchestrator.errors import Refusal
from orchestrator.method.sparse import cholmod, symmetric
from orchestrator.method.sparse.symmetric import by_cholesky, by_superlu, factorise, semidefinite_solver
from orchestrator.method.linear.macro import Macro
from orchestrator.parallel.team import ALONE
from benchmarks.studies.prediction import macro_pattern

needs_cholmod = pytest.mark.skipif(cholmod.library() is None, reason="no CHOLMOD here")
SIDE = 6  # cubes along it: 3,240 unknowns, beyond ``symmetric.ORDERED``


def lower(matrix):
    return sp.tril(matrix, format="csc")


@pytest.fixture(scope="module")
def macro():
    matrix = macro_pattern(SIDE)
    assert matrix.shape[0] > symmetric.ORDERED
    return matrix


@pytest.fixture(params=["CHOLMOD", "SuperLU"])
def solver(request, monkeypatch):
    """What ``factorise`` takes."""
    if request.param == "SuperLU":
        monkeypatch.setattr(cholmod, "library", lambda: None)
    elif cholmod.library() is None:
        pytest.skip("no CHOLMOD here")
    return request.param


@pytest.mark.parametrize("steps", [1, 3])
def test_solutions_do_not_depend_on_the_solver(macro, solver, steps):
    wanted = np.random.default_rng(1).standard_normal((steps, macro.shape[0]))
    right = (macro @ wanted.T).T
    assert np.abs(factorise(macro)(right) - wanted).max() <= 1e-12
    assert np.abs(factorise(macro[:50][:, :50])(right[:, :50]) - np.linalg.solve(macro[:50][:, :50].toarray(),
                                                                             right[:, :50].T).T).max() <= 1e-12


def test_a_singular_macro_matrix_is_reported(solver):
    independent = sp.csr_array(np.diag([1.0, 2.0, 0.0]))
    with pytest.raises(Refusal, match="singular"):
        Macro._solver(SimpleNamespace(shared=np.zeros(3, dtype=bool), space=SimpleNamespace(team=ALONE)), independent)


def test_a_matrix_that_rounding_has_made_indefinite_is_solved_all_the_same(solver):
    rotation = np.linalg.qr(np.random.default_rng(2).standard_normal((6, 6)))[0]
    matrix = rotation @ np.diag([1.0, 2.0, 3.0, 4.0, 5.0, -1e-13]) @ rotation.T
    right = matrix @ np.ones(6)
    assert np.abs(matrix @ factorise(sp.csr_array(matrix))(right[None])[0] - right).max() <= 1e-12


@pytest.mark.parametrize("size", [40, symmetric.ORDERED + 1])
def test_singular_systems_that_have_a_solution_are_solved(solver, size):
    """A chain of springs that nothing holds, loaded in balance."""
    springs = sp.diags_array([np.ones(size - 1), -np.ones(size - 1)], offsets=[0, 1], shape=(size - 1, size))
    chain = sp.csr_array(springs.T @ springs)
    right = np.zeros((1, size))
    right[0, 0], right[0, -1] = 1.0, -1.0
    found = semidefinite_solver(chain)(right)
    assert np.abs(np.diff(found[0]) + 1.0).max() <= 1e-6


def test_a_solver_that_gets_it_wrong_is_not_trusted(macro, monkeypatch):
    if cholmod.library() is None:
        pytest.skip("no CHOLMOD here")
    monkeypatch.setattr(symmetric, "sound", lambda lower, solve: False)
    assert by_cholesky(lower(macro)) is None
    monkeypatch.undo()
    assert symmetric.sound(lower(macro), by_superlu(lower(macro)))
    assert not symmetric.sound(lower(macro), lambda right: by_superlu(lower(macro))(right) * (1 + 1e-6))


@needs_cholmod
@pytest.mark.parametrize("order", cholmod.ORDERS)
def test_cholmod_says_what_is_not_positive_definite(macro, order):
    indefinite = lower(macro - 2 * sp.diags_array(macro.diagonal()))
    assert cholmod.factorised(indefinite, order) is None
    assert cholmod.factorised(lower(sp.csc_array(np.diag([1.0, 0.0]))), order) is None


@needs_cholmod
def test_one_factor_serves_several_threads(macro):
    """Each gets its own solution, whatever the others ask at the same time; a later one leaves an earlier one as it is."""
    solve, rights = by_cholesky(lower(macro)), np.random.default_rng(3).standard_normal((12, macro.shape[0]))
    alone = [solve(right) for right in rights]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(solve, rights))
    assert all(np.array_equal(a, b) for a, b in zip(alone, together))
    assert np.abs(solve(rights.T) - np.stack(alone, axis=1)).max() <= 1e-12 * np.abs(alone).max()


@needs_cholmod
@pytest.mark.long
def test_factors_of_several_threads_do_not_disturb_each_other():
    """The library's linear algebra may have one workspace for all threads."""
    rng = np.random.default_rng(5)
    spread = [sp.random_array((300, 300), density=0.02, rng=rng) for _ in range(4)]
    matrices = [sp.csc_array(a @ a.T + 3 * sp.eye_array(300)) for a in spread]
    right = rng.standard_normal((300, 40))

    def worst(matrix):
        """Of a factor that is made and used while others do the same."""
        solve = cholmod.factorised(lower(matrix), "amd")
        return max(np.abs(matrix @ solve(right) - right).max() for _ in range(200))

    with ThreadPoolExecutor(4) as pool:
        assert max(pool.map(worst, matrices)) < 1e-9
