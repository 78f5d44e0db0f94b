"""A process that draws, made ready while the run computes: a graphics library that finds no display
may end its process.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

from orchestrator.apart import Apart, Died
from orchestrator.errors import InputError
from orchestrator.optional import absent, command, DRAWING

UNDRAWN = (
    "The results are complete but for figures: orchestrator report draws them in the results "
    "folder.")


class CannotDraw(Exception):
    """The process has ended without an answer, or has been given up."""


class Artist(Apart):
    """The process; as a context manager it is ended on leaving."""

    def __init__(self) -> None:
        super().__init__(["orchestrator.results.figures.figures"])

    def finish(self, patience: float = 300.0) -> object:
        """The result of the last function that was asked for.

        Raises CannotDraw: the process crashes, as where VTK finds neither a display, EGL nor
        OSMesa, or takes longer than ``patience`` seconds
        Raises InputError: from the function: disk full or folder not writable
        Raises KeyboardInterrupt: saying what there is
        """
        try:
            return super().finish(patience)
        except InputError:
            raise
        except KeyboardInterrupt as error:
            raise KeyboardInterrupt(UNDRAWN) from error
        except Died as died:
            raise CannotDraw(f"the process that draws was not done after {patience:g} s"
                             if died.late else
                             "VTK cannot draw on this machine") from None
        except Exception as error:
            raise CannotDraw(f"drawing has failed: {error!r}") from error


def artist_for(figures: object) -> AbstractContextManager[Artist | None]:
    """The artist for what a configuration asks for: none where that is nothing, or the packages are
    not there (``no_figures``).
    """
    return Artist() if figures and not absent(*DRAWING) else nullcontext()


def no_figures() -> list[str]:
    """A warning where packages that draw are not there."""
    lacking = absent(*DRAWING)
    return [
        f"no figures: {', '.join(lacking)} not installed; {command(lacking[0])}, then "
        "orchestrator report"] if lacking else []


def drawn(draw: Callable[..., object], *job: object) -> object:
    """Result of ``draw(*job)``, called in a process of its own; errors as from
    ``Artist.finish``.
    """
    with Artist() as artist:
        artist.begin(draw, *job)
        return artist.finish()
