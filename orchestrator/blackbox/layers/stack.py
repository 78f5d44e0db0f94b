"""The layers that save a black box work, one on the other."""

from __future__ import annotations

from orchestrator.blackbox.layers.compliance import Compliance
from orchestrator.blackbox.layers.shared import SharedModels
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.savings import Savings


def with_layers(blackbox: BlackBox, skip, workers: int, steps: int, savings: Savings) -> BlackBox:
    """The black box behind the layers that ``method.skip`` allows.

    Parameters
    ----------
    skip : ``method.skip`` of a configuration: congruent, repeated, compliance
    workers : processes behind the black box
    steps : load steps that are solved together
    savings : where what is saved is noted
    """
    if skip.compliance:
        blackbox = Compliance(blackbox, workers=workers, savings=savings)
    return SharedModels(blackbox, congruent=skip.congruent, repeated=skip.repeated, explicit=skip.compliance,
                        workers=workers, steps=steps, savings=savings)
