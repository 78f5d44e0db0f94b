"""What makes the coarse contact problem quick leaves it what it is."""

import numpy as np
import pytest
from contact_case import contact
from method_case import box_of, prepared
from test_scene_pairing import MEASURED, made, two_parts

from orchestrator.scene.build import build_scene


def rough_top(x):
    """Lifted and bent: no node of a pair lies on the other."""
    return x + np.outer(0.002 + 0.01 * x[:, 0] ** 2, [0.0, 0.0, 1.0])


def decomposed(config):
    scene = build_scene(config)
    with box_of(config) as blackbox:
        return prepared(config, scene, blackbox)


@pytest.fixture(scope="module", params=["shared nodes", "nodes apart"])
def coarse(request, tmp_path_factory):
    """The coarse contact problem of two blocks."""
    shared = request.param == "shared nodes"
    folder = tmp_path_factory.mktemp("coarse")
    result = decomposed(contact(0.3) if shared else made(folder, two_parts(rough_top), MEASURED)).coarse
    assert result.problem.fields.phi.shape[1] == (4 if shared else 8)
    return result


@pytest.fixture
def steps(coarse):
    """Per load step what the coarse contact problem is asked at the first iteration."""
    stage = coarse.stage
    fields = stage(np.zeros((len(stage.loaded), stage.space.size)))
    F0 = coarse.pairs.traces(*fields.extended).predicted()
    return list(zip(F0, coarse._of_all(coarse._resultants(fields.f)).swapaxes(0, 1)))


def test_moments_do_the_work_of_the_fields(coarse, steps):
    """T, Tᵀf̂ and ΣTᵀ(∂f̂/∂F)L as they are written."""
    pairs, at = coarse.pairs, coarse.problem.fields
    U = coarse.response.U
    T = np.concatenate([pairs.transfer.first(U), -pairs.transfer.second(U)]).transpose(2, 1, 0)
    free = pairs.free.T
    assert np.abs(at.at_pairs()[free] - T[free]).max() < 1e-12 * np.abs(T).max()
    answer = pairs.force(steps[0][0], np.zeros((3, len(pairs))), 0, derivative=True)
    assert len(answer.active)
    carried = np.einsum("pif,ip->f", T, answer.force)
    weight = np.ones(len(pairs))
    assert at.carried(answer.force, weight, 2).ravel() == pytest.approx(carried, abs=1e-12 * np.abs(carried).max())
    slopes = np.einsum("pif,ijp,pjg->fg", T[answer.active], answer.derivative, at.L[answer.active])
    assert np.abs(at.slopes(answer, weight)[0].swapaxes(1, 2).reshape(24, 24) - slopes).max() < 1e-5 * np.abs(slopes).max()


@pytest.mark.parametrize("reach", [0.0, 1e-3, 1.0])
def test_pairs_left_out_come_back_when_they_matter(coarse, steps, reach):
    """However small the fields were believed to be, the solution is that with all pairs."""
    problem, previous = coarse.problem, np.zeros((3, len(coarse.pairs)))
    for step, (F0, resultant) in enumerate(steps):
        problem._reach = {}
        exact, force = problem.solve(step, step, F0, resultant, previous, 1.0)
        problem._reach = {step: np.full(1, reach)}
        found, same = problem.solve(step, step, F0, resultant, previous, 1.0)
        assert np.abs(exact).max() > 0
        assert found == pytest.approx(exact, abs=1e-6 * np.abs(exact).max())
        assert same == pytest.approx(force, abs=1e-6 * np.abs(force).max())
