"""Random scenes with contact, each drawn from its number: grids, slices, grains, blocks of different stiffness and parts meshed apart.

Bodies that nothing but contact holds are among them, gaps, press fits, friction and several load steps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

ASKED = (1e-2, 1e-3, 1e-4, 1e-5)
FRICTION = (0.0, 0.0, 0.0, 0.1, 0.3, 0.6)
CUT = 500  # iterations, after which a run has failed
YOUNG = 200e3
LITTLE = (0.01, 0.25)  # friction of blocks that are held
KINDS = ("grid", "slices", "grains", "grains", "blocks", "apart")
STACKED = ("slices", "blocks", "apart")  # faces one above the other: a press fit leaves room, and a pressure does not topple anything


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


def crowd(number: int, code: str = "freefem") -> tuple[dict[str, Any], dict[str, Any]]:
    """Grains pressed and sheared between two plates, some of which nothing but the others hold; of alike or of very different matter."""
    rng = np.random.default_rng([number, 2])
    count, friction, steps = int(rng.integers(9, 22)), float(rng.choice(FRICTION[2:])), int(rng.integers(1, 3))
    contrast, asked = float(rng.choice([1, 1, 1000])), float(rng.choice([1e-3, 1e-4]))
    path = [[*map(float, rng.uniform(-0.004, 0.004, 2)), -float(rng.uniform(0.003, 0.01))] for _ in range(steps)]
    labels = {"kind": "crowd", "friction": friction, "contrast": contrast, "steps": steps, "asked": asked}
    return {
        "name": f"crowd-{number}", "subdomains": "groups",
        "mesh": {"polycrystal": {"grains": count, "size": 1.0, "h": 0.2, "seed": int(rng.integers(1000))}},
        "materials": [{"young": YOUNG, "poisson": 0.3}] + [
            {"young": float(f"{YOUNG * contrast ** -rng.random():.4g}"), "poisson": 0.3, "on": f"grain_{k + 1}"}
            for k in range(count) if contrast > 1],
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]}, {"on": {"plane": "z", "at": 1}, "displacement": path}],
        "interfaces": [{"law": "contact", "friction": friction}], "blackbox": {"code": code},
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
