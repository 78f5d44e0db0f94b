"""CalculiX as a black box: unmodified, one run per question, input decks in and files out."""

from orchestrator.blackbox.codes.calculix.code import CalculiX

__all__ = ["CalculiX"]
