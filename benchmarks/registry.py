"""Studies: the paper's figures and the benchmarks, as matrices of configurations; `orchestrator study` runs them in a clone.

Every study leaves table.csv, curves.csv, targets.csv and a figure in results/studies/NAME. One file each in ``studies``, and
one line here; ``kit`` is what they are made of, ``problems`` what several of them solve.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.util import find_spec

from orchestrator import InputError, Problem

# name: module and function in ``benchmarks``, what it shows
_LISTED = {
    "fig7": ("studies.fig7:run",
             "paper, figure 7: convergence for 8 to 128 slices: mono-scale, equilibrium, continuity"),
    "fig8": ("studies.fig8:run", "paper, figures 8 and 9: axial stress after one and two iterations"),
    "fig10": ("studies.sole_modulus:equilibrium", "paper, figure 10: soles 100 times softer to stiffer, equilibrium"),
    "fig11": ("studies.sole_modulus:continuity", "paper, figure 11: soles 100 times softer to stiffer, continuity"),
    "slices": ("studies.stages:slices", "stages to a true error of 1e-6 for 8, 32, 64 and 128 slices in tension"),
    "cubes": ("studies.stages:cubes", "stages to 1e-6 for 3³, 4³ and 5³ cubes in bending and tension"),
    "metis": ("studies.stages:metis", "stages to 1e-6 for 64 METIS parts of an irregular mesh"),
    "assembly": ("studies.stages:assembly", "a CAD assembly of 18 solids to 1e-6, with wall time"),
    "contact": ("studies.contact_cases:run", "contact beside books: friction, limit loads, Hertz, Mindlin, NAFEMS, with pictures"),
    "sliding": ("studies.sliding:run", "a die dragged over a slab with pairs that stay and that follow: what staying costs beside the mesh"),
    "contact_cubes": ("studies.contact:cubes",
                      "sweeps to 1e-3 for 3³ cubes in contact, beside the paper's fixed point"),
    "contact_grains": ("studies.contact:polycrystals",
                       "sweeps to 1e-2, 1e-3 and 1e-6 for 15 and 40 grains, beside the paper's fixed point"),
    "contact_soles": ("studies.contact:soles", "soles ten times softer to stiffer, with contact"),
    "contact_cantilevers": ("studies.cantilevers:run", "two clamped beams in contact, L/h 5 to 40: iterations and tip"),
    "moduli": ("studies.moduli:run", "a punch on a block a thousand times softer or stiffer, in contact"),
    "bolted": ("studies.bolted:run", "bolted and press-fitted assemblies: settings that should not matter"),
    "limit_loads": ("studies.limits:run",
                    "belts, wedges, arches, an incline beside a press fit, stacks of boxes: carried or told, beside theory"),
    "ten_grains": ("studies.ten_grains:run",
                   "a contact problem of 8,235 dofs from the command line, with wall time"),
    "polycrystal": ("studies.polycrystal:run",
                    "paper, figures 13 to 15 and tables 2 to 4: 100 grains in frictional contact"),
    "scaling": ("studies.scaling:run",
                "strong and weak scaling over workers and ranks, and what a cluster would take"),
    "ranks": ("studies.ranks:run",
              "grains over 1, 2, 4 ranks and two kernels of OpenBLAS: the same forces; what four ranks take, predicted"),
    "grains": ("studies.grains:run",
               "27 to 343 grains (up to 1,000 if set) pressed and sheared: iterations and seconds over their number"),
    "contact_race": ("studies.contact_race:run",
                     "contact beside a semismooth Newton method in one piece: CPU and memory to the same error"),
    "newton_at_end": ("studies.newton_at_end:run",
                      "27 grains from an error of 1e-3, 1e-4, 1e-6 on by Newton's method in one piece: steps and CPU beside ours"),
    "load_paths": ("studies.load_paths:run",
                   "27 grains pressed, let go, twisted, sheared with friction to 1, walls of bricks: iterations to 1e-4 and 1e-6"),
    "floor": ("studies.floor:run", "wall time of whole runs beside the code's own seconds"),
    "codes": ("studies.codes:run",
              "the same scenes through FreeFEM, CalculiX, scikit-fem and mixed: agreement and seconds"),
    "time_vs_error": ("studies.time_vs_error:run",
                      "seconds against true error: four problems, P1 and P2, four methods"),
    "large": ("studies.large:run",
              "easy and hard cubes of 200,000 dofs beside multigrid and direct solvers, up to 8,000 subdomains, a million dofs"),
    "polycrystals": ("studies.polycrystals:run",
                     "meshes of 27 and 125 grains (343 and 1,000 if set), twenty seeds each: sound, round, in which time"),
    "stability": ("studies.stability:run",
                  "hard cases: solved within the bound, refused or stopped by name, never silently wrong"),
    "meshed_apart": ("studies.meshed_apart:run",
                     "parts meshed each on its own: pairs, bonded, bolted, shrunk and pressed, beside conforming, Lamé, Hertz"),
    "six_node_faces": ("studies.six_node_faces:run",
                       "contact between ten-node tets and between four-node ones: two cantilevers, a cylinder on a block"),
    "bolts": ("studies.bolts:run",
              "eight bolts tightened one round after another, beside CalculiX's pre-tension sections on the same mesh"),
    "lap_joint": ("studies.lap_joint:run", "a lap joint of two bolts, pulled until it slips: by hand and beside CalculiX"),
    "sweeps": ("studies.sweeps:run",
               "sweeps of frictions, preloads, forces that begin with their neighbours: CPU and errors beside runs from zero"),
    "faults": ("studies.faults:run",
               "runs killed at random moments and disks full at every stage, then resumed: nothing is lost"),
    "falsified": ("studies.falsified:run",
                  "one reply of FreeFEM falsified by a thousandth at 100 random places: refused, stopped or right"),
    "bound": ("studies.bound:run", "the error bound beside the true error, tolerances 1e-2 to 1e-10"),
    "certified": ("studies.certified:run",
                  "the energy error with contact beside the true one: 200 random scenes against solutions in one piece"),
    "places": ("studies.places:run", "how far grains may be off their places beside how far they are: 60 random crowds"),
    "accuracy": ("studies.accuracy:run",
                 "accuracies that are asked for, beside true errors and uniform meshes: L, hole, slit, punch, ball, grains"),
    "elements_by_part": ("studies.elements_by_part:run",
                         "what four-node tets in some parts beside ten-node ones would save: a lap joint, an assembly"),
    "gallery": ("studies.gallery:run", "every configuration and tutorial, with a picture: writes docs/gallery.md"),
    "metamorphic": ("metamorphic.study:run",
                    "random scenes over all features, turned, cut otherwise, in other units …: never silently wrong"),
}
# row by row, for ``--resume``
KEPT = frozenset(("certified", "contact_race", "gallery", "grains", "large", "load_paths", "metamorphic", "places", "ranks", "sweeps"))
STUDIES = {name: title for name, (_, title) in _LISTED.items()}


def function_of(name: str) -> Callable[..., None]:
    """A study's function, imported when it is asked for."""
    module, _, function = _LISTED[name][0].partition(":")
    return getattr(import_module(f"benchmarks.{module}"), function)


def run_study(name: str, folder: str | os.PathLike[str] | None = None, overrides: Sequence[str] = (),
              resume: bool = False) -> None:
    """Run a study, print its table and its targets.

    Parameters
    ----------
    name : one of ``STUDIES``
    folder : where its results go; default results/studies/NAME
    overrides : ``key=value`` texts, for studies that have settings
    resume : take over what the folder has of the same runs, for studies that keep them

    Raises
    ------
    InputError : no such study, none of its settings, one that keeps no runs, or the folder cannot be written
    BlackBoxError : from the code; the cases finished so far are on disk
    """
    if name not in STUDIES:
        raise InputError(Problem((), f"study '{name}'", "one of " + ", ".join(STUDIES), "take one of these"))
    if name == "metamorphic" and find_spec("hypothesis") is None:
        raise InputError(Problem((), f"study '{name}' without hypothesis, which draws its scenes", "the packages of the tests",
                                 "pip install hypothesis, or make test once"))
    if resume and name not in KEPT:
        raise InputError(Problem((), "--resume", f"nothing: the study {name} keeps no runs", "run it anew, without"))
    from benchmarks.kit.study import Study
    from benchmarks.kit.settings import arguments

    function = function_of(name)
    asked = arguments(name, function, overrides)
    study = Study(name, STUDIES[name], folder, resume)
    function(study, **asked)
    study.close()

