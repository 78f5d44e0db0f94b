"""Studies: the paper's figures and the benchmarks, as matrices of configurations.

Every study leaves table.csv, curves.csv, targets.csv and a figure in results/studies/NAME. Rooms, each importing
from those before it alone, never one of the last four from another:

- ``kit``: what studies are made of;
- ``problems``: problems that several of them share;
- ``paper``: the paper's figures and tables;
- ``convergence``: how many stages or sweeps, to which error;
- ``robustness``: hard cases, and other codes;
- ``performance``: wall time.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib.util import find_spec

from orchestrator.errors import InputError, Problem
from orchestrator.registry import Registry

# name: function in its module and room, what it shows
_LISTED = {
    "fig7": ("paper.fig7:run",
             "paper, figure 7: convergence for 8 to 128 slices: mono-scale, equilibrium, continuity"),
    "fig8": ("paper.fig8:run", "paper, figures 8 and 9: axial stress after one and two iterations"),
    "fig10": ("paper.sole_modulus:equilibrium", "paper, figure 10: soles 100 times softer to stiffer, equilibrium"),
    "fig11": ("paper.sole_modulus:continuity", "paper, figure 11: soles 100 times softer to stiffer, continuity"),
    "slices": ("convergence.stages:slices", "stages to a true error of 1e-6 for 8, 32, 64 and 128 slices in tension"),
    "cubes": ("convergence.stages:cubes", "stages to 1e-6 for 3³, 4³ and 5³ cubes in bending and tension"),
    "metis": ("convergence.parts:metis", "stages to 1e-6 for 64 METIS parts of an irregular mesh"),
    "assembly": ("convergence.parts:assembly", "a CAD assembly of 18 solids to 1e-6, with wall time"),
    "contact_cubes": ("convergence.contact:cubes",
                      "sweeps to 1e-3 for 3³ cubes in contact, beside the paper's fixed point"),
    "contact_grains": ("convergence.contact:polycrystals",
                       "sweeps to 1e-2, 1e-3 and 1e-6 for 15 and 40 grains, beside the paper's fixed point"),
    "contact_soles": ("convergence.contact:soles", "soles ten times softer to stiffer, with contact"),
    "moduli": ("convergence.moduli:run", "a punch on a block a thousand times softer or stiffer, in contact"),
    "bolted": ("convergence.bolted:run", "bolted and press-fitted assemblies: settings that should not matter"),
    "ten_grains": ("performance.ten_grains:run",
                   "a contact problem of 8,235 dofs from the command line, with wall time"),
    "polycrystal": ("paper.polycrystal:full",
                    "paper, figures 13 to 15 and tables 2 to 4: 100 grains in frictional contact"),
    "polycrystal_small": ("paper.polycrystal:small", "the same with 15 grains"),
    "scaling": ("performance.scaling:run",
                "strong and weak scaling over workers and ranks, and what a cluster would take"),
    "grains": ("performance.grains:run",
               "27 to 343 grains (up to 1,000 if set) pressed and sheared: iterations and seconds over their number"),
    "floor": ("performance.floor:run", "wall time of whole runs beside the code's own seconds"),
    "codes": ("robustness.codes:run",
              "the same scenes through FreeFEM, CalculiX, scikit-fem and mixed: agreement and seconds"),
    "time_vs_error": ("performance.time_vs_error:run",
                      "wall time against true error: four problems, P1 and P2, four methods"),
    "large": ("performance.large:run",
              "easy and hard cubes of 200,000 dofs beside multigrid and direct solvers, up to 8,000 subdomains, a million dofs"),
    "polycrystals": ("robustness.polycrystals:run",
                     "meshes of 27 and 125 grains (343 and 1,000 if set), twenty seeds each: sound, round, in which time"),
    "stability": ("robustness.stability:run",
                  "hard cases: solved within the bound, refused or stopped by name, never silently wrong"),
    "meshed_apart": ("robustness.meshed_apart:run",
                     "parts meshed each on its own: pairs, bonded, bolted, shrunk and pressed, beside conforming, Lamé, Hertz"),
    "bolts": ("robustness.bolts:run",
              "eight bolts tightened one round after another, beside CalculiX's pre-tension sections on the same mesh"),
    "faults": ("robustness.faults:run",
               "runs killed at random moments and disks full at every stage, then resumed: nothing is lost"),
    "falsified": ("robustness.falsified:run",
                  "one reply of FreeFEM falsified by a thousandth at 100 random places: refused, stopped or right"),
    "bound": ("convergence.bound:run", "the error bound beside the true error, tolerances 1e-2 to 1e-10"),
}
# The same in a clone's folder beside this package, ``benchmarks``, which no wheel has.
_BESIDE = {
    "metamorphic": ("metamorphic.study:run",
                    "random scenes over all features, turned, cut otherwise, in other units …: never silently wrong"),
}
STUDIES = {name: title for name, (_, title) in (_LISTED | _BESIDE).items()}
FUNCTIONS = Registry({name: f"{__name__}.{place}" for name, (place, _) in _LISTED.items()}
                     | {name: f"benchmarks.{place}" for name, (place, _) in _BESIDE.items()})


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
    InputError : no such study, none of its settings, or the folder cannot be written
    BlackBoxError : from the code; the cases finished so far are on disk
    """
    if name not in STUDIES:
        raise InputError(Problem((), f"study '{name}'", "one of " + ", ".join(STUDIES), "take one of these"))
    if name in _BESIDE:
        _check_beside(name)
    from orchestrator.studies.kit.framework import Study
    from orchestrator.studies.kit.settings import arguments

    asked = arguments(name, FUNCTIONS[name], overrides, resume)
    study = Study(name, STUDIES[name], folder)
    FUNCTIONS[name](study, **asked)
    study.close()


def _check_beside(name: str) -> None:
    """Raises InputError where a study is not in this installation, or what it draws its scenes with is not."""
    if find_spec("benchmarks") is None:
        raise InputError(Problem((), f"study '{name}' without the folder benchmarks", "a clone of the project: wheels do not have it",
                                 "run it in a clone, after `make setup`"))
    if find_spec("hypothesis") is None:
        raise InputError(Problem((), f"study '{name}' without hypothesis, which draws its scenes", "the packages of the tests",
                                 "pip install hypothesis, or make test once"))
