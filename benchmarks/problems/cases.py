"""The problems and the settings that studies combine, as plain data for ``config_from``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from orchestrator import Config

STEEL = [{"young": 200e3, "poisson": 0.3}]  # N, mm
SLICES = (8, 16, 32, 64, 128)
CUT = 70  # iterations the paper's figures show
COMPRESSED = [[0, 0, -0.005], [0, 0, -0.01], [0, 0, -0.005], [0, 0, -0.001]]  # of the top of a cube of side 1
GRAINS, GRAIN_H = 100, 0.018  # the paper's polycrystal: grains, and the element size of its 565,000 dofs
CONTACT_RATIO = Config.model_fields["method"].get_default(call_default_factory=True).sole.contact_ratio
NEVER = {"indicator": 1e-30}  # a tolerance that only rounding meets: the number of iterations decides


def beam(slices: int) -> dict[str, Any]:
    """The paper's beam, table 1: clamped at one end, pulled at the other."""
    return {
        "name": f"beam-{slices}",
        "mesh": {"beam": {"size": [160, 10, 10], "h": 1.25}},
        "subdomains": {"slices": {"axis": "x", "count": slices}},
        "materials": STEEL,
        "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "x", "at": 160}, "traction": [10, 0, 0]}],
    }


def cube(count: int, elements: int = 4) -> dict[str, Any]:
    """count³ unit cubes with ``elements`` elements a side, clamped at x = 0, pulled and bent at the other end."""
    return {
        "name": f"cubes-{count}",
        "mesh": {"box": {"size": [count] * 3, "cells": [elements * count] * 3}},
        "subdomains": {"grid": [count] * 3},
        "materials": STEEL,
        "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "x", "at": count}, "traction": [10, 0, 10]}],
    }


def assembly() -> dict[str, Any]:
    """gmsh's example of a bolted assembly, every part bonded: the plate clamped at its base, the rod pulled."""
    return {
        "name": "assembly",
        "mesh": {"step": "gmsh:as1-tu-203.stp", "h": 4.0},
        "subdomains": "groups",
        "materials": STEEL,
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "x", "at": 190}, "traction": [10, 0, 0]}],
    }


def pressed_cubes(friction: float, count: int = 3, elements: int = 4) -> dict[str, Any]:
    """count³ unit cubes in contact: compressed, sheared, partly unloaded; no cube comes loose."""
    return {
        "name": f"pressed-cubes-{count}",
        "mesh": {"box": {"size": [count] * 3, "cells": [elements * count] * 3}},
        "subdomains": {"grid": [count] * 3},
        "materials": STEEL,
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": count}, "displacement": [
                         [0, 0, -0.01], [0, 0, -0.02], [0.01, 0, -0.02], [0.02, 0.01, -0.02], [0.01, 0.01, -0.015],
                         [0.01, 0, -0.01]]}],
        "interfaces": [{"law": "contact", "friction": friction}],
    }


def bolted_apart() -> dict[str, Any]:
    """A pad clamped between two plates by two posts that are bolts, all meshed apart: tightened one by one, then sheared to and fro."""
    def box(name: str, size: list[float], cells: list[int], move: list[float]) -> dict[str, Any]:
        return {"name": name, "mesh": {"box": {"size": size, "cells": cells}}, "move": {"translate": move}}

    return {
        "name": "bolted-apart",
        "parts": [box("base", [4, 2, 1], [9, 5, 3], [0, 0, 0]), box("pad", [1, 1.8, 2], [4, 7, 5], [1.5, 0.1, 1]),
                  box("cap", [4, 2, 1], [11, 7, 3], [0, 0, 3]),
                  *(box(f"post_{k}", [0.6, 0.6, 2], [3, 3, 6], [x, 0.7, 1]) for k, x in enumerate((0.4, 3.0), 1))],
        "subdomains": "groups",
        "materials": STEEL,
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "y", "at": 1.9}, "traction": [30, 0, 0], "history": "shear"}],
        "bolts": [{"on": f"post_{k}", "cut": {"plane": "z", "at": 2.05}, "force": 400, "history": history}
                  for k, history in enumerate(("first", "second"), 1)],
        "histories": {"first": [1, 1, 1, 1], "second": [0, 1, 1, 1], "shear": [0, 0, 1, -1]},
        "interfaces": [{"between": ["pad", plate], "law": "contact", "friction": 0.3} for plate in ("base", "cap")]
        + [{"between": ["post_*", plate], "law": "perfect"} for plate in ("base", "cap")],
    }


def grains(count: int, h: float, friction: float = 0.1, path: Sequence[Sequence[float]] = COMPRESSED, **more: int) -> dict[str, Any]:
    """The paper's polycrystal: a unit cube of grains in contact, its bottom clamped.

    Parameters
    ----------
    path : motion of the top, a vector per load step; the paper compresses further, then unloads in two steps
    more : seed and lloyd of the mesh
    """
    return {
        "name": "-".join(["grains", str(count), *(f"{key}-{value}" for key, value in more.items())]),
        "mesh": {"polycrystal": {"grains": count, "size": 1.0, "h": h, **more}},
        "subdomains": "groups",
        "materials": STEEL,
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 1}, "displacement": list(map(list, path))}],
        "interfaces": [{"law": "contact", "friction": friction}],
    }


def paper(strategy: str, *, kplus: str = "full", relaxation: float = 0.8, modulus_ratio: float = 0.008,
          iterations: int = CUT) -> dict[str, Any]:
    """The paper's method: a soft one-sided layer one element thick, relaxed fixed point, no acceleration."""
    return {
        "sole": {"kind": "layer", "modulus_ratio": modulus_ratio, "thickness": 1.25, "allow_extreme": True},
        "macro": {"strategy": strategy}, "search_direction": {"kplus": kplus},
        "acceleration": "none", "relaxation": relaxation, "tolerance": NEVER, "max_iterations": iterations,
    }


def defaults(strategy: str = "equilibrium", *, modulus_ratio: float | None = None, error: float | None = 1e-6,
             iterations: int = 200) -> dict[str, Any]:
    """This program's defaults, but for what is given.

    Parameters
    ----------
    error : tolerance of the error bound; None iterates to the last iteration
    """
    method: dict[str, Any] = {"macro": {"strategy": strategy}, "max_iterations": iterations,
                              "tolerance": NEVER if error is None else {"error": error}}
    if modulus_ratio is not None:
        method["sole"] = {"modulus_ratio": modulus_ratio, "allow_extreme": True}
    return method


def paper_contact(strategy: str = "equilibrium", *, kind: str = "layer", ratio: float = 1.0, relaxation: float = 0.5,
                  iterations: int = CUT) -> dict[str, Any]:
    """The paper's method with contact: the relaxed fixed point with a linear macro problem on all interfaces.

    Parameters
    ----------
    kind, ratio : of the soles; a layer has a diagonal k⁺, for which the fixed point needs relaxation 0.5
    """
    return {
        "sole": {"contact": kind, "contact_ratio": ratio, "allow_extreme": True},
        "macro": {"strategy": strategy, "on": "all"}, "coarse": "none", "contact": {"stabilisation": 0},
        "acceleration": "none", "relaxation": relaxation, "tolerance": {"law": 1e-9}, "max_iterations": iterations,
    }


def contact_defaults(*, factor: float = 1.0, coarse: str = "affine", law: float = 1e-9,
                     iterations: int = 500) -> dict[str, Any]:
    """This program's defaults with contact, but for what is given.

    Parameters
    ----------
    factor : on the soles' modulus
    coarse : "none" leaves Anderson's acceleration alone
    law : tolerance of the law residual; rounding leaves an energy error of about 5e-9, a root of what it leaves of gaps
    """
    method: dict[str, Any] = {"coarse": coarse, "tolerance": {"law": law}, "max_iterations": iterations}
    if factor != 1:
        method["sole"] = {"contact_ratio": factor * CONTACT_RATIO, "allow_extreme": True}
    return method


def with_method(problem: Mapping[str, Any], method: Mapping[str, Any]) -> dict[str, Any]:
    """A problem and how to solve it, as one configuration."""
    return {**problem, "method": dict(method)}
