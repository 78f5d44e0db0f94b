"""Accelerations of the fixed point on small affine maps: against least squares of the definition, and exact ends."""

from types import SimpleNamespace

import numpy as np
import pytest
from method_case import box_of, config, method, prepared

from orchestrator.method.acceleration.anderson import Anderson
from orchestrator.method.acceleration.relaxation import Aitken, Relaxation, stable_relaxation
from orchestrator.method.acceleration.residual_minimisation import ResidualMinimisation
from orchestrator.method.linear.stage import Admissible
from orchestrator.parallel.team import Team
from orchestrator.scene.build import build_scene


def fields(s: np.ndarray, u: np.ndarray, alpha: np.ndarray) -> Admissible:
    return Admissible(s, u, alpha, u, s, None)


def state(s: np.ndarray) -> Admissible:
    return fields(s, s, np.zeros((len(s), 0)))


def least(states: list, residuals: list, root: np.ndarray, relaxation: float) -> np.ndarray:
    """The definition: the affine combination of the residuals, in the norm of ``root``, that is least, and a step along it."""
    s, r = states[-1], residuals[-1]
    if len(states) > 1:
        ds, dr = (np.array([(a - b).ravel() for a, b in zip(x[1:], x[:-1])]).T for x in (states, residuals))
        weight = np.broadcast_to(root, s.shape).ravel()[:, None]
        gamma = np.linalg.lstsq(weight * dr, (weight[:, 0] * r.ravel()), rcond=None)[0]
        s, r = s - (ds @ gamma).reshape(s.shape), r - (dr @ gamma).reshape(s.shape)
    return s + relaxation * r


def mapped(rng, size: int):
    """An affine contraction of rows of some size, and its fixed point of two rows."""
    matrix = rng.standard_normal((size, size))
    matrix *= 0.7 / np.abs(np.linalg.eigvals(matrix)).max()
    end = rng.standard_normal((2, size))
    return lambda s: end + (s - end) @ matrix.T, end


@pytest.mark.parametrize("memory", [2, 3, 30])
def test_anderson_is_least_squares_of_its_last_differences(memory):
    """Each load step with those before it; what is older than the window is forgotten, whatever place it has had."""
    rng = np.random.default_rng(2)
    image, _ = mapped(rng, 12)
    weight, states, residuals, s = rng.uniform(0.2, 5.0, 12), [], [], rng.standard_normal((2, 12))
    anderson = Anderson(weight, memory, 0.6, forget=1e3)
    for number in range(9):
        states.append(s)
        residuals.append(image(s) - s)
        assert np.array_equal(anderson.take(state(s), image(s)), residuals[-1])
        assert anderson.depth == 1 + min(number, memory)
        window = slice(-anderson.depth, None)
        s = anderson.next()
        rows = [least([x[:t + 1] for x in states[window]], [x[:t + 1] for x in residuals[window]],
                      np.sqrt(weight), 0.6)[t:] for t in range(2)]
        assert s == pytest.approx(np.concatenate(rows), abs=1e-6)
        assert np.array_equal(anderson.next(), s), "asked again it says the same"
    assert np.abs(residuals[-1]).max() < np.abs(residuals[0]).max()


def test_anderson_forgets_when_the_residual_has_grown_beyond_the_best():
    """Below the limit it combines; above it relaxes, and judges later residuals by that one."""
    direction, limit = np.array([[3.0, 4.0]]), 2.0
    anderson = Anderson(np.ones(2), 5, 0.5, forget=limit)
    sizes, kept = [1.0, 0.8, 1.59, 1.61, 3.2, 0.1, 0.21], [0, 1, 2, 0, 1, 2, 0]
    for k, (size, count) in enumerate(zip(sizes, kept)):
        s, r = np.array([[float(k), k**2]]), size * direction / 5
        r = r[:, ::-1] if k % 2 else r
        anderson.take(state(s), s + r)
        assert anderson.kept == count
        assert (np.abs(anderson.next() - (s + 0.5 * r)).max() < 1e-12) == (count == 0)


def test_what_happens_in_a_load_step_is_nothing_to_those_before():
    """A load step goes on as if those after it were not there, whatever their residuals are."""
    rng = np.random.default_rng(5)
    image, _ = mapped(rng, 6)
    both, alone = (Anderson(np.ones(6), 5, 0.6, forget=1e9) for _ in range(2))
    s = rng.standard_normal((2, 6))
    for number in range(8):
        moved = image(s)
        moved[1] += 1e3 * (number == 5)
        both.take(state(s), moved)
        alone.take(state(s[:1]), moved[:1])
        assert both.next()[:1] == pytest.approx(alone.next(), abs=1e-12)
        s = both.next()


def test_anderson_divides_by_no_difference_that_is_none():
    """And goes twice as far in each step along a residual that stays as it is, until it changes."""
    anderson, s = Anderson(np.ones(3), 4, 0.5), np.ones((1, 3))
    for length in (1, 2, 4):
        anderson.take(state(s), 3 * s)
        assert anderson.next() == pytest.approx((1 + length) * s, abs=1e-9)
    anderson.take(state(s), 3 * s * [1, -1, 1])
    assert anderson.stride == 1


@pytest.mark.parametrize("memory", [None, 40])
def test_residual_minimisation_is_least_squares_load_step_by_load_step(memory):
    rng = np.random.default_rng(4)
    image, end = mapped(rng, 12)
    weight, states, residuals, s = rng.uniform(0.2, 5.0, 12), [], [], rng.standard_normal((2, 12))
    s[1] = end[1]  # nothing is left to do there
    gmres = ResidualMinimisation(fields, weight, memory, 0.6)
    for _ in range(9):
        states.append(s)
        residuals.append(image(s) - s)
        left = gmres.take(state(s), image(s))
        rows = [least([x[t:t + 1] for x in states], [x[t:t + 1] for x in residuals], np.sqrt(weight), 0.6) for t in range(2)]
        s = gmres.next()
        assert s[0] == pytest.approx(rows[0][0], abs=1e-9) and np.array_equal(s[1], end[1])
        best = gmres.best(state(states[-1]))
        assert best.s + 0.6 * left == pytest.approx(s, abs=1e-12) and not left[1].any()


def test_residual_minimisation_keeps_as_many_directions_as_it_is_told():
    rng = np.random.default_rng(4)
    image, end = mapped(rng, 12)
    short, s, sizes = ResidualMinimisation(fields, np.ones(12), 3, 1.0), np.zeros((2, 12)), []
    for number in range(60):
        sizes.append(np.linalg.norm(short.take(state(s), image(s)), axis=1))
        s = short.next()
        assert len(short.directions) == min(number, 3) and short.depth == 4
        q = np.reshape([q for q, _ in short.directions], (-1, 2, 12)).swapaxes(0, 1)
        assert np.abs(q @ q.swapaxes(1, 2) - np.eye(len(short.directions))).max(initial=0.0) < 1e-9
    assert (np.diff(sizes, axis=0) <= 1e-12).all() and s == pytest.approx(end, abs=1e-6)


def test_relaxation_stays_within_what_converges():
    """The fixed point's eigenvalues are within 1 ± λ for the worst ratio λ of both search directions: α < 2/(1 + λ)."""
    made = config(**method(search_direction={"kplus": "diagonal"}, acceleration="none"))
    with box_of(made) as blackbox:
        d = prepared(made, build_scene(made), blackbox)
    low, high = d.local.conditioning()
    assert 0 < low < 1 < high
    assert Relaxation.of(d, made.method).relaxation == Aitken.of(d, made.method).relaxation == stable_relaxation(low, high)
    assert Relaxation.of(d, config(**method(relaxation=0.3)).method).relaxation == 0.3
    assert stable_relaxation(1.0, 1.0) == 0.8 == stable_relaxation(0.9, 1.1), "the paper's"
    for worst in (2.0, 10.0, 100.0):
        assert stable_relaxation(0.7, worst) == stable_relaxation(1 / worst, 1.2) == pytest.approx(0.9 * 2 / (1 + worst))
    assert 0 < stable_relaxation(0.0, 1.0) == stable_relaxation(1.0, 1e9) < stable_relaxation(1.0, 100.0)


def test_aitken_keeps_its_step_where_nothing_has_changed():
    s, aitken = np.ones((1, 2)), Aitken(0.3, np.ones(2))
    for _ in range(2):
        aitken.take(state(s), 2 * s)
        assert np.array_equal(aitken.next(), 1.3 * s)


def test_aitken_finds_where_a_single_mode_ends():
    """With one mode, two residuals tell the fixed point; with a resumed one in between, too."""
    rng = np.random.default_rng(3)
    mode, end, weight = rng.normal(size=(1, 5)), rng.normal(size=(1, 5)), rng.uniform(1, 2, 5)
    s, aitken, resumed, taken = end + mode, Aitken(0.7, weight), Aitken(0.1, weight), []
    for _ in range(2):
        taken.append((SimpleNamespace(s=s), end + 0.6 * (s - end)))
        aitken.take(*taken[-1])
        s = aitken.next()
    for evaluation in taken[-Aitken.depth:]:
        resumed.take(*evaluation)
    assert s == pytest.approx(end, abs=1e-12) and resumed.next() == pytest.approx(end, abs=1e-12)


def test_gmres_solves_a_linear_problem_in_its_dimension():
    """Residual minimisation over n + 1 evaluations of an affine map of dimension n is exact, row by row."""
    rng = np.random.default_rng(0)
    matrix, shift = rng.standard_normal((6, 6)), rng.standard_normal((3, 6))
    solution = np.linalg.solve(np.eye(6) - matrix, shift.T).T

    class Counting(Team):
        def sum(self, *parts):
            self.reductions += 1
            return super().sum(*parts)

    team = Counting()
    gmres = ResidualMinimisation(fields, rng.uniform(0.5, 2, 6), None, 1.0, team)
    s = np.zeros((3, 6))
    for _ in range(7):
        image = s @ matrix.T + shift
        evaluated = fields(s, image, np.zeros((3, 0)))
        gmres.take(evaluated, image)
        best = gmres.best(evaluated)
        s = gmres.next()
    assert np.abs(best.s - solution).max() < 1e-9 * np.abs(solution).max()
    assert np.abs(best.u - solution).max() < 1e-9 * np.abs(solution).max(), "affine functions of s are combined alike"
    assert team.reductions == 2 + 5 * 3, "three messages for every direction, two for the first"


def test_directions_of_gmres_stay_orthogonal():
    """Rounding does not add up from direction to direction."""
    n, taken, rng = 120, 80, np.random.default_rng(1)
    values = np.geomspace(1e-3, 1.0, n)

    gmres, exact = ResidualMinimisation(fields, np.ones(n), None, 1.0), rng.standard_normal((1, n))
    s = np.zeros((1, n))
    for _ in range(taken):
        image = s - values * (s - exact)
        gmres.take(fields(s, image, np.zeros((1, 0))), image)
        s = gmres.next()
    Q = np.array([q[0] for q, _ in gmres.directions])
    assert len(Q) == taken - 1 and np.abs(Q @ Q.T - np.eye(len(Q))).max() < 1e-11
