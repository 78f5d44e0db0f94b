"""The cubes on which solvers are compared: an easy one, three hard ones, and one that none of them likes.

All are clamped at x = 0, pulled and bent at the other end, and have as many dofs, whatever the element.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kit.meshes import bricks, centres, write
from benchmarks.problems.cases import STEEL, cube

CONTRAST = 1000.0  # of moduli, brick by brick at random
INCOMPRESSIBLE = 0.499  # Poisson's ratio
THIN = 30  # longest over shortest side
CASES = ("easy", "random", "incompressible", "thin", "squeezed")


def named(case: str, folder: Path, blocks: int, elements: int) -> dict[str, Any]:
    """A cube, as a configuration without method.

    Parameters
    ----------
    case : *easy*: steel; *random*: every brick soft or stiff by chance; *incompressible*: ten-node tets, half as many along a
        side; *thin*: a plate of compact bricks; *squeezed*: the easy cube's bricks all made flat
    folder : for the mesh that no generator makes
    blocks, elements : subdomains along the side, and bricks along the side of each
    """
    data = cube(blocks, elements)
    if case == "random":
        count = blocks * elements
        nodes, cells = bricks((blocks,) * 3, (count,) * 3)
        stiff = np.random.default_rng(0).integers(0, 2, (count,) * 3)[tuple(centres(nodes, cells, 1 / elements).T)]
        data |= {"mesh": write(folder / f"random-{blocks}-{elements}.meshb", nodes, cells, stiff), "materials": [
            {"young": 200e3 / CONTRAST, "poisson": 0.3}, {"young": 200e3, "poisson": 0.3, "on": "volume_2"}]}
    elif case == "incompressible":
        data = {**cube(blocks, max(1, elements // 2)), "materials": [{"young": 200e3, "poisson": INCOMPRESSIBLE}],
                "blackbox": {"element": "P2"}}
    elif case == "thin":
        # twice the subdomains along both long sides, one through the thickness: as many as in a cube of 4³
        side = 2 * blocks * max(1, round(1.5 * elements))
        data |= {"mesh": {"box": {"size": [THIN, THIN, 1], "cells": [side, side, max(1, round(side / THIN))]}},
                 "subdomains": {"grid": [2 * blocks, 2 * blocks, 1]}, "materials": STEEL}
        data["boundary"] = [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]},
                            {"on": {"plane": "x", "at": THIN}, "traction": [10, 0, 10]}]
    elif case == "squeezed":
        data["mesh"]["box"]["size"] = [blocks, blocks, blocks / THIN]
    return {**data, "name": f"{case}-{blocks}-{elements}", "output": {"fields": False, "figures": False}}
