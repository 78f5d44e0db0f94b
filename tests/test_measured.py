"""What an estimate tells, measured by the energies on two meshes, against an exact solution."""

import math
from dataclasses import replace

from test_discretisation import LENGTH, WEIGHT, YOUNG, contact, hanging, solved

from orchestrator.accuracy.measured import energies, explained, told
from orchestrator.method.delivery.quantities import estimator_of


def weighed(problem):
    run = solved(problem)
    estimator = estimator_of(run.scene)
    found = estimator(run.sides)
    return energies(run, estimator, found), found.relative


def test_against_an_exact_solution():
    """Of a bar that hangs: an estimate that tells too little is raised to near the truth, by what two meshes tell."""
    exact = 2 * WEIGHT**2 * LENGTH**3 / (6 * YOUNG)  # ∫ σ²/E
    (coarse, _), (fine, error) = (weighed(hanging(n, tolerance=1e-6)) for n in (2, 4))
    assert coarse.potential > fine.potential > -exact
    true = math.sqrt((fine.potential + exact) / exact)
    assert 0.9 < error / true < 1.2 and told(coarse, fine) == 1  # as much as there is, or more: never lowered
    less = [replace(one, estimated=0.36 * one.estimated) for one in (coarse, fine)]
    share = told(*less)
    assert share < 1 and 0.8 < 0.6 * error / share / true < 1.3
    assert told(fine, coarse) is None and told(None, fine) is None
    shaken = replace(fine, volume=0.9 * fine.volume)  # bodies that change with the mesh
    lighter = replace(fine, loads=[0.9 * x for x in fine.loads])
    assert told(coarse, shaken) is None and told(coarse, lighter) is None and explained(coarse, fine)
    assert not explained(replace(coarse, energy=4 * fine.energy), fine)


def test_not_with_friction():
    assert weighed(contact(1e-3))[0] is None
    assert weighed({**contact(1e-3), "interfaces": [{"law": "contact"}]})[0] is not None
