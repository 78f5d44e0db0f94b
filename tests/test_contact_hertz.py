"""Hertz and Cattaneo–Mindlin: a cylinder on a block of the same matter, nodes opposite each other, gaps from the geometry.

With F the force per length, 1/E* = 2 (1 − ν²)/E and R the radius,

    a = √(4 F R / (π E*)),   p(x) = p₀ √(1 − x²/a²),   p₀ = 2 F / (π a)

and under a tangential force Q < μF the strip |x| < c = a √(1 − Q/(μF)) sticks:

    q(x) = μ p₀ (√(1 − x²/a²) − c/a √(1 − x²/c²))

(Johnson, Contact Mechanics, sections 4.2 and 7.2). Bodies 22 times as large as a stand for half-spaces.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from contact_case import contact, contacts, converged

sys.path.append(str(Path(__file__).parents[1] / "meshes"))
from hertz import LENGTH, RADIUS, cylinder_on_block, write

from orchestrator.laws.contact import SLIP, STICK

YOUNG, POISSON = 200e3, 0.3
EFFECTIVE = YOUNG / (2 * (1 - POISSON**2))
PRESS, FRICTION = 0.002, 0.3
TOP, BOTTOM = {"plane": "z", "at": LENGTH}, {"plane": "z", "at": -LENGTH}


def solved(folder, h, path, *, half, friction=0.0):
    """Plane strain: both faces of the slice keep their y; the upper side of the cylinder follows a path."""
    write(folder / f"{h}.msh", cylinder_on_block(h, half=half))
    boundary = [{"on": {"plane": "y", "at": y}, "displacement": [None, 0, None]} for y in (0.0, 2 * h)]
    boundary += [{"on": {"plane": "x", "at": 0.0}, "displacement": [0, None, None]}] if half else []
    boundary += [{"on": BOTTOM, "displacement": [None if half else 0, None, 0]}, {"on": TOP, "displacement": path}]
    law = {"law": "contact", "friction": friction, "gap": "geometry", "within": 0.02}
    return converged(contact(error=1e-6, law=[law], mesh={"file": str(folder / f"{h}.msh")}, subdomains="groups",
                             materials=[{"young": YOUNG, "poisson": POISSON}], boundary=boundary,
                             blackbox={"workers": 2}))


def lines(c, values):
    """x of the lines of nodes along y, and the mean (T, lines) of nodal values (T, P) on them, weighted by area."""
    x, line = np.unique(np.round(c.points[:, 0], 9), return_inverse=True)
    total = np.stack([np.bincount(line, row * c.area) for row in values])
    return x, total / np.bincount(line, c.area)


def hertz(force):
    """a and p₀ of a force per length."""
    a = np.sqrt(4 * force * RADIUS / (np.pi * EFFECTIVE))
    return a, 2 * force / (np.pi * a)


@pytest.mark.long
def test_cattaneo_mindlin(tmp_path):
    """Pressed, then pushed sideways below the threshold: the middle sticks, the rest slips, by the closed form."""
    h, push = 0.005, [4e-4, 7e-4]
    path = [[0, None, -PRESS]] + [[u, None, -PRESS] for u in push]
    one = solved(tmp_path, h, path, half=False, friction=FRICTION)
    c = contacts(one)
    force = np.array(one.summary["reactions"])[-1] / (2 * h)  # of the cylinder's upper side
    a, p0 = hertz(-force[0, 2])
    x, status = lines(c, (c.status == STICK).astype(float))
    shear = lines(c, c.shear[:, :, 0])[1]
    assert np.abs(shear[0])[np.abs(x) < 0.9 * a].max() < 0.03 * FRICTION * p0, "equal matter: pressing alone hardly shears"
    for t in (1, 2):
        share = force[t, 0] / (FRICTION * -force[t, 2])
        a, p0 = hertz(-force[t, 2])
        stick = a * np.sqrt(1 - share)
        inside = np.abs(x[status[t] > 0.5]).max()
        print(f"\nQ/(μF) = {share:.3f}: c/a = {stick / a:.3f}, found {inside / a:.3f} to {(inside + h) / a:.3f}, h/a = {h / a:.3f}")
        assert 0.2 < share < 0.95 and inside - 0.5 * h <= stick <= inside + 1.5 * h
        assert np.all(status[t][np.abs(x) < inside - h / 2] > 0.99), "one strip"
        exact = FRICTION * p0 * (np.sqrt(np.maximum(1 - (x / a) ** 2, 0))
                                 - stick / a * np.sqrt(np.maximum(1 - (x / stick) ** 2, 0)))
        off = np.abs(np.abs(shear[t]) - exact) / (FRICTION * p0)
        print(f"friction traction over μp₀: off by {off[np.abs(x) < a].mean():.4f} on average, {off.max():.3f} at most")
        assert off[np.abs(x) < a].mean() < 0.03
        sliding = (c.status[t] == SLIP) & (c.pressure[t] > 1e-3 * p0)
        assert np.linalg.norm(c.shear[t], axis=1)[sliding] == pytest.approx(FRICTION * c.pressure[t][sliding], rel=1e-3)
