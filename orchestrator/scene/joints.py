"""Where subdomains meet each other, rigid tools and grounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from orchestrator.config.model import Config
from orchestrator.errors import Problems
from orchestrator.scene.body import Body
from orchestrator.scene.bolts import BoltCut
from orchestrator.scene.cautions import loads_on_pairs
from orchestrator.scene.conditions.boundary import acting
from orchestrator.scene.conditions.ground import add_grounds
from orchestrator.scene.interface import Interface
from orchestrator.scene.interfaces.freedom import join_bolts
from orchestrator.scene.interfaces.mortar.fitting import fitted
from orchestrator.scene.interfaces.mortar.surfaces import Matter
from orchestrator.scene.interfaces.overlap import sagittas
from orchestrator.scene.interfaces.patches import make_interfaces
from orchestrator.scene.interfaces.search import Laws, Search
from orchestrator.scene.mesh.mesh import SplitNumbering
from orchestrator.scene.model import BoundaryEntry, PlacedBolt
from orchestrator.scene.overview import Beside
from orchestrator.scene.partition import Partition


@dataclass
class Cut:
    """The mesh in subdomains.

    bolts : their cuts
    failed : it could not be cut, and is judged whole
    """

    partition: Partition
    numbering: SplitNumbering
    bolts: Sequence[BoltCut] = ()
    failed: bool = False


@dataclass
class Joints:
    """Where subdomains meet.

    near, covered : see ``Scene``
    grounds : those of the interfaces that are with a ground, and the entry of ``boundary`` that each is of
    stands : per entry of ``boundary`` that stands on one, the nodes of its grounds
    """

    interfaces: list[Interface]
    near: dict[tuple[int, int], Beside]
    bolts: list[PlacedBolt]
    covered: np.ndarray
    grounds: list[tuple[int, Interface]] = field(default_factory=list)
    stands: dict[int, slice] = field(default_factory=dict)


def joined(config: Config, body: Body, cut: Cut, boundary: list[BoundaryEntry], problems: Problems) -> Joints:
    """The interfaces; where their sides are fitted to each other the mesh's nodes move, and what acts on faces with them."""
    mesh, matter = body.mesh, _matter(body, boundary)
    laws = Laws(config.interfaces, [*cut.partition.names, *mesh.volumes], config.factors(config.interfaces))
    asked = "interfaces" in config.model_fields_set and any(entry.tool is None for entry in config.interfaces)
    interfaces, near = ([], {}) if cut.failed else make_interfaces(Search(
        mesh, body.faces, cut.partition, cut.numbering, laws, problems, asked, matter))
    bolts = join_bolts(cut.bolts, interfaces, config.bolts, config.factors(config.bolts), problems)
    if mesh.foreign and not cut.failed:
        from orchestrator.scene.foreign.standin import report_joints, report_units

        report_joints(mesh, interfaces, cut.numbering, problems)
        report_units(mesh, interfaces, cut.partition.subdomain, matter.young, problems)
    covered = loads_on_pairs(mesh, boundary, interfaces, cut.numbering)
    if any(i.surfaces is not None for i in interfaces):
        held = matter.held.copy()
        for stand in mesh.foreign:
            held[stand.nodes] = True
        body.mesh = fitted(mesh, cut.numbering, interfaces, held)
        for entry, given, times in zip(boundary, config.boundary, config.factors(config.boundary)):
            entry.does = acting(body.mesh, entry.triangles, given, times, ("boundary", entry.index), Problems())  # told before
    return Joints(interfaces, near, bolts, covered)


def near_sagittas(body: Body, joints: Joints) -> dict[int, np.ndarray]:
    """Of volumes that are near others, see ``Scene``."""
    if not joints.near:
        return {}
    return sagittas(body.mesh, sorted({v for pair in joints.near for v in pair}))


def _matter(body: Body, boundary: list[BoundaryEntry]) -> Matter:
    """What chooses slaves; without materials, which are complained of elsewhere, all is alike."""
    young = np.array([m.young for m in body.materials] or [1.0])[np.maximum(body.material, 0) if body.materials else 0 * body.material]
    held = np.zeros((len(body.mesh.nodes), 3), dtype=bool)
    for entry in boundary:
        if entry.prescribed and entry.prescribed.fixed.any():
            held[entry.nodes] |= entry.prescribed.fixed
    for stand in body.mesh.foreign:
        held[stand.nodes] |= stand.held
    return Matter(young, held)


def add_rigid(config: Config, body: Body, cut: Cut, joints: Joints, boundary: list[BoundaryEntry], problems: Problems) -> None:
    """Adds rigid tools: cells, subdomains, interfaces, and entries of ``boundary`` that drive them."""
    if not config.tools or cut.failed or not body.materials:
        return
    from orchestrator.scene.tools.add import add_tools, pressed_tools

    pressed = pressed_tools(body.mesh, body.faces, config.interfaces, config.tools, config.factors(config.tools.values()), problems)
    if problems.found:
        return
    added, interfaces, entries = add_tools(body.mesh, body.faces, cut.partition, body.material, pressed, len(boundary))
    body.mesh, body.faces, body.material, cut.partition, cut.numbering = (
        added.mesh, added.faces, added.material, added.partition, added.numbering)
    joints.interfaces = joints.interfaces + interfaces
    boundary += entries


def add_behind(body: Body, cut: Cut, joints: Joints, boundary: list[BoundaryEntry], problems: Problems) -> None:
    """Adds a ground behind every entry that stands on one: cells, subdomains, interfaces."""
    added, joints.grounds, joints.stands = add_grounds(body.mesh, cut.partition, body.material, boundary, problems)
    body.mesh, body.material, cut.partition, cut.numbering = added.mesh, added.material, added.partition, added.numbering
    joints.interfaces = joints.interfaces + [i for _, i in joints.grounds]
