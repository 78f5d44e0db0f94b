"""What makes the coarse contact problem quick leaves it what it is."""

import gc

import numpy as np
import pytest
from contact_case import CASES, contact, converged
from method_case import decomposed
from test_scene_pairing import MEASURED, made, two_parts

from orchestrator.config.model import Config
from orchestrator.laws.points import Answer
from orchestrator.method.coarse.cluster import Cluster
from orchestrator.method.coarse.load_step import Line, LoadStep
from orchestrator.method.coarse.newton import search
from orchestrator.method.coarse.pair_fields import PairFields
from orchestrator.method.events import Subscriber
from orchestrator.method.interface.pairs import History
from orchestrator.method.interface.rows import times
from orchestrator.run import solve


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


def test_each_interface_has_as_many_shapes_as_its_own_fields_need():
    """One body moves in fields of its own, at random; its neighbours' sums over points do not take longer for it."""
    pairs, random = decomposed(contact(0.3, **CASES["eight cubes"])).coarse.pairs, np.random.default_rng(1)
    own = np.repeat([0 in i.subdomains for i in pairs.interfaces], np.diff(pairs.bounds))
    x = np.column_stack([np.ones(len(pairs)), random.normal(size=(len(pairs), 3))])
    T = np.einsum("pm,mif->pif", x, random.normal(size=(4, 3, 24)))
    T[own], L = random.normal(size=(own.sum(), 3, 24)), random.normal(size=T.shape)
    at = PairFields.of(pairs, T, L, 8)
    assert at.shapes.tolist() == [b - a if own[a] else 4 for a, b in zip(pairs.bounds[:-1], pairs.bounds[1:])]
    some = np.flatnonzero(random.random(len(pairs)) < 0.7)
    part, T, L = at.some(some), T[some], L[some]
    assert np.abs(part.T - T).max() < 1e-12 * np.abs(T).max()
    weight, force, y = random.random(len(pairs)), random.normal(size=(3, len(some))), random.normal(size=(8, 12))
    both = at.both(y)[np.repeat(np.arange(len(at.ends)), np.diff(part.pairs.bounds))]
    for found, expected in zip(part.swept(y, weight), (L, weight[some, None, None] * T)):
        assert found == pytest.approx(np.einsum("pif,pf->ip", expected, both), abs=1e-5 * np.abs(found).max())
    assert np.vdot(part.carried(force, weight), y) == pytest.approx(np.einsum("p,pif,ip,pf->", weight[some], T, force, both))
    answer = Answer(force, None, np.arange(len(some)), random.normal(size=(3, 3, len(some))))
    slopes = np.einsum("p,pif,ijp,pjg->pfg", weight[some], T, answer.derivative, L)
    for found, a, b in zip(part.slopes(answer, weight), part.pairs.bounds[:-1], part.pairs.bounds[1:]):
        assert found.swapaxes(1, 2).reshape(24, 24) == pytest.approx(slopes[a:b].sum(axis=0), abs=1e-5 * np.abs(slopes).max())


def test_few_bodies_alone_are_a_part_of_all():
    """ρ, its derivative and a line of a cluster, beside those of all bodies where the others stand still."""
    d = decomposed(contact(0.3, **CASES["eight cubes"], method={"contact": {"stabilisation": 1e-3}}))
    problem, members, random = d.coarse.problem, np.array([1, 5, 6]), np.random.default_rng(2)
    F0, shape = 1e-3 * random.normal(size=(3, len(d.coarse.pairs))) * d.coarse.pairs.points.stiff_n, problem.bodies.K0.shape[:2]
    at = LoadStep(problem.bodies, 0, F0, random.normal(size=shape), History.none(len(d.coarse.pairs)))
    start, dy = 1e-3 * random.normal(size=(2, *shape))
    dy[np.setdiff1d(np.arange(8), members)] = 0.0
    few = Cluster(at, at.residual(start), start, members)
    assert few.residual(start)[members] == pytest.approx(at.residual(start)[members], rel=1e-9)
    whole = at.bodies.pattern.matrix(at.matrix(), 0.0).toarray().reshape(8, 12, 8, 12)[members][:, :, members]
    assert few.matrix() == pytest.approx(whole.reshape(36, 36), abs=1e-6 * np.abs(whole).max())
    few.residual(start)
    one, two = Line(few, dy), Line(at, dy)
    assert one(0.4) == pytest.approx(two(0.4), rel=1e-9)
    assert one.end(0.4)[members] == pytest.approx(two.end(0.4)[members], rel=1e-9)
    assert not np.delete(few.residual(start + dy), members, axis=0).any()
    assert np.unique(few.answer(few.F).status).tolist() == [0, 1, 2]


def test_rigid_bodies_move_as_such_and_lead_to_the_same_end():
    """Six fields per body, that strain nothing; where bodies end is no matter of how many there are."""
    config = contact(0.3, error=1e-8)
    d = decomposed(rigidly(config))
    x = d.scene.mesh.nodes[d.space.dof // 3]
    assert d.coarse.response.U.shape == (6, d.space.size) and d.coarse.sweeps == 6
    for e, part in enumerate(d.coarse.parts):
        of_node = {}
        for column, dof in zip(range(part.start, part.stop), d.space.dof[part]):
            of_node.setdefault(dof // 3, {})[dof % 3] = column
        whole = np.array([[c[0], c[1], c[2]] for c in of_node.values() if len(c) == 3])
        apart = np.linalg.norm(x[whole[1:, 0]] - x[whole[0, 0]], axis=1)
        u = d.coarse.response.U[:, whole]  # distances between nodes do not change to first order
        way = (x[whole[1:, 0]] - x[whole[0, 0]]) / apart[:, None]
        assert np.abs(((u[:, 1:] - u[:, :1]) * way).sum(axis=2)).max() < 1e-10 * np.abs(u).max()
    one, two = converged(config), converged(rigidly(config))
    assert two.displacement == pytest.approx(one.displacement, abs=1e-7 * np.abs(one.displacement).max())


def test_the_first_half_of_affine_fields_is_rigid_and_may_be_eliminated_alone(monkeypatch):
    """The same end as with all fields in the fronts, in a coarse problem whose stretches follow by GMRES."""
    config = contact(0.3, error=1e-8)
    d, rigid = decomposed(config), decomposed(rigidly(config))
    k = d.coarse.stage.direction.k
    one = times(k, d.coarse.response.U)
    for part in d.coarse.parts:  # every rigid motion is one of the first six fields', U k Uᵀ = 1
        shares = one[:6, part] @ rigid.coarse.response.U[:, part].T
        assert shares @ shares.T == pytest.approx(np.eye(6), abs=1e-9)
    assert d.coarse.problem.bodies.pattern.first == 12
    expected = converged(config).displacement
    monkeypatch.setattr("orchestrator.method.coarse.elimination.WORTH", 0.0)
    assert decomposed(config).coarse.problem.bodies.pattern.first == 6
    assert converged(config).displacement == pytest.approx(expected, abs=1e-7 * np.abs(expected).max())


class Cycles(Subscriber):
    """What Python's search for cycles finds of iterations 3 and 4."""

    def __init__(self):
        self.left = []

    def iteration(self, event):
        if event.iteration in (2, 4):
            gc.collect()
            gc.set_debug(gc.DEBUG_SAVEALL)
            self.left = [type(x).__qualname__ for x in gc.garbage if type(x).__module__.startswith("orchestrator")]


@pytest.mark.parametrize("known", [0, 1, 3])
def test_a_line_whose_work_is_no_number_ends(known):
    """As where bodies grow without limit, which the iterations then tell."""
    works = iter([8.0, -6.0, 5.0][:known])
    assert 0 < search(lambda theta: next(works, np.nan), -1.0) <= 1


def test_an_iteration_leaves_no_cycles_behind():
    """They would hold its arrays until Python looks for cycles, which with so few objects it hardly does."""
    found, method = Cycles(), {"tolerance": {"error": 1e-12}, "max_iterations": 4, "contact": {"stabilisation": 1e-6}}
    gc.disable()
    try:
        solve(contact(0.3, method=method), subscribers=[found])
    finally:
        gc.set_debug(0)
        gc.enable()
        gc.garbage.clear()
    assert found.left == []
