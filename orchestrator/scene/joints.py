"""Where subdomains meet: each other, rigid tools and grounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from orchestrator.config.model import Config
from orchestrator.errors import Problems
from orchestrator.scene.body import Body, Divided
from orchestrator.scene.cautions import loads_on_pairs
from orchestrator.scene.conditions.boundary import acting
from orchestrator.scene.conditions.ground import add_grounds
from orchestrator.scene.interface import Beside, Interface
from orchestrator.scene.interfaces.freedom import join_bolts
from orchestrator.scene.interfaces.governing import Laws
from orchestrator.scene.interfaces.mortar.fitting import fitted
from orchestrator.scene.interfaces.overlap import sagittas
from orchestrator.scene.interfaces.pairs import make_interfaces
from orchestrator.scene.interfaces.parts import Parts
from orchestrator.scene.model import BoundaryEntry, PlacedBolt


@dataclass(frozen=True)
class Joined:
    """Subdomains and where they meet.

    cut : the subdomains; where sides are fitted to each other their nodes are moved
    boundary : what acts on faces, and what drives tools
    near, covered, sagitta : see ``Scene``
    grounds : those of the interfaces that are with a ground, and the entry of ``boundary`` of each
    stands : per entry of ``boundary`` that stands on one, the nodes of its grounds
    """

    cut: Divided
    boundary: list[BoundaryEntry]
    interfaces: list[Interface]
    near: Mapping[tuple[int, int], Beside]
    bolts: list[PlacedBolt]
    covered: np.ndarray
    sagitta: Mapping[int, np.ndarray]
    grounds: Sequence[tuple[int, Interface]] = ()
    stands: Mapping[int, slice] = field(default_factory=dict)


def joined(config: Config, cut: Divided, boundary: list[BoundaryEntry],
           problems: Problems) -> Joined:
    """Return the interfaces; where their sides are fitted to each other the mesh's nodes move, and
    what acts on faces with them."""
    body, mesh = cut.body, cut.body.mesh
    young, held = _matter(body, boundary)
    asked = "interfaces" in config.model_fields_set and any(
        entry.tool is None for entry in config.interfaces)
    laws = Laws(config.interfaces, [*cut.partition.names, *mesh.volumes],
                config.factors(config.interfaces), asked)
    parts = Parts(mesh, body.faces, cut.partition, cut.numbering, young, held)
    interfaces, near = ([], {}) if cut.failed else make_interfaces(parts, laws, problems)
    bolts = join_bolts(cut.bolts, interfaces, config.bolts, config.factors(config.bolts), problems)
    if mesh.foreign and not cut.failed:
        from orchestrator.scene.foreign.standin import report_joints, report_units

        report_joints(mesh, interfaces, cut.numbering, problems)
        report_units(mesh, interfaces, cut.partition.subdomain, young, problems)
    covered = loads_on_pairs(mesh, boundary, interfaces, cut.numbering)
    if any(i.surfaces is not None for i in interfaces):
        for stand in mesh.foreign:
            held[stand.nodes] = True
        mesh = fitted(mesh, cut.numbering, interfaces, held)
        boundary = [replace(entry, does=acting(mesh, entry.triangles, given, times,
                                               # told before
                                               ("boundary", entry.index), Problems()))
                    for entry, given, times in zip(
                        boundary, config.boundary, config.factors(config.boundary))]
    return Joined(replace(cut, body=replace(body, mesh=mesh)), boundary, interfaces, near, bolts,
                  covered, sagittas(mesh, sorted({v for pair in near for v in pair})))


def _matter(body: Body, boundary: list[BoundaryEntry]) -> tuple[np.ndarray, np.ndarray]:
    """Return the modulus (m,) of each cell, 1 without materials, which are complained of
    elsewhere; and which components (n, 3) bool are prescribed.
    """
    young = np.array([m.young for m in body.materials] or [1.0])
    young = young[np.maximum(body.material, 0) if body.materials else 0 * body.material]
    held = np.zeros((len(body.mesh.nodes), 3), dtype=bool)
    for entry in boundary:
        if entry.prescribed and entry.prescribed.fixed.any():
            held[entry.nodes] |= entry.prescribed.fixed
    for stand in body.mesh.foreign:
        held[stand.nodes] |= stand.held
    return young, held


def with_tools(config: Config, before: Joined, problems: Problems) -> Joined:
    """Add rigid tools: cells, subdomains, interfaces, and entries of ``boundary`` that drive
    them."""
    body = before.cut.body
    if before.cut.failed or not (config.tools and body.materials):
        return before
    from orchestrator.scene.tools.add import add_tools, pressed_tools

    pressed = pressed_tools(body.mesh, body.faces, config.interfaces, config.tools,
                            config.factors(config.tools.values()), problems)
    if problems.found:
        return before
    cut, interfaces, entries = add_tools(before.cut, pressed, len(before.boundary))
    return replace(before, cut=cut, boundary=before.boundary + entries,
                   interfaces=before.interfaces + interfaces)


def with_grounds(before: Joined, problems: Problems) -> Joined:
    """Add a ground behind every entry that stands on one: cells, subdomains, interfaces."""
    if before.cut.failed or problems.found or not any(e.ground for e in before.boundary):
        return before
    cut, grounds, stands = add_grounds(before.cut, before.boundary, problems)
    return replace(before, cut=cut, grounds=grounds, stands=stands,
                   interfaces=before.interfaces + [i for _, i in grounds])
