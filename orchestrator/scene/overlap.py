"""Soles made of the neighbours' own elements: for matter or meshes that a layer of prisms imitates badly.

The first row of elements of both sides is copied, half the modulus each, and clamped behind. What the
sole feels at a node is then a share of what the elements there feel, whatever their matter, their
shape and their order along the interface: with stiff and soft cells side by side (contrast 1:1000)
a sole that follows the facets alone misses the stiff cells that touch the interface by an edge.
The Schur complement of a subdomain never exceeds its own first row clamped behind, so that with modulus
ratio r and at most n interfaces meeting in an element S ≤ (2 n / r) k, whatever the contrast: there is
nothing that the sole is too soft for.
"""

from __future__ import annotations

import numpy as np

from orchestrator.scene.model import Interface, Scene


def overlap(scene: Scene, interface: Interface, ratio: float) -> tuple[np.ndarray, ...]:
    """The sole of both sides of an interface whose sides share their nodes.

    Parameters
    ----------
    ratio : ``method.sole.modulus_ratio``; each side's copy has half of it times its own modulus

    Returns
    -------
    points, cells, young, poisson : of a ``Sole``
    """
    count = len(interface.global_nodes)
    number = np.full(len(scene.mesh.nodes), -1)
    number[interface.global_nodes] = np.arange(count)
    matter = np.array([[m.young, m.poisson] for m in scene.materials])
    points, cells, copied = [], [], []
    for e in interface.subdomains:
        row = first_row(scene, interface, e)
        corners = scene.mesh.cells[row]
        behind = np.setdiff1d(corners, interface.global_nodes)
        own = number.copy()
        own[behind] = count + np.arange(len(behind))
        count += len(behind)
        points.append(scene.mesh.nodes[behind])
        cells.append(own[corners])
        copied.append(matter[scene.cell_material[row]])
    young, poisson = np.vstack(copied).T
    return np.vstack(points), np.vstack(cells), 0.5 * ratio * young, poisson


def first_row(scene: Scene, interface: Interface, subdomain: int) -> np.ndarray:
    """(r,) global cells of a subdomain that touch an interface, be it in a single node."""
    on = np.zeros(len(scene.mesh.nodes), dtype=bool)
    on[interface.global_nodes] = True
    cells = scene.subdomains[subdomain].cells
    return cells[on[scene.mesh.cells[cells]].any(axis=1)]
