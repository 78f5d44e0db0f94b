"""Errors that nobody has foreseen: told in one message, with what to report."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from contextlib import contextmanager

from orchestrator.errors import InputError, InternalError, OrchestratorError, lacks_memory
from orchestrator.parallel.team import Elsewhere, Team
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.subscribers.checkpoint import saved

NAME = "traceback.txt"


@contextmanager
def unexpected(folder: ResultsFolder, team: Team) -> Iterator[None]:
    """Turns what is no error of the user's into an ``InternalError``, its traceback into a file of the folder.

    Memory that is exhausted is a want of memory, not a bug: it is said so.
    """
    try:
        yield
    except (Exception, Elsewhere) as error:
        cause = team.cause(error)
        if isinstance(cause, OrchestratorError) or not isinstance(cause, Exception):
            raise
        text, where = "".join(traceback.format_exception(cause)), "standard error"
        try:
            where = str(folder.write(NAME, text))
        except InputError:
            traceback.print_exception(cause)
        what = f"{type(cause).__name__}: {cause}".rstrip(": ")
        raise InternalError(what, where, saved(folder), lacks_memory(cause)) from error
