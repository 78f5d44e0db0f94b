"""Knowledge of a whole scene where a part of it is at hand: numbers per subdomain and
interface, what is difficult, what is near.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Beside:
    """Two volumes with faces opposite each other, within reach, that belong to no interface.

    gap : a sentence on their gap; empty where they touch
    said : a sentence on what may come of it; empty where something connects the two and that is
        enough
    """

    gap: str
    said: str = ""


@dataclass(frozen=True)
class Difficulty:
    """Difficulties of a scene.

    mixed_moduli : (interfaces,) bool, stiff and soft cells side by side
    incompressible_or_slender : (subdomains,) bool, nearly incompressible, or slender or flat
    soft : (subdomains,) bool, those of them that affine macro functions do not do for
    softest : (subdomains,) bool, those that coarse nodes do not do for either
    slenderness : (subdomains,) largest over smallest extent
    """

    mixed_moduli: np.ndarray
    incompressible_or_slender: np.ndarray
    soft: np.ndarray
    softest: np.ndarray
    slenderness: np.ndarray


@dataclass(frozen=True)
class Overview:
    """Overview that a part of a scene has of all of it: a number per subdomain or interface, and
    what is
    one for all.

    sizes : (subdomains,) as of the ``Scene``
    loose : (subdomains,) bool, bodies that nothing but contact could hold
    difficulty : what is difficult about the interfaces and subdomains
    matched, conforming : (interfaces,) bool, and bool, as of the ``Scene``
    supports : what holds the subdomains as rigid bodies, see ``conditions.supports``
    box : (2, 3) around all nodes of the mesh
    """

    sizes: np.ndarray
    loose: np.ndarray
    difficulty: Difficulty
    matched: np.ndarray
    conforming: bool
    supports: object
    box: np.ndarray
