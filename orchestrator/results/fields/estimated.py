"""The estimated discretisation error of a whole solution, from stresses that are formed for its fields anyway."""

from __future__ import annotations

import numpy as np

from orchestrator.method.stopping.discretisation import SOFTEST, Estimate, moved_alone, size_of
from orchestrator.scene.stress_loops import squares
from orchestrator.results.fields.fields import Fields


def estimated(fields: Fields) -> Estimate | None:
    """As ``Estimator`` finds it; None where it takes other means than those of the fields' nodes, and has to be asked.

    That is so where nothing opens, with ten-node tets, thermal strain or stresses that are not to be believed, and where two
    parts of one matter are bonded, whose stresses at nodes the fields tell apart.
    """
    drawn, nodal = fields.opened, fields.nodal
    if not drawn.compiled or drawn.thermal is not None or drawn.believed is not None or not (drawn.lame[:, 1] > 0).all():
        return None
    meets = np.zeros((int(drawn.joined.max()) + 1) * (kinds := int(drawn.material.max()) + 1), dtype=bool)
    for corner in drawn.cells.T:
        meets[drawn.joined[corner] * kinds + drawn.material] = True
    if np.count_nonzero(meets) != len(nodal):
        return None
    errors, energies, alone = np.empty((fields.steps, len(drawn.cells))), np.empty(fields.steps), np.empty(fields.steps)
    for step in range(fields.steps):
        errors[step], energy = squares(nodal.corner, drawn.stress(step).T, nodal.stress(step).T, drawn.lame, drawn.volumes,
                                       1 / 3 - 2 / (9 * SOFTEST))
        energies[step] = energy.sum()
        alone[step] = moved_alone(drawn.displacement[step], drawn.cells, drawn.volumes, drawn.lame)
    total = errors.sum(axis=1)
    size = size_of(energies + total, alone)
    return Estimate(float(np.sqrt(total.max(initial=0.0)) / size), np.sqrt(errors) / size)
