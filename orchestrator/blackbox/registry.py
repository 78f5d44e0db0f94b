"""The codes and transports there are, and the black box a configuration asks for.

A new code is a new module and one line in ``CODES``; a new transport likewise in ``TRANSPORTS``.
"""

from __future__ import annotations

from typing import Protocol

from orchestrator.blackbox.compliance import Compliance
from orchestrator.blackbox.file import FileWorker
from orchestrator.blackbox.freefem import FreeFem
from orchestrator.blackbox.pipe import PipeWorker
from orchestrator.blackbox.pool import Pool, default_workers
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.blackbox.shared import SharedModels
from orchestrator.errors import Problems
from orchestrator.savings import Savings

CODES = {"freefem": FreeFem}
TRANSPORTS = {"pipe": PipeWorker, "file": FileWorker}


class Settings(Protocol):
    """The ``blackbox`` section of a configuration. ``timeout``: seconds one answer may take."""

    code: str
    element: str
    transport: str
    workers: int | str
    timeout: float


def make_blackbox(settings: Settings) -> Pool:
    """Check that the code is there, then start the pool.

    Raises InputError for unknown codes, elements or transports and for a code that is not installed
    (nothing has been started then), BlackBoxError when its processes do not start.
    """
    problems = Problems()
    path = ("blackbox",)
    if settings.code not in CODES:
        problems.add((*path, "code"), repr(settings.code), f"one of {', '.join(CODES)}")
    elif settings.element not in CODES[settings.code].elements:
        expected = f"one of {', '.join(CODES[settings.code].elements)}"
        problems.add((*path, "element"), repr(settings.element), expected)
    if settings.transport not in TRANSPORTS:
        problems.add((*path, "transport"), repr(settings.transport), f"one of {', '.join(TRANSPORTS)}")
    workers = default_workers() if settings.workers == "auto" else settings.workers
    if not isinstance(workers, int) or workers < 1:
        problems.add((*path, "workers"), repr(settings.workers), "auto or a number from 1 on")
    problems.raise_if_any()
    timeout = float(getattr(settings, "timeout", 600.0))
    return Pool(TRANSPORTS[settings.transport], CODES[settings.code](), settings.element, workers, timeout)


def spared(blackbox: BlackBox, skip, workers: int, steps: int, savings: Savings) -> BlackBox:
    """The black box with the layers that save it work.

    Parameters
    ----------
    skip : ``method.skip`` of a configuration: congruent, repeated, compliance
    workers : processes behind the black box
    steps : load steps that are solved together
    savings : where what is saved is noted
    """
    if skip.compliance:
        blackbox = Compliance(blackbox, workers=workers, savings=savings)
    return SharedModels(blackbox, congruent=skip.congruent, repeated=skip.repeated, workers=workers, steps=steps,
                        savings=savings)
