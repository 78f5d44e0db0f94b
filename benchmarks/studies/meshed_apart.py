"""Parts meshed each on its own, their pairs found: beside conforming meshes, and beside Lamé and Hertz."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kit.drawing import BLUE, GREY, ORANGE, panels
from benchmarks.kit.study import Case, Study
from benchmarks.problems import assemblies
from benchmarks.problems.cases import STEEL
from orchestrator import Solution, build_scene, config_from, solve

AS1, AS1_SIZE, FLANGE_SIZE = "gmsh:as1-tu-203.stp", 5, 4
GRIPPED_SIZES = 5.0, 3.5
# Solids at sizes of their own, beside those of the same size as the conforming mesh.
AS1_SIZES, FLANGE_SIZES = {"*": 7, "bolt*": 4, "nut*": 3, "rod": 4}, {"*": 3, "solid_[12]": 5}
NEAR, TIGHT = 0.02, 0.01  # of displacements and resultants beside conforming meshes; of Lamé's solution
HERTZ_PRESSURE, ACROSS = 0.03, 8  # of Hertz' pressure; elements across the radius of contact
TOLERANCE = 1e-4  # of bound or law residual: a hundredth of what is compared


def run(study: Study) -> None:
    """Pairs, bonded and tightened assemblies, shrink fit, ball on block."""
    study.columns = ("case", "what", "value", "expected", "difference", "iterations", "stop_reason", "seconds")
    folder = study.folder
    for case, problem, size, sizes in (("as1", lambda mesh: _pulled({"step": AS1, **mesh}), AS1_SIZE, AS1_SIZES),
                                       ("flange", lambda mesh: assemblies.flange(folder, mesh, True), FLANGE_SIZE, FLANGE_SIZES)):
        _pairs(study, case, problem, size, sizes)
        _bonded(study, case, problem, size)
    _tightened(study, folder)
    _gripped(study)
    ring = _shrunk(study, folder)
    _ball(study, folder)
    study.figure(_picture(ring))


def _row(study: Study, case: str, what: str, value: float, expected: float, most: float, aim: str, seconds: float,
         solved: Solution | None = None) -> None:
    """One comparison and its target."""
    off = abs(value / expected - 1)
    row: dict[str, Any] = {"value": value, "expected": expected, "difference": off,
                           "iterations": solved.iterations if solved else 0,
                           "stop_reason": solved.stop_reason if solved else "-", "seconds": round(seconds, 2)}
    study.add(Case({}, {"case": case, "what": what}), row, solved.history if solved else {}, f"off by {off:.2g}")
    study.target(f"{case}: {what}", aim, f"{off:.2g}", off <= most)


def _pairs(study: Study, case: str, problem: Any, size: float, sizes: dict[str, float]) -> None:
    """Pairs found between solids meshed one by one, against those that share faces in the conforming mesh."""
    def found(**keys: Any) -> tuple[set[frozenset[str]], float]:
        begin = time.perf_counter()
        made = problem(keys)
        pulled = [entry["on"] for entry in made["boundary"] if "traction" in entry]  # faces that meet no other solid
        scene = build_scene(config_from({**made, "boundary": [{"on": face, "displacement": [0, 0, 0]} for face in pulled]}))
        return ({frozenset(scene.subdomains[e].name for e in i.subdomains) for i in scene.interfaces}, time.perf_counter() - begin)

    expected, _ = found(h=size)
    for name, h in (("same size", size), ("sizes by solid", sizes)):
        got, seconds = found(h=h, conforming=False)
        missing, false = len(expected - got), len(got - expected)
        row = {"value": len(got), "expected": len(expected), "difference": missing + false, "iterations": 0, "stop_reason": "-",
               "seconds": round(seconds, 2)}
        study.add(Case({}, {"case": case, "what": f"pairs, {name}"}), row, {}, f"{missing} missing, {false} false")
        study.target(f"{case}: pairs found, {name}", f"all {len(expected)}, no false one", f"{missing} missing, {false} false",
                     got == expected)


def _pulled(mesh: dict[str, Any]) -> dict[str, Any]:
    return {"name": "as1", "mesh": mesh, "subdomains": "groups", "materials": STEEL,
            "interfaces": [{"between": "auto", "law": "perfect"}],
            "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                         {"on": {"plane": "x", "at": 190}, "traction": [10, 0, 0]}]}


def _solved(problem: dict[str, Any], error: float = TOLERANCE, **method: Any) -> tuple[Solution, float]:
    begin = time.perf_counter()
    solved = solve(config_from({**problem, "method": {"tolerance": {"error": error}, **method}}))
    return solved, time.perf_counter() - begin


def _bonded(study: Study, case: str, problem: Any, size: float) -> None:
    """Displacement of the loaded face along the load, everything bonded."""
    values = []
    for conforming in (True, False):
        solved, seconds = _solved(problem({"h": size, "conforming": conforming}))
        entry = next(e for e in solved.scene.boundary if e.kind == "traction")
        values.append(float((solved.displacement[-1, entry.nodes] @ entry.forces.amounts[-1, 0]).mean()))
    _row(study, case, "bonded: displacement under the load", values[1], values[0], NEAR, f"within {NEAR:.0%} of conforming",
         seconds, solved)


def _tightened(study: Study, folder: Path) -> None:
    """Forces between the flanges, and of the bolt that differs most, nuts tightened and the neck pulled."""
    forces = []
    for conforming in (True, False):
        solved, seconds = _solved(assemblies.flange(folder, {"h": FLANGE_SIZE, "conforming": conforming}, False), 10 * TOLERANCE)
        fields, names = solved.interfaces, [s.name for s in solved.scene.subdomains]
        found: dict[tuple[str, ...], np.ndarray] = {}
        for pair, force in zip(fields.subdomains, np.linalg.norm(fields.resultant, axis=2).T):
            key = tuple(sorted(names[e] for e in pair))
            found[key] = found.get(key, 0.0) + force
        forces.append(found)
    heads = [pair for pair in forces[0] if "solid_1" in pair and "solid_2" not in pair]
    worst = max(heads, key=lambda pair: abs(forces[1][pair][0] / forces[0][pair][0] - 1))
    for what, pairs, step in (("bolt forces, tightened, all", heads, 0), ("bolt force, tightened, the farthest off", [worst], 0),
                              ("bolt forces, pulled, all", heads, 1), ("between the flanges, pulled", [("solid_1", "solid_2")], 1)):
        own, other = (sum(f[pair][step] for pair in pairs) for f in forces)
        _row(study, "flange", what, other, own, NEAR, f"within {NEAR:.0%} of conforming", seconds, solved)


def _gripped(study: Study) -> None:
    """What the nuts of ``as1`` press with, at two sizes: both meshes tend to the same, those that share faces from near it.

    Threads are bonded and the plate's bores have room: in the conforming mesh faceted bores carry along their axis what smooth
    ones could not (105 of 1,910 N a bolt without any friction), which is no matter of the coupling.
    """
    forces = []
    for conforming in (True, False):
        for h in GRIPPED_SIZES:
            solved, seconds = _solved(_nuts({"step": AS1, "h": h, "conforming": conforming}), 10 * TOLERANCE)
            names = [s.name for s in solved.scene.subdomains]
            pressed = [all(any(word in names[e] for e in pair) for word in ("nut", "plate")) for pair in solved.interfaces.subdomains]
            forces.append(float(np.linalg.norm(solved.interfaces.resultant[0, pressed], axis=1).sum()))
    coarse, fine = GRIPPED_SIZES
    for h, own, other in zip(GRIPPED_SIZES, forces[2:], forces[:2]):
        _row(study, "as1", f"force of the nuts, h {h:g}", own, other, NEAR, f"within {NEAR:.0%} of conforming", seconds, solved)
    share = (fine / coarse) ** 2
    own, other = ((b - share * a) / (1 - share) for a, b in (forces[2:], forces[:2]))
    _row(study, "as1", "force of the nuts, extrapolated in h²", own, other, NEAR, f"within {NEAR:.0%} of conforming", seconds, solved)


def _nuts(mesh: dict[str, Any]) -> dict[str, Any]:
    """``as1`` with its nuts tightened by 5 µm."""
    slides = {"law": "contact", "friction": 0.15}
    return {"name": "as1_gripped", "mesh": mesh, "subdomains": "groups", "materials": STEEL,
            "interfaces": [{"between": "auto", **slides}, {"between": ["nut_*", "bolt_*"], "law": "perfect"},
                           {"between": ["nut_*", "rod"], "law": "perfect"}, {"between": ["nut_*", "plate"], **slides, "gap": -0.005},
                           {"between": ["bolt*", "plate"], "law": "contact", "gap": 1.0}],
            "boundary": [{"on": {"plane": "x", "at": at}, "displacement": [0, 0, 0]} for at in (0, 180)]}


def _shrunk(study: Study, folder: Path) -> tuple[np.ndarray, ...]:
    """Pressure and displacement of the shrunk ring; angle and pressure at its points are returned."""
    exact = assemblies.lame_pressure()
    solved, seconds = _solved(assemblies.shrunk_ring(folder, (0.1, 0.14), "P2"), TOLERANCE / 10)
    fields, mortar = solved.interfaces, solved.scene.interfaces[0].mortar
    pressure, area = fields.pressure[-1][mortar.points], fields.area[mortar.points]
    x = solved.scene.mesh.nodes[fields.nodes[mortar.points]]
    means = assemblies.through_depth(x, area, pressure)
    worst = means[np.abs(means - exact).argmax()]
    ring = next(s for s in solved.scene.subdomains if s.name == "ring")
    at, moved = solved.scene.mesh.nodes[ring.nodes][:, :2], solved.parts[ring.index][-1][:, :2]
    radius = np.linalg.norm(at, axis=1)
    outward = np.einsum("ni,ni->n", moved, at) / radius
    far = int(np.abs(outward / assemblies.lame_displacement(radius) - 1).argmax())
    aim = f"within {TIGHT:.0%} of Lamé"
    _row(study, "shrunk ring, P2", "mean pressure", float(area @ pressure / area.sum()), exact, TIGHT, aim, seconds, solved)
    _row(study, "shrunk ring, P2", "pressure through the depth, farthest off", float(worst),
         exact, TIGHT, aim, seconds, solved)
    _row(study, "shrunk ring, P2", "displacement of the ring farthest off", float(outward[far]),
         float(assemblies.lame_displacement(radius[far])), TIGHT, aim, seconds, solved)
    _stressed(study, solved, seconds)
    return np.degrees(np.arctan2(x[:, 1], x[:, 0])), pressure / exact


def _stressed(study: Study, solved: Solution, seconds: float) -> None:
    """Mean stress of the ring's cells: root mean square of what they are off Lamé's, and the worst, over the largest stress."""
    scene, ring = solved.scene, next(s for s in solved.scene.subdomains if s.name == "ring")
    corners = scene.mesh.nodes[scene.mesh.cells[ring.cells, :4]]
    middle, volume = corners.mean(axis=1), np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    radius = np.linalg.norm(middle[:, :2], axis=1)
    xx, yy, xy = solved.fields.stress(0)[ring.cells][:, [0, 1, 3]].T
    x, y = middle[:, :2].T / radius
    largest = float(assemblies.lame_stress(assemblies.INNER)[1])
    for name, own, exact in zip(("radial", "hoop"), (xx * x * x + yy * y * y + 2 * xy * x * y, xx * y * y + yy * x * x - 2 * xy * x * y),
                                assemblies.lame_stress(radius)):
        off = (own - exact) / largest
        rms, worst = float(np.sqrt(volume @ off**2 / volume.sum())), float(np.abs(off).max())
        _row(study, "shrunk ring, P2", f"{name} stress in the ring, off by in the mean, over the largest stress", 1 + rms, 1.0, TIGHT,
             f"within {TIGHT:.0%} of Lamé", seconds, solved)
        _row(study, "shrunk ring, P2", f"{name} stress in the ring, worst cell, over the largest stress", 1 + worst, 1.0, TIGHT,
             f"within {TIGHT:.0%} of Lamé", seconds, solved)


def _ball(study: Study, folder: Path) -> None:
    """Largest pressure, and the radius beyond which there is none, of a ball on a block."""
    size = assemblies.CONTACT / ACROSS
    for name, sizes in (("same size", (size, size)), ("block coarser", (size, 1.5 * size))):
        solved, seconds = _solved(assemblies.ball_on_block(folder, sizes))
        fields, mortar = solved.interfaces, solved.scene.interfaces[0].mortar
        pressure, area = fields.pressure[-1][mortar.points], fields.area[mortar.points]
        peak, radius = assemblies.hertz(4 * float(pressure @ area))
        x = solved.scene.mesh.nodes[fields.nodes[mortar.points]]
        touched = np.linalg.norm(x[pressure > NEAR * peak][:, :2], axis=1).max()
        _row(study, f"ball on block, {name}", "largest pressure", float(pressure.max()), peak, HERTZ_PRESSURE,
             f"within {HERTZ_PRESSURE:.0%} of Hertz", seconds, solved)
        _row(study, f"ball on block, {name}", "radius of contact", float(touched), radius, max(sizes) / radius,
             "within one element of Hertz", seconds, solved)


def _picture(ring: tuple[np.ndarray, ...]):
    """Pressure of the shrunk ring round the shaft."""
    figure, ((axes,),) = panels(size=(6.4, 3.6))
    axes.plot(*ring, "o", color=BLUE, markersize=4, label="at the points of the interface")
    axes.axhline(1.0, color=ORANGE, linewidth=1.5, label="Lamé")
    for edge in (1 - TIGHT, 1 + TIGHT):
        axes.axhline(edge, color=GREY, linewidth=1, linestyle="--")
    axes.set(xlabel="angle (degrees)", ylabel="pressure over Lamé's", ylim=(0.97, 1.03))
    axes.set_title("Ring shrunk on a shaft, meshed apart, P2; dashed: 1 %", fontsize=11)
    return figure
