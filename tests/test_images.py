"""One model answers for its images: turned, mirrored, moved and numbered otherwise; nothing else passes for one."""

from dataclasses import replace

import numpy as np
from blackbox_case import box

from orchestrator.blackbox.models.congruence import _AXES, _SIGNS, images
from orchestrator.blackbox.models.matter import Matter
from orchestrator.blackbox.protocol import Model


def image_of(model: Model, axes, signs, seed: int) -> Model:
    """Another one that is its image, in another order of nodes, tets and corners, somewhere else."""
    random = np.random.default_rng(seed)
    node, tet = random.permutation(len(model.nodes)), random.permutation(len(model.cells))
    place = np.argsort(node)
    cells = place[model.cells[tet]]
    cells = cells[:, [1, 2, 0, 3] if np.linalg.det(np.eye(3)[axes] * signs) > 0 else [1, 0, 2, 3]]
    return Model("image", (model.nodes[:, axes] * signs)[node] + [1.0, -2.0, 0.5], cells, model.region[tet], model.materials,
                 model.fixed[:, axes][node], np.array([3 * place[d // 3] + list(axes).index(d % 3) for d in random.permutation(model.trace)]))


def with_ten_nodes(model: Model) -> Model:
    """The same with a node in the middle of every edge."""
    edges, middle = np.unique(np.sort(model.cells[:, [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]], axis=2).reshape(-1, 2), axis=0,
                              return_inverse=True)
    return replace(model, nodes=np.vstack([model.nodes, model.nodes[edges].mean(axis=1)]),
                   cells=np.hstack([model.cells, len(model.nodes) + middle.reshape(-1, 6)]),
                   fixed=np.vstack([model.fixed, np.zeros((len(edges), 3), bool)]))


def test_images_are_found_and_answer():
    """All 48 turns of a box whose sides, matter and supports tell them apart; forces of the image are the model's, turned."""
    model, random = box(), np.random.default_rng(1)
    others = [image_of(model, axes, signs, seed) for seed, (axes, signs) in enumerate(zip(_AXES[::5], _SIGNS[::5]))]
    found = images([model, *others], range(len(others) + 1))
    assert sorted(found) == list(range(1, len(others) + 1)) and {first for first, _ in found.values()} == {0}
    for i, other in enumerate(others, start=1):
        image, u = found[i][1], random.standard_normal((2, other.fixed.size))
        forces = Matter.of(other).forces(u)
        assert np.abs(image.back(Matter.of(model).forces(image.to_other(u))) - forces).max() <= 1e-12 * np.abs(forces).max()
        f = random.standard_normal((1, len(model.trace)))
        on = image.on(other.trace, model.trace)
        full, theirs = np.zeros((2, 1, other.fixed.size))
        full[:, other.trace], theirs[:, model.trace] = f, on.to_other(f)
        assert np.array_equal(image.to_other(full), theirs) and np.array_equal(on.back(on.to_other(f)), f)


def test_what_only_looks_alike_is_no_image():
    model = image_of(box(), [1, 0, 2], [1.0, -1.0, 1.0], 7)
    fixed, bent, region, cells = model.fixed.copy(), model.nodes.copy(), model.region.copy(), model.cells.copy()
    a, b = np.flatnonzero(fixed.ravel())[0], np.setdiff1d(np.flatnonzero(~fixed.ravel()), model.trace)[0]
    fixed.ravel()[[a, b]] = False, True
    bent[-1] += 1e-6
    one, two = np.flatnonzero(region == region[0])[0], np.flatnonzero(region != region[0])[0]
    region[[one, two]] = region[[two, one]]
    cells[0, 0] = np.setdiff1d(cells, cells[0])[0]
    free = np.setdiff1d(np.flatnonzero(~model.fixed.ravel()), model.trace)[0]
    others = [replace(model, fixed=fixed), replace(model, nodes=bent), replace(model, region=region), replace(model, cells=cells),
              replace(model, trace=np.append(model.trace[1:], free)), replace(model, materials=model.materials * [1.001, 1.0]),
              replace(model, nodes=model.nodes * 2)]
    assert not any(images([box(), other], [0, 1]) for other in others)
    assert images([box(), model], [0, 1])
    ten, other = with_ten_nodes(box()), with_ten_nodes(model)
    swapped = other.cells.copy()
    swapped[0, [4, 5]] = swapped[0, [5, 4]]
    assert images([ten, other], [0, 1]) and not images([ten, replace(other, cells=swapped)], [0, 1])
