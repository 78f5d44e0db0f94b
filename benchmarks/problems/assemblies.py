"""Assemblies of parts meshed each on its own: a bolted flange, a ring shrunk on a shaft, a ball on a block, a bolt in a bore,
blocks on each other."""

from __future__ import annotations

from math import cos, pi, sin
from pathlib import Path
from typing import Any

import gmsh
import numpy as np

from benchmarks.kit.meshes import session
from benchmarks.problems.cases import STEEL

# --- bolted flange: solid_1 the lower flange, solid_2 the upper one, then bolt and nut four times; N and mm ------------

BOLTS, CIRCLE, SHANK, HOLE, HEAD = 4, 35.0, 4.0, 5.0, 8.0
OUTSIDE, NECK, BORE, THICKNESS, HEIGHT = 50.0, 25.0, 20.0, 10.0, 30.0
PAIRS = 1 + 3 * BOLTS  # flange on flange; head on flange, nut on flange, bolt in nut


def flange_model(folder: Path) -> str:
    """Two flanges with necks, bolts with room in their holes, nuts that fit them: written as a BREP file."""
    path = str(folder / "flange.brep")
    with session():
        occ = gmsh.model.occ
        places = [(CIRCLE * cos(2 * pi * i / BOLTS + 0.3), CIRCLE * sin(2 * pi * i / BOLTS + 0.3)) for i in range(BOLTS)]
        for up in (-1, 1):
            plate = [(3, occ.addCylinder(0, 0, 0, 0, 0, up * THICKNESS, OUTSIDE))]
            neck = [(3, occ.addCylinder(0, 0, up * THICKNESS, 0, 0, up * (HEIGHT - THICKNESS), NECK))]
            holes = [(3, occ.addCylinder(x, y, -HEIGHT, 0, 0, 2 * HEIGHT, HOLE)) for x, y in places]
            occ.cut(occ.fuse(plate, neck)[0], [*holes, (3, occ.addCylinder(0, 0, -HEIGHT, 0, 0, 2 * HEIGHT, BORE))])
        for x, y in places:
            low = -THICKNESS - 6
            occ.fuse([(3, occ.addCylinder(x, y, low, 0, 0, THICKNESS - low, SHANK))],
                     [(3, occ.addCylinder(x, y, THICKNESS, 0, 0, 5, HEAD))])
            occ.cut([(3, occ.addCylinder(x, y, low, 0, 0, 6, HEAD))], [(3, occ.addCylinder(x, y, low, 0, 0, 6, SHANK))])
        occ.synchronize()
        gmsh.write(path)
    return path


def flange(folder: Path, mesh: dict[str, Any], bonded: bool) -> dict[str, Any]:
    """The flange, held at the lower neck and pulled at the upper one; in contact its nuts are tightened by 20 µm first.

    Parameters
    ----------
    mesh : h, and whether solids share their faces
    """
    bolts = [(f"solid_{3 + 2 * i}", f"solid_{4 + 2 * i}") for i in range(BOLTS)]
    contact = [{"between": "auto", "law": "contact", "friction": 0.15},
               *({"between": list(pair), "law": "perfect"} for pair in bolts),
               *({"between": [nut, "solid_1"], "law": "contact", "friction": 0.15, "gap": -0.02} for _, nut in bolts)]
    return {
        "name": "flange", "mesh": {"step": flange_model(folder), **mesh}, "subdomains": "groups", "materials": STEEL,
        "interfaces": [{"between": "auto", "law": "perfect"}] if bonded else contact,
        "boundary": [{"on": {"plane": "z", "at": -HEIGHT}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": HEIGHT}, "traction": [0, 2, 10], **({} if bonded else {"history": "pull"})}],
        **({} if bonded else {"histories": {"pull": [0.0, 1.0]}}),
    }


# --- a thick ring shrunk on a shaft, a quarter, in plane strain: Lamé ---------------------------------------------------

INNER, OUTER, DEPTH, PRESS = 1.0, 2.0, 0.25, 1e-3
SECTORS = 8  # a little more than an element of .16 each


def shrunk_ring(folder: Path, sizes: tuple[float, float], element: str) -> dict[str, Any]:
    """Parts ``shaft`` and ``ring`` of the same matter, pressed together by ``PRESS`` of the radius.

    Parameters
    ----------
    sizes : element sizes of shaft and ring
    """
    for name in ("shaft", "ring"):
        with session():
            occ = gmsh.model.occ
            whole = [(3, occ.addCylinder(0, 0, 0, 0, 0, DEPTH, INNER if name == "shaft" else OUTER))]
            if name == "ring":
                whole = occ.cut(whole, [(3, occ.addCylinder(0, 0, 0, 0, 0, DEPTH, INNER))])[0]
            occ.intersect(whole, [(3, occ.addBox(0, 0, 0, OUTER, OUTER, DEPTH))])
            occ.synchronize()
            gmsh.write(str(folder / f"{name}.brep"))
    held = [("x", 0.0, [0, None, None]), ("y", 0.0, [None, 0, None]), ("z", 0.0, [None, None, 0]), ("z", DEPTH, [None, None, 0])]
    return {
        "name": "shrunk_ring", "subdomains": "groups", "materials": STEEL, "blackbox": {"element": element},
        "parts": [{"name": name, "mesh": {"step": str(folder / f"{name}.brep")}, "h": h}
                  for name, h in zip(("shaft", "ring"), sizes)],
        "interfaces": [{"between": "auto", "law": "contact", "gap": -PRESS}],
        "boundary": [{"on": {"plane": axis, "at": at}, "displacement": vector} for axis, at, vector in held],
    }


def conforming_ring(folder: Path, size: float, element: str) -> dict[str, Any]:
    """The same as two solids of one mesh, whose faces match."""
    problem, path = shrunk_ring(folder, (size, size), element), str(folder / "both.brep")
    with session():
        for part in problem.pop("parts"):
            gmsh.model.occ.importShapes(part["mesh"]["step"])
        gmsh.model.occ.synchronize()
        gmsh.write(path)
    return {**problem, "mesh": {"step": path, "h": size}}


def through_depth(x: np.ndarray, area: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    """Return means (``SECTORS``,) of pressures (n,) at x (n, 3), in sectors of the quarter.

    Nodal forces of coarse meshes scatter, those of Lamé's own displacements too.
    """
    angle = np.arctan2(x[:, 1], x[:, 0]) / (pi / 2)
    at = np.clip((SECTORS * angle).astype(int), 0, SECTORS - 1)
    force, total = (np.bincount(at, w, SECTORS) for w in (area * pressure, area))
    return force / total


def lame_pressure() -> float:
    """Of the shrunk ring, exactly: the press fit over what shaft and ring give way under unit pressure."""
    young, poisson = STEEL[0]["young"], STEEL[0]["poisson"]
    shape = 1 - 2 * poisson
    squares = INNER**2, OUTER**2
    return PRESS * young / ((1 + poisson) * INNER * (shape + (shape * squares[0] + squares[1]) / (squares[1] - squares[0])))


def lame_displacement(radius: Any) -> Any:
    """Outward displacement in the ring at radii, exactly."""
    young, poisson = STEEL[0]["young"], STEEL[0]["poisson"]
    size = (1 + poisson) / young * lame_pressure() * INNER**2 / (OUTER**2 - INNER**2)
    return size * ((1 - 2 * poisson) * radius + OUTER**2 / radius)


def lame_stress(radius: Any) -> tuple[Any, Any]:
    """Radial and hoop stress in the ring at radii, exactly."""
    size = lame_pressure() * INNER**2 / (OUTER**2 - INNER**2)
    return size * (1 - OUTER**2 / radius**2), size * (1 + OUTER**2 / radius**2)


# --- a bolt in a bore without clearance, turned and pulled there and back ------------------------------------------------

SIDEWAYS = [[0.004, 0, 0], [0.01, 0.002, -0.004], [-0.006, 0, 0.004], [0.004, 0, 0]]


def bolt_in_bore(folder: Path, sizes: tuple[float, float], friction: float) -> dict[str, Any]:
    """Parts ``bolt`` and ``plate``; the plate is held at two sides, the bolt's end moved there and back.

    Parameters
    ----------
    sizes : element sizes of bolt and plate
    """
    for name in ("bolt", "plate"):
        with session():
            occ = gmsh.model.occ
            bolt = [(3, occ.addCylinder(0, 0, 0, 0, 0, 1.4 if name == "bolt" else 1.0, 1.0))]
            if name == "plate":
                occ.cut([(3, occ.addBox(-2, -2, 0, 4, 4, 1))], bolt)
            occ.synchronize()
            gmsh.write(str(folder / f"{name}.brep"))
    return {
        "name": "bolt_in_bore", "subdomains": "groups", "materials": STEEL,
        "parts": [{"name": name, "mesh": {"step": str(folder / f"{name}.brep")}, "h": h} for name, h in zip(("bolt", "plate"), sizes)],
        "interfaces": [{"between": "auto", "law": "contact", "friction": friction}],
        "boundary": [{"on": {"plane": "x", "at": -2}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "x", "at": 2}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 1.4}, "displacement": SIDEWAYS}],
    }


# --- three blocks on each other ------------------------------------------------------------------------------------------


def stack_of_three(friction: float | None, cells: tuple[int, int, int] = (4, 3, 5)) -> dict[str, Any]:
    """Parts ``low``, ``mid`` and ``top``, bonded; with friction ``top`` slides there and back.

    Parameters
    ----------
    cells : of each along its edges
    """
    held = [{"between": ["mid", "top"], "law": "contact", "friction": friction}] if friction is not None else []
    return {
        "name": "stack_of_three", "subdomains": "groups", "materials": STEEL,
        "parts": [{"name": name, "mesh": {"box": {"size": [1, 1, 0.5], "cells": [n, n, n // 2]}}, "move": {"translate": [0, 0, 0.5 * k]}}
                  for k, (name, n) in enumerate(zip(("low", "mid", "top"), cells))],
        "interfaces": [{"law": "perfect"}, *held],
        "boundary": [{"on": "low/zmin", "displacement": [0, 0, 0]},
                     {"on": "top/zmax", "displacement": [[0, 0, -0.004], [0.003, 0, -0.004], [-0.003, 0.001, -0.004]]}],
    }


# --- a ball pressed on a block, a quarter: Hertz ------------------------------------------------------------------------

RADIUS, CONTACT = 8.0, 1.0  # of the ball; of the contact that the load is meant to give


def ball_on_block(folder: Path, sizes: tuple[float, float]) -> dict[str, Any]:
    """Parts ``ball`` and ``block``, side ``RADIUS``; pressed by a prescribed approach of the far faces.

    Parameters
    ----------
    sizes : element sizes at the contact of ball and block
    """
    for name, size in zip(("ball", "block"), sizes):
        with session():
            occ = gmsh.model.occ
            if name == "ball":
                body = occ.intersect([(3, occ.addSphere(0, 0, RADIUS, RADIUS))], [(3, occ.addBox(0, 0, 0, *3 * [RADIUS]))])[0]
            else:
                body = [(3, occ.addBox(0, 0, -RADIUS, *3 * [RADIUS]))]
            occ.synchronize()
            gmsh.model.addPhysicalGroup(3, [tag for _, tag in body], name=name)
            field = gmsh.model.mesh.field.add("Ball")
            for key, value in (("Radius", 1.4 * CONTACT), ("VIn", size), ("VOut", RADIUS / 5), ("Thickness", RADIUS)):
                gmsh.model.mesh.field.setNumber(field, key, value)
            gmsh.model.mesh.field.setAsBackgroundMesh(field)
            gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
            gmsh.model.mesh.generate(3)
            gmsh.option.setNumber("Mesh.Binary", 1)
            gmsh.write(str(folder / f"{name}.msh"))
    return {
        "name": "ball_on_block", "subdomains": "groups", "materials": STEEL,
        "parts": [{"name": name, "mesh": {"file": str(folder / f"{name}.msh")}} for name in ("ball", "block")],
        "interfaces": [{"between": "auto", "law": "contact", "within": (1.4 * CONTACT) ** 2 / (2 * RADIUS)}],
        "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, None, None]},
                     {"on": {"plane": "y", "at": 0}, "displacement": [None, 0, None]},
                     {"on": {"plane": "z", "at": -RADIUS}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": RADIUS}, "displacement": [None, None, -1.1 * CONTACT**2 / RADIUS]}],
    }


def hertz(force: float) -> tuple[float, float]:
    """Largest pressure and radius of the contact under a force, exactly."""
    stiff = STEEL[0]["young"] / (1 - STEEL[0]["poisson"] ** 2) / 2
    radius = (3 * force * RADIUS / (4 * stiff)) ** (1 / 3)
    return 3 * force / (2 * pi * radius**2), radius
