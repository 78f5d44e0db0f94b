"""What FreeFEM answers beside what ``conformance`` asks of it (test_conformance.py), through both transports."""

from pathlib import Path

import numpy as np
import pytest
from blackbox_case import assemble, box, chain, difference, forces, settings

from orchestrator.blackbox.codes.freefem.code import report
from orchestrator.blackbox.pool import longest_first
from orchestrator.blackbox.start import make_blackbox


@pytest.fixture(scope="module")
def models():
    return [box((3, 2, 2), "a"), box((2, 2, 3), "b", seed=1), box((4, 3, 2), "c", seed=2)]


@pytest.fixture(scope="module")
def pool(models):
    with make_blackbox(settings(workers=2)) as blackbox:
        blackbox.load(models)
        yield blackbox


def test_some_models_and_uneven_right_hand_sides(pool, models):
    both = pool.traces({2: forces(models[2], 4), 0: forces(models[0], 1)})
    assert list(both) == [2, 0]
    assert [u.shape for u in both.values()] == [(4, len(models[2].trace)), (1, len(models[0].trace))]
    assert pool.traces({1: np.zeros((0, len(models[1].trace)))})[1].shape == (0, len(models[1].trace))
    assert pool.traces({}) == {}


def test_forces_of_the_wrong_size_are_refused(pool):
    with pytest.raises(ValueError, match="expected \\(rhs, "):
        pool.traces({0: np.zeros((1, 3))})


@pytest.mark.parametrize("changes", [{"workers": 1}, {"transport": "file", "workers": 2}])
def test_workers_and_transports_agree(pool, models, changes):
    f = {i: forces(m) for i, m in enumerate(models)}
    whole = {i: np.random.default_rng(9).standard_normal((2, m.fixed.size)) for i, m in enumerate(models)}
    with make_blackbox(settings(**changes)) as other:
        other.load(models)
        for mine, theirs in [
            (pool.traces(f), other.traces(f)),
            (pool.fields(whole), other.fields(whole)),
            (dict(enumerate(pool.stiffness(models))), dict(enumerate(other.stiffness(models)))),
        ]:
            for i in range(len(models)):
                assert difference(theirs[i], mine[i]) < 1e-12


def test_loading_again_forgets_what_was_loaded(models):
    with make_blackbox(settings()) as blackbox:
        blackbox.load(models)
        blackbox.load(models[1:])
        f = forces(models[1])
        again = blackbox.traces({0: f})[0]
        blackbox.load([models[1]])
        assert difference(again, blackbox.traces({0: f})[0]) == 0


@pytest.mark.parametrize("nodes", [64, 512, 1024])
def test_vertex_counts_that_stall_freefem(nodes):
    model = chain(nodes)
    assert len(model.nodes) == nodes
    with make_blackbox(settings(timeout=120.0)) as blackbox:
        blackbox.load([model])
        (k,) = blackbox.stiffness([model])
        assert difference(k, assemble(model)) < 1e-12
        f = np.random.default_rng(0).standard_normal((1, 3 * nodes))
        u = blackbox.fields({0: f})[0]
        residual = (k @ u[0] - f[0])[~model.fixed.ravel()]
        assert abs(residual).max() < 1e-6 * abs(k).max() * abs(u).max()


def test_the_processes_use_openblas(pool):
    assert len(pool.usage.pids()) == 2
    for pid in pool.usage.pids():
        assert "openblas" in blas_of(pid)


def test_doctor_finds_everything_here():
    assert not [line for line in report() if line.startswith("missing")]


def test_the_clock_and_memory(pool, models):
    pool.traces({i: forces(model) for i, model in enumerate(models)})
    clock = pool.usage.clock()
    assert set(clock) == {"start", "assemble", "factorise", "solve"}
    assert all(seconds > 0 for seconds in clock.values())
    assert 40 < pool.usage.memory_peak_mb() < 500


def test_placing_puts_the_longest_first():
    assert longest_first([1, 5, 3, 3], 2) == [[1, 0], [2, 3]]


def blas_of(pid: int) -> str:
    """Path of the BLAS library that a running process has mapped; '' when none is."""
    paths = [row.split(maxsplit=5)[-1].strip() for row in Path(f"/proc/{pid}/maps").read_text().splitlines()]
    libraries = [path for path in paths if "blas" in Path(path).name and "gslcblas" not in path]
    return next((path for path in libraries if "openblas" in path), libraries[0] if libraries else "")
