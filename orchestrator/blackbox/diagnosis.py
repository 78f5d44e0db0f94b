"""The usual mistakes of a solver, by name, from wrong answers."""

from __future__ import annotations

import numpy as np

AGREE = 1e-9  # relative difference that rounding may leave on sound models
ROUGH = 1e-4  # below it, a difference looks like missing digits rather than like a mistake


def difference(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference relative to the largest expected entry."""
    scale = np.abs(expected).max(initial=0.0)
    return float(np.abs(found - expected).max(initial=0.0) / (scale or 1.0))


def diagnosis(found: np.ndarray, expected: np.ndarray) -> str:
    """Say what is wrong with displacements (rhs, 3n); empty when they are right.

    found, expected : a row per load case, dof = 3 * node + component
    """
    if found.shape != expected.shape:
        return (
            f"{'x'.join(map(str, found.shape))} values for {'x'.join(map(str, expected.shape))}"
            " expected: a row per load case, a column per dof"
        )
    if not np.isfinite(found).all():
        return "values that are not finite"
    if (apart := difference(found, expected)) <= AGREE:
        return ""
    still = (expected == 0).all(axis=0) & found.any(axis=0)
    if still.any() and difference(np.where(still, 0.0, found), expected) <= AGREE:
        return f"clamped dofs move: {int(still.sum())} of them"
    missing = [i for i in range(len(expected)) if not found[i].any() and expected[i].any()]
    if missing:
        return (
            f"load case {missing[0] + 1} of {len(expected)} was not answered: all its "
            "displacements are zero")
    order = [next((j for j, row in enumerate(expected) if difference(f, row) <= AGREE), -1)
             for f in found]
    if -1 not in order and order != list(range(len(order))):
        return f"load cases in another order: {', '.join(str(i + 1) for i in order)}"
    factor = float(np.sum(found * expected) / np.sum(expected**2))
    if abs(factor - 1) > ROUGH and difference(found,
                                              factor * expected) <= AGREE * max(abs(factor), 1.0):
        if abs(factor + 1) <= AGREE:
            return "the opposite sign: displacements along the forces are expected"
        return (
            f"{factor:.6g} times what is expected: are forces, lengths and moduli in the units of "
            "the model?")
    nodes = expected.shape[1] // 3
    if 3 * nodes == expected.shape[1] and difference(
        found.reshape(-1, 3, nodes).swapaxes(1, 2).reshape(found.shape), expected) <= AGREE:
        return "dofs component after component: 3 * node + component is expected"
    if difference(np.sort(found, axis=1), np.sort(expected, axis=1)) <= AGREE:
        return (
            "the right displacements at the wrong dofs: nodes are numbered otherwise than in the "
            "model")
    if apart <= ROUGH:
        return (
            f"{-np.log10(apart):.0f} right digits only: single precision, or numbers written with "
            "few digits")
    return f"relative difference {apart:.1e}"
