"""What makes the coarse contact problem quick leaves it what it is."""


import numpy as np
import pytest
from contact_case import contact
from method_case import decomposed
from test_scene_pairing import MEASURED, made, two_parts

from orchestrator.config.model import Config
from orchestrator.method.coarse.newton import search
from orchestrator.method.interface.pairs import History
from orchestrator.method.interface.rows import times


def rough_top(x):
    """Lifted and bent: no node of a pair lies on the other."""
    return x + np.outer(0.002 + 0.01 * x[:, 0] ** 2, [0.0, 0.0, 1.0])


def rigidly(config):
    """The same with a coarse problem of rigid bodies."""
    return Config.model_validate({**config.complete(), "method": {**config.complete()["method"], "coarse": "rigid"}})


@pytest.fixture(scope="module", params=["shared nodes", "nodes apart", "shared nodes, rigid bodies"])
def coarse(request, tmp_path_factory):
    """The coarse contact problem of two blocks."""
    shared = request.param.startswith("shared nodes")
    folder = tmp_path_factory.mktemp("coarse")
    config = contact(0.3) if shared else made(folder, two_parts(rough_top), MEASURED)
    return decomposed(rigidly(config) if request.param.endswith("rigid bodies") else config).coarse


@pytest.fixture
def steps(coarse):
    """Per load step what the coarse contact problem is asked at the first iteration."""
    stage = coarse.stage
    fields = stage(np.zeros((len(stage.loading.boundary), stage.space.size)))
    F0 = coarse.pairs.traces(*fields.extended).predicted()
    return list(zip(F0, coarse._of_all(coarse._resultants(fields.f)).swapaxes(0, 1)))


def test_sums_over_points_do_the_work_of_the_fields(coarse, steps):
    """T, Tᵀf̂ and ΣTᵀ(∂f̂/∂F)L as they are written."""
    pairs, at = coarse.pairs, coarse.problem.fields
    U = coarse.response.U
    T = np.concatenate([pairs.transfer.first(U), -pairs.transfer.second(U)]).transpose(2, 1, 0)
    free = pairs.free.T
    assert np.abs(at.T[free] - T[free]).max() < 1e-12 * np.abs(T).max()
    answer = pairs.force(steps[0][0], History.none(len(pairs)), 0, derivative=True)
    assert len(answer.active)
    carried = np.einsum("pif,ip->f", T, answer.force)
    weight = np.ones(len(pairs))
    assert at.carried(answer.force, weight).ravel() == pytest.approx(carried, abs=1e-12 * np.abs(carried).max())
    slopes = np.einsum("pif,ijp,pjg->fg", T[answer.active], answer.derivative, at.L[answer.active])
    assert np.abs(at.slopes(answer, weight)[0].swapaxes(1, 2).reshape(slopes.shape) - slopes).max() < 1e-5 * np.abs(slopes).max()


def test_the_first_half_of_affine_fields_is_rigid():
    """So that it may be eliminated alone, where that is worth it: few bodies' fields all are."""
    config = contact(0.3, error=1e-8)
    d, rigid = decomposed(config), decomposed(rigidly(config))
    k = d.coarse.stage.direction.k
    one = times(k, d.coarse.response.U)
    for part in d.coarse.parts:  # every rigid motion is one of the first six fields', U k Uᵀ = 1
        shares = one[:6, part] @ rigid.coarse.response.U[:, part].T
        assert shares @ shares.T == pytest.approx(np.eye(6), abs=1e-9)
    assert d.coarse.problem.bodies.pattern.elimination.size == 12


@pytest.mark.parametrize("known", [0, 1, 3])
def test_a_line_whose_work_is_no_number_ends(known):
    """As where bodies grow without limit, which the iterations then tell."""
    works = iter([8.0, -6.0, 5.0][:known])
    assert 0 < search(lambda theta: next(works, np.nan), -1.0) <= 1
