"""Scenes of contact with solutions in books: Cattaneo's and Mindlin's cylinder, NAFEMS' cylinder on a block, a die that irons a slab."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gmsh
import numpy as np

from benchmarks.kit.meshes import session

sys.path.append(str(Path(__file__).parents[2] / "meshes"))
from hertz import LENGTH, cylinder_on_block, write  # noqa: E402

YOUNG, POISSON, FRICTION = 200e3, 0.3, 0.3
PRESS, PUSH, LOADS = 0.002, 7e-4, 4
FINE = 0.005  # elements where the cylinder touches


def cylinder_pushed(folder: Path) -> dict[str, Any]:
    """A cylinder and a block of the same matter in plane strain, pressed, then pushed sideways, back, and forth again.

    Steps go by a quarter of the push at first, by a half afterwards: a branch is twice the first one, stretched by two (Masing).
    """
    write(folder / "pushed.msh", cylinder_on_block(FINE))
    step = PUSH / LOADS
    way = [0.0, *(k * step for k in range(1, LOADS + 1)), *(PUSH - 2 * k * step for k in range(1, LOADS + 1)),
           *(2 * k * step - PUSH for k in range(1, LOADS + 1))]
    boundary = [{"on": {"plane": "y", "at": y}, "displacement": [None, 0, None]} for y in (0.0, 2 * FINE)]
    boundary += [{"on": {"plane": "z", "at": -LENGTH}, "displacement": [0, None, 0]},
                 {"on": {"plane": "z", "at": LENGTH}, "displacement": [[x, None, -PRESS] for x in way]}]
    return {"name": "pushed", "mesh": {"file": str(folder / "pushed.msh")}, "subdomains": "groups", "boundary": boundary,
            "materials": [{"young": YOUNG, "poisson": POISSON}],
            "interfaces": [{"law": "contact", "friction": FRICTION, "gap": "geometry", "within": 0.02}]}


def pushed(x: np.ndarray, a: float, share: float, before: float | None = None) -> np.ndarray:
    """Friction over μ p₀ at points (n,) of a contact of half-width a under ``share`` of μ times the force that presses.

    before : the share from which it has come back; None: it has been pushed for the first time (Mindlin & Deresiewicz 1953)
    """
    def full(width: float) -> np.ndarray:
        return np.sqrt(np.maximum(width**2 - x**2, 0)) / a

    if before is None:
        return full(a) - full(a * np.sqrt(1 - share))
    return pushed(x, a, before) - 2 * pushed(x, a, (before - share) / 2)


FORCE, LARGE, DEEP = 35e3, 50.0, 100.0  # N per mm, the cylinder's radius, the block's height, mm
STEEL, ALUMINIUM = 210e3, 70e3


def nafems_cylinder(folder: Path, size: float = 0.8) -> dict[str, Any]:
    """Half a cylinder of steel on half a block of aluminium, a slice of them in plane strain; the upper half of the cylinder is left out,
    its force is spread over the cut. Meshed apart.

    size : of the elements where they touch
    """
    for name in ("cylinder", "block"):
        with session():
            occ = gmsh.model.occ
            if name == "cylinder":
                face = occ.intersect([(2, occ.addDisk(0, LARGE, 0, LARGE, LARGE))], [(2, occ.addRectangle(0, 0, 0, LARGE, LARGE))])[0]
            else:
                face = [(2, occ.addRectangle(0, -DEEP, 0, DEEP, DEEP))]
            bodies = occ.extrude(face, 0, 0, 2 * size, numElements=[2])
            occ.synchronize()
            gmsh.model.addPhysicalGroup(3, [tag for dimension, tag in bodies if dimension == 3], name=name)
            near = gmsh.model.mesh.field.add("Ball")
            for key, value in (("Radius", 9.0), ("VIn", size), ("VOut", LARGE / 6), ("Thickness", LARGE)):
                gmsh.model.mesh.field.setNumber(near, key, value)
            gmsh.model.mesh.field.setAsBackgroundMesh(near)
            gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
            gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
            gmsh.model.mesh.generate(3)
            gmsh.write(str(folder / f"{name}.msh"))
    held: list[dict[str, Any]] = [{"on": {"plane": "z", "at": z}, "displacement": [None, None, 0]} for z in (0, 2 * size)]
    held += [{"on": {"plane": "x", "at": 0}, "displacement": [0, None, None]},
             {"on": {"plane": "y", "at": -DEEP}, "displacement": [None, 0, None]},
             {"on": {"plane": "y", "at": LARGE}, "traction": [0, -FORCE / 2 / LARGE, 0]}]
    return {"name": "nafems", "parts": [{"name": name, "mesh": {"file": str(folder / f"{name}.msh")}} for name in ("cylinder", "block")],
            "subdomains": "groups", "boundary": held,
            "materials": [{"young": STEEL, "poisson": 0.3, "on": ["cylinder"]}, {"young": ALUMINIUM, "poisson": 0.3, "on": ["block"]}],
            "interfaces": [{"between": "auto", "law": "contact", "friction": 0.0, "within": 1.0}]}


def hertz_line(force: float, radius: float, *moduli: float) -> tuple[float, float]:
    """Half-width and largest pressure of a cylinder on a plane, ν = 0.3 (Hertz)."""
    stiff = 1 / sum((1 - 0.3**2) / young for young in moduli)
    a = np.sqrt(4 * force * radius / (np.pi * stiff))
    return float(a), float(2 * force / (np.pi * a))


IRON = 0.3  # friction of the die
WAY = (0.0, 0.0, 0.3, 0.6, 0.9, 1.2, 1.5, 1.8, 2.1, 2.4)  # of the die, per load step


def ironing(size: float = 0.1, pairing: str = "follow") -> dict[str, Any]:
    """A die, edges of 1, pressed on a slab ten times as soft, dragged along it over many elements, in plane strain.

    size : of the slab's elements
    """
    depth = 2 * size  # two elements: nodes between the faces that are held carry the pressures
    held = [{"on": f"{part}/{end}", "displacement": [None, 0, None]} for part in ("slab", "die") for end in ("ymin", "ymax")]
    return {"name": "ironing", "subdomains": "groups",
            "parts": [{"name": "slab", "mesh": {"box": {"size": [6, depth, 1], "cells": [round(6 / size), 2, round(1 / size)]}}},
                      {"name": "die", "mesh": {"box": {"size": [1, depth, 0.5], "cells": [7, 2, 4]}}, "move": {"translate": [1.5, 0, 1]}}],
            "materials": [{"young": 1e3, "poisson": 0.3, "on": ["slab"]}, {"young": 1e4, "poisson": 0.3, "on": ["die"]}],
            "interfaces": [{"between": ["slab", "die"], "law": "contact", "friction": IRON, "pairing": pairing}],
            "boundary": [*held, {"on": "slab/zmin", "displacement": [0, None, 0]},
                         {"on": "die/zmax", "displacement": [[x, None, -0.02 if k else -0.01] for k, x in enumerate(WAY)]}]}


def middle(values: Sequence[float]) -> np.ndarray:
    """Of the load steps, those in which the die is dragged on."""
    return np.asarray(values)[3:]
