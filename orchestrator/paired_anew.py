"""``pairing: auto``: where sides have slid by more than a fifth of an element they are paired anew,
where they are.

The run is solved with pairs as they lie before loading. Interfaces that have slid are then given
entries of their own, with ``pairing: follow``, and all is solved again. Places that are off by a
fifth cost less than a third of what the mesh costs, those that are off by one more than that
(``study sliding``). The first result stays where sides cannot follow, where something is asked for
that following does not go with, or where the second run does not converge.
"""

from __future__ import annotations

from collections.abc import Callable
from glob import escape

from orchestrator.config.boundary import Entry
from orchestrator.config.model import Config
from orchestrator.errors import InputError, some
from orchestrator.method.checkpoint import Start
from orchestrator.results.solution import Solution
from orchestrator.results.summary.cautions import FIFTH
from orchestrator.scene.interfaces.opposite import TOUCHING
from orchestrator.scene.interface import Interface
from orchestrator.scene.model import Scene


def paired_anew(config: Config, first: Solution, built: Callable[[Config], Scene],
                solve: Callable[[Config, Scene, Start], Solution]) -> Solution:
    """The solution with sides paired anew that have slid, else the first one; its summary says
    which.

    first : with pairs as they lie before loading
    built : what makes the scene of a configuration
    solve : solves a configuration on a scene; iterations are counted from the start
    """
    slid = _slid(config, first) if first.converged and first.met is not None else []
    if not slid:
        return first
    told, scene, pairs, far = [], None, {}, first.met.slides[slid[0].name]
    for i in slid:  # of two bodies, in pieces, one entry
        pairs.setdefault(tuple(first.scene.subdomains[e].name for e in i.subdomains), i)
    fixed = {pair: _stays(config, first, i) for pair, i in pairs.items()}
    while scene is None and (left := [pair for pair, reason in fixed.items() if not reason]):
        then = config.model_copy(update={"interfaces": [
            *config.interfaces, *(_entry(config, pairs[pair], pair) for pair in left)]})
        try:
            scene = built(then)
        except InputError as error:
            wrong = {p.path[1] - len(config.interfaces): p.found for p in error.problems
                     if p.path[0] == "interfaces" and len(p.path) > 1}
            wrong = {pair: wrong[k] for k, pair in enumerate(left) if k in wrong}
            fixed |= wrong or dict.fromkeys(left, error.problems[0].found)
    if scene is not None:
        many = f"{some([i.name for i in slid])} slid by up to {far:.2g} of an element"
        second = solve(then, scene, Start(iteration=first.iterations,
                                          sweeps=first.summary["sweeps"]["iterations"]))
        spent = second.iterations - first.iterations
        if second.converged:
            told.append(
                f"{many}: paired anew where they are, in {spent} more iterations; of sides that "
                "follow no energy error is known")
            second.summary["config"], first = config.complete(), second
        else:
            told.append(
                f"{many}: with sides paired anew where they are the run has not converged "
                f"({second.stop_reason}, {spent} iterations), and forces act where they did before "
                "loading")
    said = []
    for reason in dict.fromkeys(filter(None, fixed.values())):
        names = [pairs[pair].name for pair, own in fixed.items() if own == reason]
        said.append(
            f"{some(names)} {'is' if len(names) == 1 else 'are'} not paired anew where sides have "
            f"slid to: {reason}")
    first.summary["warnings"] = [*told, *first.summary["warnings"], *said]
    return first


def _slid(config: Config, solution: Solution) -> list[Interface]:
    """Return the interfaces whose sides have slid that may follow, the farthest first."""
    far = solution.met.slides
    auto = [i for i in solution.scene.interfaces if far.get(i.name, 0.0) > FIFTH and i.entry >= 0
            and getattr(config.interfaces[i.entry], "pairing", "") == "auto"]
    return sorted(auto, key=lambda i: -far[i.name])


def _entry(config: Config, i: Interface, pair: tuple[str, str]) -> Entry:
    """The entry that an interface has, for its two bodies alone, with sides that follow."""
    entry = config.interfaces[i.entry]
    tolerance = TOUCHING if entry.found and entry.tolerance == "auto" else entry.tolerance
    return entry.model_copy(update={"between": [escape(name) for name in pair], "exclude": None,
                                    "tolerance": tolerance,
                                    "gap": "geometry" if entry.apart else entry.gap,
                                    "pairing": "follow"})


def _stays(config: Config, first: Solution, i: Interface) -> str:
    """Return why the pairs of an interface stay as they are, as far as it shows before it is tried;
    empty: they need not.
    """
    method, cut = config.method, [first.scene.subdomains[e] for e in i.subdomains]
    return next((why for there, why in (
        (method.tolerance.error == "auto", "the tolerance follows the mesh's error"),
        (method.macro.on == "all", "the macro problem is on all interfaces"),
        (method.increment not in ("auto", 1), "several load steps are solved together"),
        (first.scene.remembers, "matter is nonlinear"),
        (any(s.body != s.name for s in cut), "bodies are cut further"),
        (first.met.common[first.met.names.index(i.name)], "they share faces of one mesh"))
        if there), "")
