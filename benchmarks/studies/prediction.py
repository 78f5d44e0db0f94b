"""What a run of N equal cubes, one to a core, would take on a cluster.

A rank has a block of subdomains, each with a worker on a core of its own, and works for all of them itself. It eliminates
the macro unknowns that it alone sees. Those on the borders between ranks are a dense problem that every rank solves or, where they are
many, one that MUMPS spreads over the ranks: the macro problem of as many subdomains as there are ranks, with more unknowns to an
interface. The repositioning of the error bound is solved on every rank for all subdomains or, where they are many, by MUMPS as well. More
subdomains to a rank mean smaller borders and more work for each rank: the best number is sought for every N.

Measured: what one subdomain costs the code and the orchestrator, and what a rank costs whatever it has, on runs of this study
with one and two ranks; what it takes rank 0 to make a rank's part, and what all others cost each rank; the macro problem and the
repositioning, on matrices of their pattern; the borders, on a dense matrix. Assumed: the network, what rank 0 takes for a message of
each rank, that R ranks make MUMPS √R times as fast as one, but for the order of elimination, which one finds, and that costs grow as far
as they were not measured. All are CPU seconds: on cores of one's own they pass on the wall's clock, and others' work changes them least.

``on_cores`` says the same of runs that can be made here, so that the model can be held against such as it has not seen.
"""

from __future__ import annotations

import math
import pickle
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.linalg.lapack import dpftrf, dpftrs, dtrttf

from benchmarks.kit.commands import codes_seconds
from orchestrator import build_scene
from orchestrator.config.model import Config
from orchestrator.method.delivery.balance import Resultants
from orchestrator.method.sparse.symmetric import by_cholesky
from orchestrator.linalg import dissection
from orchestrator.parallel.team import Team
from orchestrator.method.setup import RankPart, make_soles_of
from orchestrator.parallel.numbering import Placement
from orchestrator.parallel.team import ALONE
from orchestrator.results.probes import INTERFACES, interface_table
from orchestrator.results.folder import ResultsFolder
from orchestrator.scene.part import overview, part_of

LATENCY, BANDWIDTH = 2e-6, 1e10  # of a cluster's network: seconds per message, bytes per second
TOLD = 2 * 5e-5  # seconds that rank 0 takes in the end for what each rank tells it, in two messages
FIELDS, FACES, RIGID = 6, 6, 6  # macro fields of an interface where these are many; interfaces of a cube; rigid motions
MESSAGES = 13  # of a rank per iteration, sums over the ranks among them, where no two ranks were measured; see docs/parallel.md
GRIDS = (4, 5, 6, 7, 8, 10, 12)  # cubes a side of the macro problems that are measured: some seconds
BORDER = 3000  # unknowns of the dense problem that is measured: some seconds, and far beyond a core's cache
SIDES = range(1, 17)  # subdomains along the side of a rank's block
PERIODS = ("set_up", "iterations")  # of a run, as its summary has them
OF_OTHERS = 8  # cubes a side of the scene of which it is measured what a rank has of others' subdomains


@dataclass(frozen=True)
class Costs:
    """CPU seconds of one subdomain.

    Parameters
    ----------
    start : of a rank: Python, MPI and the code's process
    scene : mesh, cut and interfaces; bytes : of it in its rank's part
    part : of each rank's part what rank 0 does for every subdomain of the whole scene
    outline : what a rank does for every subdomain of the whole scene: names, neighbours, numbers
    tables : what rank 0 writes of its interfaces
    prepare : the orchestrator in the set-up: soles, search direction, macro problem, loads; prepare_rank : of a rank beside that
    factorise : assembling and factorising
    solve : one back-substitution
    own : the orchestrator in one iteration: messages to the code, local stage, acceleration, error measures; own_rank : of a rank
        beside that
    results : the orchestrator after the iterations: delivery, guards, summary
    iterations, sweeps : of a run; back-substitutions of a subdomain in all iterations
    trace : dofs on one face
    messages : of a rank in one iteration
    """

    start: float
    scene: float
    part: float
    outline: float
    tables: float
    bytes: float
    prepare: float
    factorise: float
    solve: float
    own: float
    results: float
    iterations: int
    sweeps: float
    trace: float
    messages: float = MESSAGES
    prepare_rank: float = 0.0
    own_rank: float = 0.0

    @classmethod
    def of(cls, summary: Mapping[str, Any], cpu: float, start: float, cubes: Callable[[Sequence[int], int], Config],
           elements: int) -> Costs:
        """Of a run with one rank and one worker.

        cpu : seconds of the whole command; start : of one with next to nothing to do
        cubes : the configuration of some cubes along x, y, z, of so many elements a side; elements : of the run's, which has 2 × 2 × 2
        """
        count, sweeps, iterations = summary["subdomains"], summary["sweeps"]["iterations"], summary["iterations"]
        (setup,), (loop,) = (summary["workload"][period]["workers"] for period in PERIODS)
        prepare, own = orchestrators(summary)
        begin = time.process_time()
        build_scene(cubes((2, 2, 2), elements))
        scene = time.process_time() - begin
        known = start + scene + prepare + own + codes_seconds(summary)
        return cls(start=start, scene=scene / count, **measure_parts(cubes)._asdict(),
                   prepare=prepare / count, factorise=(setup["assemble"] + setup["factorise"]) / count,
                   solve=loop["solve"] / (count * sweeps), own=own / (count * iterations),
                   results=max(cpu - known, 0.0) / count, iterations=iterations, sweeps=sweeps,
                   trace=3 * summary["interface_nodes"] / summary["interfaces"])

    @classmethod
    def least(cls, found: Sequence[Costs]) -> Costs:
        """Of repetitions of one run, the least of each cost: what else the machine does only adds to them."""
        return cls(**{f.name: min(getattr(costs, f.name) for costs in found) for f in fields(cls)})

    def apart(self, two: Mapping[str, Any], start: float) -> Costs:
        """With what a rank costs whatever it has told from what its subdomains cost, by a run with two ranks; start : of one of these."""
        count, given = two["subdomains"], (self.prepare, self.iterations * self.own)
        alone = [min(max(2 * half - count * each, 0.0), half) for half, each in zip(orchestrators(two), given)]
        prepare, own = ((count * each - rank) / count for each, rank in zip(given, alone))
        messages = max(rank["messages"] for rank in two["workload"]["iterations"]["ranks"]) / two["iterations"]
        return replace(self, start=start, prepare=prepare, own=own / self.iterations, prepare_rank=alone[0],
                       own_rank=alone[1] / self.iterations, messages=messages)


class Parts(NamedTuple):
    """CPU seconds of rank 0 for a rank's part, and of that rank, for each cube of the scene; of each
    in tables; and bytes of each in its part."""

    part: float
    outline: float
    tables: float
    bytes: float


def measure_parts(cubes: Callable[[Sequence[int], int], Config]) -> Parts:
    """Return what it costs to hand out a scene, where each rank has a block of eight of many cubes."""
    config, count = cubes((OF_OTHERS,) * 3, 1), OF_OTHERS**3
    rank_of = np.ravel_multi_index(np.indices((OF_OTHERS,) * 3).reshape(3, -1) // 2, (OF_OTHERS // 2,) * 3)
    scene = build_scene(config)
    known, begin = overview(scene), time.process_time()
    part = part_of(scene, np.flatnonzero(rank_of == 0), known)
    handed, told = time.process_time(), len(pickle.dumps(part))
    own = RankPart.of(part, config.method, rank_of, ALONE)  # what set-up does of all subdomains
    make_soles_of(own, config.method, Placement.of(part, rank_of, ALONE).touched)
    done, none = time.process_time(), np.zeros((scene.steps, len(scene.interfaces), 3))
    table = interface_table(scene, Resultants(none, none, none, none[0], none[0, :, 0]), None)
    with TemporaryDirectory() as folder:
        ResultsFolder(folder).write_table(INTERFACES, table)
    seconds = handed - begin, done - handed, time.process_time() - done
    return Parts(*(each / count for each in seconds), told / (rank_of == 0).sum())


def orchestrators(summary: Mapping[str, Any]) -> tuple[float, float]:
    """CPU seconds of the mean rank, the codes' not among them: in set-up, and in the iterations."""
    first, second = (float(np.mean([rank["cpu"] for rank in summary["workload"][period]["ranks"]])) for period in PERIODS)
    return first, second


@dataclass(frozen=True)
class MacroCosts:
    """Growth of the macro problem and of repositioning with N subdomains: (factor, exponent) of factor · N^exponent.

    Parameters
    ----------
    factorise, solve : seconds of one factorisation and of one solution
    rigid_factorise, rigid_solve : the same of repositioning
    order, rigid_order : seconds to find the order of elimination of either, a part of the factorisation
    border : seconds of factorising a dense matrix over the cube of its size, and of a solution over the square
    """

    factorise: tuple[float, float]
    solve: tuple[float, float]
    rigid_factorise: tuple[float, float]
    rigid_solve: tuple[float, float]
    border: tuple[float, float]
    order: tuple[float, float] = (0.0, 1.0)
    rigid_order: tuple[float, float] = (0.0, 1.0)

    def at(self, quantity: str, count: int) -> float:
        factor, exponent = getattr(self, quantity)
        return factor * count**exponent


def measure_macro(grids: Sequence[int] = GRIDS) -> tuple[MacroCosts, list[dict[str, float]]]:
    """Factorise matrices of both problems' patterns for cubes in a grid; also what was measured."""
    rows = []
    for side in grids:
        row: dict[str, float] = {"subdomains": side**3}
        for matrix, prefix in ((macro_pattern(side), ""), (rigid_pattern(side), "rigid_")):
            begin = time.process_time()
            solve = _factor(matrix)
            done = time.process_time()
            row |= {f"{prefix}unknowns": matrix.shape[0], f"{prefix}factorise": done - begin,
                    f"{prefix}order": _repeated(lambda: dissection(matrix), 0.02),
                    f"{prefix}solve": _repeated(lambda: solve(np.ones(matrix.shape[0])), 0.02)}
        rows.append(row)
    growths = [_growth(rows, key) for key in ("factorise", "solve", "rigid_factorise", "rigid_solve", "order", "rigid_order")]
    return MacroCosts(*growths[:4], _dense(BORDER), *growths[4:]), rows


def _factor(matrix: sp.csr_array) -> Callable[[np.ndarray], np.ndarray]:
    """CHOLMOD's factorisation, as a run's; SuperLU's where it is not installed."""
    return by_cholesky(sp.tril(matrix, format="csc")) or spla.splu(sp.csc_matrix(matrix)).solve


def _repeated(task: Callable[[], object], enough: float) -> float:
    """CPU seconds of a task, the mean of so many that they take ``enough``."""
    begin, count = time.process_time(), 0
    while time.process_time() - begin < enough:
        task()
        count += 1
    return (time.process_time() - begin) / count


def _dense(size: int) -> tuple[float, float]:
    """Seconds per size³ of a dense factorisation in the format that ranks use, and per size² of a solution."""
    packed, _ = dtrttf(np.full((size, size), 1e-6) + np.eye(size))
    begin = time.process_time()
    factor, failed = dpftrf(size, packed, overwrite_a=True)
    seconds = time.process_time() - begin
    assert not failed
    return seconds / size**3, _repeated(lambda: dpftrs(size, factor, np.ones((size, 1))), 0.1) / size**2


def macro_pattern(side: int) -> sp.csr_array:
    """Symmetric positive definite matrix with the macro problem's pattern for side³ cubes.

    Two interfaces are coupled where they belong to one subdomain.
    """
    return macro_of(touches(side), FIELDS)


def macro_of(touching: sp.csr_array, fields: int) -> sp.csr_array:
    """The same of some subdomains, which interfaces (interfaces, subdomains) of so many fields touch."""
    return _of_blocks(touching @ touching.T, fields)


def rigid_pattern(side: int) -> sp.csr_array:
    """Symmetric positive definite matrix with the pattern of repositioning: two subdomains are coupled by an interface."""
    touching = touches(side)
    return _of_blocks(touching.T @ touching, RIGID)


def touches(side: int) -> sp.csr_array:
    """(interfaces, side³) 1 where an interface belongs to a cube."""
    number = np.arange(side**3).reshape((side,) * 3)
    low, high = range(side - 1), range(1, side)
    pairs = np.concatenate([np.stack([number.take(low, a).ravel(), number.take(high, a).ravel()], 1) for a in range(3)])
    interface = np.repeat(np.arange(len(pairs)), 2)
    return sp.csr_array((np.ones(pairs.size), (interface, pairs.ravel())), shape=(len(pairs), side**3))


def _of_blocks(coupled: sp.sparray, size: int) -> sp.csr_array:
    blocks = sp.csr_array(sp.kron(coupled, np.ones((size, size))))
    return sp.csr_array(blocks + sp.diags_array(2.0 * blocks.sum(axis=1)))


def predict(costs: Costs, macro: MacroCosts, count: int) -> dict[str, dict[str, float]]:
    """Seconds of ``count`` subdomains on as many cores, with the best number of them to a rank, each with a worker of its own.

    Returns
    -------
    {"set_up" | "iterations" | "end": {what: seconds}} of a whole run
    """
    return min((_of_ranks(costs, macro, count, side**3, 1) for side in SIDES if side**3 <= count), key=_total)


def on_cores(costs: Costs, macro: MacroCosts, count: int, ranks: int, cores: int) -> tuple[float, float]:
    """Wall and CPU seconds of ``count`` subdomains over ranks with a worker each, which have so many cores to themselves."""
    every = _total(_of_ranks(costs, macro, count, count / ranks, count / ranks))
    return every * max(1.0, ranks / cores), every * ranks


def _total(parts: Mapping[str, Mapping[str, float]]) -> float:
    return sum(sum(part.values()) for part in parts.values())


def ranks_of(costs: Costs, macro: MacroCosts, count: int) -> tuple[int, float, float]:
    """Subdomains to a rank in the best of cases, unknowns on the borders between ranks, and GB of the matrix of these on each."""
    each = min((side**3 for side in SIDES if side**3 <= count),
               key=lambda m: _total(_of_ranks(costs, macro, count, m, 1)))
    unknowns = _border(count, each)
    return each, unknowns, 8e-9 * (unknowns if unknowns < Team.shared_from else _own(each)) ** 2


def _own(each: int) -> float:
    """Macro unknowns on the borders of one rank."""
    return FIELDS * FACES * each ** (2 / 3)


def _border(count: int, each: int) -> float:
    """Macro unknowns that several ranks see, of ``count`` cubes in a block, in blocks of ``each``."""
    return FIELDS * 3 * (count - count ** (2 / 3) - count / each * (each - each ** (2 / 3)))


def _between(macro: MacroCosts, border: float, each: int, ranks: float) -> tuple[float, float, float]:
    """Seconds to bring together the problem of the borders, to factorise it, and to solve it once."""
    if border < Team.shared_from:
        cube, square = macro.border
        return 2 * 8 * border**2 / BANDWIDTH, cube * border**3, square * border**2 + 2 * 8 * border / BANDWIDTH
    more, faster = each ** (2 / 3), math.sqrt(ranks)  # unknowns to an interface, over those of the pattern that was measured; assumed
    return (8 * _own(each)**2 / BANDWIDTH, macro.at("order", ranks) * more + macro.at("factorise", ranks) * more**3 / faster,
            macro.at("solve", ranks) * more**2 / faster + 2 * 8 * _own(each) / BANDWIDTH)


def _rigid(macro: MacroCosts, count: int, each: float, ranks: float) -> tuple[float, float]:
    """Seconds to bring together and factorise the problem of repositioning, and to solve it once."""
    factorise, solve = (macro.at(f"rigid_{what}", count) for what in ("factorise", "solve"))
    if RIGID * count < Team.shared_from or ranks <= 1:
        alone = ranks <= 1
        return (factorise + (0.0 if alone else 12 * (1 + FACES) * RIGID**2 * count / BANDWIDTH),
                solve + (0.0 if alone else 2 * 8 * RIGID * count / BANDWIDTH))
    seen, faster = each + FACES * each ** (2 / 3), math.sqrt(ranks)  # subdomains that a rank has modes of; assumed, as for the borders
    numbers = 8 * RIGID * seen * ranks  # bytes, of the modes that each rank sees, on all ranks
    return ((numbers + 12 * (1 + FACES) * RIGID**2 * seen) / BANDWIDTH + macro.at("rigid_order", count) + factorise / faster,
            solve / faster + FACES * LATENCY + 2 * 8 * RIGID * seen / BANDWIDTH)


def _of_ranks(costs: Costs, macro: MacroCosts, count: int, each: float, turns: float) -> dict[str, dict[str, float]]:
    """With ``each`` subdomains to a rank, of which a worker has ``turns``."""
    ranks, border, own = count / each, max(_border(count, each), 0.0), _own(each)
    levels = math.ceil(math.log2(max(ranks, 2)))
    summing, factorising, solving = _between(macro, border, each, ranks)
    bringing, moving = _rigid(macro, count, each, ranks)
    alone = ranks <= 1
    return {
        "set_up": {
            "start": costs.start,
            "scene, by rank 0": costs.scene * count,
            "ranks' parts, by rank 0": 0.0 if alone else (ranks * costs.part + costs.bytes / BANDWIDTH) * count,
            "outline of the scene, on every rank": 0.0 if alone else costs.outline * count,
            "prepare": costs.prepare_rank + costs.prepare * each,
            "factorise": costs.factorise * turns,
            "macro columns": FIELDS * 3 * min(count ** (1 / 3) - 1, 2) * costs.solve * turns,  # of a subdomain with the most neighbours
            "macro problem: inside a rank": macro.at("factorise", each) + (0 if alone else own * macro.at("solve", each)),
            "macro problem: sum over ranks": 0.0 if alone else levels * LATENCY + summing,
            "macro problem: borders": 0.0 if alone else factorising,
            "repositioning": bringing,
        },
        "iterations": {
            "solve": costs.sweeps * costs.solve * turns,
            "orchestrator": costs.iterations * (costs.own_rank + costs.own * each),
            "traces to neighbours": costs.iterations * FACES * (LATENCY + 16 * costs.trace * each ** (2 / 3) / BANDWIDTH),
            "reductions": 0.0 if alone else costs.iterations * costs.messages * levels * LATENCY,
            "macro problem: inside a rank": costs.iterations * (1 if alone else 2) * macro.at("solve", each),
            "macro problem: borders": 0.0 if alone else costs.iterations * (levels * LATENCY + solving),
            "repositioning": costs.iterations * (moving + (0.0 if alone else levels * LATENCY)),
        },
        "end": {"results, by rank 0": costs.results * count, "what each rank tells rank 0": 0.0 if alone else TOLD * ranks,
                "tables, by rank 0": 0.0 if alone else costs.tables * count},
    }


def largest(parts: Mapping[str, Mapping[str, float]]) -> tuple[str, float]:
    """The longest part of a prediction, and its share of all."""
    found = {f"{period.replace('_', '-')}: {what}": s for period, part in parts.items() for what, s in part.items()}
    name = max(found, key=found.get)
    return name, found[name] / sum(found.values())


def limit(costs: Costs, macro: MacroCosts) -> int:
    """Number of subdomains, in steps of a tenth, from which the macro problem takes longer than the code's own work."""
    count = 8
    while count < 10**7:
        parts = predict(costs, macro, count)
        mine = sum(s for part in parts.values() for what, s in part.items() if what.startswith("macro problem"))
        code = parts["set_up"]["factorise"] + parts["set_up"]["macro columns"] + parts["iterations"]["solve"]
        if mine > code:
            break
        count = math.ceil(1.1 * count)
    return count


def _growth(rows: Sequence[Mapping[str, float]], quantity: str) -> tuple[float, float]:
    """Factor and exponent through the larger half of what was measured."""
    rows = rows[len(rows) // 2:] if len(rows) > 3 else rows
    exponent, log_factor = np.polyfit(np.log([r["subdomains"] for r in rows]), np.log([r[quantity] for r in rows]), 1)
    return float(np.exp(log_factor)), float(exponent)
