"""fields.npz: all fields of a run for programs, written and read back.

| name | array |
|---|---|
| `nodes`, `cells`, `subdomain`, `lame`, `displacement` | as in ``Fields`` |
| `discretisation_error`, `believed` | as there, where it was estimated, where not all is to be
believed | | `part`, `parts`, `joined` | as there: parts, their names, and which nodes are one where
interfaces open | | `displacement_sides_0`, `…_1`, … | (steps, n_E, 3) per subdomain, where
interfaces open | | `gap`, `initial_gap`, `slip`, `pressure`, `friction_traction`, `status` | as in
``InterfaceFields``, where interfaces open | | `shift_normal`, `shift_tangential` | as there, where
they are known | | `own_…` | the laws' own variables, so `own_damage`, (steps, N) |
| `interface_…` | its other arrays, so `interface_nodes` for `nodes` |
"""

from __future__ import annotations

import os
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
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
_IF_THERE = ("discretisation_error", "part", "joined", "believed", "thermal")
SIDES = "displacement_sides_"  # + index of the subdomain
# no body has them
_ONLY_THERE = {"initial_gap", "gap", "slip", "pressure", "friction_traction", "status"}
_INTERFACE = {f.name: f.name if f.name in _ONLY_THERE else f"interface_{f.name}"
              for f in fields(InterfaceFields)
              if f.name not in ("own", *SHIFTS, *UNWRITTEN)}
_OWN = "own_"


def arrays(written: Fields) -> Iterator[tuple[str, np.ndarray]]:
    """Names and arrays of the file."""
    yield from ((name, getattr(written, name)) for name in _ALWAYS)
    yield from ((f"{SIDES}{e}", u) for e, u in enumerate(written.sides or ()))
    if (met := written.interfaces) is not None:
        yield from ((key, getattr(met, name)) for name, key in _INTERFACE.items())
        yield from ((_OWN + name, x) for name, x in met.own.items())
        yield from ((name, x) for name in SHIFTS if (x := getattr(met, name)) is not None)
    yield from ((name, array) for name in _IF_THERE
                if (array := getattr(written, name)) is not None)
    yield "parts", np.array(written.parts, dtype=str)


def write_npz(path: Path, written: Iterable[tuple[str, np.ndarray]]) -> None:
    """Write names and arrays as ``np.savez`` does, uncompressed (compression would take longer than
    the solution).
    """
    with zipfile.ZipFile(path, "w") as file:
        for name, array in written:
            with file.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)


def read_npz(directory: str | os.PathLike[str]) -> Fields | None:
    """Fields of a results folder; None if the run was asked for none.

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
        return fields_from(data)
    except (OSError, ValueError, KeyError, EOFError, MemoryError, zlib.error,
            zipfile.BadZipFile) as error:
        raise wrong(DIRECTORY_KEY, f"{path} cannot be read: {error}",
                    f"arrays {', '.join(_ALWAYS)}, as a run writes them",
                    "run the configuration again") from error


def fields_from(data: Mapping[str, np.ndarray]) -> Fields:
    """Fields of the arrays of a file."""
    count = sum(name.startswith(SIDES) for name in data)
    return Fields(*(data[name] for name in _ALWAYS),
                  [data[f"{SIDES}{e}"] for e in range(count)] or None, _interfaces(data),
                  **{name: data[name] for name in _IF_THERE if name in data},
                  parts=tuple(data["parts"].tolist()))


def _interfaces(data: Mapping[str, np.ndarray]) -> InterfaceFields | None:
    """None where all interfaces are perfect."""
    if _INTERFACE["nodes"] not in data:
        return None
    own = {name.removeprefix(_OWN): data[name] for name in data if name.startswith(_OWN)}
    return InterfaceFields(**{name: data[key] for name, key in _INTERFACE.items()}, own=own,
                           **{name: data[name] for name in SHIFTS if name in data})
