"""From the configuration to the scene, in ten steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orchestrator.config.model import Config
from orchestrator.errors import InputError, Problems
from orchestrator.scene.body import Body, Meshed
from orchestrator.scene.cautions import odd_moduli
from orchestrator.scene.conditions.agreement import check_agreement, check_sides
from orchestrator.scene.conditions.boundary import Held, moving_as_one, prescribe, resolve_boundary
from orchestrator.scene.conditions.selection import assign_codes, cells_loaded
from orchestrator.scene.conditions.ground import held_rows, within_free
from orchestrator.scene.conditions.finder import Finder
from orchestrator.scene.conditions.rigid import check_held
from orchestrator.scene.interfaces.freedom import leave_free, straighten
from orchestrator.scene.conditions.supports import joins
from orchestrator.scene.loads.base import InVolumes, Strain
from orchestrator.scene.loads.temperature import thermal_loads
from orchestrator.scene.mesh.geometry import node_areas, tet_volumes
from orchestrator.scene.mesh.mesh import Mesh, SplitNumbering, split_numbering
from orchestrator.scene.mesh.quadratic import CORNER_SHARES
from orchestrator.scene.joints import add_behind, add_rigid, Cut, joined, Joints, near_sagittas
from orchestrator.scene.model import BoundaryEntry, Scene, Subdomain
from orchestrator.scene.names import look_alike
from orchestrator.scene.bolts import cut_bolts
from orchestrator.scene.partition import Partition, make_partition


def build_scene(config: Config, run_programs: bool = False, meshed: Meshed | None = None) -> Scene:
    """Everything the method needs to know of the problem.

    run_programs : whether parts that are programs are started; they alone know their joints
    meshed : what makes the mesh; one that has been used before has it already where nothing that makes it has changed
    Raises InputError: with all that is wrong with mesh, partition, boundary conditions, materials and interfaces;
        a bad mesh is reported alone, since nothing else can be judged without it; programs that may not be started

    Examples
    --------
    >>> from orchestrator import build_scene, config_from
    >>> scene = build_scene(config_from({
    ...     "name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
    ...     "subdomains": {"slices": {"axis": "x", "count": 4}}, "materials": [{"young": 200e3, "poisson": 0.3}],
    ...     "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax", "traction": [10, 0, 0]}]}))
    >>> scene
    Scene(bar: 4 subdomains, 3 interfaces, 243 dofs, 1 load steps)
    >>> [interface.subdomains for interface in scene.interfaces]
    [(0, 1), (1, 2), (2, 3)]
    """
    problems = Problems()
    body = (meshed or Meshed())(config, run_programs, problems)
    boundary = resolve_boundary(body.mesh, body.faces, config.boundary, config.factors(config.boundary), problems)
    resolved = all(problem.path[0] != "boundary" for problem in problems.found)
    cut = _divided(config, body, problems)
    joints = joined(config, body, cut, boundary, problems)
    plain, sagitta = replace(body), near_sagittas(body, joints)
    add_rigid(config, body, cut, joints, boundary, problems)
    bodies = replace(body)  # without grounds
    if any(entry.ground for entry in boundary) and not cut.failed and not problems.found:
        add_behind(body, cut, joints, boundary, problems)
    loads, thermal, body_force = _loaded(config, plain, body, cut, boundary, problems)
    held = _supported(config, body, cut, joints, boundary, problems)
    _freed(config, body, cut, joints, held, problems)
    if resolved and (joints.grounds or not any(entry.ground for entry in boundary)):
        # A selection that failed holds nothing: a second complaint would only distract.
        _check_held(bodies, cut, joints, held, problems)
    probes = _watched(config, plain, cut, joints, problems)
    problems.raise_if_any()
    _remark(config, body.mesh, problems)
    subdomains = _subdomains(config, body, cut, joints, held, loads, thermal)
    fixed, prescribed = held.on_mesh()
    return Scene(config.name, body.mesh, cut.partition.subdomain, body.material, body.materials, subdomains, joints.interfaces, boundary,
                 fixed, prescribed, _on_nodes(loads, cut.numbering), config.steps, problems.warnings, joints.near, sagitta, joints.bolts, thermal,
                 probes=probes, element=body.choice, body_force=body_force, covered=joints.covered,
                 brought=any(config.codes[s.code].brings_loads or s.remembers for s in subdomains))


def _divided(config: Config, body: Body, problems: Problems) -> Cut:
    """The subdomains, bolts cut."""
    mesh, cuts, failed = body.mesh, (), False
    try:
        partition = make_partition(mesh, body.faces, config.subdomains)
    except InputError as error:
        problems.found.extend(error.problems)
        # Body forces name volumes: they can be judged on the undivided mesh.
        partition, failed = Partition(np.zeros(len(mesh.cells), dtype=int), [config.name]), True
    if config.bolts and not failed:
        partition, cuts = cut_bolts(mesh, body.faces, partition, config, problems)
    return Cut(partition, split_numbering(mesh.cells, partition.subdomain, len(mesh.nodes)), cuts, failed)


def _loaded(config: Config, plain: Body, body: Body, cut: Cut, boundary: list[BoundaryEntry],
            problems: Problems) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """(steps, N, 3) forces on split nodes; (steps, m, 4) thermal strain at the cells' corners, None where nothing is heated;
    (steps, m, 1 or 4, 3) the body force of every cell, at its corners where it varies, None where there is none.

    plain : without grounds, on which nothing acts
    """
    mesh, count = plain.mesh, config.steps
    loads, thermal, body_force = np.zeros((count, len(cut.numbering.nodes), 3)), None, None
    for entry in boundary:  # a face loads the subdomain its tet belongs to
        if entry.forces and len(entry.triangles):
            entry.forces.add_to(loads, cut.numbering.find(cut.partition.subdomain[entry.cells[:, 0]][:, None], entry.triangles))
    matter = [*config.matter, *(None for _ in mesh.foreign)]
    for i, (entry, times) in enumerate(zip(config.loads, config.factors(config.loads))):
        cells = cells_loaded(mesh, entry.on, ("loads", i, "on"), problems)
        where = InVolumes(("loads", i, entry.acts), mesh, cells, tet_volumes(mesh.nodes, mesh.cells[cells]), matter,
                          plain.material[cells], np.array(times, dtype=float), problems)
        made = entry.kind.made(entry.given, where)
        if isinstance(made, Strain):
            thermal = np.zeros((count, len(body.mesh.cells), 4)) if thermal is None else thermal
            thermal[:, cells] += made.values
        elif made is not None:
            made.add_to(loads, cut.numbering.corners[cells])
            density = made.densities(where.volume)
            body_force = np.zeros((count, len(body.mesh.cells), 1, 3)) if body_force is None else body_force
            body_force = np.repeat(body_force, max(density.shape[2] // body_force.shape[2], 1), axis=2)
            body_force[:, cells] += density
    if thermal is not None:
        thermal_loads(body.mesh, thermal, body.materials, body.material, cut.numbering.corners, loads)
    return loads, thermal, body_force


def _supported(config: Config, body: Body, cut: Cut, joints: Joints, boundary: list[BoundaryEntry], problems: Problems) -> Held:
    """What is prescribed, and whether that agrees: at nodes, across interfaces, with what grounds hold."""
    numbering, grounds = cut.numbering, joints.grounds
    label = moving_as_one(numbering, joints.interfaces)
    held = prescribe(body.mesh, boundary, cut.partition.subdomain, numbering, label, config.steps, problems)
    if not problems.found:
        check_agreement(held, joints.interfaces, grounds, problems)
        check_sides(held, joints.interfaces[:len(joints.interfaces) - len(grounds)], problems)
    for entry, nodes in joints.stands.items():  # what a ground carries is the reaction of its entry
        held.by[(numbering.nodes >= nodes.start) & (numbering.nodes < nodes.stop)] = entry
    return held


def _freed(config: Config, body: Body, cut: Cut, joints: Joints, held: Held, problems: Problems) -> None:
    """Takes out of the interfaces what is prescribed on both sides."""
    joints.interfaces = leave_free(body.mesh, joints.interfaces, cut.partition, cut.numbering, held.fixed,
                                   config.interfaces, problems)
    joints.bolts = straighten(body.mesh, joints.interfaces, joints.bolts, problems)
    within_free([i for _, i in joints.grounds], held, problems)


def _check_held(plain: Body, cut: Cut, joints: Joints, held: Held, problems: Problems) -> None:
    """Adds a problem for bodies that can move as rigid ones."""
    mesh = plain.mesh
    between = [i for i in joints.interfaces if not i.law.on_ground]
    links, hinges = joins(mesh, cut.partition, between)
    links = links + mesh.one_body
    check_held(mesh, plain.faces, held.on_mesh()[0][: len(mesh.nodes)], problems, np.concatenate(links) if links else None,
               held_rows([i for _, i in joints.grounds], mesh), hinges)


def _watched(config: Config, plain: Body, cut: Cut, joints: Joints, problems: Problems) -> list:
    """Return the probes."""
    mesh, asked = plain.mesh, config.output.named_probes
    subdomain = cut.partition.subdomain[: len(mesh.cells)]  # tools and grounds come after
    bodies = [cut.partition.body(i) or name for i, name in enumerate(cut.partition.names)]
    return Finder(mesh, plain.faces, subdomain, bodies, joints.interfaces, problems).find(asked)


def _remark(config: Config, mesh: Mesh, problems: Problems) -> None:
    """Adds warnings of the mesh, of names, of histories without use."""
    problems.warnings += [*mesh.remarks, *look_alike(mesh.volumes, "volume"),
                          *look_alike(mesh.surfaces, "surface")]
    problems.warnings += odd_moduli(config.output.units,
                                    [(m.young, m.poisson) for m in config.matter])
    used = {e.history for e in (*config.boundary, *config.loads, *config.interfaces, *config.bolts)}
    used |= {tool.history for tool in config.tools.values()}
    used |= {part.foreign.history for part in config.parts or [] if part.foreign is not None}
    problems.warnings += [f"history '{name}' has no use: no entry of boundary, loads, interfaces, bolts or parts names it"
                          for name in config.histories if name not in used]


def _subdomains(config: Config, body: Body, cut: Cut, joints: Joints, held: Held, loads: np.ndarray, thermal: np.ndarray | None) -> list[Subdomain]:
    """The subdomains with all that is theirs, and the code that solves each."""
    mesh, partition, numbering, fixed, made = body.mesh, cut.partition, cut.numbering, held.fixed, []
    order = np.argsort(partition.subdomain, kind="stable")
    bounds = np.searchsorted(partition.subdomain[order], np.arange(len(partition.names) + 1))
    for i, name in enumerate(partition.names):
        cells, own = order[bounds[i]:bounds[i + 1]], slice(numbering.offsets[i], numbering.offsets[i + 1])
        made.append(Subdomain(
            i, name, cells, numbering.nodes[own], numbering.corners[cells] - own.start, body.material[cells], fixed[own],
            np.ascontiguousarray(held.values[:, own]), np.ascontiguousarray(loads[:, own]), held.by[own], body=partition.body(i),
            foreign=bool(mesh.foreign) and bool(mesh.is_foreign(cells[:1])[0]), contact_area=np.zeros(own.stop - own.start),
            heated=thermal is not None and bool(thermal[:, cells].any())))
    grounded = {i.subdomains[1]: i.subdomains[0] for i in joints.interfaces if i.tool is not None}
    grounded |= {i.subdomains[1]: i.subdomains[0] for _, i in joints.grounds}
    assign_codes(mesh, [s for s in made if s.index not in grounded], config.codes)
    for e, beside in grounded.items():
        made[e].code = made[beside].code
    for i in joints.interfaces:
        for side, (e, nodes) in enumerate(zip(i.subdomains, i.nodes) if not i.law.perfect else ()):
            made[e].contact_area[nodes] += node_areas(
                mesh.nodes[made[e].nodes[nodes]], i.triangles_on(side)[:, :3], CORNER_SHARES[3])
    return made


def _on_nodes(loads: np.ndarray, numbering: SplitNumbering) -> np.ndarray:
    """Loads (steps, n, 3) on the mesh's nodes from those on split nodes (steps, N, 3)."""
    return np.stack([[np.bincount(numbering.nodes, weights=step[:, c], minlength=numbering.total) for c in range(3)]
                     for step in loads]).transpose(0, 2, 1).copy()
