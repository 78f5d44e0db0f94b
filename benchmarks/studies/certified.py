"""The energy error with contact beside the true one: random scenes, against solutions in one piece that share no code with the method.

Every scene is drawn from its number: grids, slices, grains, blocks of different stiffness and parts meshed apart, bodies that nothing
but contact holds among them, with gaps, press fits, friction and several load steps. Errors are of the displacements that are
delivered, max_t ‖v − u*‖ / max_t ‖u*‖, from the strains of the difference, which rigid motions do not have.
Beside scenes of all kinds there are pairs of blocks held by supports, with little friction in one load step, whose error mostly is
guaranteed. One scene is also ended after more and more iterations: what a run says of its error at every moment, beside the true one,
over iterations and over seconds. What has been measured is kept beside the study, for ``--resume``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import Field, PositiveInt

from benchmarks.kit.drawing import BLUE, GREEN, GREY, ORANGE, RED, between_lines, level, panels
from benchmarks.kit.elasticity import energy
from benchmarks.kit.settings import Keys
from benchmarks.kit.study import Study
from benchmarks.monolithic import Monolithic
from benchmarks.problems.cases import with_method
from orchestrator import OrchestratorError, Scene, Solution, build_scene, config_from, solve

MEDIAN, LARGEST = 2.0, 6.0  # of guaranteed bounds over true errors
ASKED = (1e-2, 1e-3, 1e-4, 1e-5)
FRICTION = (0.0, 0.0, 0.0, 0.1, 0.3, 0.6)
EXACT = 1e-10  # residual of a solution in one piece that others are measured against
NOISE = 3e-8  # relative energy error that such a solution still tells from zero
CUT = 500  # iterations, after which a run has failed
YOUNG = 200e3
LITTLE = (0.01, 0.25)  # friction of blocks that are held
FOLLOWED = 7  # number of grains of the scene that is followed
KINDS = ("grid", "slices", "grains", "grains", "blocks", "apart")
STACKED = ("slices", "blocks", "apart")  # faces one above the other: a press fit leaves room, and a pressure does not topple anything

CLAIMS = {"guaranteed": (BLUE, "o"), "guaranteed with friction": (GREEN, "s"), "estimated": (ORANGE, "^")}

Rows = Sequence[Mapping[str, Any]]


class Settings(Keys):
    """What to draw, and who solves it."""

    scenes: PositiveInt = Field(200, description="random scenes, each with an error that is asked for")
    first: int = Field(1, ge=0, description="number of the first one; scenes are drawn from their numbers")
    held: int = Field(40, ge=0, description="pairs of held blocks with little friction, one load step each")
    code: str = Field("freefem", description="the code that solves the bodies")
    follow: bool = Field(True, description="whether one scene is followed over its iterations")


def run(study: Study, settings: Settings = Settings(), resume: bool = False) -> None:
    """All scenes, then the one that is followed.

    Parameters
    ----------
    resume : take over what the folder has of the same runs
    """
    study.columns = ("scene", "kind", "bodies", "friction", "gap", "contrast", "steps", "element", "asked", "iterations", "stop_reason",
                     "error_kind", "true_error", "error_bound", "effectivity", "seconds")
    numbers = range(settings.first, settings.first + settings.scenes)
    scenes = {str(number): drawn(number, settings.code) for number in numbers}
    scenes |= {f"held-{number}": held(number, settings.code) for number in range(settings.first, settings.first + settings.held)}
    for scene, (data, labels) in scenes.items():
        row = {"scene": scene, **labels, **study.kept(f"scene-{scene}", data, lambda: _judged(data), resume)}
        study.note(row, f"scene {scene}, {', '.join(f'{key} {value}' for key, value in labels.items())}: " + (
            f"failed, {row['failure']}" if "failure" in row else f"{row['stop_reason']} after {row['iterations']}, {row['error_kind']} "
            f"{row['error_bound']:.1e}, true {row['true_error']:.1e}"))
    followed = study.kept("followed", {"data": _followed(settings.code)}, lambda: _curves(_followed(settings.code)),
                          resume) if settings.follow else {}
    study.figure(_picture(study.rows, followed))
    judge(study)


# --- what is drawn ----------------------------------------------------------------------------------------


def drawn(number: int, code: str = "freefem") -> tuple[dict[str, Any], dict[str, Any]]:
    """A scene's configuration, and what tells it from others."""
    rng = np.random.default_rng(number)
    kind, friction, steps = str(rng.choice(KINDS)), float(rng.choice(FRICTION)), int(rng.integers(1, 5))
    element = "P2" if rng.random() < 0.2 else "P1"
    contrast = float(rng.choice([1, 10, 1000])) if kind in ("grains", "blocks", "apart") else 1.0
    gap = float(rng.choice([0, 0, 0.001, 0.002] + [-0.001] * (kind in STACKED)))
    asked = float(rng.choice(ASKED))
    bodies, names = _BODIES[kind](rng, 2 if element == "P2" else 3)
    matters = [{"young": YOUNG, "poisson": 0.3}]
    matters += [{"young": float(f"{YOUNG * contrast ** -rng.random():.4g}"), "poisson": 0.3, "on": name} for name in names if contrast > 1]
    if contrast > 1:  # the full contrast is there
        matters[1 + int(rng.integers(len(names)))]["young"] = YOUNG / contrast
    labels = {"kind": kind, "friction": friction, "gap": gap, "contrast": contrast, "steps": steps, "element": element, "asked": asked}
    return {
        "name": f"scene-{number}", **bodies, "materials": matters,
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]}, _top(rng, kind, friction, steps)],
        "interfaces": [{"law": "contact", "friction": friction, **({"gap": gap} if gap else {})}],
        "blackbox": {"code": code, "element": element}, "method": {"tolerance": {"error": asked}, "max_iterations": CUT},
        "output": {"fields": False, "figures": False},
    }, labels


def held(number: int, code: str = "freefem") -> tuple[dict[str, Any], dict[str, Any]]:
    """The same of two blocks, one on the other, whose outer faces are moved: matching or meshed apart, one load step, little friction."""
    rng = np.random.default_rng([number, 1])
    apart, friction, contrast = bool(rng.random() < 0.5), round(float(rng.uniform(*LITTLE)), 3), float(rng.choice([1, 10, 1000]))
    gap, asked, cells = float(rng.choice([0, 0, 0.001, -0.001])), float(rng.choice(ASKED)), int(rng.integers(2, 6))
    bodies, names = _piled(2, _any_size(rng) if apart else lambda height: {"box": {"size": [1, 1, height], "cells": [cells] * 3}})
    top = [*map(float, rng.uniform(-0.01, 0.01, 2)), -float(rng.uniform(0.003, 0.012))]
    labels = {"kind": "held apart" if apart else "held", "friction": friction, "gap": gap, "contrast": contrast, "steps": 1,
              "element": "P1",
              "asked": asked}
    return {
        "name": f"held-{number}", **bodies, "materials": [{"young": YOUNG, "poisson": 0.3}, {
            "young": YOUNG / contrast, "poisson": 0.3, "on": str(rng.choice(names))}],
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 1}, "displacement": top}],
        "interfaces": [{"law": "contact", "friction": friction, **({"gap": gap} if gap else {})}], "blackbox": {"code": code},
        "method": {"tolerance": {"error": asked}, "max_iterations": CUT}, "output": {"fields": False, "figures": False},
    }, labels


def _top(rng: np.random.Generator, kind: str, friction: float, steps: int) -> dict[str, Any]:
    """What happens to the top: it is moved, or pressed and pushed by less than friction can hold."""
    if kind in STACKED and rng.random() < 0.3:
        pressure = rng.uniform(100, 1000, steps)
        aside = 0.4 * friction * pressure * rng.uniform(-1, 1, steps)
        return {"on": {"plane": "z", "at": 1}, "traction": [[float(a), 0.0, -float(p)] for a, p in zip(aside, pressure)]}
    path = [[*rng.uniform(-0.01, 0.01, 2), -rng.uniform(0.003, 0.012)] for _ in range(steps)]
    return {"on": {"plane": "z", "at": 1}, "displacement": [list(map(float, step)) for step in path]}


def _grid(rng: np.random.Generator, n: int) -> tuple[dict[str, Any], list[str]]:
    return {"mesh": {"box": {"size": [1, 1, 1], "cells": [2 * n] * 3}},
            "subdomains": {"grid": [int(rng.integers(1, 3)), int(rng.integers(1, 3)), 2]}}, []


def _slices(rng: np.random.Generator, n: int) -> tuple[dict[str, Any], list[str]]:
    return {"mesh": {"box": {"size": [1, 1, 1], "cells": [4, 4, 6]}}, "subdomains": {"slices": {"axis": "z", "count": 3}}}, []


def _grains(rng: np.random.Generator, n: int) -> tuple[dict[str, Any], list[str]]:
    count = int(rng.integers(3, 9))
    return {"mesh": {"polycrystal": {"grains": count, "size": 1.0, "h": 0.22 if n > 2 else 0.3, "seed": int(rng.integers(1000))}},
            "subdomains": "groups"}, [f"grain_{k + 1}" for k in range(count)]


def _blocks(rng: np.random.Generator, n: int) -> tuple[dict[str, Any], list[str]]:
    """A pile of blocks whose nodes meet."""
    return _piled(int(rng.integers(2, 4)), lambda height: {"box": {"size": [1, 1, height], "cells": [2 * n, 2 * n, n - 1]}})


def _apart(rng: np.random.Generator, n: int) -> tuple[dict[str, Any], list[str]]:
    """A pile of blocks each meshed at a size of its own."""
    return _piled(int(rng.integers(2, 4)), _any_size(rng))


def _any_size(rng: np.random.Generator) -> Callable[[float], dict[str, Any]]:
    """Height → mesh of a block by the mesher, at a size of its own."""
    return lambda height: {"polycrystal": {"grains": 1, "size": [1, 1, height], "h": float(f"{rng.uniform(0.2, 0.3):.3f}")}}


def _piled(count: int, mesh: Callable[[float], dict[str, Any]]) -> tuple[dict[str, Any], list[str]]:
    names = [f"block_{k + 1}" for k in range(count)]
    return {"parts": [{"name": name, "mesh": mesh(1 / count), "move": {"translate": [0, 0, k / count]}} for k, name in enumerate(names)],
            "subdomains": "groups"}, names


_BODIES = {"grid": _grid, "slices": _slices, "grains": _grains, "blocks": _blocks, "apart": _apart}


# --- what is measured -------------------------------------------------------------------------------------


class Truth:
    """The solution in one piece.

    Attributes
    ----------
    residual : of equilibrium and laws, largest of all load steps
    """

    def __init__(self, scene: Scene):
        steps = Monolithic(scene).solve()
        self.scene, self.residual = scene, max(step.residual for step in steps)
        self.parts = [np.stack(part) for part in zip(*(step.parts for step in steps))]
        self.size = energy(scene, self.parts).max()

    def error(self, sides: Sequence[np.ndarray]) -> float:
        """Relative, of displacements (T, n_E, 3) per subdomain."""
        return float(np.sqrt(energy(self.scene, [u - exact for u, exact in zip(sides, self.parts)]).max() / self.size))


def solved_in(data: Mapping[str, Any]) -> tuple[Scene, Solution, float] | str:
    """Scene, solution and seconds of a run; where there is none, why."""
    try:
        config = config_from(data)
        scene, begin = build_scene(config), time.perf_counter()
        return scene, solve(config, scene), time.perf_counter() - begin
    except OrchestratorError as error:
        return " ".join(str(error).split())


def _judged(data: dict[str, Any]) -> dict[str, Any]:
    """Columns of a run, and its true error; where there is no run or nothing to compare it with, why."""
    if isinstance(run := solved_in(data), str):
        return {"failure": run}
    scene, solved, seconds = run
    summary = solved.summary
    row = {"bodies": summary["subdomains"], "dofs": summary["dofs_decomposed"], "iterations": solved.iterations,
           "stop_reason": solved.stop_reason, "error_kind": summary["error_kind"] or "unknown", "error_bound": solved.error_bound,
           "law_residual": summary["residuals"]["law_residual"], "seconds": round(seconds, 2)}
    truth = Truth(scene)
    known = truth.residual <= EXACT
    error = truth.error(solved.sides) if known else float("nan")
    return {**row, "exact_residual": truth.residual, "true_error": error,
            "effectivity": solved.error_bound / error if known and error > NOISE else float("nan")}


def _followed(code: str) -> dict[str, Any]:
    """Grains with friction, to the smallest error."""
    return {
        "name": "followed", "mesh": {"polycrystal": {"grains": FOLLOWED, "size": 1.0, "h": 0.22}}, "subdomains": "groups",
        "materials": [{"young": YOUNG, "poisson": 0.3}],
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 1}, "displacement": [[0, 0, -0.005], [0.01, 0, -0.005]]}],
        "interfaces": [{"law": "contact", "friction": 0.1}], "blackbox": {"code": code},
        "method": {"tolerance": {"error": min(ASKED)}, "max_iterations": CUT}, "output": {"fields": False, "figures": False},
    }


def _curves(data: dict[str, Any]) -> dict[str, Any]:
    """Per iteration true error, E and law residual of a run that ends with it, and seconds after which the last of these runs was there."""
    config = config_from(data)
    scene = build_scene(config)
    truth, last = Truth(scene), solve(config, scene)
    ends = {last.iterations: last}
    for count in range(1, last.iterations):
        ends[count] = solve(config_from(with_method(data, {**data["method"], "max_iterations": count})), scene)
    found = [(count, float(seconds), truth.error(end.sides), end.error_bound, float(end.history["law_residual"][-1]))
             for (count, end), seconds in zip(sorted(ends.items()), last.history["seconds"])]
    return dict(zip(("iteration", "seconds", "true_error", "error_bound", "law_residual"), map(list, zip(*found))))


def kind_of(row: Mapping[str, Any]) -> str:
    """What is claimed of the error: guaranteed by convex laws, or with a factor beside friction, or estimated."""
    return "guaranteed with friction" if row["error_kind"] == "guaranteed" and row["friction"] > 0 else row["error_kind"]


def judge(study: Study) -> None:
    """The targets, of what has been run."""
    runs = [row for row in study.rows if "iterations" in row]
    ended = [row for row in runs if row["stop_reason"] == "converged"]
    study.target("runs that converge", f"all {len(study.rows)}", len(ended), len(ended) == len(study.rows))
    for kind in CLAIMS:
        rows = [row for row in runs if kind_of(row) == kind]
        ratios = np.array([row["effectivity"] for row in rows if np.isfinite(row["effectivity"])])
        if not len(ratios):
            continue
        least, middle, most, below = ratios.min(), np.median(ratios), ratios.max(), int((ratios < 1).sum())
        shown = f"{least:.3f}, {middle:.2f}, {most:.2f} of {len(ratios)}; {below} below 1"
        if kind == "guaranteed":
            study.target("guaranteed: bound over true error, least, median, largest", f"at least 1, at most {MEDIAN:g}, {LARGEST:g}", shown,
                         least >= 1 and middle <= MEDIAN and most <= LARGEST)
        else:  # the factor for friction has no limit
            sure = kind != "estimated"
            study.target(f"{kind}: the same", "at least 1" if sure else "told", shown, least >= 1 or not sure)
        # where bodies are loose residuals may end a run, and the error that it tells is above
        claimed = [row for row in rows if row["error_bound"] <= row["asked"]]
        above = [row["true_error"] / row["asked"] for row in claimed if row["true_error"] > row["asked"]]
        study.target(f"{kind}: true error above what was asked, of runs that tell one below it", "told" if kind == "estimated" else "none",
                     f"{len(above)} of {len(claimed)}" + (f", at most {max(above):.2f} times" if above else ""),
                     kind == "estimated" or not above)
    unknown = sum(not np.isfinite(row["true_error"]) for row in runs)
    study.target("scenes whose solution in one piece is not found", "told", f"{unknown} of {len(runs)}", True)


def _picture(rows: Rows, followed: Mapping[str, Any]):
    """E over true errors; and both over the iterations and the seconds of one run."""
    figure, ((left, middle, right),) = panels(1, 3, (15.0, 4.8))
    limits = (1e-7, 1e-1)
    between_lines(left, LARGEST, limits)
    for kind, (colour, marker) in CLAIMS.items():
        those = [row for row in rows if "error_kind" in row and kind_of(row) == kind]
        left.loglog([row["true_error"] for row in those], [row["error_bound"] for row in those], marker, color=colour, markersize=4,
                    markerfacecolor="none", label=kind)
    left.set_ylabel("energy error that the run tells")
    left.set_title(f"solid: both alike, dashed: {LARGEST:g} times", fontsize=10)
    for axes, abscissa, name in ((middle, "iteration", "iterations"), (right, "seconds", "seconds from the start of the run")):
        for quantity, colour, label in (("error_bound", ORANGE, "energy error, estimated"), ("true_error", GREEN, "true energy error"),
                                        ("law_residual", RED, "law residual")):
            if followed:
                axes.semilogy(followed[abscissa], followed[quantity], ".-", color=colour, linewidth=1.2, markersize=4, label=label)
        level(axes, min(ASKED), "asked")
        axes.set(xlabel=name, ylabel="relative")
        axes.set_title(f"{FOLLOWED} grains, friction 0.1, two load steps", fontsize=10, color=GREY)
    return figure
