"""The black box that a configuration asks for: codes are found, started, and put behind the layers that save them work."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import copy

import numpy as np

from orchestrator.blackbox.codes.finding import find_codes
from orchestrator.blackbox.layers.guarded import GuardedCode
from orchestrator.blackbox.layers.shared import SharedModels
from orchestrator.blackbox.models.extended import body_model
from orchestrator.blackbox.pool.pool import Pool
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.config.blackbox import CodeSettings
from orchestrator.savings import Savings
from orchestrator.scene.model import Scene


def make_blackbox(settings: CodeSettings | Sequence[CodeSettings], used: Iterable[int] | None = None) -> BlackBox:
    """A pool of all codes, whose answers are judged as they arrive.

    Parameters
    ----------
    settings : one, or the entries of a list, to which ``Model.code`` refers
    used : which entries of a list have a model; default all

    Raises
    ------
    InputError : a code that is not installed; nothing has been started then
    BlackBoxError : its processes do not start
    """
    codes = find_codes(settings if isinstance(settings, Sequence) else [settings], used)
    guarded = {number for number, code in codes.items() if code.guarded}
    return GuardedCode(Pool(codes), guarded) if guarded else Pool(codes)


def with_layers(blackbox: BlackBox, skip, workers: int, steps: int, savings: Savings) -> BlackBox:
    """The black box behind the layers that ``method.skip`` allows.

    Parameters
    ----------
    skip : ``method.skip`` of a configuration: congruent, repeated
    workers : processes behind the black box
    steps : load steps that are solved together
    savings : where what is saved is noted
    """
    return SharedModels(blackbox, congruent=skip.congruent, repeated=skip.repeated, workers=workers, steps=steps, savings=savings)


def with_own_loads(scene: Scene, settings: Sequence[CodeSettings]) -> Scene:
    """The scene with the loads that codes' own models have beside those of the YAML: heat, own weight, whatever a form says.

    They are asked for once, before anything is decomposed: energies, reactions and the error bound then know them like any
    others. It is another scene, so that the first may be solved again.

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
    own = [s for s in scene.subdomains if s.code in asked]
    with Pool(find_codes(settings, asked)) as pool:
        found = pool.own_loads([body_model(scene, s) for s in own], scene.steps)
    for s, forces in zip(own, found):
        forces = forces.reshape(scene.steps, -1, 3)
        s.loads = s.loads + forces
        np.add.at(scene.loads, (slice(None), s.nodes), forces)
    return scene
