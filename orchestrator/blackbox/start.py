"""The black box a configuration asks for: the codes are found, then started."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from orchestrator.blackbox.codes.finding import find_codes
from orchestrator.blackbox.layers.guarded import GuardedCode
from orchestrator.blackbox.layers.routed import Routed
from orchestrator.blackbox.pool.pool import Pool
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.config.blackbox import CodeSettings


def make_blackbox(settings: CodeSettings | Sequence[CodeSettings], used: Iterable[int] | None = None) -> BlackBox:
    """A pool, or several behind one face.

    Parameters
    ----------
    settings : one, or the entries of a list, to which ``Model.code`` refers
    used : which entries of a list have a model; default all

    Raises
    ------
    InputError : a code that is not installed; nothing has been started then
    BlackBoxError : its processes do not start
    """
    entries = settings if isinstance(settings, Sequence) else [settings]
    codes = find_codes(entries, used)
    if len(entries) == 1:
        return GuardedCode(Pool(codes[0]))
    pools: dict[int, BlackBox] = {}
    try:
        for index, code in codes.items():
            pools[index] = GuardedCode(Pool(code))
    except BaseException:
        for pool in pools.values():
            pool.close()
        raise
    return Routed(pools)
