"""Work that another thread does while this one goes on: what is asked of the codes, mostly waiting."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Meanwhile(Generic[T]):
    """Begins at once. It ends with the process, even where nobody waits for it: an interrupt is not held up.

    Parameters
    ----------
    work : what it does; it must not speak to other ranks
    """

    def __init__(self, work: Callable[[], T]):
        self._work, self._answer, self._error = work, None, None
        self._thread = threading.Thread(target=self._run, name="meanwhile", daemon=True)
        self._thread.start()

    def result(self) -> T:
        """Waits for what the work returns; raises what it raises."""
        self._thread.join()
        if self._error is not None:
            raise self._error
        return self._answer

    def _run(self) -> None:
        try:
            self._answer = self._work()
        except BaseException as error:  # noqa: BLE001 - handed over to who waits
            self._error = error
        self._work = None  # and what it holds
