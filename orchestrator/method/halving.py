"""Load steps that are solved together, and parts of one that is halved, each solved from where the
one before has ended.

Loads, prescribed displacements and what laws are given at each load step (a gap, the force of a
bolt) go from one load step to the next in proportion. Of a part nothing is delivered; what it
leaves is the history that the next one begins with. A part takes two back-substitutions per
subdomain for its loads, and no factorisation.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.linear.loading import Loading, apply_loads, partway
from orchestrator.method.stopping.error_estimate import Judged
from orchestrator.scene.model import Scene

TOGETHER = 12  # load steps solved as one batch with contact; more are taken INCREMENT at a time
INCREMENT = 4  # load steps of a batch where there are more
# of a load step, the smallest part: what does not settle in it snaps, and no path leads through
LEAST = 1 / 16


@dataclass(frozen=True)
class Increment:
    """Load steps that are solved together, or a part of one.

    steps : of the decomposition
    begin, end : of what a single load step adds, where the part begins and where it ends; else 0
        and 1
    """

    steps: slice
    begin: float = 0.0
    end: float = 1.0

    def __len__(self) -> int:
        return self.steps.stop - self.steps.start

    @property
    def one_by_one(self) -> list[Increment]:
        """An increment for each of its load steps."""
        return [Increment(slice(t, t + 1)) for t in range(self.steps.start, self.steps.stop)]

    @property
    def halves(self) -> list[Increment]:
        """Both halves of a load step or of a part of one; none if they are too small."""
        middle = 0.5 * (self.begin + self.end)
        both = [replace(self, end=middle), replace(self, begin=middle)]
        return both if middle - self.begin >= LEAST else []


def follow_each_other(scene: Scene) -> bool:
    """Whether load steps are solved one by one: matter remembers them, or sides are paired anew as
    they slide.
    """
    return scene.remembers or any(i.follows for i in scene.interfaces)


def increments_of(steps: int, scene: Scene, method) -> list[Increment]:
    """Return so many load steps in increments that are solved together."""
    if scene.bonded and not follow_each_other(scene):
        return [Increment(slice(0, steps))]
    size = 1 if follow_each_other(scene) else method.increment
    if size == "auto":
        size = steps if steps <= TOGETHER else INCREMENT
    return [Increment(slice(a, min(a + size, steps))) for a in range(0, steps, size)]


def may_be_halved(d: Decomposition, method) -> bool:
    """Whether the way to a load counts, and load steps have halves.

    Nonlinear matter cannot take back what it has gone through, sides that follow are paired for
    load steps as they are, and the mesh's error is estimated for them.
    """
    return not follow_each_other(d.scene) and method.tolerance.error != "auto"


def proportional(d: Decomposition) -> bool:
    """Whether half of what the first load step adds has half of its solution, so that its halves
    are no easier; all ranks ask.

    Nothing acts but the loads, and no law knows a length: no gaps, no press fits, no damage.
    """
    knows = any(law.acts or np.any(law.distance) or law.variables for i in d.scene.interfaces
                for law in i.laws(1))
    return not d.space.team.max(float(knows))[0]


def part_of(d: Decomposition, part: Increment, before: History | None,
            bound: Judged | None) -> Decomposition:
    """The decomposition for a part of one of its load steps; ``before`` and ``bound`` as for
    ``Decomposition.batch``.
    """
    step, share = part.steps.start, part.end
    view = d.batch(part.steps, before, bound)
    certificate = view.certificate and view.certificate.estimated()
    if share == 1:
        return replace(view, certificate=certificate)
    stage, local, coarse = view.stage.under(_loading(d, step, share)), copy(view.local), copy(
        view.coarse)
    local.pairs = _at(local.pairs, step, share)
    if coarse is not None:
        coarse.start_from(local)
    if certificate is not None:
        certificate.pairs, certificate.stage = _at(certificate.pairs, step, share), stage
        certificate.external = partway(d.certificate.external, step, share)[None]
        certificate.pushed = partway(d.certificate.pushed, step, share)[None]
    return replace(view, stage=stage, local=local, coarse=coarse, certificate=certificate)


def _at(pairs: Pairs, step: int, share: float) -> Pairs:
    return replace(pairs, numbers=np.array([step - (1 - share)]))


def _loading(d: Decomposition, step: int, share: float) -> Loading:
    """Answers to the loads of a part alone."""
    subdomains = [replace(s, prescribed=partway(s.prescribed, step, share)[None],
                          loads=partway(s.loads, step, share)[None])
                  for s in d.scene.subdomains]
    scene: Scene = replace(d.scene, subdomains=subdomains, steps=1)
    return apply_loads(scene, d.stage.direction, d.made.node_counts, d.made.traces, d.made.rims,
                       d.blackbox,
                       d.made.carried.between(step, share))


def path_sentence(found: Mapping[str, Any]) -> str:
    """Sentence on load steps that were solved again in smaller ones, or could not be."""
    (first, last), (begin,
                    end), why = found["load_steps"], found[
                        "part"], f"{found['why']} (iteration {found['after']})"
    if first != last:
        return f"load steps {first} to {last} were solved again one by one: {why}"
    if found["stuck"]:
        return (
            f"load step {first} could not be followed from {begin:.4g} to {end:.4g} of what it "
            f"adds: {why}; smaller parts would not do, and the rest was tried as a whole")
    part = "" if (begin, end) == (0, 1) else f" from {begin:.4g} to {end:.4g} of what it adds"
    what = f"load step {first}{part}"
    return f"{what} was solved again in two halves: {why}"
