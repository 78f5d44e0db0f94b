"""``output: {mesh_bound: true}`` beside true errors: an L, a hole, a slit, bonded, of four-node and ten-node tets; a punch in contact without
friction, of four-node ones.

True errors are distances from a graded mesh of ten-node tets in the energy norm, whose own estimated error is added as the other leg of a
right-angled triangle.
"""

from __future__ import annotations

import math

from benchmarks.kit.apart import apart
from benchmarks.kit.commands import cpu_seconds
from benchmarks.kit.drawing import BLUE, GREY, panels
from benchmarks.kit.study import Study
from benchmarks.studies.accuracy import graded, problem
from orchestrator import Solution, config_from, solve
from orchestrator.method.stopping.mesh_bound import MeshBounds

MOST = 3.0  # times the true error


def run(study: Study, cases: tuple[str, ...] = ("l_shape", "hole", "slit", "punch"), sizes: tuple[float, ...] = (0.25, 0.12, 0.08),
        reference: int = 9_000) -> None:
    """Uniform meshes.

    Parameters
    ----------
    sizes : of elements
    reference : ten-node tets of the graded mesh, about
    """
    study.columns = ("case", "element", "size", "elements", "bound", "true_error", "ratio", "estimated", "seconds", "solved_in")
    figure, (axes,) = panels(1, len(cases), size=(3.6 * len(cases), 3.5))
    for panel, name in zip(axes, cases):
        best, estimate = _reference(study, name, reference)
        for element, marker in (("P1", "o"), ("P2", "s"))[: 1 if name == "punch" else 2]:
            rows = [_bounded(study, name, element, size, best, estimate) for size in sizes]
            ratios = [row["ratio"] for row in rows]
            study.target(f"{name}, {element}: guaranteed over true error", f"1 to {MOST:g}", f"{min(ratios):.2f} to {max(ratios):.2f}",
                         1 <= min(ratios) and max(ratios) <= MOST)
            counts = [row["elements"] for row in rows]
            panel.loglog(counts, [row["true_error"] for row in rows], f"{marker}-", color=GREY, label=f"{element}, true")
            panel.loglog(counts, [row["bound"] for row in rows], f"{marker}-", color=BLUE, label=f"{element}, guaranteed")
        panel.set(title=name, xlabel="elements")
        panel.legend()
    study.figure(figure)


def _reference(study: Study, name: str, elements: int) -> tuple[Solution, float]:
    """The last of meshes that are refined, and its estimated error."""
    made = {**problem(study.folder, name, "P2"), "name": f"{name}-reference"}
    found, _ = graded(study, made, {"accuracy": {"error": 1e-3, "elements": elements}})
    return found[-1], found[-1].summary["discretisation_error"]


def _bounded(study: Study, name: str, element: str, size: float, reference: Solution, estimate: float) -> dict[str, object]:
    """One mesh: its row."""
    begin = cpu_seconds()
    solution = solve(config_from({**problem(study.folder, name, element, size), "method": {"tolerance": {"error": 1e-4}}}))
    solved = cpu_seconds()
    bound = MeshBounds(solution.scene)(solution.sides).relative
    seconds, true = cpu_seconds() - solved, math.hypot(apart(solution, reference), estimate)
    row = {"case": name, "element": element, "size": size, "elements": len(solution.scene.mesh.cells), "bound": bound,
           "true_error": true, "ratio": bound / true, "estimated": solution.summary["discretisation_error"],
           "seconds": round(seconds, 2), "solved_in": round(solved - begin, 2)}
    study.note(row, f"{name}, {element}, {row['elements']:,} elements: guaranteed {bound:.2%}, true {true:.2%}, {seconds:.1f} s")
    return row
