"""Advice after a stop: the likely causes in this scene, with these settings, and their cures.

What the stops mean is in ``monitors.ending``; the same table, for all scenes, is in
docs/running.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from operator import attrgetter

from orchestrator.config.method import Method
from orchestrator.errors import some
from orchestrator.method.delivery.loose import Stabilised
from orchestrator.method.halving import path_sentence
from orchestrator.method.iterated import Iterated
from orchestrator.method.monitors.ending import ROUNDING
from orchestrator.scene.cautions import LOCKING
from orchestrator.scene.model import Scene
from orchestrator.scene.soles.overlap import SLENDER, difficulty

PACE = 10  # iterations over which the latest pace is taken
MOVING = 0.97  # factor per iteration above which nothing moves any more
CONTRAST = 1e3  # of moduli, from which convergence suffers visibly
_DEFAULTS = Method()


@dataclass(frozen=True)
class Stopped:
    """A run that has not converged.

    loose : names of bodies that are detached or weakly held
    codes : names of the codes
    stabilised : what stabilisation carried; None where there is none
    """

    scene: Scene
    method: Method
    iterated: Iterated
    loose: list[str] = field(default_factory=list)
    codes: Sequence[str] = ()
    stabilised: Stabilised | None = None

    @property
    def pace(self) -> float:
        """Factor per iteration, of late, of what the tolerance is compared with; bonded, of the
        forces' imbalance.
        """
        name = "force_imbalance" if self.scene.bonded else "law_residual"
        values = [getattr(event, name) for event in self.iterated.history[-PACE - 1:]]
        if len(values) < 3 or not all(math.isfinite(v) and v > 0 for v in values):
            return math.nan
        return (values[-1] / values[0]) ** (1 / (len(values) - 1))

    @property
    def reached(self) -> float:
        """Return what the tolerance is compared with, as it is in the end; nan where it is not
        known.
        """
        last = self.iterated.last
        return last.law_residual if last.target[
            0] == "law_residual" else self.iterated.bound.relative


def how_far(run: Stopped) -> Iterator[str]:
    """max_iterations: whether more of them would do."""
    last, pace = run.iterated.last, run.pace
    if not pace < MOVING:
        yield "it hardly gets any better: more iterations will not do"
        return
    more, left = "", run.reached / last.tolerance
    if math.isfinite(left) and left > 1:
        more = f", about {math.ceil(math.log(left) / -math.log(pace))} more iterations at this pace"
    yield (
        f"it was still getting better, by a factor of {1 / pace:.2g} per iteration{more}: --resume "
        "goes on from here, --set method.max_iterations=… allows more")


def rounding(run: Stopped) -> Iterator[str]:
    """stagnated: double precision leaves no more."""
    reached = run.reached
    wanted = f"method.tolerance.error={2 * reached:.0e} would be met" if math.isfinite(
        reached) and reached < 1 else \
        "raise method.tolerance"
    yield (
        f"the state changes by less than {ROUNDING:g} and what is left is rounding: {wanted}; less "
        "rounding comes with moduli, sizes and displacements of the same order")


def standing(run: Stopped) -> Iterator[str]:
    """error bound stands still: laws hold, bodies that little holds keep it up."""
    reached = run.iterated.bound.relative
    known = f"method.tolerance.error={1.1 * reached:.1e} would be met; " if math.isfinite(
        reached) and reached < 0.9 else ""
    yield (
        "the laws hold much better than that: "
        f"{known}method.tolerance.law={run.iterated.last.law_residual * 2:.0e} asks for these "
        "alone")


def settings(run: Stopped) -> Iterator[str]:
    """Advice where the method is not the default one, which was chosen to converge."""
    method, changed = run.method, []
    for path in ("acceleration", "relaxation", "coarse", "memory", "macro.strategy", "macro.basis",
                 "sole.kind",
                 "sole.modulus_ratio", "sole.contact", "sole.contact_ratio",
                 "search_direction.kplus"):
        asked = attrgetter(path)
        if asked(method) != asked(_DEFAULTS):
            changed.append(f"method.{path}={asked(_DEFAULTS)}")
    if changed:
        yield (
            "settings differ from the defaults, which converge more widely: --set "
            f"{' --set '.join(changed)}")


def matter(run: Stopped) -> Iterator[str]:
    """Nearly incompressible matter, and very different moduli."""
    used = [run.scene.materials[m] for m in run.scene.used]
    poisson, young = max(m.poisson for m in used), [m.young for m in used]
    if poisson > LOCKING:
        element = "blackbox: {element: P2} and " if run.scene.mesh.cells.shape[1] == 4 else ""
        yield (
            f"Poisson's ratio {poisson:g} slows convergence: {element}method: {{sole: {{kind: "
            f"auto}}, macro: {{basis: auto}}}}, as by default, take it into account")
    if max(young) > CONTRAST * min(young):
        yield (
            f"moduli differ by {max(young) / min(young):.0e}: cut along the borders of the "
            f"materials (subdomains: {{groups: true}})")


def shape(run: Stopped) -> Iterator[str]:
    """Flat or slender subdomains."""
    scene = run.scene
    worst = float(difficulty(scene).slenderness[~scene.stand_ins].max(initial=1.0))
    if worst < SLENDER:
        return
    yield (
        f"subdomains are up to {worst:.0f} times as long as thick, which slows convergence: cut so "
        f"that they are about as thick as long and wide, as by subdomains: {{metis: "
        f"{len(scene.subdomains)}}} or more")


def contact(run: Stopped) -> Iterator[str]:
    """Friction and bodies that come loose."""
    if run.scene.bonded:
        return
    yield from (f"interfaces {caution}: lower it" for caution in sorted(
        {i.law.caution for i in run.scene.interfaces} - {""}))
    if run.loose:
        yield (
            f"{some(run.loose)} can move as a whole without resistance: hold them (a displacement, "
            "friction, law: elastic with a small stiffness)")
    if run.scene.steps > 1 and any(i.has_history for i in run.scene.interfaces):
        yield "large load steps, whose order counts: smaller ones, or method.increment=1"


def halving(run: Stopped) -> Iterator[str]:
    """A load step that could not be followed in parts."""
    for found in run.iterated.found.get("path", []):
        if found["stuck"]:
            yield f"{path_sentence(found)}; load steps before it have what they were asked for"


def springs(run: Stopped) -> Iterator[str]:
    """Stabilisation carries what should be carried by the laws."""
    found, asked = run.stabilised, run.method.contact.stabilisation
    if found is None:
        return
    names = list(dict.fromkeys(name for step in found.bodies for name in step))
    yield (
        "no limit load was found: forces that the laws allow balance every body; springs that hold "
        f"{some(names or [found.most])} still carry {found.force:.1e} of the largest contact force")
    if asked != "auto":
        yield (
            f"stabilisation {asked:g} carries {found.force:.1e} of the largest contact force: "
            "lower it in proportion, or method.contact.stabilisation=auto")
    if run.scene.steps > 1:
        yield (
            "what friction holds may depend on the way there: smaller load steps, or "
            "method.increment=1")


def limit(run: Stopped) -> Iterator[str]:
    """No forces balance the loads: a sentence for the first load step of all in which the same
    bodies move.
    """
    alike: dict[tuple[str, ...], list] = {}
    for found in run.iterated.found.get("limit_load", []):
        alike.setdefault(tuple(sorted(motion.body for motion in found.motions)), []).append(found)
    for found, *others in alike.values():
        less = "raise friction" if found.prescribed else "lower the load, raise friction"
        steps = some([str(other.load_step) for other in others])
        also = (
            f"; nor are the loads of load step{'s' * (len(others) > 1)} {steps} carried" if others
            else "")
        yield f"{found}{also}: {less}, or hold {some([motion.body for motion in found.motions])}"


def code(run: Stopped) -> Iterator[str]:
    """A code that answers inexactly."""
    names = [name for name in run.codes if name]
    others = [name for name in names if name != "freefem"] or names
    yield (
        "answers of a code that are inexact or contradictory: orchestrator conformance "
        f"{others[0] if others else 'CODE'}")


RUNAWAY = ("displacements grew without limit or are no numbers: look for bodies that are not held, "
           "and for loads or moduli in other units than the rest")
SURFACES = (
    "forces are not what surfaces and friction allow: smaller elements on curved faces that "
            "slide, or loads that friction can hold")
# first word or words of ``stop_reason`` → where the causes are, the likeliest first
CAUSES: dict[str, list[str | Callable[[Stopped], Iterator[str]]]] = {
    "max_iterations": [how_far, halving, settings, matter, shape, contact],
    "diverged": [halving, settings, RUNAWAY, contact, code],
    "limit load": [limit, halving],
    "a body is let go": [how_far, halving],
    "held by stabilisation alone": [springs, halving],
    "stagnated at rounding": [rounding, settings, matter, code],
    "error bound stands still": [standing],
    "check": [SURFACES],
    "guard": [code, settings, contact],
}


def advice(run: Stopped) -> list[str]:
    """Groups that no forces answer; where the run has not converged the likely causes, each with
    its cure.
    """
    found = run.iterated.found.get("unsolved", [])
    if run.iterated.converged:
        return found
    return found + [sentence for name, causes in CAUSES.items()
                    if run.iterated.stop_reason.startswith(name)
                    for cause in causes
                    for sentence in ([cause] if isinstance(cause, str) else cause(run))]
