"""The joints of a part, read by whoever knows its kind."""

from __future__ import annotations

from importlib import import_module

from orchestrator.config.foreign_parts import ForeignPart
from orchestrator.errors import KeyPath
from orchestrator.scene.foreign.joints import Joints

# kind → module of this folder with a function joints(part, path, name)
READERS = {"matrix": "tables", "deck": "deck", "program": "program"}


def read_joints(part: ForeignPart, path: KeyPath, name: str) -> Joints:
    """The joints of a part.

    Parameters
    ----------
    path : of its entry in the YAML; name : of the part

    Raises
    ------
    InputError : files that cannot be read, joints that are none
    """
    return import_module(f"orchestrator.scene.foreign.{READERS[part.kind]}").joints(part, path, name)
