"""Plain models of the scene's subdomains with their soles, as they are handed to the black box.

- the extended subdomains: mesh, loads' dofs and the soles of all interfaces, outer nodes clamped;
- the soles alone, each interface apart, for the search direction k⁻;
- the rims: the tets that touch an interface or a clamped node, whose stiffness gives the
  energies of boundary corrections and the reactions without exporting whole matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.blackbox.protocol import Model, Origin
from orchestrator.scene.model import Scene, Subdomain
from orchestrator.scene.soles import Sole

SolePair = tuple[Sole, Sole]


def sides_by_subdomain(scene: Scene) -> list[list[tuple[int, int]]]:
    """Per subdomain, its (interface, side) pairs in the order of the interfaces."""
    sides: list[list[tuple[int, int]]] = [[] for _ in scene.subdomains]
    for interface in scene.interfaces:
        for side, subdomain in enumerate(interface.subdomains):
            sides[subdomain].append((interface.index, side))
    return sides


def boundary_dofs(scene: Scene, subdomain: Subdomain, sides: Sequence[tuple[int, int]]) -> np.ndarray:
    """(t,) ascending dofs of the subdomain that lie on an interface and are not prescribed."""
    on = np.zeros(len(subdomain.nodes), dtype=bool)
    for index, side in sides:
        on[scene.interfaces[index].nodes[side]] = True
    return np.flatnonzero(on[:, None] & ~subdomain.fixed)


def extended_model(scene: Scene, subdomain: Subdomain, sides: Sequence[tuple[int, int]], soles: Sequence[SolePair]) -> Model:
    """The subdomain's mesh with the soles of all its interfaces: its stiffness is K + NᵀkN of eq. 13."""
    count = len(subdomain.nodes)
    points, cells, matter = [scene.mesh.nodes[subdomain.nodes]], [subdomain.connectivity], [_moduli(scene, subdomain.material)]
    for index, side in sides:
        sole, inner = soles[index][side], scene.interfaces[index].nodes[side]
        numbering = np.concatenate([inner, count + np.arange(len(sole.points))])
        cells.append(numbering[sole.cells])
        points.append(sole.points)
        matter.append(np.column_stack([sole.young, sole.poisson]))
        count += len(sole.points)
    fixed = np.ones((count, 3), dtype=bool)
    fixed[: len(subdomain.nodes)] = subdomain.fixed
    return _model(subdomain.name, np.vstack(points), np.vstack(cells), np.vstack(matter), fixed=fixed,
                  trace=boundary_dofs(scene, subdomain, sides), code=subdomain.code,
                  origin=_origin(scene, subdomain.nodes, subdomain.cells))


def body_model(scene: Scene, subdomain: Subdomain) -> Model:
    """The subdomain's own mesh, without soles."""
    return _model(subdomain.name, scene.mesh.nodes[subdomain.nodes], subdomain.connectivity, _moduli(scene, subdomain.material),
                  fixed=subdomain.fixed, code=subdomain.code, origin=_origin(scene, subdomain.nodes, subdomain.cells))


def both_alike(scene: Scene, index: int, pair: SolePair) -> bool:
    """Whether the sole of an interface is one and the same stiffness on both sides: not so where a side takes its diagonal,
    as parts do whose mesh is not ours and which remember load steps."""
    return pair[0] is pair[1] and not any(
        s.foreign and s.remembers for s in (scene.subdomains[e] for e in scene.interfaces[index].subdomains))


def sole_models(scene: Scene, soles: Sequence[SolePair]) -> list[tuple[Model, tuple[int, int]]]:
    """One model per different sole, with the (interface, side) it belongs to; interfaces without soles are left out."""
    models = []
    for interface, pair in zip(scene.interfaces, soles):
        for side in () if pair is None else (0,) if both_alike(scene, interface.index, pair) else (0, 1):
            sole = pair[side]
            nodes = np.vstack([scene.side_points(interface, side), sole.points])
            models.append((_model(f"sole of {interface.name}", nodes, sole.cells, np.column_stack([sole.young, sole.poisson]),
                       code=scene.subdomains[interface.subdomains[side]].code), (interface.index, side)))
    return models


@dataclass
class Rim:
    """The part of a subdomain that touches its interfaces and clamped nodes.

    model : the tets with at least one such node, as a model
    nodes : (r,) int, local node index in the subdomain of each of the model's nodes
    """

    model: Model
    nodes: np.ndarray


def rim_model(scene: Scene, subdomain: Subdomain, sides: Sequence[tuple[int, int]]) -> Rim:
    """The rim of a subdomain; its stiffness has complete rows for interface and clamped dofs."""
    touched = subdomain.fixed.any(axis=1)
    for index, side in sides:
        touched[scene.interfaces[index].nodes[side]] = True
    chosen = touched[subdomain.connectivity].any(axis=1)
    if subdomain.foreign and chosen.any():  # its stiffness couples all of its joints
        chosen[:] = True
    nodes, cells = np.unique(subdomain.connectivity[chosen], return_inverse=True)
    model = _model(f"rim of {subdomain.name}", scene.mesh.nodes[subdomain.nodes[nodes]],
                   cells.reshape(-1, subdomain.connectivity.shape[1]), _moduli(scene, subdomain.material[chosen]), code=subdomain.code,
                   origin=_origin(scene, subdomain.nodes[nodes], subdomain.cells[chosen]))
    return Rim(model, nodes)


def whole_model(scene: Scene) -> Model:
    """The undecomposed problem as one model, for the reference solution."""
    mesh = scene.mesh
    return _model("the whole structure", mesh.nodes, mesh.cells, _moduli(scene, scene.cell_material), fixed=scene.fixed,
                  origin=_origin(scene, np.arange(len(mesh.nodes)), np.arange(len(mesh.cells))))


def _model(name: str, nodes: np.ndarray, cells: np.ndarray, matter: np.ndarray, **more) -> Model:
    """A model of tets whose (E, ν) are ``matter`` (m, 2); nothing clamped and no traces unless said otherwise."""
    if len(matter) and (matter == matter[0]).all():
        region, materials = np.zeros(len(matter), dtype=int), matter[:1].copy()
    else:  # as complex numbers: sorting rows is ten times slower
        materials, region = np.unique(np.ascontiguousarray(matter).view(complex).ravel(), return_inverse=True)
        materials = materials.view(float).reshape(-1, 2)
    return Model(name, nodes, cells, region, materials, **{"fixed": np.zeros((len(nodes), 3), bool), "trace": np.empty(0, int), **more})


def _origin(scene: Scene, nodes: np.ndarray, cells: np.ndarray) -> Origin:
    return Origin(nodes, cells, scene.mesh.volume, scene.mesh.volumes)


def _moduli(scene: Scene, material: np.ndarray) -> np.ndarray:
    """(m, 2) E and ν of tets of these materials (m,)."""
    return np.array([[m.young, m.poisson] for m in scene.materials])[material].reshape(-1, 2)
