"""Faces of meshes that are not ours: nodes of one side on the shape functions of the other."""

import numpy as np
import pytest
from mortar_case import TURN, there

from orchestrator.scene.interfaces.mortar.face import Face
from orchestrator.scene.interfaces.mortar.feet import feet
from orchestrator.scene.interfaces.mortar.node_to_face import carried, dealt_out


def grid(kind, n, shape=lambda p: p):
    """A unit square of facets of so many nodes each; those between corners are in the middle of straight edges."""
    m = 2 * n + 1
    x = np.linspace(0, 1, m)
    points = shape(np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((m, m))], axis=-1).reshape(-1, 3))

    def at(i, j):
        return (i * m + j).ravel()

    i, j = 2 * np.indices((n, n))
    square = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)]
    halves = [[(0, 0), (2, 0), (2, 2), (1, 0), (2, 1), (1, 1)], [(0, 0), (2, 2), (0, 2), (1, 1), (1, 2), (0, 1)]]
    cells = [square[:kind]] if kind in (4, 8) else [half[:kind] for half in halves]
    facets = np.concatenate([np.stack([at(i + a, j + b) for a, b in cell], axis=1) for cell in cells])
    used, local = np.unique(facets, return_inverse=True)
    return Face(there(points[used], TURN), [local.reshape(facets.shape)])


def skewed(p):
    """No facet is a parallelogram any more, all are plane."""
    return np.c_[p[:, 0] * (1 + 0.3 * p[:, 1]), p[:, 1] * (1 - 0.2 * p[:, 0]), p[:, 2]]


def bent(p):
    return np.c_[p[:, :2], 0.1 * p[:, 0] ** 2 - 0.1 * p[:, 0] * p[:, 1]]


def nodes(count=40, away=0.0):
    """Inside the square, so far above it."""
    inner = np.random.default_rng(1).uniform(0.1, 0.7, (count, 2))
    return there(np.c_[inner, np.full(count, away)], TURN)


@pytest.mark.parametrize("kind", [3, 4, 6, 8])
def test_functions_of_the_other_side(kind):
    """Linear fields arrive as they are, quadratic ones from facets that have them; also where facets are no parallelograms."""
    for shape in (lambda p: p, skewed):
        face, here = grid(kind, 3, shape), nodes()
        on = feet(here, face, 0.1)
        assert on.there.all() and on.distance.max() < 1e-13 and on.beside.max() < 1e-13
        assert np.abs(on.weights @ face.points - here).max() < 1e-13
        assert np.abs(np.asarray(on.weights.sum(axis=1)).ravel() - 1).max() < 1e-13
    if kind in (6, 8):
        face = grid(kind, 3)
        assert np.abs(feet(here, face, 0.1).weights @ (face.points @ [1, 2, -1]) ** 2 - (here @ [1, 2, -1]) ** 2).max() < 1e-13


@pytest.mark.parametrize("kind", [3, 4, 6, 8])
@pytest.mark.parametrize("shape, away", [(lambda p: p, 0.02), (bent, 0.03)], ids=["apart", "curved"])
def test_rigid_motions_open_nothing_and_moments_are_opposite(kind, shape, away):
    """Nodes off the face are carried like an arm; the gap is their distance, whether the slave's facets are known or not."""
    face, here = grid(kind, 3, shape), nodes(away=away)
    side = carried(here, face, 0.2)
    turn = np.array([0.3, -0.2, 0.5])
    moved = (side.second @ np.cross(turn, face.points).ravel()).reshape(-1, 3)
    assert np.abs(moved - np.cross(turn, here)).max() < 1e-12
    force = np.random.default_rng(2).normal(size=here.shape)
    other = (side.second.T @ force.ravel()).reshape(-1, 3)
    assert np.abs(other.sum(axis=0) - force.sum(axis=0)).max() < 1e-11
    assert np.abs(np.cross(face.points, other).sum(axis=0) - np.cross(here, force).sum(axis=0)).max() < 1e-11
    assert np.abs(side.gap - side.feet.distance).max() < 1e-9 and np.abs(np.linalg.norm(side.normal, axis=1) - 1).max() < 1e-12
    if shape is not bent:
        assert np.abs(side.gap - away).max() < 1e-12
    known = grid(8, 2)
    side = carried(known.points, face, 0.2, known)
    assert abs(side.area.sum() - 1) < 1e-12 and np.abs(side.normal - side.normal[0]).max() < 1e-12


def test_what_misses_the_face_is_told():
    face = grid(4, 3)
    on = feet(there(np.array([[0.5, 0.5, 0.0], [1.05, 0.5, 0.01], [0.5, 0.5, 0.5]]), TURN), face, 0.1)
    assert on.there.tolist() == [True, True, False] and on.weights.indptr[-1] == on.weights.indptr[-2]
    assert abs(on.beside[1] - 0.05) < 1e-12 and on.beside[0] < 1e-13
    with pytest.raises(ValueError, match="facets of 5 nodes; there are those of 3, 4, 6, 8"):
        Face(face.points, [np.zeros((2, 5), int)])


@pytest.mark.parametrize("n", [3, 9])
def test_nodes_alone_share_the_area_of_the_face_behind_them(n):
    """Of a face that is wider than they are no more than what is theirs."""
    for slave in (grid(3, n).points, nodes(200)):
        area = dealt_out(slave, grid(8, 4))
        assert 0.3 < area.sum() <= 1 + 1e-12
    assert abs(dealt_out(grid(3, n).points, grid(4, 5)).sum() - 1) < 1e-12
