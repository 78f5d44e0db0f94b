"""From the configuration to the scene, in eight steps: the mesh and its matter, subdomains, where
they meet, rigid tools and grounds, loads, supports, what interfaces carry, and the subdomains with
all that is theirs. Each makes a state from the one before; what is wrong goes to ``Problems``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from orchestrator.config.model import Config
from orchestrator.errors import InputError, Problems
from orchestrator.scene.body import Body, Divided, Meshed
from orchestrator.scene.bolts import cut_bolts
from orchestrator.scene.cautions import odd_moduli
from orchestrator.scene.conditions.agreement import check_agreement, check_sides
from orchestrator.scene.conditions.boundary import Held, moving_as_one, prescribe, resolve_boundary
from orchestrator.scene.conditions.probes import Finder
from orchestrator.scene.conditions.ground import held_rows, within_free
from orchestrator.scene.conditions.rigid import check_held
from orchestrator.scene.conditions.selection import assign_codes, cells_loaded
from orchestrator.scene.conditions.supports import joins
from orchestrator.scene.interfaces.freedom import leave_free, straighten
from orchestrator.scene.joints import Joined, joined, with_grounds, with_tools
from orchestrator.scene.loads.base import VolumePlace, Strain
from orchestrator.scene.loads.temperature import thermal_loads
from orchestrator.scene.mesh.faces import by_label
from orchestrator.scene.mesh.geometry import node_areas, summed, tet_volumes
from orchestrator.scene.mesh.mesh import split_numbering
from orchestrator.scene.mesh.quadratic import CORNER_SHARES
from orchestrator.scene.model import Scene, Subdomain
from orchestrator.scene.partition import make_partition, Partition


def build_scene(config: Config, run_programs: bool = False, meshed: Meshed | None = None) -> Scene:
    """Return everything that the method needs to know of the problem.

    run_programs : whether parts that are programs are started; they alone know their joints
    meshed : what makes the mesh; one that has been used before has it already where nothing that
        makes it has changed
    Raises InputError: with all that is wrong with mesh, partition, boundary conditions, materials
        and interfaces; a bad mesh is reported alone, since nothing else can be judged without it;
        programs that may not be started

    Examples
    --------
    >>> from orchestrator import build_scene, config_from
    >>> scene = build_scene(config_from({
    ...     "name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
    ...     "subdomains": {"slices": {"axis": "x", "count": 4}},
    ...     "materials": [{"young": 200e3, "poisson": 0.3}],
    ...     "boundary": [{"on": "xmin", "displacement": [0, 0, 0]},
    ...                  {"on": "xmax", "traction": [10, 0, 0]}]}))
    >>> scene
    Scene(bar: 4 subdomains, 3 interfaces, 243 dofs, 1 load steps)
    >>> [interface.subdomains for interface in scene.interfaces]
    [(0, 1), (1, 2), (2, 3)]
    """
    problems = Problems()
    body = (meshed or Meshed())(config, run_programs, problems)
    boundary = resolve_boundary(body.mesh, body.faces, config.boundary,
                                config.factors(config.boundary), problems)
    resolved = all(problem.path[0] != "boundary" for problem in problems.found)
    cut = divided(config, body, problems)
    plain = joined(config, cut, boundary, problems)
    bodies = with_tools(config, plain, problems)
    whole = with_grounds(bodies, problems)
    acting = loaded(config, plain.cut.body, whole, problems)
    held = supported(config.steps, whole, problems)
    whole = freed(config, whole, held, problems)
    if resolved and (whole.grounds or not any(entry.ground for entry in whole.boundary)):
        # A selection that failed holds nothing: a second complaint would only distract.
        _check_held(bodies.cut.body, whole, held, problems)
    probes = _watched(config, plain.cut.body, whole, problems)
    problems.raise_if_any()
    _remark(config, whole.cut.body, problems)
    subdomains = owned(config, whole, held, acting)
    cut, (fixed, prescribed) = whole.cut, held.on_mesh()
    return Scene(
        config.name, cut.body.mesh, cut.partition.subdomain, cut.body.material, body.materials,
        subdomains, whole.interfaces, whole.boundary, fixed, prescribed,
        np.stack([summed(cut.numbering.nodes, step, cut.numbering.total)
                  for step in acting.loads]), config.steps, problems.warnings, whole.near,
        whole.sagitta, whole.bolts, acting.thermal, probes=probes, element=body.choice,
        body_force=acting.body_force, covered=whole.covered,
        brought=any(config.codes[s.code].brings_loads or s.remembers for s in subdomains))


def divided(config: Config, body: Body, problems: Problems) -> Divided:
    """Return the subdomains, bolts cut."""
    mesh, cuts, failed = body.mesh, (), False
    try:
        partition = make_partition(mesh, body.faces, config.subdomains)
    except InputError as error:
        problems.found.extend(error.problems)
        # Body forces name volumes: they can be judged on the undivided mesh.
        partition, failed = Partition(np.zeros(len(mesh.cells), dtype=int), ["all"]), True
    if config.bolts and not failed:
        partition, cuts = cut_bolts(mesh, body.faces, partition, config.bolts, config.interfaces,
                                    problems)
    numbering = split_numbering(mesh.cells, partition.subdomain, len(mesh.nodes))
    return Divided(body, partition, numbering, cuts, failed)


@dataclass(frozen=True)
class SceneLoads:
    """Loads of a scene, on its nodes and in its cells.

    loads : (steps, N, 3) forces on split nodes
    thermal, body_force : see ``Scene``
    """

    loads: np.ndarray
    thermal: np.ndarray | None
    body_force: np.ndarray | None


def loaded(config: Config, plain: Body, whole: Joined, problems: Problems) -> SceneLoads:
    """Return what loads the scene.

    plain : without tools and grounds, on which nothing acts
    """
    body, numbering, subdomain = whole.cut.body, whole.cut.numbering, whole.cut.partition.subdomain
    mesh, count, cells_in_all = plain.mesh, config.steps, len(body.mesh.cells)
    loads, thermal, body_force = np.zeros((count, len(numbering.nodes), 3)), None, None
    for entry in whole.boundary:  # a face loads the subdomain its tet belongs to
        if entry.forces and len(entry.triangles):
            owner = subdomain[entry.cells[:, 0]][:, None]
            entry.forces.add_to(loads, numbering.find(owner, entry.triangles))
    matter = [*config.matter, *(None for _ in mesh.foreign)]
    for i, (entry, times) in enumerate(zip(config.loads, config.factors(config.loads))):
        cells = cells_loaded(mesh, entry.on, ("loads", i, "on"), problems)
        volumes = tet_volumes(mesh.nodes, mesh.cells[cells])
        made = entry.kind.made(entry.given, VolumePlace(
            ("loads", i, entry.acts), mesh, cells, volumes, matter, plain.material[cells],
            np.array(times, dtype=float), problems))
        if isinstance(made, Strain):
            thermal = np.zeros((count, cells_in_all, 4)) if thermal is None else thermal
            thermal[:, cells] += made.values
        elif made is not None:
            made.add_to(loads, numbering.corners[cells])
            density = made.densities(volumes)
            if body_force is None:
                body_force = np.zeros((count, cells_in_all, 1, 3))
            body_force = np.repeat(body_force, max(density.shape[2] // body_force.shape[2], 1),
                                   axis=2)
            body_force[:, cells] += density
    if thermal is not None:
        thermal_loads(body.mesh, thermal, body.materials, body.material, numbering.corners, loads)
    return SceneLoads(loads, thermal, body_force)


def supported(steps: int, whole: Joined, problems: Problems) -> Held:
    """Return what is prescribed; complain where that disagrees: at nodes, across interfaces, with
    what grounds hold."""
    numbering, grounds = whole.cut.numbering, whole.grounds
    label = moving_as_one(numbering, whole.interfaces)
    held = prescribe(whole.cut.body.mesh, whole.boundary, whole.cut.partition.subdomain, numbering,
                     label, steps, problems)
    if not problems.found:
        check_agreement(held, whole.interfaces, grounds, problems)
        check_sides(held, whole.interfaces[:len(whole.interfaces) - len(grounds)], problems)
    for entry, nodes in whole.stands.items():  # a ground carries the reaction of its entry
        held.by[(numbering.nodes >= nodes.start) & (numbering.nodes < nodes.stop)] = entry
    return held


def freed(config: Config, whole: Joined, held: Held, problems: Problems) -> Joined:
    """Take out of the interfaces what is prescribed on both sides."""
    mesh, cut = whole.cut.body.mesh, whole.cut
    interfaces = leave_free(mesh, whole.interfaces, cut.partition, cut.numbering, held,
                            config.interfaces, problems)
    bolts = straighten(mesh, interfaces, whole.bolts, problems)
    within_free([i for _, i in whole.grounds], held, problems)
    return replace(whole, interfaces=interfaces, bolts=bolts)


def _check_held(bodies: Body, whole: Joined, held: Held, problems: Problems) -> None:
    """Add a problem for bodies, without grounds, that can move as rigid ones."""
    mesh = bodies.mesh
    between = [i for i in whole.interfaces if not i.ground]
    links, hinges = joins(mesh, whole.cut.partition, between)
    check_held(mesh, bodies.faces, held.on_mesh()[0][: len(mesh.nodes)], problems,
               [*links, *mesh.one_body],
               held_rows([i for _, i in whole.grounds], mesh), hinges)


def _watched(config: Config, plain: Body, whole: Joined, problems: Problems) -> list:
    """Return the probes."""
    mesh, partition, asked = plain.mesh, whole.cut.partition, config.output.named_probes
    subdomain = partition.subdomain[: len(mesh.cells)]  # tools and grounds come after
    bodies = [partition.body(i) or name for i, name in enumerate(partition.names)]
    return Finder(mesh, plain.faces, subdomain, bodies, whole.interfaces, problems).find(asked)


def _remark(config: Config, body: Body, problems: Problems) -> None:
    """Add warnings of the mesh, of names, of histories without use."""
    mesh = body.mesh
    problems.warnings += mesh.remarks
    problems.warnings += odd_moduli(config.output.units,
                                    [(m.young, m.poisson) for m in config.matter])
    used = {e.history for e in (*config.boundary, *config.loads, *config.interfaces, *config.bolts)}
    used |= {tool.history for tool in config.tools.values()}
    used |= {part.foreign.history for part in config.parts or [] if part.foreign is not None}
    problems.warnings += [
        f"history '{name}' has no use: no entry of boundary, loads, interfaces, bolts or parts "
        "names it"
                          for name in config.histories if name not in used]


def owned(config: Config, whole: Joined, held: Held, acting: SceneLoads) -> list[Subdomain]:
    """Return the subdomains with all that is theirs, and the code that solves each."""
    body, partition, numbering = whole.cut.body, whole.cut.partition, whole.cut.numbering
    mesh, fixed, thermal, made = body.mesh, held.fixed, acting.thermal, []
    for i, (name, cells) in enumerate(zip(partition.names, by_label(partition.subdomain,
                                                           len(partition.names)))):
        own = slice(*numbering.offsets[i:i + 2])
        made.append(Subdomain(
            i, name, cells, numbering.nodes[own], numbering.corners[cells] - own.start,
            body.material[cells], fixed[own],
            np.ascontiguousarray(held.values[:, own]), np.ascontiguousarray(acting.loads[:, own]),
            held.by[own], body=partition.body(i),
            foreign=bool(mesh.foreign) and bool(mesh.is_foreign(cells[:1])[0]),
            contact_area=np.zeros(own.stop - own.start),
            heated=thermal is not None and bool(thermal[:, cells].any())))
    behind = [i for i in whole.interfaces if i.tool is not None] + [i for _, i in whole.grounds]
    grounded = {i.subdomains[1]: i.subdomains[0] for i in behind}
    assign_codes(mesh, [s for s in made if s.index not in grounded], config.codes)
    for e, beside in grounded.items():
        made[e].code = made[beside].code
    for i in whole.interfaces:
        for side, (e, nodes) in enumerate(zip(i.subdomains, i.nodes) if not i.law.perfect else ()):
            made[e].contact_area[nodes] += node_areas(
                mesh.nodes[made[e].nodes[nodes]], i.triangles_on(side)[:, :3], CORNER_SHARES[3])
    return made
