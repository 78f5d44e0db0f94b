"""The matrix of hard cases: axis by axis, from harmless to hopeless."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.problems.hard_scenes import (
    apart,
    blocks,
    box,
    contrast,
    cubes,
    halves,
    joined,
    patches,
    slices,
    sliver,
)

ROUNDING = str(Path(__file__).resolve().parents[1] / "kit" / "rounding_solver.py")
HELD = {"on": {"plane": "x", "at": 0.0}, "displacement": [0, 0, 0]}
PULL = {"on": {"plane": "x", "at": 4.0}, "traction": [10.0, 0.0, 10.0]}
PRESS, SLIDE = [0, 0, -0.002], [0.002, 0, -0.002]
BEFORE = {"sole": {"kind": "symmetric"}, "macro": {"basis": "affine"}}


@dataclass(frozen=True)
class Hard:
    """One hard case.

    Parameters
    ----------
    axis, value : what is hard, and how much
    config : plain data
    meaningful : whether it is a well-posed problem of mechanics, solved with settings that one may choose
    """

    axis: str
    value: str
    config: Mapping[str, Any]
    meaningful: bool = True


def hard_cases(folder: Path) -> Iterator[Hard]:
    """All of them; meshes are written to a folder."""
    yield from _settings()
    yield from _matter(folder)
    yield from _shape(folder)
    yield from _topology(folder)
    yield from _scale()
    yield from _contact(folder)


def _settings() -> Iterator[Hard]:
    for power in (-8, -6, -4, -3, -2, -1, 0, 1, 2, 4, 6, 8):
        sole = {"modulus_ratio": 10.0**power, "allow_extreme": True}
        yield Hard("sole modulus / E", f"1e{power}", slices(method={"sole": sole}), abs(power) < 3)
    yield Hard("sole modulus / E", "1e-8, not allowed", slices(method={"sole": {"modulus_ratio": 1e-8}}), False)
    for digits in (6, 8, 17):
        for error in (1e-4, 1e-6):
            made = slices(blackbox={"code": ROUNDING, "options": {"digits": digits}},
                          method={"tolerance": {"error": error}, "max_iterations": 60})
            # strains are differences of displacements: three digits are lost
            yield Hard("digits of traces", f"{digits}, tolerance {error:g}", made, 1e3 * 10.0**-digits < error)
    yield Hard("tolerance", "1e-10", slices(method={"tolerance": {"error": 1e-10}}))
    yield Hard("tolerance", "1e-14, below rounding", slices(method={"tolerance": {"error": 1e-14}}), False)


def _matter(folder: Path) -> Iterator[Hard]:
    for element, ratios in (("P1", (0.0, 0.45, 0.49, 0.499, 0.4999)), ("P2", (0.49, 0.4999))):
        for nu in ratios:
            made = cubes(materials=[{"young": 200e3, "poisson": nu}], blackbox={"element": element})
            if element == "P2":
                made["mesh"] = {"box": {"size": [2.0, 2.0, 2.0], "cells": [4, 4, 4]}}
            yield Hard("Poisson's ratio", f"{nu:g}, {element}", made)
    yield Hard("Poisson's ratio", "0.5", cubes(materials=[{"young": 200e3, "poisson": 0.5}]), False)
    for pattern, ratios in (("across", (1e2, 1e4, 1e6, 1e8)), ("layers", (1e3, 1e6)), ("checkerboard", (1e3, 1e6)),
                            ("random bricks", (1e3, 1e6)), ("random tets", (1e1, 1e3, 1e6, 1e8))):
        for ratio in ratios:
            yield Hard("contrast", f"{pattern}, {ratio:g}", contrast(folder, pattern, ratio))


def _shape(folder: Path) -> Iterator[Hard]:
    for aspect in (10, 30, 100):
        yield Hard("aspect ratio", f"flat, {aspect}", box([2, 2, 2 / aspect], [8, 8, 8], [2, 2, 2]))
        yield Hard("aspect ratio", f"slender, {aspect}", box([2, 2 / aspect, 2 / aspect], [8, 8, 8], [2, 2, 2]))
    yield Hard("aspect ratio", "long bars, 30", box([15, 1, 1], [60, 4, 4], [1, 2, 2]))
    for angle in (10, 3, 1, 0.5):
        yield Hard("dihedral angle", f"{angle:g}°", sliver(folder, angle))


def _topology(folder: Path) -> Iterator[Hard]:
    yield Hard("subdomains", "one", {**slices(), "subdomains": {"grid": [1, 1, 1]}})
    row = {"slices": {"axis": "x", "count": 12}}
    yield Hard("subdomains", "floating, 12 in a row", {**slices(), "subdomains": row})
    yield Hard("subdomains", "metis 9", {**cubes(), "subdomains": {"metis": 9}})
    for nodes in (3, 2, 1):
        yield Hard("interface nodes", f"{nodes}", joined(folder, nodes), nodes == 3)
    yield Hard("interface", "two patches", patches(folder))
    yield Hard("mechanism", "nothing held", {**slices(), "boundary": [PULL]}, False)
    slip = {"on": {"plane": "x", "at": 0.0}, "displacement": [0, None, None]}
    yield Hard("mechanism", "held along x alone", {**slices(), "boundary": [slip, PULL]}, False)
    yield Hard("mechanism", "hinge of one triangle", _hinge(), True)
    for distance in (1e-12, 1e-9, 1e-6, 1e-3):
        made = {**blocks([PRESS]), "mesh": apart(folder, distance), "subdomains": "groups",
                "boundary": [{"on": {"plane": "z", "at": 0.0}, "displacement": [0, 0, 0]},
                             {"on": {"box": [[-1, -1, 0.99], [2, 2, 2]]}, "displacement": PRESS}],
                "interfaces": [{"law": "contact", "friction": 0.3, "gap": "geometry"}]}
        yield Hard("planes apart", f"{distance:g}, contact", made)
    pulled = [made["boundary"][0], {"on": made["boundary"][1]["on"], "traction": [0, 0, -1.0]}]
    yield Hard("planes apart", "0.001, bonded", {**made, "boundary": pulled, "interfaces": [{"law": "perfect"}]}, False)


def _hinge() -> dict[str, Any]:
    corner = {"on": {"box": [[-0.1, -0.1, -0.1], [0.1, 0.4, 0.4]]}, "displacement": [0, 0, 0]}
    return {**slices(), "boundary": [corner, PULL]}


def _scale() -> Iterator[Hard]:
    for unit, factor in (("m", 1e-3), ("mm", 1.0), ("µm", 1e3)):
        made = slices(materials=[{"young": 200e3 / factor**2, "poisson": 0.3}])
        made["mesh"] = {**made["mesh"], "scale": factor}
        made["boundary"] = [HELD, {"on": {"plane": "x", "at": 4.0 * factor}, "traction": [10.0 / factor**2, 0, 0]}]
        yield Hard("units", unit, made)
    for power in (-3, 0, 9, 15):
        yield Hard("Young's modulus", f"1e{power}", slices(materials=[{"young": 10.0**power, "poisson": 0.3}]))
    for load in (1e-12, 1e12):
        yield Hard("load", f"{load:g}", slices(force=load))
    yield Hard("load", "none", {**slices(), "boundary": [HELD]})
    yield Hard("load", "none, prescribed motion", {**slices(), "boundary": [
        HELD, {"on": {"plane": "x", "at": 4.0}, "displacement": [0.01, 0, 0]}]})


def _contact(folder: Path) -> Iterator[Hard]:
    for ratio, cuts in ((1e3, 1), (1e3, 2), (1e3, 4), (1e6, 1), (1e6, 2)):
        yield Hard("contact, contrast", f"random bricks, {ratio:g}, {2 * cuts**2} pieces", halves(folder, ratio, cuts))
    for friction in (0.0, 0.1, 0.5, 1.0, 2.0):
        yield Hard("friction", f"{friction:g}", blocks([PRESS, SLIDE], friction=friction), friction < 1)
    for gap in (0.0, 1e-6, 1e-3, 1.0):
        yield Hard("initial gap", f"{gap:g}", blocks([PRESS, SLIDE], gap=gap))
    for depth in (1e-3, 0.05):
        yield Hard("press fit", f"{depth:g}", blocks([[0, 0, 0], SLIDE], gap=-depth))
    yield Hard("detachment", "complete", blocks([PRESS, [0, 0, 0.01], PRESS]))
    loose = {**blocks([PRESS]), "boundary": [{"on": {"plane": "z", "at": 0.0}, "displacement": [0, 0, 0]},
                                             {"on": {"plane": "z", "at": 1.0}, "traction": [0, 0, 10.0]}]}
    yield Hard("detachment", "pulled off by a force", loose, False)
    yield Hard("reversal", "slide back and forth", blocks([PRESS, SLIDE, [-0.002, 0, -0.002], SLIDE, [0, 0, -0.001]]))
    for factor in (1e-12, 1e6):
        scaled = blocks([PRESS, SLIDE], materials=[{"young": 200e3 * factor, "poisson": 0.3}])
        yield Hard("contact, Young's modulus", f"{200e3 * factor:g}", scaled)
    for nu in (0.45, 0.49):
        made = blocks([PRESS, SLIDE], materials=[{"young": 200e3, "poisson": nu}])
        yield Hard("contact, Poisson's ratio", f"{nu:g}", made)
    yield Hard("contact, zero load", "nothing moves", blocks([[0, 0, 0]]))
    soft = {"sole": {"contact_ratio": 1e-6, "allow_extreme": True}}
    yield Hard("contact, sole modulus", "× 1e-6", blocks([PRESS, SLIDE], method=soft), False)


def cured(folder: Path) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """What the affine basis and soles along the facets fail at."""
    small = {"box": {"size": [2.0, 2.0, 2.0], "cells": [4, 4, 4]}}
    rubber = {"materials": [{"young": 200e3, "poisson": 0.4999}]}
    yield "ν = 0.4999, P2", {**cubes(**rubber, blackbox={"element": "P2"}), "mesh": small}
    yield "ν = 0.4999, P1", cubes(**rubber)
    yield "flat, 30", box([3, 3, 0.1], [12, 12, 12], [3, 3, 3])
    yield "slender, 30", box([3, 0.1, 0.1], [12, 12, 12], [3, 3, 3])
    yield "long bars, 30", box([15, 1, 1], [60, 4, 4], [1, 2, 2])
    for pattern in ("random tets", "random bricks", "layers"):
        yield f"{pattern}, 1:1000", contrast(folder, pattern, 1e3)
