"""Which joints of parts whose mesh is not ours meet nothing, and why that may be."""

from __future__ import annotations

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.mesh.quality import format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Interface
from orchestrator.scene.names import INSIDE
from orchestrator.scene.partition.numbering import SplitNumbering

# Units of length that models are mixed up in: m and mm, m and cm, inches and mm, feet and m, inches and m.
UNITS = (1000.0, 100.0, 25.4, 1 / 0.3048, 1 / 0.0254, 10.0)
STEP, NEAR = 3.0, 0.5  # decades between units of stress (Pa, kPa, MPa, GPa), and how near a ratio of moduli is to such steps
ROOM = 0.01  # of the other parts' extent: joints within their box but for this may lie on them


def report_joints(mesh: Mesh, interfaces: list[Interface], numbering: SplitNumbering, problems: Problems) -> None:
    """Adds a problem for each such part that meets no other, and a warning for each single joint that does not."""
    met = np.zeros(len(mesh.nodes), dtype=bool)
    for i in interfaces:
        for e, nodes in zip(i.subdomains, i.nodes):
            met[numbering.nodes[numbering.offsets[e] + nodes]] = True
    own = np.concatenate([np.arange(s.nodes.start, s.nodes.stop) for s in mesh.foreign])
    others = np.delete(mesh.nodes, own, axis=0)
    for stand in mesh.foreign:
        name = mesh.volumes[stand.volume]
        joints = {s[len(name + INSIDE):]: t for s, t in mesh.surfaces.items() if s.startswith(name + INSIDE)}
        lost = [joint for joint, triangles in joints.items() if not met[np.unique(triangles)].any()]
        if len(lost) < len(joints):
            problems.warnings += [f"joint {joint} of {name!r} meets no other part" for joint in lost]
            continue
        points = mesh.nodes[stand.first : stand.first + stand.joints]
        problems.add(("interfaces",), f"{name!r} meets no other part: its joints reach from {format_point(points.min(axis=0))} to "
                     f"{format_point(points.max(axis=0))}" + _beside(points, others),
                     "joints that lie on faces of other parts and look at them, and an entry of interfaces between them",
                     "name it under interfaces, move the other parts to it (parts: move), make units of length the same; faces are "
                     "given anticlockwise seen from outside, outward: points out of the part")


def report_units(mesh: Mesh, interfaces: list[Interface], subdomain: np.ndarray, young: np.ndarray, problems: Problems) -> None:
    """Adds a warning for each such part whose own modulus seems to be in another unit than the scene's.

    subdomain : (m,) int, of every tet; young : (m,) the modulus that the YAML, or the part itself, gives it
    """
    for stand in mesh.foreign:
        cells = np.flatnonzero(mesh.volume == stand.volume)
        if stand.matter is None or not len(cells):
            continue
        own, name, beside = stand.matter[0], mesh.volumes[stand.volume], "the material: of its entry"
        others = young[cells[:1]]
        if others[0] == own:
            pairs = np.array([i.subdomains for i in interfaces], dtype=int).reshape(-1, 2)
            met = np.setdiff1d(pairs[(pairs == subdomain[cells[0]]).any(axis=1)], subdomain[cells[0]])
            others, beside = young[np.isin(subdomain, met)], "the nearest of the parts that it meets"
        with np.errstate(divide="ignore", invalid="ignore"):
            decades = np.log10(own / others)
        decades = decades[np.isfinite(decades)]
        if not len(decades):
            continue
        off = decades[np.abs(decades).argmin()]
        if abs(off) >= STEP - NEAR and abs(off - STEP * np.round(off / STEP)) <= NEAR:
            problems.warnings.append(f"{name!r} has a modulus of {own:.4g}, {10**off:.3g} times {beside}, as between units of stress")


def _beside(points: np.ndarray, others: np.ndarray) -> str:
    """Words for the extent of the other parts, and for units that may be mixed up."""
    if not len(others):
        return ""
    text = f", all other parts from {format_point(others.min(axis=0))} to {format_point(others.max(axis=0))}"
    low, high = others.min(axis=0), others.max(axis=0)
    room = ROOM * np.linalg.norm(high - low)

    def fits(factor: float) -> bool:
        return bool(((factor * points >= low - room) & (factor * points <= high + room)).all())

    unit = None if fits(1.0) else next((u for u in UNITS if fits(u) or fits(1 / u)), None)
    return text + (f"; with a factor of {unit:.4g}, as between units of length, they would fit" if unit else "")
