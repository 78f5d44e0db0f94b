"""``pairing: auto``: where sides have slid by more than a fifth of an element they are paired anew,
where they are.

The run is solved with pairs as they lie before loading. Interfaces that have slid are then given
entries of their own, with ``pairing: follow``, and all is solved again. Places that are off by a
fifth cost less than a third of what the mesh costs, those that are off by one more than that
(``study sliding``). The first result stays where sides cannot follow, where something is asked for
that following does not go with, or where the second run does not converge.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
    slid = _slid(config, first) if first.converged and first.met is not None else {}
    if not slid:
        return first
    many = f"{some(list(slid))} slid by up to {max(slid.values()):.2g} of an element"
    told, said = [], []
    config_then, scene = _following(config, first, slid, built, said)
    result = first
    if scene is not None:
        second = solve(config_then, scene,
                       Start(iteration=first.iterations,
                             sweeps=first.summary["sweeps"]["iterations"]))
        spent = second.iterations - first.iterations
        if second.converged:
            told.append(
                f"{many}: paired anew where they are, in {spent} more iterations; of sides that "
                "follow no energy error is known")
            second.summary["config"], result = config.complete(), second
        else:
            told.append(
                f"{many}: with sides paired anew where they are the run has not converged "
                f"({second.stop_reason}, {spent} iterations), and forces act where they did before "
                "loading")
    result.summary["warnings"] = [*told, *result.summary["warnings"], *said]
    return result


def _slid(config: Config, solution: Solution) -> dict[str, float]:
    """How far sides have slid that may follow, the farthest first."""
    far = solution.met.slides
    auto = {i.name for i in solution.scene.interfaces if i.entry >= 0
            and getattr(config.interfaces[i.entry], "pairing", "") == "auto"}
    return {name: far[name] for name in sorted(far, key=far.get, reverse=True) if name in auto
            and far[name] > FIFTH}


def _following(config: Config, first: Solution, slid: Mapping[str, float],
               built: Callable[[Config], Scene],
               said: list[str]) -> tuple[Config, Scene | None]:
    """The configuration under which those that can follow do so, and its scene; None where none
    can. ``said`` learns why.
    """
    scene, pairs, why = first.scene, {}, _stays(config, first.scene)
    for name in slid:
        pairs.setdefault(tuple(scene.subdomains[e].name for e in _named(scene, name).subdomains),
                         name)
    fixed = {pair: why or _cannot(first, name) for pair, name in pairs.items()}
    while left := [pair for pair, reason in fixed.items() if not reason]:
        then = config.model_copy(
            update={"interfaces": [*config.interfaces,
                                   *(_entry(config, _named(scene, pairs[p]), p) for p in left)]})
        try:
            found = then, built(then)
            break
        except InputError as error:
            told = {p.path[1] - len(config.interfaces): p.found for p in error.problems
                    if p.path[0] == "interfaces" and len(p.path) > 1}
            wrong = {k: text for k, text in told.items()
                     if 0 <= k < len(left)} or dict.fromkeys(
                         range(len(left)), error.problems[0].found)
            fixed |= {left[k]: text for k, text in wrong.items()}
    else:
        found = config, None
    for reason in dict.fromkeys(filter(None, fixed.values())):
        names = [pairs[pair] for pair, own in fixed.items() if own == reason]
        said.append(
            f"{some(names)} {'is' if len(names) == 1 else 'are'} not paired anew where sides have "
            f"slid to: {reason}")
    return found


def _named(scene: Scene, name: str) -> Interface:
    return next(i for i in scene.interfaces if i.name == name)


def _entry(config: Config, i: Interface, pair: tuple[str, str]) -> Entry:
    """The entry that an interface has, for its two bodies alone, with sides that follow."""
    entry = config.interfaces[i.entry]
    tolerance = TOUCHING if entry.found and entry.tolerance == "auto" else entry.tolerance
    return entry.model_copy(update={"between": [escape(name) for name in pair], "exclude": None,
                                    "tolerance": tolerance,
                                    "gap": "geometry" if entry.apart else entry.gap,
                                    "pairing": "follow"})


def _stays(config: Config, scene: Scene) -> str:
    """Why pairs stay as they are in all of a scene; empty: they need not."""
    method = config.method
    return next((why for there, why in (
        (config.refines, "an accuracy is asked for"),
        (method.tolerance.error == "auto", "the tolerance follows the mesh's error"),
        (method.macro.on == "all", "the macro problem is on all interfaces"),
        (method.increment not in ("auto", 1), "several load steps are solved together"),
        (scene.remembers, "matter is nonlinear")) if there), "")


def _cannot(first: Solution, name: str) -> str:
    """Why an interface cannot follow, as far as it shows before it is tried; empty: it may."""
    one, two = (first.scene.subdomains[e] for e in _named(first.scene, name).subdomains)
    if one.body != one.name or two.body != two.name:
        return "bodies are cut further"
    if first.met.common[first.met.names.index(name)]:
        return "they share faces of one mesh"
    return ""
