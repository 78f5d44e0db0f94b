"""A process that makes the finer meshes of CAD models: where gmsh ends it, or the kernel for want of memory, results are still there."""

from __future__ import annotations

import signal
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from orchestrator.apart import Apart, Died
from orchestrator.config.model import Config
from orchestrator.errors import wrong


class Mesher(Apart):
    """The process; ready, with gmsh, by the time that the first mesh is solved on."""

    def __init__(self) -> None:
        super().__init__(["orchestrator.scene.mesh.solids", "gmsh"])

    def __call__(self, make: Callable[..., Any], *given: object) -> Any:
        """What ``make(*given)`` returns, called there; raises what that raises, and InputError where the process ends."""
        self.begin(make, *given)
        try:
            return self.finish()
        except Died as died:
            how = "did not begin" if died.code is None else f"was ended by {signal.Signals(-died.code).name}" if died.code < 0 else \
                f"has ended with {died.code}"
            raise wrong(("mesh",), f"the process that makes meshes {how}", "a mesh: gmsh fails on few models, the kernel ends what takes more "
                        "memory than there is", "set the limits elements or memory of method.accuracy, or mesh that part by hand") from None


def mesher_for(config: Config) -> AbstractContextManager[Mesher | None]:
    """One where there is a CAD model to be meshed anew; other meshes are refined without libraries that may fail."""
    sources = [config.mesh] if config.mesh else [part.source for part in config.parts]
    return Mesher() if any(source is not None and source.step is not None for source in sources) else nullcontext()
