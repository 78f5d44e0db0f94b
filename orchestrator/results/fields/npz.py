"""fields.npz: all fields of a run for programs, written and read back.

| name | array |
|---|---|
| `nodes`, `cells`, `subdomain`, `lame`, `displacement` | as in ``Fields`` |
| `discretisation_error`, `believed` | as there, where it was estimated, where not all is to be
  believed |
| `part`, `parts`, `joined` | as there: parts, their names, and which nodes are one where interfaces
  open |
| `displacement_sides_0`, `…_1`, … | (steps, n_E, 3) per subdomain, where interfaces open |
| `gap`, `initial_gap`, `slip`, `pressure`, `friction_traction`, `status` | as in
  ``InterfaceFields``, where interfaces open |
| `shift_normal`, `shift_tangential` | as there, where they are known |
| `own_…` | the laws' own variables, so `own_damage`, (steps, N) |
| `interface_…` | its other arrays, so `interface_nodes` for `nodes` |
"""

from __future__ import annotations

import os
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

import numpy as np

from orchestrator.errors import wrong
from orchestrator.method.delivery.interface_fields import InterfaceFields, SHIFTS, UNWRITTEN
from orchestrator.folders import read_arrays
from orchestrator.results.fields.fields import Fields
from orchestrator.results.folder import DIRECTORY_KEY
from orchestrator.scene.mesh.checks import check_memory

NAME = "fields.npz"
_ALWAYS = ("nodes", "cells", "subdomain", "lame", "displacement")
_OWN_NAMES = (*_ALWAYS, "discretisation_error", "part", "joined", "believed", "thermal")
SIDES, _OWN = "displacement_sides_", "own_"  # + index of the subdomain; + name of a law's variable
# of ``InterfaceFields``, those whose names say what they are of: no body has them
_ONLY_THERE = {"initial_gap", "gap", "slip", "pressure", "friction_traction", "status", *SHIFTS}
_INTERFACE = {f.name: f.name if f.name in _ONLY_THERE else f"interface_{f.name}"
              for f in fields(InterfaceFields) if f.name not in ("own", *UNWRITTEN)}


def write_npz(path: Path, written: Fields) -> None:
    """Write the file, uncompressed (compression would take longer than the solution)."""
    found = {name: getattr(written, name) for name in _OWN_NAMES}
    found |= {f"{SIDES}{e}": u for e, u in enumerate(written.sides or ())}
    if (met := written.interfaces) is not None:
        found |= {key: getattr(met, name) for name, key in _INTERFACE.items()}
        found |= {_OWN + name: x for name, x in met.own.items()}
    found["parts"] = np.array(written.parts, str)
    with open(path, "wb") as file:
        np.savez(file, **{name: x for name, x in found.items() if x is not None})


def read_npz(directory: str | os.PathLike[str]) -> Fields | None:
    """Return the fields of a results folder; None if the run was asked for none.

    Raises InputError: fields.npz is there but cannot be read, or does not fit in memory
    """
    path = Path(directory) / NAME
    if not path.is_file():
        return None
    try:
        with zipfile.ZipFile(path) as packed:  # a few bytes may unpack to any size
            check_memory(sum(entry.file_size for entry in packed.infolist()), DIRECTORY_KEY,
                         str(path), "check the file: is it this run's?")
        data = read_arrays(path)
        sides = [data[f"{SIDES}{e}"] for e in range(sum(name.startswith(SIDES) for name in data))]
        return Fields(**{name: data[name] for name in _OWN_NAMES if name in data},
                      sides=sides or None, interfaces=_interfaces(data),
                      parts=tuple(data["parts"].tolist()))
    except (OSError, ValueError, KeyError, TypeError, EOFError, MemoryError, zlib.error,
            zipfile.BadZipFile) as error:
        raise wrong(DIRECTORY_KEY, f"{path} cannot be read: {error}",
                    f"arrays {', '.join(_ALWAYS)}, as a run writes them",
                    "run the configuration again") from error


def _interfaces(data: Mapping[str, np.ndarray]) -> InterfaceFields | None:
    """None where all interfaces are perfect."""
    if _INTERFACE["nodes"] not in data:
        return None
    own = {name.removeprefix(_OWN): x for name, x in data.items() if name.startswith(_OWN)}
    return InterfaceFields(**{name: data[key] for name, key in _INTERFACE.items() if key in data},
                           own=own)
