"""The black box a configuration asks for: the codes are found, then started."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress

from orchestrator.blackbox.codes.finding import find_codes
from orchestrator.blackbox.layers.guarded import GuardedCode
from orchestrator.blackbox.layers.routed import Routed
from orchestrator.blackbox.pool.pool import Pool
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.config.blackbox import CodeSettings
from orchestrator.errors import OrchestratorError


class Ahead:
    """Processes that get ready while the mesh is made; as a context manager, those that nobody took are ended on leaving.

    Of several codes the scene tells which are used: none is started then. Where they cannot be started, what there is to
    say is said when the black box is asked for.

    Parameters
    ----------
    settings : the entries of ``blackbox``
    """

    def __init__(self, settings: Sequence[CodeSettings]):
        self._pool: Pool | None = None
        if len(settings) == 1:
            with suppress(OrchestratorError):
                self._pool = Pool(find_codes(settings)[0], wait=False)

    def take(self) -> Pool | None:
        """Its pool, ready, if there is one; whoever takes it closes it."""
        pool, self._pool = self._pool, None
        if pool is not None:
            pool.ready()
        return pool

    def __enter__(self) -> Ahead:
        return self

    def __exit__(self, *exc: object) -> None:
        if self._pool is not None:
            self._pool.close()


def make_blackbox(settings: CodeSettings | Sequence[CodeSettings], used: Iterable[int] | None = None,
                  ahead: Ahead | None = None) -> BlackBox:
    """A pool, or several behind one face.

    Parameters
    ----------
    settings : one, or the entries of a list, to which ``Model.code`` refers
    used : which entries of a list have a model; default all
    ahead : where they may have been started already

    Raises
    ------
    InputError : a code that is not installed; nothing has been started then
    BlackBoxError : its processes do not start
    """
    entries = settings if isinstance(settings, Sequence) else [settings]
    codes = find_codes(entries, used)
    if len(entries) == 1:
        pool = (ahead.take() if ahead else None) or Pool(codes[0])
        return GuardedCode(pool) if codes[0].guarded else pool
    pools: dict[int, BlackBox] = {}
    try:
        for index, code in codes.items():
            pools[index] = GuardedCode(Pool(code)) if code.guarded else Pool(code)
    except BaseException:
        for pool in pools.values():
            pool.close()
        raise
    return Routed(pools)
