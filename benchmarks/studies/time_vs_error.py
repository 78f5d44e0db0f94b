"""Time against true error: what accuracy costs with which element, mesh, method and tolerance.

Seconds are those of the processor, all processes together, from the configuration to the displacements: mesh, set-up, iterations, no
files. A busy machine does not change them, and they count what several workers take. Errors are
true ones, of the mesh and of the iterations together, relative; ``true_errors`` says how they are measured.

- *energy*: the displacement in the energy norm.
- *deflection*: the work of the loads, f·ũ, which is the mean deflection where they act, weighted by them.
- *stress*: the largest von Mises stress of the recovered nodal stresses away from edges where the exact one is
  unbounded, against that on the finest mesh.

Methods: FreeFEM in one piece with CHOLMOD, the quickest of its direct solvers (study ``large``); the paper's settings
(a one-sided sole after its eq. 15, relaxation, no acceleration) at three values of its indicator, at most 70
iterations; our defaults at two fixed tolerances and at ``error: auto``; and ``accuracy``, which makes its meshes by itself from the
coarsest, all of them counted, files too. With contact two are left out: FreeFEM's direct solvers are linear, and the mesh that stands
for the exact solution contains no graded ones.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import PositiveInt

from benchmarks.kit.commands import cpu_seconds
from benchmarks.kit.drawing import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, panels, plain_ticks
from benchmarks.kit.settings import Keys
from benchmarks.kit.study import Case, Study
from benchmarks.kit.true_errors import Exact, direct, extrapolated, finer, graded
from benchmarks.problems.cases import CUT, paper, paper_contact
from benchmarks.problems.error_cases import MODELS, Model
from orchestrator import InputError, Solution, build_scene, config_from, solve
from orchestrator.accuracy.loop import run as refined
from orchestrator.config.load import Loaded
from orchestrator.run import Means

TOLERANCES = (1e-3, 1e-6, "auto")
INDICATORS = (1e-3, 1e-4, 1e-5)
FINE = 1e-6  # tolerance of the reference with contact
ASKED = {"P1": (0.1, 0.05), "P2": (0.1, 0.05, 0.02, 0.01, 0.005)}  # by ``accuracy``
DIRECT, PAPER, FIXED, AUTO = "FreeFEM, undecomposed", "paper's settings", "defaults", "defaults, error: auto"
ASKED_FOR = "accuracy asked for"
COLOURS = {DIRECT: ORANGE, PAPER: RED, FIXED: BLUE, AUTO: GREEN, ASKED_FOR: PURPLE}
DEFLECTION, FASTER = 0.01, 10.0  # accuracy of the beam's deflection, P2 over P1
ADDED = 0.02  # error that ``error: auto`` may add to the mesh's
MOST = {"P1": 100_000, "P2": 20_000}  # tets of an accuracy that is asked for
LARGEST_PAPER = 60_000  # dofs from which the paper's 70 iterations are left out
LABELS = ("case", "element", "k", "method", "tolerance")


SHOWN = (0.1, 0.005)  # true errors between which what is asked for is held against the best that is chosen by hand


class Settings(Keys):
    """What to solve."""

    cases: list[str] = list(MODELS)
    methods: list[str] = list(COLOURS)
    reference: PositiveInt = 40_000  # tets of the mesh that tells the exact energy, where accuracies are asked for


def run(study: Study, settings: Settings = Settings(), models: Mapping[str, Model] = MODELS) -> None:
    """All problems, elements, meshes, methods and tolerances."""
    models = {name: model for name, model in models.items() if name in settings.cases}
    study.columns = ("case", "element", "k", "dofs", "method", "tolerance", "iterations", "energy_error",
                     "deflection_error", "stress_error", "estimate", "stop_reason", "seconds")
    folder = study.folder
    for name, model in models.items():
        contact = len(model.exact) == 1
        with study.console.status(f"{name}: what is exact"):
            if contact:
                method = {"tolerance": {"error": FINE}}
                exact = finer(_problem(model, folder, *model.exact, "P1", method), model.watched)
            else:
                exact = extrapolated([_problem(model, folder, k, "P2", {}) for k in model.exact], model.watched)
                if ASKED_FOR in settings.methods:
                    exact = graded(exact, _problem(model, folder, model.sizes["P2"][0], "P2", {}), folder / "graded", settings.reference)
        study.console.print(f"{name}: ‖u‖² = {exact.energy:.8g}" + (
            "" if contact else f", of which {exact.uncertain:.1e} extrapolated"))
        for element, sizes in model.sizes.items():
            for k in sizes:
                _compare(study, settings.methods, name, model, element, k, exact)
                if (element, k) == ("P2", model.exact[-1]):  # the mesh that the stress is compared with
                    for row in study.rows:
                        if (row["case"], row["element"], row["k"]) == (name, element, k):
                            row["stress_error"] = math.nan
            if not contact and ASKED_FOR in settings.methods:
                _asked(study, folder, name, model, element, exact)
        _auto(study, name)
        _beside(study, name)
    if "beam in bending" in models:
        _deflection(study)
    study.figure(_picture(study, list(models)))


def _problem(model: Model, folder: Any, k: int, element: str, method: Mapping[str, Any]) -> dict[str, Any]:
    return {**model.problem(folder, k), "method": dict(method), "blackbox": {"element": element},
            "output": {"fields": False, "figures": False}}


def _compare(study: Study, methods: list[str], name: str, model: Model, element: str, k: int, exact: Exact) -> None:
    """Methods on one mesh."""
    def case(method: str, tolerance: Any, settings: Mapping[str, Any]) -> Case:
        labels = dict(zip(LABELS, (name, element, k, method, tolerance)))
        return Case(_problem(model, study.folder, k, element, settings), labels)

    contact = exact.finer is not None
    if DIRECT in methods:
        whole = case(DIRECT, "", {})
        if contact:
            _leave_out(study, whole, "contact is not linear")
        else:
            begin = cpu_seconds()
            solved = direct(whole.config)
            _add(study, whole, solved, exact, {"iterations": 0, "stop_reason": "solved", "seconds": cpu_seconds() - begin})
    if PAPER in methods:
        ratio = model.brick / k / model.length  # eq. 15
        settings = paper_contact(ratio=ratio) if contact else paper("equilibrium", modulus_ratio=ratio)
        if not contact:
            settings["sole"]["thickness"] = "auto"
        for indicator in INDICATORS:
            _solve(study, case(PAPER, f"η {indicator:g}", {**settings, "tolerance": {"indicator": indicator},
                                                           "max_iterations": CUT}), exact)
    for tolerance in TOLERANCES:
        method = AUTO if tolerance == "auto" else FIXED
        if method in methods:
            _solve(study, case(method, tolerance, {"tolerance": {"error": tolerance}}), exact)


def _asked(study: Study, folder: Any, name: str, model: Model, element: str, exact: Exact) -> None:
    """Accuracies asked for on the coarsest mesh, each as a row."""
    k, found = model.sizes[element][0], []
    for asked in ASKED[element]:
        method = {"accuracy": {"error": asked, "elements": MOST[element]}}
        case = Case(_problem(model, folder, k, element, method), dict(zip(LABELS, (name, element, k, ASKED_FOR, asked))))
        with study.console.status(str(case)):
            begin = cpu_seconds()
            refined(Loaded(config_from(dict(case.config))), output=folder / "asked", quiet=True,
                    means=Means(judge=lambda solution: found.append(solution) or solution))
            solved = found[-1]
            _add(study, case, solved, exact, {"iterations": solved.iterations, "stop_reason": solved.stop_reason,
                                              "estimate": solved.summary["accuracy"]["reached"], "seconds": cpu_seconds() - begin})
        if not solved.summary["accuracy"]["met"]:
            return  # nor would a smaller one be


def _solve(study: Study, case: Case, exact: Exact) -> None:
    """One decomposed run, as a row; what cannot be is left out with its reason."""
    with study.console.status(str(case)), np.errstate(over="ignore", invalid="ignore"):  # some of the paper's diverge
        begin = cpu_seconds()
        try:
            config = config_from(dict(case.config))
            scene = build_scene(config)
        except InputError as error:
            _leave_out(study, case, error.problems[0].found)
            return
        if case.labels["method"] == PAPER and 3 * len(scene.mesh.nodes) > LARGEST_PAPER:
            _leave_out(study, case, f"more than {LARGEST_PAPER} dofs")
            return
        solved = solve(config, scene)
        row = {"iterations": solved.iterations, "stop_reason": solved.stop_reason,
               "error_bound": solved.summary["error_bound"], "estimate": solved.summary["discretisation_error"],
               "seconds": cpu_seconds() - begin}
        _add(study, case, solved, exact, row)


def _leave_out(study: Study, case: Case, reason: str) -> None:
    study.note({**case.labels, "stop_reason": f"left out: {reason}"}, f"{case}: left out: {reason}")


def _add(study: Study, case: Case, solved: Solution, exact: Exact, row: dict[str, Any]) -> None:
    """Measure the errors of a finished run and add its row."""
    errors = exact.errors(solved)
    study.add(case, {"dofs": solved.summary["dofs"], **errors, **row}, solved.history,
              f"energy error {errors['energy_error']:.1e}, stress error {errors['stress_error']:.1e}")


def _deflection(study: Study) -> None:
    """The quickest run of each element that finds the beam's deflection."""
    quickest = {}
    for element in ("P1", "P2"):
        good = [row for row in study.rows if row["case"] == "beam in bending" and row["element"] == element
                and row.get("deflection_error", 1.0) <= DEFLECTION
                and row["energy_error"] <= math.sqrt(DEFLECTION)]  # the same but for luck before convergence
        quickest[element] = min(good, key=lambda row: row["seconds"], default=None)
    one, two = quickest["P1"], quickest["P2"]
    shown = ", ".join(f"{element} {row['method']} {row['tolerance']} k = {row['k']}: {row['seconds']:.2f} s" if row else
                      f"{element}: none" for element, row in quickest.items())
    ratio = one["seconds"] / two["seconds"] if one and two else 0.0
    study.target(f"beam, deflection to {DEFLECTION:.0%}: quickest P1 over quickest P2", f"at least {FASTER:g}",
                 f"{ratio:.1f}: {shown}", ratio >= FASTER)


def _auto(study: Study, name: str) -> None:
    """What ``error: auto`` adds to the error of the mesh, and what it saves."""
    rows = [row for row in study.rows if row["case"] == name and row.get("energy_error") is not None]
    tight = {(r["element"], r["k"]): r for r in rows if r["method"] == FIXED and r["tolerance"] == min(TOLERANCES[:2])}
    pairs = [(r, tight[r["element"], r["k"]]) for r in rows if r["method"] == AUTO and (r["element"], r["k"]) in tight]
    if not pairs:
        return
    added = max(a["energy_error"] / t["energy_error"] - 1 for a, t in pairs)
    stages = [sum(row["iterations"] for row in side) for side in zip(*pairs)]
    study.target(f"{name}: error: auto beside {min(TOLERANCES[:2]):g}",
                 f"at most {ADDED:.0%} more error in fewer stages",
                 f"{100 * added:.1f} % more; {stages[0]} stages, not {stages[1]}",
                 added <= ADDED and stages[0] < stages[1])


def _beside(study: Study, name: str) -> None:
    """Every accuracy that was asked for beside the quickest run with as small a true error of those whose meshes are chosen by hand."""
    rows = [row for row in study.rows if row["case"] == name and row.get("energy_error") is not None]
    by_hand = [row for row in rows if row["method"] != ASKED_FOR]
    for row in rows:
        if row["method"] == ASKED_FOR and SHOWN[1] <= row["energy_error"] <= SHOWN[0]:
            best = min((other for other in by_hand if other["energy_error"] <= row["energy_error"]), key=lambda other: other["seconds"],
                       default=None)
            own = f"{row['seconds']:.2f} s, true {row['energy_error']:.2%}"
            study.target(f"{name}, {row['element']}: {row['tolerance']:g} asked for", "as quick as the best by hand",
                         f"{own}; " + (f"{best['seconds']:.2f} s, true {best['energy_error']:.2%}, {best['method']} {best['tolerance']}, "
                                       f"{best['element']}, k = {best['k']}" if best else "none is so near"),
                         best is None or row["seconds"] <= best["seconds"])


def _front(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows that no other beats in both time and error, by time."""
    front: list[dict[str, Any]] = []
    for row in sorted(rows, key=lambda row: (row["seconds"], row["energy_error"])):
        if not front or row["energy_error"] < front[-1]["energy_error"]:
            front.append(row)
    return front


def _picture(study: Study, names: list[str]):
    """A column per problem: energy error and stress error over seconds, with the Pareto front of each."""
    figure, axes = panels(2, len(names), (3.6 * len(names) + 0.6, 7.0), sharex="col")
    for column, name in enumerate(names):
        rows = [row for row in study.rows if row["case"] == name and math.isfinite(row.get("energy_error", math.nan))]
        for panel, quantity in zip(axes[:, column], ("energy_error", "stress_error")):
            front = _front([{**row, "energy_error": row[quantity]} for row in rows])
            panel.loglog([r["seconds"] for r in front], [r["energy_error"] for r in front], color=GREY, linewidth=1,
                         drawstyle="steps-post", label="best so far" if panel is axes[0, 0] else "_")
            for method, colour in COLOURS.items():
                for element, marker in (("P1", "o"), ("P2", "s")):
                    mine = [r for r in rows if r["method"] == method and r["element"] == element]
                    panel.loglog([r["seconds"] for r in mine], [r[quantity] for r in mine], marker, color=colour,
                                 markersize=5, markerfacecolor="none" if element == "P1" else colour,
                                 label=f"{method}, {element}" if panel is axes[0, 0] else "_")
            plain_ticks(panel)
        axes[0, column].set_title(name, fontsize=11)
        axes[1, column].set_xlabel("seconds of the processor", fontsize=9)
    for panel, label in zip(axes[:, 0], ("true error, energy norm", "true error of the largest stress")):
        panel.set_ylabel(label, fontsize=9)
    return figure
