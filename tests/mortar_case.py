"""Parts meshed on their own, for the tests: boxes put together and turned, and fields that they must reproduce."""

import numpy as np
from in_process import IN_PROCESS

from orchestrator.config.model import Config
from orchestrator.config.base import Rotate
from orchestrator.scene.mesh.sources import turned
from orchestrator.scene.model import Scene

YOUNG, POISSON = 200e3, 0.3
# about no axis in particular
TURN = {"axis": [1.0, 2.0, -0.5], "degrees": 37.0, "about": [0.3, 0.1, -0.2]}
# all six stresses, one per load step
SIX = np.array([[[10.0 * ((i, j) in ((a, b), (b, a))) for j in range(3)] for i in range(3)]
                for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))])
NORMALS = {f"{axis}{end}": sign * np.eye(3)[k] for k, axis in enumerate("xyz") for end, sign in (("min", -1.0), ("max", 1.0))}

# name: size, lowest corner
TWO = {"a": ([1, 1, 0.5], [0, 0, 0]), "b": ([1, 1, 0.5], [0, 0, 0.5])}
THREE = {"a": ([2, 1, 0.5], [0, 0, 0]), "b": ([0.9, 1, 0.5], [0, 0, 0.5]), "c": ([1.1, 1, 0.5], [0.9, 0, 0.5])}  # a T
FOUR = {"a": ([1, 1, 1], [0, 0, 0]), "b": ([1, 1, 1], [1, 0, 0]), "c": ([1, 1, 1], [0, 0, 1]), "d": ([1, 1, 1], [1, 0, 1])}


def free_mesh(size, h):
    """Tetrahedra as the mesher likes them."""
    return {"polycrystal": {"grains": 1, "size": size, "h": h}}


def blocks(bodies: dict, meshes: dict, law=None, turn=TURN, element="P1", stresses=None, held=None, **changes) -> Config:
    """Boxes in constant states of stress, turned as a whole.

    Parameters
    ----------
    bodies : name → (size, lowest corner); meshes : name → what is under ``mesh``
    law : entry of ``interfaces`` without ``between``
    stresses : (T, 3, 3) before the turn, one per load step; tractions on all faces that are outside
    held : boundary entries that come before these
    """
    parts = [{"name": name, "mesh": meshes[name], "move": {"translate": list(map(float, corner))}} for name, (_, corner) in bodies.items()]
    if turn:
        for part, (_, corner) in zip(parts, bodies.values()):
            # shift, then turn: as a turn first, then the shift turned
            part["move"] = {"rotate": [turn],
                            "translate": (there(np.array([corner], float), turn) - there(np.zeros((1, 3)), turn))[0].tolist()}
    boundary = list(held or [])
    if stresses is not None:
        R = axes(turn)
        boundary += [{"on": f"{name}/{side}", "traction": (R.T @ stresses @ normal).tolist()}
                     for name in bodies for side, normal in NORMALS.items() if outside(bodies, name, normal)]
    return Config.model_validate({
        "name": "blocks", "parts": parts, "subdomains": "groups", "materials": [{"young": YOUNG, "poisson": POISSON}],
        "boundary": boundary, "interfaces": [{"law": "perfect", **(law or {})}],
        "blackbox": {**IN_PROCESS, "element": element},
        "method": {"tolerance": {"law" if (law or {}).get("law", "perfect") != "perfect" else "error": 1e-11}}, **changes})


def there(points, turn):
    return turned(points, Rotate.model_validate(turn)) if turn else points


def outside(bodies, name, normal) -> bool:
    """Whether a box's face has no other box before its middle."""
    size, corner = (np.array(x, float) for x in bodies[name])
    before = corner + size / 2 + normal * (size / 2 + 0.01)
    return not any((before > np.array(c)).all() and (before < np.array(c) + s).all() for s, c in bodies.values())


def axes(turn) -> np.ndarray:
    """(3, 3) the turned unit vectors, row by row."""
    return there(np.eye(3), turn) - there(np.zeros((1, 3)), turn)


def gradients(stresses, turn) -> np.ndarray:
    """(T, 3, 3) strains of stresses, turned."""
    R = axes(turn)
    return R.T @ (((1 + POISSON) * stresses - POISSON * np.trace(stresses, axis1=1, axis2=2)[:, None, None] * np.eye(3)) / YOUNG) @ R


def off(scene: Scene, parts, strains) -> float:
    """How far displacements, per subdomain (T, n, 3), are from ε x, at most, over the largest."""
    exact = np.einsum("tij,nj->tni", strains, scene.mesh.nodes)
    return max(np.abs(np.asarray(u) - exact[:, s.nodes]).max() for u, s in zip(parts, scene.subdomains)) / np.abs(exact).max()
