"""Solution of a problem: its scene made, and solved."""

from __future__ import annotations

from collections.abc import Sequence

from orchestrator.blackbox.start import find_codes
from orchestrator.config.model import Config
from orchestrator.errors import wrong
from orchestrator.method.checkpoint import Start
from orchestrator.method.events import Subscriber, Subscribers
from orchestrator.one_solution import OneSolution, Ranks
from orchestrator.optional import check_there
from orchestrator.processes import trim
from orchestrator.refused import by_keys
from orchestrator.results.solution import Solution
from orchestrator.scene.body import Meshed
from orchestrator.scene.build import build_scene
from orchestrator.scene.model import Scene
from orchestrator.timing import Stopwatch


def solve(config: Config, scene: Scene | None = None, subscribers: Sequence[Subscriber] = (), *,
          reference: bool = False,
          start: Start | None = None, watch: Stopwatch | None = None,
          ranks: Ranks = Ranks()) -> Solution | None:
    """Solve a problem; nothing is written.

    scene : default: ``scene_of`` the configuration
    subscribers : told what goes on
    reference : also solve undecomposed, and follow the true error; with perfect interfaces only
    start : where an earlier run stood, to resume from
    watch : where seconds are counted
    ranks : that solve it together; each calls this. Rank 0 alone has the scene, and hands out its
        parts. Only it gets the solution, and only its subscribers see whole states
    Returns the solution, converged or not, on rank 0; None on others
    Raises InputError: the problem cannot be solved, or a code is not there
    Raises BlackBoxError: a code fails, hangs or answers nonsense

    Examples
    --------
    A bar of length 4 and modulus 200e3, pulled by 10 per unit area: it grows by 4 · 10 / 200e3.

    >>> from orchestrator import config_from, solve
    >>> config = config_from({
    ...     "name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
    ...     "subdomains": {"slices": {"axis": "x", "count": 4}},
    ...     "materials": [{"young": 200e3, "poisson": 0.0}],
    ...     "boundary": [{"on": "xmin", "displacement": [0, 0, 0]},
    ...                  {"on": "xmax", "traction": [10, 0, 0]}]})
    >>> solution = solve(config, reference=True)
    >>> solution.converged, solution.summary["true_error"] <= solution.error_bound <= 1e-6
    (True, True)
    >>> solution.displacement.shape    # load steps, nodes, components
    (1, 81, 3)
    >>> moved, held = solution.displacement[0, :, 0].max(), solution.reactions[0, 0, 0]
    >>> print(f"{moved:.7f}, held by {held:.6f}")
    0.0002000, held by -10.000000
    """
    told, watch, team = Subscribers(subscribers), watch or Stopwatch(), ranks.team
    try:
        if config.method.accuracy is not None:
            raise wrong(("method", "accuracy"), "accuracy where one mesh is solved on",
                        "orchestrator run, which solves on several", "remove accuracy here")
        if not all(entry.kind.perfect for entry in config.interfaces):
            check_there("numba")  # before the time it takes to mesh
        if team.share(scene is None):
            scene = None if team.rank else scene_of(config, told, watch)
        with by_keys():
            return OneSolution(config, told, start, watch, ranks, reference).of(scene)
    except BaseException as error:  # whatever it is, history and checkpoint are worth keeping
        told.failed(team.cause(error))
        raise


def scene_of(config: Config, told: Subscribers, watch: Stopwatch,
             meshed: Meshed | None = None) -> Scene:
    """Return the scene of a configuration, programs started, after a look whether its code is
    there; subscribers are told.

    meshed : as of ``build_scene``
    Raises InputError: as ``build_scene``, or a code is not there
    """
    told.stage("meshing")
    with watch("mesh"):
        # a code that all subdomains need: before the time it takes to mesh
        if len(config.codes) == 1:
            find_codes(config.codes, run_programs=False)
        scene = build_scene(config, run_programs=True, meshed=meshed or Meshed().once)
        trim()
    told.made(scene)
    return scene
