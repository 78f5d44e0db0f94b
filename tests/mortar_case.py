"""Parts meshed on their own, for the tests: boxes put together and turned, and fields that they must reproduce."""

import numpy as np
from in_process import IN_PROCESS
from monolithic import Monolithic

from orchestrator.blackbox.start import make_blackbox
from orchestrator.config import Config
from orchestrator.config.parts import Rotate
from orchestrator.scene.build import build_scene
from orchestrator.scene.mesh.placing import turned
from orchestrator.scene.model import Scene

YOUNG, POISSON = 200e3, 0.3
# about no axis in particular
TURN = {"axis": [1.0, 2.0, -0.5], "degrees": 37.0, "about": [0.3, 0.1, -0.2]}
STRESSES = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "yz": (1, 2), "zx": (2, 0)}
NORMALS = {f"{axis}{end}": sign * np.eye(3)[k] for k, axis in enumerate("xyz") for end, sign in (("min", -1.0), ("max", 1.0))}

# name: size, lowest corner
TWO = {"a": ([1, 1, 0.5], [0, 0, 0]), "b": ([1, 1, 0.5], [0, 0, 0.5])}
THREE = {"a": ([2, 1, 0.5], [0, 0, 0]), "b": ([0.9, 1, 0.5], [0, 0, 0.5]), "c": ([1.1, 1, 0.5], [0.9, 0, 0.5])}  # a T
FOUR = {"a": ([1, 1, 1], [0, 0, 0]), "b": ([1, 1, 1], [1, 0, 0]), "c": ([1, 1, 1], [0, 0, 1]), "d": ([1, 1, 1], [1, 0, 1])}


def free_mesh(size, h):
    """Tetrahedra as the mesher likes them."""
    return {"polycrystal": {"grains": 1, "size": size, "h": h}}


def blocks(bodies: dict, meshes: dict, law=None, turn=TURN, element="P1", stress=None, held=None, **changes) -> Config:
    """Boxes in a constant state of stress, turned as a whole.

    Parameters
    ----------
    bodies : name → (size, lowest corner); meshes : name → what is under ``mesh``
    law : entry of ``interfaces`` without ``between``
    stress : (3, 3) before the turn; tractions on all faces that are outside
    held : boundary entries instead of one small face
    """
    parts = [{"name": name, "mesh": meshes[name], "move": {"translate": list(map(float, corner))}} for name, (_, corner) in bodies.items()]
    if turn:
        for part, (_, corner) in zip(parts, bodies.values()):
            # shift, then turn: as a turn first, then the shift turned
            part["move"] = {"rotate": [turn], "translate": (there(np.array([corner], float), turn) - there(np.zeros((1, 3)), turn))[0].tolist()}
    boundary = list(held or [])
    if stress is not None:
        R = there(np.eye(3), turn) - there(np.zeros((1, 3)), turn) if turn else np.eye(3)  # rows: turned axes
        sigma = R.T @ stress @ R
        boundary += [{"on": f"{name}/{side}", "traction": (sigma @ (normal @ R)).tolist()}
                     for name in bodies for side, normal in NORMALS.items() if outside(bodies, name, normal)]
    return Config.model_validate({
        "name": "blocks", "parts": parts, "subdomains": "groups", "materials": [{"young": YOUNG, "poisson": POISSON}],
        "boundary": boundary, "interfaces": [{"law": "perfect", **(law or {})}],
        "blackbox": {**IN_PROCESS, "element": element}, "method": {"tolerance": {"error": 1e-11}}, **changes})


def there(points, turn):
    return turned(points, Rotate.model_validate(turn)) if turn else points


def outside(bodies, name, normal) -> bool:
    """Whether a box's face has no other box before its middle."""
    size, corner = (np.array(x, float) for x in bodies[name])
    before = corner + size / 2 + normal * (size / 2 + 0.01)
    return not any((before > np.array(c)).all() and (before < np.array(c) + s).all() for s, c in bodies.values())


def strain_of(stress):
    """(3, 3)"""
    return ((1 + POISSON) * stress - POISSON * np.trace(stress) * np.eye(3)) / YOUNG


def patch_scene(made: Config, gradient: np.ndarray) -> Scene:
    """The scene, held on one facet so that u = gradient · x is its solution.

    Parameters
    ----------
    gradient : (3, 3) of the displacement
    """
    scene = build_scene(made)
    exact = scene.mesh.nodes @ gradient.T
    for s in scene.subdomains:
        s.prescribed[:] = np.where(s.fixed, exact[s.nodes], 0.0)
    scene.prescribed[:] = np.where(scene.fixed, exact, 0.0)
    return scene


def one_piece(scene: Scene, made: Config) -> Monolithic:
    with make_blackbox(made.codes[0]) as blackbox:
        return Monolithic(scene, blackbox)
