"""What a run of N equal cubes, one to a core, would take on a cluster.

Measured: what one subdomain costs the code and the orchestrator, on the runs of this study; the macro problem, on
matrices of its pattern. Assumed: the network, and that costs grow as far as they were not measured.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.factor import Factor

LATENCY, BANDWIDTH = 2e-6, 1e10  # of a cluster's network: seconds per message, bytes per second
FIELDS, FACES = 9, 6  # affine fields in three components on a plane interface; interfaces of a cube
REDUCTIONS = 6  # per iteration: macro resultants, indicator, bound, jumps and imbalances, acceleration
GRIDS = (4, 5, 6, 7, 8)  # cubes a side of the macro problems that are measured


@dataclass(frozen=True)
class Costs:
    """Seconds of one subdomain on one core.

    Parameters
    ----------
    start : of Python and the code's process
    scene : mesh, cut and interfaces, per subdomain of the whole scene: one rank makes it for all
    prepare : the orchestrator in the set-up: soles, search direction, macro problem, loads
    factorise : assembling and factorising
    solve : one back-substitution; message : what is on the way to the code and back
    own : the orchestrator in one iteration: local stage, acceleration, error measures
    iterations, sweeps : of a run; back-substitutions of a subdomain in all iterations
    trace : dofs on one face
    """

    start: float
    scene: float
    prepare: float
    factorise: float
    solve: float
    message: float
    own: float
    iterations: int
    sweeps: float
    trace: float

    @classmethod
    def of(cls, summary: Mapping[str, Any]) -> "Costs":
        """Of a run with one rank and one worker."""
        count, sweeps, iterations = summary["subdomains"], summary["sweeps"]["iterations"], summary["iterations"]
        timing = summary["timing"]
        (setup,), (loop,) = (summary["workload"][period]["workers"] for period in ("set_up", "iterations"))
        return cls(
            start=timing["startup"] + timing["start"],
            scene=timing["mesh"] / count, prepare=(timing["soles"] + setup["idle"]) / count,
            factorise=(setup["assemble"] + setup["factorise"]) / count,
            solve=loop["solve"] / (count * sweeps), message=max(loop["messages"], 0.0) / (count * sweeps),
            own=loop["idle"] / (count * iterations), iterations=iterations, sweeps=sweeps,
            trace=3 * summary["interface_nodes"] / summary["interfaces"])


@dataclass(frozen=True)
class MacroCosts:
    """Growth of the macro problem with N subdomains: (factor, exponent) of factor · N^exponent.

    Parameters
    ----------
    factorise, solve : seconds of one factorisation and of one solution
    entries : of the factor
    """

    factorise: tuple[float, float]
    solve: tuple[float, float]
    entries: tuple[float, float]

    def at(self, quantity: str, count: int) -> float:
        factor, exponent = getattr(self, quantity)
        return factor * count**exponent


def measure_macro(grids: Sequence[int] = GRIDS) -> tuple[MacroCosts, list[dict[str, float]]]:
    """Factorise matrices of the macro problem's pattern for cubes in a grid; also what was measured."""
    rows = []
    for side in grids:
        matrix, right = macro_pattern(side), np.ones((1, FIELDS * 3 * side * side * (side - 1)))
        begin = time.process_time()
        solve = Factor(matrix)
        done = time.process_time()
        repeats = 0
        while time.process_time() - done < 0.02:
            solve(right)
            repeats += 1
        seconds = (time.process_time() - done) / repeats
        rows.append({"subdomains": side**3, "unknowns": right.size, "factorise": done - begin, "solve": seconds,
                     "entries": solve.entries})
    return MacroCosts(*(_growth(rows, key) for key in ("factorise", "solve", "entries"))), rows


def macro_pattern(side: int) -> sp.csr_array:
    """Symmetric positive definite matrix with the macro problem's pattern for side³ cubes.

    Two interfaces are coupled where they belong to one subdomain.
    """
    number = np.arange(side**3).reshape((side,) * 3)
    low, high = range(side - 1), range(1, side)
    pairs = np.concatenate([np.stack([number.take(low, a).ravel(), number.take(high, a).ravel()], 1) for a in range(3)])
    count = len(pairs)
    interface = np.repeat(np.arange(count), 2)
    touches = sp.csr_array((np.ones(2 * count), (interface, pairs.ravel())), shape=(count, side**3))
    coupled = sp.csr_array(touches @ touches.T)
    blocks = sp.csr_array(sp.kron(coupled, np.ones((FIELDS, FIELDS))))
    return sp.csr_array(blocks + sp.diags_array(2.0 * blocks.sum(axis=1)))


def predict(costs: Costs, macro: MacroCosts, count: int) -> dict[str, dict[str, float]]:
    """Seconds of ``count`` subdomains on as many cores: {"set_up" | "iterations": {what: seconds}}, whole run."""
    levels = math.ceil(math.log2(max(count, 2)))
    right_side = 8.0 * FIELDS * FACES / 2 * count  # bytes of the macro problem's right-hand side
    reductions = REDUCTIONS * levels * LATENCY + levels * LATENCY + 2 * right_side / BANDWIDTH
    return {
        "set_up": {
            "start": costs.start,
            "scene, on one rank": costs.scene * count,
            "prepare": costs.prepare,
            "factorise": costs.factorise,
            "macro columns": FIELDS * FACES * (costs.solve + costs.message),
            "macro problem: gather": levels * LATENCY + 8.0 * (FIELDS * FACES) ** 2 * count / BANDWIDTH,
            "macro problem: factorise": macro.at("factorise", count),
        },
        "iterations": {
            "solve": costs.sweeps * costs.solve,
            "messages to the code": costs.sweeps * costs.message,
            "orchestrator": costs.iterations * costs.own,
            "traces to neighbours": costs.iterations * FACES * (LATENCY + 8 * 2 * costs.trace / BANDWIDTH),
            "reductions": costs.iterations * reductions,
            "macro problem: solve": costs.iterations * macro.at("solve", count),
        },
    }


def limit(costs: Costs, macro: MacroCosts) -> float:
    """Number of subdomains from which the redundant macro solution takes longer than a subdomain's own solve."""
    factor, exponent = macro.solve
    return (costs.sweeps / costs.iterations * costs.solve / factor) ** (1 / exponent)


def _growth(rows: Sequence[Mapping[str, float]], quantity: str) -> tuple[float, float]:
    """Factor and exponent through the larger half of what was measured."""
    rows = rows[len(rows) // 2:] if len(rows) > 3 else rows
    exponent, log_factor = np.polyfit(np.log([r["subdomains"] for r in rows]), np.log([r[quantity] for r in rows]), 1)
    return float(np.exp(log_factor)), float(exponent)
