"""Solvers that a process of its own imports, and nothing that they do not need."""

from orchestrator.blackbox.codes.adapter import Adapter
from orchestrator.blackbox.codes.template import Solver


class Softened(Solver):
    """The template's solver with all moduli divided by ``softening``."""

    translation_invariant = own_matter = True

    def __init__(self, softening: float):
        self.softening = softening

    def stiffness(self, model):
        return super().stiffness(model) / self.softening


class Named(Adapter):
    """All that a name takes: this class, and a line."""

    translation_invariant = True

    def stiffness(self, model):
        return Solver().stiffness(model)
