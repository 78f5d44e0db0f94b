"""Everything that installation can do beforehand: all loops of contact compiled, packages named
that are not there.

The loops are compiled by the first few iterations of the smallest scene that calls all of them.
"""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path

from orchestrator.compiled import kept_in
from orchestrator.config.load import load_config
from orchestrator.method.sparse import cholmod
from orchestrator.optional import absent, command, WANTED
from orchestrator.parallel import petsc
from orchestrator.solving import solve

SCENE = Path(__file__).with_suffix(".yaml")  # solved as far as it calls every loop


def compiled_once() -> str:
    """Compile the loops if that has not been done for this package, Python and compiler; return a
    line that tells where they are.
    """
    done, begin = kept_in() / "done", time.perf_counter()
    if not done.exists():
        solve(load_config(SCENE).config)
        with suppress(OSError):
            done.touch()
    return f"loops of contact: compiled in {time.perf_counter() - begin:.1f} s, kept in {kept_in()}"


def examine() -> list[str]:
    """List Python's packages and libraries, a line each, once all loops have been compiled."""
    lines = [f"without {name}: {use}; {command(name)}" for name, (_, use) in WANTED.items()
             if absent(name)]
    library = cholmod.library()
    lines.append(
        "without CHOLMOD: SuperLU factorises, slower in large scenes; Debian: libcholmod3, conda: "
        "suitesparse" if library is None
                 else f"CHOLMOD: {library._name}")
    found = petsc.library()
    lines.append(f"without PETSc, which spreads macro problems of many ranks: {found}"
                 if isinstance(found, str)
                 else f"PETSc {'.'.join(map(str, found.Sys.getVersion()))} with MUMPS: "
                 f"{found.__file__}")
    return lines if absent("numba") else [*lines, compiled_once()]
