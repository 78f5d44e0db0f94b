"""Requests about a mesh that is not kept, the same for every transport of messages."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import Model
from orchestrator.blackbox.transport import messages
from orchestrator.blackbox.transport.messages import Buffers, Reply


class Asking:
    """Part of a worker: a transport derives from it, and says in ``_asked`` how a request finds its reply."""

    def stiffness(self, index: int, model: Model) -> sp.csr_array:
        """As ``Worker`` says."""
        model = self.code.told(model)
        return self._about(index, model, messages.stiffness(index, model), "the stiffness matrix was not obtained",
                           lambda reply: messages.check_stiffness(reply, index, model.fixed.size))

    def own_loads(self, index: int, model: Model, steps: int) -> np.ndarray:
        """As ``Worker`` says."""
        model = self.code.told(model)
        return self._about(index, model, messages.own_loads(index, model, steps), "its own loads were not obtained",
                           lambda reply: messages.check_own_loads(reply, index, steps, model.fixed.size))

    def _about(self, index: int, model: Model, request: Buffers, otherwise: str, read: Callable[[Reply], Any]) -> Any:
        path = self.write_mesh(index, model)
        try:
            return self._asked(index, model.name, request, otherwise, read)
        finally:
            path.unlink(missing_ok=True)

    def _asked(self, index: int, name: str, request: Buffers, otherwise: str, read: Callable[[Reply], Any]) -> Any:
        """What ``read`` makes of the reply to a request about the mesh that is written; ``otherwise`` tells a failure."""
        raise NotImplementedError
