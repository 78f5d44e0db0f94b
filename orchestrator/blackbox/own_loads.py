"""Loads that a code's own model has beside those of the YAML: heat, own weight, whatever a form or a solver says.

They are asked for once, before anything is decomposed, and added to the scene's: energies, reactions and the error bound
then know them like any others.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from orchestrator.blackbox.codes.finding import find_codes
from orchestrator.blackbox.models.extended import body_model
from orchestrator.blackbox.pool.pool import Pool
from orchestrator.config.blackbox import CodeSettings
from orchestrator.scene.model import Scene


def with_own_loads(scene: Scene, settings: Sequence[CodeSettings]) -> Scene:
    """The scene with them among its loads and its subdomains': another one, so that the first may be solved again.

    Parameters
    ----------
    settings : the entries of ``blackbox``

    Raises
    ------
    InputError : a code that is not installed
    BlackBoxError : its processes do not start, or answer nonsense
    """
    asked = {s.code for s in scene.subdomains if settings[s.code].brings_loads}
    if not asked:
        return scene
    scene = copy(scene)
    scene.loads, scene.subdomains = scene.loads.copy(), [copy(s) for s in scene.subdomains]
    for index, code in find_codes(settings, asked).items():
        own = [s for s in scene.subdomains if s.code == index]
        with Pool(code) as pool:
            found = pool.own_loads([body_model(scene, s) for s in own], scene.steps)
        for s, forces in zip(own, found):
            forces = forces.reshape(scene.steps, -1, 3)
            s.loads = s.loads + forces
            np.add.at(scene.loads, (slice(None), s.nodes), forces)
    return scene
