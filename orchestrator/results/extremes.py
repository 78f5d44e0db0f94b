"""The largest and smallest of every quantity, part by part, with their places and load steps; signed.

extremes.csv has a line for each: displacement of the nodes, stress as in ``nodal``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orchestrator.results.fields.nodal import Nodal
from orchestrator.scene.elasticity import principal, von_mises

NAME = "extremes.csv"
DISPLACEMENT = ("ux", "uy", "uz", "|u|")
STRESS = ("sxx", "syy", "szz", "sxy", "syz", "sxz", "von_mises", "s1", "s2", "s3")
RESULTANT = ("fx", "fy", "fz", "mx", "my", "mz")
COLUMNS = ("part", "quantity", "extreme", "value", "x", "y", "z", "load_step")


@dataclass(frozen=True)
class Extremes:
    """Extremes of p parts and q quantities, as ``DISPLACEMENT`` and ``STRESS`` name them, the smallest and the largest.

    parts : names; quantities : names
    value : (2, p, q), nan where nothing is known or to be believed
    at : (2, p, q, 3) places in the undeformed body; step : (2, p, q) int, from 1
    """

    parts: tuple[str, ...]
    quantities: tuple[str, ...]
    value: np.ndarray
    at: np.ndarray
    step: np.ndarray

    @property
    def rows(self) -> Iterator[tuple]:
        """Rows with ``COLUMNS``; what is not known is left out."""
        for p, part in enumerate(self.parts):
            for q, quantity in enumerate(self.quantities):
                for k, extreme in enumerate(("min", "max")):
                    if np.isfinite(self.value[k, p, q]):
                        yield (part, quantity, extreme, float(self.value[k, p, q]), *map(float, self.at[k, p, q]), int(self.step[k, p, q]))

    def largest(self, quantity: str) -> dict[str, object] | None:
        """The largest of all parts: value, at, part, load_step; None where none is known."""
        values = self.value[1, :, self.quantities.index(quantity)]
        if not np.isfinite(values).any():
            return None
        p, q = int(np.nanargmax(values)), self.quantities.index(quantity)
        return {"value": float(values[p]), "at": self.at[1, p, q].tolist(), "part": self.parts[p], "load_step": int(self.step[1, p, q])}


def components_of_stress(sigma: np.ndarray) -> np.ndarray:
    """(..., 10) as ``STRESS``, of stresses (..., 6) in VTK's order."""
    return np.concatenate([sigma, von_mises(sigma)[..., None], principal(sigma)], axis=-1)


def components_of_displacement(u: np.ndarray) -> np.ndarray:
    """(..., 4) components and length of displacements (..., 3), as ``DISPLACEMENT``."""
    return np.concatenate([u, np.linalg.norm(u, axis=-1, keepdims=True)], axis=-1)


def extremes(nodal: Nodal, lost: np.ndarray | None = None) -> Extremes:
    """Extremes of a solution, over all load steps.

    lost : (steps, subdomains) bool, bodies that nothing holds: where they are means nothing; None: there are none
    """
    fields, names = nodal.fields, nodal.fields.parts or ("",)
    node, cells = nodal.split
    part = np.zeros(len(node), dtype=int)
    part[cells] = 0 if fields.part is None else fields.part[:, None]
    points = fields.nodes[node]
    shape = (2, len(names), len(DISPLACEMENT) + len(STRESS))
    value, step_of, at = np.full(shape, np.nan), np.zeros(shape, dtype=int), np.zeros((*shape, 3))
    for step in range(fields.steps):
        u = components_of_displacement(fields.displacement[step][node])
        if lost is not None and lost[step].any():
            u[np.unique(cells[lost[step][fields.subdomain]])] = np.nan
        moved = _ends(u, part, len(names))
        inside = _ends(components_of_stress(nodal.stress(step)), nodal.part, len(names))
        found, which = (np.concatenate(both, axis=2) for both in zip(moved, inside))
        better = np.stack([~(found[0] >= value[0]), ~(found[1] <= value[1])]) & np.isfinite(found)
        value[better], step_of[better] = found[better], step + 1
        at[better] = points[which[better]]
    return Extremes(names, DISPLACEMENT + STRESS, value, at, step_of)


def _ends(values: np.ndarray, part: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(2, count, q) smallest and largest of values (K, q) of each part, and where these are, int; nan where all are nan."""
    order = np.argsort(part, kind="stable") if count > 1 else np.arange(len(part))
    bounds = np.searchsorted(part[order], np.arange(count + 1))
    result, which = np.full((2, count, values.shape[1]), np.nan), np.zeros((2, count, values.shape[1]), dtype=int)
    for p, (a, b) in enumerate(zip(bounds[:-1], bounds[1:])):
        rows = order[a:b]
        rows = rows[np.isfinite(values[rows]).all(axis=1)]
        if len(rows):
            own = values[rows]
            for k, place in enumerate((own.argmin(axis=0), own.argmax(axis=0))):
                which[k, p] = rows[place]
                result[k, p] = own[place, np.arange(own.shape[1])]
    return result, which
