"""The joints of a part, read by whoever knows its kind; and what a configuration would have started, told unless it is asked for."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from orchestrator.config.model import Config
from orchestrator.config.parts import ForeignPart
from orchestrator.config.parts import OnePart
from orchestrator.errors import InputError, KeyPath, Problem
from orchestrator.scene.foreign.joints import Joints

# kind → module of this folder with a function joints(part, path, name)
READERS = {"matrix": "tables", "deck": "deck", "program": "program"}


def read_joints(part: ForeignPart, path: KeyPath, name: str) -> Joints:
    """The joints of a part.

    path : of its entry in the YAML; name : of the part
    Raises InputError: files that cannot be read, joints that are none
    """
    return import_module(f"orchestrator.scene.foreign.{READERS[part.kind]}").joints(part, path, name)


OPTION = "--run-programs"


def not_asked(config: Config) -> list[str]:
    """A sentence for each program, interpreter and form that is not run without ``OPTION``, and what is not checked therefore."""
    programs = [f"'{part.name}': {Path(part.program.run).name} is not started, which alone knows its joints: its interfaces, its "
                "stiffness and whether all is held" for part in config.parts or [] if part.program]
    pythons = dict.fromkeys(f"whether {entry.python} has what {entry.code} needs: it is not started"
                            for entry in config.codes if getattr(entry, "python", None))
    forms = dict.fromkeys(f"whether FreeFEM takes {Path(entry.form).name}: a form may run programs" for entry in config.codes
                          if getattr(entry, "form", None))
    return [f"not checked: {sentence} ({OPTION} does)" for sentence in [*programs, *pythons, *forms]]


def check_asked(parts: list[OnePart]) -> None:
    """Raises InputError for programs among the parts."""
    if problems := [Problem(("parts", i, "program", "run"), f"'{part.name}': a program, and nobody has asked for it to be started",
                            f"the user's word: {OPTION}, in Python build_scene(config, run_programs=True)",
                            "look at the program first, if it is not yours; orchestrator run starts it")
                    for i, part in enumerate(parts) if part.program is not None]:
        raise InputError(problems)
