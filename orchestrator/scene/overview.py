"""What is known of a whole scene where a part of it is at hand: numbers per subdomain and interface, what is difficult, what is near."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Beside:
    """Two volumes with faces opposite each other, within reach, that belong to no interface.

    gap : a sentence on their gap; empty where they touch
    said : a sentence on what may come of it; empty where something connects the two and that is enough
    enough : whether it is; where it is not known, in a piece of a mesh, it is said, and ``refused`` is that an entry asks for a joint there
    """

    gap: str
    said: str = ""
    enough: bool = True
    refused: bool = False


@dataclass(frozen=True)
class Difficulty:
    """What is difficult about a scene.

    mixed_moduli : (interfaces,) bool, stiff and soft cells side by side
    incompressible_or_slender : (subdomains,) bool, nearly incompressible, or slender or flat
    soft : (subdomains,) bool, those of them that affine macro functions do not do for
    slenderness : (subdomains,) largest over smallest extent
    """

    mixed_moduli: np.ndarray
    incompressible_or_slender: np.ndarray
    soft: np.ndarray
    slenderness: np.ndarray


@dataclass(frozen=True)
class Overview:
    """What a part of a scene knows of all of it: a number per subdomain or interface, and what is one for all.

    sizes : (subdomains,) as of the ``Scene``
    loose : (subdomains,) bool, bodies that nothing but contact could hold
    difficulty : what is difficult about the interfaces and subdomains
    nodes : (subdomains,) int, how many each has
    matched : (interfaces,) bool, as of the ``Scene``
    met : (interfaces,) int, nodes on side 1
    used : (materials,) bool, which of them some cell has
    supports : what holds the subdomains as rigid bodies, see ``conditions.supports``
    cautions : what a user should know before the scene is solved
    mesh_nodes : nodes of the mesh; box : (2, 3) around them
    prints : (subdomains, 32) as of the ``Scene``
    rank_of : (subdomains,) int, the rank that has made each; None: one has made all
    """

    sizes: np.ndarray
    loose: np.ndarray
    difficulty: Difficulty
    nodes: np.ndarray
    matched: np.ndarray
    met: np.ndarray
    used: np.ndarray
    supports: object
    cautions: list[str]
    mesh_nodes: int
    box: np.ndarray
    prints: np.ndarray
    rank_of: np.ndarray | None = None
