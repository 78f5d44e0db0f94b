"""Two cantilevers in contact, one on the other: iterations and tip over their slenderness, beside the solution in one piece."""

from __future__ import annotations

from benchmarks.kit.drawing import BLUE, GREY, ORANGE, panels
from benchmarks.kit.study import Case, Study
from benchmarks.monolithic import Monolithic
from benchmarks.problems.cantilevers import beams, tip
from orchestrator import config_from, solve

LENGTHS, ELEMENTS, FRICTIONS = (5, 10, 20, 40), ("P1", "P2"), (0.0, 0.5)
MOST, NEAR = 40, 1e-2  # iterations wanted, and difference of the tip's deflection


def run(study: Study) -> None:
    """Beams of L/h = 5 to 40, pressed on each other by the upper one's load."""
    study.columns = ("element", "friction", "length", "iterations", "sweeps_setup", "law_residual", "tip", "off", "stop_reason", "seconds")
    for element in ELEMENTS:
        for friction in FRICTIONS:
            for length in LENGTHS:
                case = Case(beams(length, friction, element), {"element": element, "friction": friction, "length": length})
                solved = solve(config_from(dict(case.config)), study.scene(case.config))
                found = tip([u[-1] for u in solved.parts], solved.scene)
                whole = tip(Monolithic(solved.scene).solve()[-1].parts, solved.scene)
                off = abs(found / whole - 1)
                row = {"iterations": solved.iterations, "sweeps_setup": round(solved.summary["sweeps"]["setup"]),
                       "law_residual": solved.summary["residuals"]["law_residual"], "tip": found, "off": off,
                       "stop_reason": solved.stop_reason, "seconds": round(solved.summary["timing"]["total"], 2)}
                study.add(case, row, solved.history, f"tip {off:.1e} off")
                study.target(f"{element}, μ = {friction:g}, L/h = {length}", f"at most {MOST} iterations, tip within {NEAR:g}",
                             f"{solved.iterations}, {off:.0e}", solved.converged and solved.iterations <= MOST and off <= NEAR)
    figure, ((axes,),) = panels()
    for element, colour in zip(ELEMENTS, (BLUE, ORANGE)):
        for friction, line in zip(FRICTIONS, ("--", "-")):
            rows = [row for row in study.rows if (row["element"], row["friction"]) == (element, friction)]
            axes.plot([row["length"] for row in rows], [row["iterations"] for row in rows], "o" + line, color=colour,
                      label=f"{element}, μ = {friction:g}")
    axes.axhline(MOST, color=GREY, linewidth=1, linestyle=":")
    axes.set(ylim=(0, None), xlabel="length over height of a beam", ylabel="iterations to a law residual of 1e-4")
    study.figure(figure)
