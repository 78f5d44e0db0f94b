"""Solution of a problem: its scene made, solved, and solved again where sides that slid are paired anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from orchestrator.blackbox.start import find_codes
from orchestrator.config.model import Config
from orchestrator.errors import wrong
from orchestrator.method.checkpoint import Start
from orchestrator.method.events import Subscriber, Subscribers
from orchestrator.one_solution import Ranks, Solving
from orchestrator.optional import check_there
from orchestrator.paired_anew import paired_anew, without_checkpoints
from orchestrator.processes import trim
from orchestrator.refused import by_keys
from orchestrator.registry import LAWS
from orchestrator.results.ranks import Piece
from orchestrator.results.solution import Solution
from orchestrator.scene.body import Meshed
from orchestrator.scene.build import build_scene
from orchestrator.scene.model import Scene
from orchestrator.scene.pieces.make import make
from orchestrator.timing import Stopwatch


def solve(config: Config, scene: Scene | None = None, subscribers: Sequence[Subscriber] = (), *, reference: bool = False,
          start: Start | None = None, watch: Stopwatch | None = None, ranks: Ranks = Ranks()) -> Solution | Piece:
    """Solve a problem; nothing is written.

    scene : default: ``scene_of`` the configuration, also where sides that slid are paired anew (``pairing: auto``); on a scene that is given
        pairs stay as they are
    subscribers : told what goes on
    reference : also solve undecomposed, and follow the true error; with perfect interfaces only
    start : where an earlier run stood, to resume from
    watch : where seconds are counted
    ranks : that solve it together; each calls this. Of a scene each needs its part, where they have made these, else rank 0 alone,
        which hands out its parts. Only rank 0 gets the solution, the others their pieces of its fields, and only its subscribers see
        whole states
    Returns the solution, converged or not
    Raises InputError: the problem cannot be solved, or a code is not there
    Raises BlackBoxError: a code fails, hangs or answers nonsense

    Examples
    --------
    A bar of length 4 and modulus 200e3, pulled by 10 per unit area: it grows by 4 · 10 / 200e3.

    >>> from orchestrator import config_from, solve
    >>> config = config_from({
    ...     "name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
    ...     "subdomains": {"slices": {"axis": "x", "count": 4}}, "materials": [{"young": 200e3, "poisson": 0.0}],
    ...     "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax", "traction": [10, 0, 0]}]})
    >>> solution = solve(config, reference=True)
    >>> solution.converged, solution.summary["true_error"] <= solution.error_bound <= 1e-6
    (True, True)
    >>> solution.displacement.shape    # load steps, nodes, components
    (1, 81, 3)
    >>> print(f"{solution.displacement[0, :, 0].max():.7f}, held by {solution.reactions[0, 0, 0]:.6f}")
    0.0002000, held by -10.000000
    """
    watch = watch or Stopwatch()
    solution = _solved(config, scene, subscribers, reference, start, watch, ranks)
    if scene is not None or ranks.team.size > 1:
        return solution

    def again(config: Config, scene: Scene, start: Start) -> Solution:
        return _solved(config, scene, without_checkpoints(subscribers), False, start, watch, ranks)

    return paired_anew(config, solution, lambda config: build_scene(config, run_programs=True), again)


def _solved(config: Config, scene: Scene | None, subscribers: Sequence[Subscriber], reference: bool,
            start: Start | None, watch: Stopwatch, ranks: Ranks) -> Solution | Piece:
    """Return one solution, with pairs as the configuration has them; parameters as for ``solve``."""
    told, team = Subscribers(subscribers), ranks.team
    try:
        if config.method.accuracy is not None:
            raise wrong(("method", "accuracy"), "accuracy where one mesh is solved on", "orchestrator run, which solves "
                        "on several", "remove accuracy here")
        if not all(LAWS[entry.law].perfect for entry in config.interfaces):
            check_there("numba")  # before the time it takes to mesh
        if team.share(scene is None):
            told.stage("meshing")
            with watch("mesh"):
                scene = scene_of(config, ranks, reference)
        with by_keys():
            return Solving(config, scene, told, start, watch, ranks, reference).solution()
    except BaseException as error:  # whatever it is, history and checkpoint are worth keeping
        told.failed(team.cause(error))
        raise


def scene_of(config: Config, ranks: Ranks, reference: bool = False, meshed: Meshed | None = None) -> Scene | None:
    """The scene of a configuration: this rank's part, where all ranks can make theirs together, see ``pieces``; else the whole on rank
    0, which all other ranks get their parts of. All ranks ask together.

    reference, meshed : as of ``solve`` and ``build_scene``
    Raises InputError: as ``build_scene``, or a code is not there
    """
    if len(config.codes) == 1:  # a code that all subdomains need: before the time it takes to mesh
        find_codes(config.codes, run_programs=False)
    apart = ranks.team.size > 1 and ranks.team.share(meshed is None) and not reference
    kept = Meshed()
    made = make(config, ranks.team, kept) if apart else "all of it is asked for"
    if isinstance(made, str):
        made = None if ranks.team.rank else replace(build_scene(config, run_programs=True, meshed=meshed or kept.once), left=made)
    trim()
    return made
