"""Contact between faces of ten-node tets beside four-node ones: two cantilevers one on the other, and a cylinder on a block.

Each cantilever carries half of what presses on the upper one: tips are over Timoshenko's theory of one. Pressures are over Hertz's
largest, p₀, at the nodes below 0.95 a, for the force that is found.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kit.drawing import BLUE, GREY, ORANGE, panels
from benchmarks.kit.study import Case, Study
from orchestrator import Solution, config_from, solve

sys.path.append(str(Path(__file__).parents[2] / "meshes"))
from hertz import LENGTH, RADIUS, cylinder_on_block, write  # noqa: E402

YOUNG, POISSON, PRESS = 200e3, 0.3, 0.002
STIFF = 0.99  # of theory's tip
COLOURS = {"P1": BLUE, "P2": ORANGE}
SIZES = (0.02, 0.01)  # of elements below the cylinder, whose half-width is about 0.045


def run(study: Study, slenderness: tuple[int, ...] = (5, 10), sizes: tuple[float, ...] = SIZES, code: str = "freefem") -> None:
    """Both elements.

    Parameters
    ----------
    slenderness : lengths of the cantilevers over their height, with an element per height
    sizes : of the elements below the cylinder
    """
    study.columns = ("case", "element", "size", "dofs", "iterations", "stop_reason", "tip", "force", "pressure_error", "seconds")
    for length in slenderness:
        for element in COLOURS:
            solved = _solved(study, {"case": f"cantilevers {length}", "element": element, "size": 1.0}, cantilevers(length), code, tip)
            if element == "P2":
                study.target(f"two cantilevers {length} times as long as high, tip over theory", f"at least {STIFF}",
                             f"{tip(solved)['tip']:.3f}",
                             STIFF <= tip(solved)["tip"] <= 2 - STIFF)
    figure, (axes,) = panels(1, len(sizes), size=(4.5 * len(sizes), 3.5))
    for panel, size in zip(axes, sizes):
        x = np.linspace(0, 1, 200)
        panel.plot(x, np.sqrt(1 - x**2), color=GREY, label="Hertz")
        for element, colour in COLOURS.items():
            solved = _solved(study, {"case": "cylinder", "element": element, "size": size}, cylinder(study, size), code, hertz)
            panel.plot(*along(solved)[:2], "o-", color=colour, markersize=3, linewidth=0.8, label=element)
        panel.set(xlim=(0, 1.5), xlabel="x / a", ylabel="p / p₀", title=f"elements of {size:g}")
        panel.legend()
    study.figure(figure)


def _solved(study: Study, labels: dict[str, Any], problem: Mapping[str, Any], code: str, measure) -> Solution:
    """One run: its row."""
    data = {**problem, "blackbox": {"code": code, "element": labels["element"]}}
    solved = solve(config_from(data), study.scene(data))
    study.add(Case(data, labels), {"dofs": solved.summary["dofs"], "iterations": solved.iterations, "stop_reason": solved.stop_reason,
                                   "seconds": round(solved.summary["timing"]["total"], 1), **measure(solved)}, solved.history,
              ", ".join(f"{name} {value:.4g}" for name, value in measure(solved).items()))
    return solved


def cantilevers(length: int) -> dict[str, Any]:
    """Two, of height and breadth 1, clamped at x = 0, one on the other, pressed on from above by 1."""
    return {"name": f"cantilevers-{length}", "mesh": {"box": {"size": [length, 1, 2], "cells": [length, 1, 2]}},
            "subdomains": {"grid": [1, 1, 2]}, "materials": [{"young": YOUNG, "poisson": 0.0}],
            "interfaces": [{"law": "contact", "friction": 0.0}], "output": {"fields": False, "figures": False},
            "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]}, {"on": {"plane": "z", "at": 2}, "pressure": 1.0}],
            "method": {"tolerance": {"law": 1e-4}, "max_iterations": 500}}


def tip(solved: Solution) -> dict[str, float]:
    """Over theory, the mean of both."""
    length = np.ptp(solved.scene.mesh.nodes[:, 0])
    theory = 0.5 * (length**4 / (8 * YOUNG / 12) + length**2 / (2 * YOUNG / 2 * 5 / 6))
    return {"tip": float(np.mean([-side[0, :, 2].min() for side in solved.sides]) / theory)}


def cylinder(study: Study, size: float) -> dict[str, Any]:
    """Half a slice of a cylinder on a block in plane strain, pressed down."""
    path = study.folder / f"hertz-{size:g}.msh"
    write(path, cylinder_on_block(size, half=True))
    held = [({"plane": "y", "at": y}, [None, 0, None]) for y in (0.0, 2 * size)] + [({"plane": "x", "at": 0.0}, [0, None, None])]
    held += [({"plane": "z", "at": -LENGTH}, [None, None, 0]), ({"plane": "z", "at": LENGTH}, [None, None, -PRESS])]
    return {"name": f"cylinder-{size:g}", "mesh": {"file": str(path)}, "subdomains": "groups",
            "materials": [{"young": YOUNG, "poisson": POISSON}], "output": {"fields": False, "figures": False},
            "interfaces": [{"law": "contact", "friction": 0.0, "gap": "geometry", "within": 0.02}],
            "boundary": [{"on": on, "displacement": u} for on, u in held], "method": {"tolerance": {"law": 1e-5}}}


def along(solved: Solution) -> tuple[np.ndarray, np.ndarray, float]:
    """x/a and p/p₀ of the lines of nodes along y, and the force per length."""
    found = solved.interfaces
    x, line = np.unique(np.round(solved.scene.mesh.nodes[found.nodes, 0], 9), return_inverse=True)
    push, width = (np.bincount(line, values) for values in (found.pressure[0] * found.area, found.area))
    force = 2 * push.sum() / np.ptp(solved.scene.mesh.nodes[:, 1])
    a = np.sqrt(8 * force * RADIUS * (1 - POISSON**2) / (np.pi * YOUNG))
    return x / a, push / width * np.pi * a / (2 * force), float(force)


def hertz(solved: Solution) -> dict[str, float]:
    """The force, and the root of the mean square of what pressures are off."""
    x, p, force = along(solved)
    inside = x < 0.95
    return {"force": force, "pressure_error": float(np.sqrt(np.mean((p[inside] - np.sqrt(1 - x[inside] ** 2)) ** 2)))}
