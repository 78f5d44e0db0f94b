"""From the configuration to the scene: mesh, materials, boundary conditions, subdomains, interfaces."""

from __future__ import annotations

import numpy as np

from orchestrator.config import Config, factors, steps, vectors_per_step
from orchestrator.errors import InputError, Problems
from orchestrator.scene.conditions.agreement import check_agreement
from orchestrator.scene.conditions.boundary import moving_as_one, on_mesh, prescribe, resolve_boundary
from orchestrator.scene.conditions.codes import assign_codes
from orchestrator.scene.conditions.covered import loads_on_pairs
from orchestrator.scene.conditions.heat import eigenstrain, thermal_loads
from orchestrator.scene.conditions.loads import body_loads, surface_loads
from orchestrator.scene.conditions.materials import assign_materials
from orchestrator.scene.conditions.rigid import check_held
from orchestrator.scene.conditions.sides import check_sides
from orchestrator.scene.interfaces.axial import join_bolts, straighten
from orchestrator.scene.interfaces.freedom import leave_free
from orchestrator.scene.interfaces.joins import joins
from orchestrator.scene.interfaces.mortar.sides import Matter
from orchestrator.scene.interfaces.entries import Laws
from orchestrator.scene.interfaces.patches import make_interfaces
from orchestrator.scene.interfaces.search import Search
from orchestrator.scene.mesh.patch import node_areas
from orchestrator.scene.mesh.quadratic import quadratic
from orchestrator.scene.mesh.size import check_memory
from orchestrator.scene.mesh.sources import Keeper, make_mesh, make_parts
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import BoundaryEntry, Interface, Material, Scene, Subdomain
from orchestrator.scene.names import look_alike
from orchestrator.scene.partition.bolts import cut_bolts
from orchestrator.scene.partition.numbering import SplitNumbering, split_numbering
from orchestrator.scene.partition.partition import Partition, make_partition

# Per node and load step: loads and prescribed displacements, on the whole mesh and on the subdomains.
STEP_BYTES = 5 * 3 * 8
# Per corner of a mesh that gets a node in the middle of every edge, at most while its scene is made, measured.
QUADRATIC_BYTES = 5800.0


def build_scene(config: Config, kept: Keeper = lambda make: make(), run_programs: bool = False) -> Scene:
    """Everything the method needs to know of the problem.

    Parameters
    ----------
    kept : may know the mesh from an earlier run
    run_programs : whether parts that are programs are started; they alone know their joints

    Raises
    ------
    InputError : with all that is wrong with mesh, partition, boundary conditions, materials and interfaces;
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
    mesh, faces = make_mesh(config.mesh, kept) if config.mesh else make_parts(config.parts, kept, run_programs)
    element, choice = config.codes[0].element, None
    if element == "auto":
        from orchestrator.scene.mesh.element import choose_element

        choice = choose_element(mesh, faces, *assign_materials(mesh, config.matter, Problems()))
        element = choice.element
    if element == "P2":
        check_memory(QUADRATIC_BYTES * len(mesh.nodes), ("blackbox",), f"element: P2 on a mesh of {len(mesh.nodes)} corners",
                     "use a coarser mesh, or element: P1")
        mesh, faces = quadratic(mesh, faces)
    problems, count = Problems(), steps(config)
    check_memory(STEP_BYTES * count * len(mesh.nodes), ("histories",), f"{count} load steps on {len(mesh.nodes)} nodes",
                 "give fewer load steps, or a coarser mesh")
    materials, cell_material = assign_materials(mesh, config.matter, problems)
    vectors = [vectors_per_step(entry, config) for entry in config.boundary]
    times = [factors(entry, config) for entry in config.boundary]
    boundary = resolve_boundary(mesh, faces, config.boundary, vectors, times, problems)
    unresolved = any(path[0] == "boundary" for path in (p.path for p in problems.found))
    try:
        partition = make_partition(mesh, faces, config.subdomains)
    except InputError as error:
        problems.found.extend(error.problems)
        # Body forces name volumes: they can be judged on the undivided mesh.
        partition = Partition(np.zeros(len(mesh.cells), dtype=int), [config.name])
        whole = True
    else:
        whole = False
    partition, cuts = (partition, []) if whole or not config.bolts else cut_bolts(mesh, faces, partition, config.bolts, problems)
    numbering = split_numbering(mesh.cells, partition.subdomain, len(mesh.nodes))
    matter = _matter(mesh, materials, cell_material, boundary)
    laws = Laws(config.interfaces, [*partition.names, *mesh.volumes], [factors(entry, config) for entry in config.interfaces])
    interfaces, near = ([], []) if whole else make_interfaces(Search(
        mesh, faces, partition, numbering, laws, problems, "interfaces" in config.model_fields_set, matter))
    bolts = join_bolts(cuts, interfaces, config.bolts, [factors(entry, config) for entry in config.bolts], problems)
    if mesh.foreign and not whole:
        from orchestrator.scene.foreign.met import report_joints, report_units

        report_joints(mesh, interfaces, numbering, problems)
        report_units(mesh, interfaces, partition.subdomain, matter.young, problems)
    problems.warnings += loads_on_pairs(mesh, boundary, interfaces, numbering)
    if any(i.surfaces is not None for i in interfaces):
        from orchestrator.scene.interfaces.mortar.fitting import fitted

        stays = matter.held.copy()
        for stand in mesh.foreign:
            stays[stand.nodes] = True
        mesh = fitted(mesh, interfaces, stays)
    plain, outside, grounds, stands = mesh, faces, [], {}
    standing = any(entry.stands for entry in config.boundary)
    if standing and not whole and not problems.found:
        from orchestrator.scene.conditions.ground import add_grounds  # soles, and SciPy with them

        mesh, partition, numbering, cell_material, grounds, stands = add_grounds(
            mesh, faces, partition, cell_material, config.boundary, boundary, vectors, [factors(e, config) for e in config.boundary], problems)
        interfaces += grounds
    split = np.zeros((count, len(numbering.nodes), 3))
    surface_loads(plain, boundary, partition.subdomain, numbering, split)
    body_loads(plain, config.loads, [vectors_per_step(entry, config) for entry in config.loads],
               [factors(entry, config) for entry in config.loads],
               [*(m.density for m in config.matter), *(None for _ in mesh.foreign)], cell_material, numbering,
               split, problems)
    times = [factors(entry, config) for entry in config.loads]
    thermal = eigenstrain(plain, config.loads, times, [*(m.expansion for m in config.matter), *(None for _ in mesh.foreign)], cell_material, problems) \
        if any(entry.temperature is not None for entry in config.loads) else None
    if thermal is not None:
        thermal = np.pad(thermal, ((0, 0), (0, len(mesh.cells) - len(plain.cells)), (0, 0)))
        thermal_loads(mesh, thermal, materials, cell_material, numbering, split)
    label = moving_as_one(numbering, interfaces)
    held_by, split_prescribed = prescribe(mesh, boundary, partition.subdomain, numbering, label, count, problems)
    if not problems.found:
        of_entries = [(entry, i) for i in grounds for entry, at in stands.items() if numbering.nodes[numbering.offsets[i.subdomains[1]]] in
                      range(at.start, at.stop)]
        check_agreement(mesh, boundary, interfaces, of_entries, numbering, label, held_by, split_prescribed, problems)
        check_sides(mesh, boundary, interfaces[:len(interfaces) - len(grounds)], numbering, held_by, split_prescribed, problems)
    for entry, nodes in stands.items():  # what a ground carries is the reaction of its entry
        held_by[(numbering.nodes >= nodes.start) & (numbering.nodes < nodes.stop)] = entry
    fixed, prescribed = on_mesh(numbering, held_by, split_prescribed)
    split_fixed = held_by >= 0
    for stand in mesh.foreign:  # whose nodes no other body has
        fixed[stand.nodes] |= stand.held
        split_fixed[np.isin(numbering.nodes, np.arange(stand.nodes.start, stand.nodes.stop))] |= stand.held
    interfaces = leave_free(mesh, interfaces, partition, numbering, split_fixed, config.interfaces, problems)
    bolts = straighten(mesh, interfaces, bolts, problems)
    keeps = []
    if grounds:
        from orchestrator.scene.conditions.ground import held_rows, within_free

        within_free(grounds, mesh, numbering, split_prescribed, problems)
        keeps = held_rows(grounds, mesh)
    if not unresolved and (grounds or not standing):
        # A selection that failed holds nothing: a second complaint would only distract.
        whole, hinges = joins(mesh, partition, [i for i in interfaces if not any(i is g for g in grounds)])
        links = whole + mesh.one_body
        check_held(plain, outside, fixed[: len(plain.nodes)], problems, np.concatenate(links) if links else None, keeps, hinges)
    probes = []
    if config.output.probes:
        from orchestrator.scene.conditions.probes import find_probes

        bodies = [partition.body(i) or name for i, name in enumerate(partition.names)]
        probes = find_probes(plain, outside, partition.subdomain, bodies, interfaces, config.output.probes, problems)
    if not isinstance(config.output.figures, bool):
        from orchestrator.scene.conditions.drawn import check_figures

        check_figures(mesh.nodes, mesh.volumes, config.output.figures, ("output", "figures"), problems)
    problems.raise_if_any()
    problems.warnings += [*mesh.remarks, *look_alike(mesh.volumes, "volume"), *look_alike(mesh.surfaces, "surface")]
    used = {e.history for e in (*config.boundary, *config.loads, *config.interfaces, *config.bolts)}
    used |= {part.foreign.history for part in config.parts or [] if part.foreign is not None}
    problems.warnings += [f"history '{name}' has no use: no entry of boundary, loads, interfaces, bolts or parts names it"
                          for name in config.histories if name not in used]
    subdomains = _subdomains(partition, numbering, cell_material, held_by, split_fixed, split_prescribed, split)
    for s in subdomains:
        s.foreign = bool(len(mesh.foreign)) and bool(mesh.is_foreign(s.cells[:1])[0])
    grounded = {i.subdomains[1]: i.subdomains[0] for i in grounds}
    assign_codes(mesh, [s for s in subdomains if s.index not in grounded], config.codes)
    for e, body in grounded.items():
        subdomains[e].code = subdomains[body].code
    for s in subdomains if thermal is not None else ():
        s.heated = bool(thermal[:, s.cells].any())
    _contact_areas(mesh, subdomains, interfaces)
    return Scene(config.name, mesh, partition.subdomain, cell_material, materials, subdomains, interfaces, boundary,
                 fixed, prescribed, _joined(split, numbering), count, problems.warnings, near, bolts, thermal, probes=probes, element=choice)


def _matter(mesh: Mesh, materials: list[Material], cell_material: np.ndarray, boundary: list[BoundaryEntry]) -> Matter:
    """What chooses slaves; without materials, which are complained of elsewhere, all is alike."""
    young = np.array([m.young for m in materials] or [1.0])[np.maximum(cell_material, 0) if materials else 0 * cell_material]
    held = np.zeros(len(mesh.nodes), dtype=bool)
    for entry in boundary:
        if entry.fixed.any():
            held[entry.nodes] = True
    for stand in mesh.foreign:
        held[stand.nodes] |= stand.held.any(axis=1)
    return Matter(young, held)


def _subdomains(partition: Partition, numbering: SplitNumbering, cell_material: np.ndarray, held_by: np.ndarray, fixed: np.ndarray,
                prescribed: np.ndarray, split: np.ndarray) -> list[Subdomain]:
    order = np.argsort(partition.subdomain, kind="stable")
    bounds = np.searchsorted(partition.subdomain[order], np.arange(len(partition.names) + 1))
    made = []
    for i, name in enumerate(partition.names):
        cells, start, end = order[bounds[i]:bounds[i + 1]], numbering.offsets[i], numbering.offsets[i + 1]
        nodes = numbering.nodes[start:end]
        made.append(Subdomain(i, name, cells, nodes, numbering.corners[cells] - start, cell_material[cells],
                              fixed[start:end], np.ascontiguousarray(prescribed[:, start:end]),
                              np.ascontiguousarray(split[:, start:end]), held_by[start:end], body=partition.body(i)))
    return made


def _contact_areas(mesh: Mesh, subdomains: list[Subdomain], interfaces: list[Interface]) -> None:
    """Enter at every subdomain's nodes the area of its interfaces that are not perfect."""
    for s in subdomains:
        s.contact_area = np.zeros(len(s.nodes))
    for i in interfaces:
        if not i.law.perfect:
            for side, (e, nodes) in enumerate(zip(i.subdomains, i.nodes)):
                s = subdomains[e]
                s.contact_area[nodes] += node_areas(mesh.nodes[s.nodes[nodes]], i.triangles_on(side))


def _joined(split: np.ndarray, numbering: SplitNumbering) -> np.ndarray:
    """Loads (steps, n, 3) on the mesh's nodes from those on split nodes (steps, N, 3)."""
    return np.stack([[np.bincount(numbering.nodes, weights=step[:, c], minlength=numbering.total) for c in range(3)]
                     for step in split]).transpose(0, 2, 1).copy()
