"""What can be added, one line each: interface laws and codes, and the modules that they are in.

Modules are imported when a name is first used, so that knowing the names costs nothing.

>>> "contact" in LAWS
True
>>> LAWS["contact"].__name__
'Contact'
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Any


class Registry(Mapping[str, Any]):
    """Names, and what they stand for.

    Parameters
    ----------
    places : name → ``module:attribute``
    """

    def __init__(self, places: Mapping[str, str]):
        self._places = dict(places)
        self._known: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._known:
            module, _, attribute = self._places[name].partition(":")
            self._known[name] = getattr(import_module(module), attribute)
        return self._known[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def __contains__(self, name: object) -> bool:
        return name in self._places

    def add(self, name: str, thing: Any) -> None:
        """Something that is not shipped: a law or a code of the user's own."""
        self._places[name], self._known[name] = f"{thing.__module__}:{thing.__qualname__}", thing


DEFAULT_LAW = "perfect"
LAWS = Registry({
    "perfect": "orchestrator.laws.perfect:Perfect",
    "contact": "orchestrator.laws.contact:Contact",
    "jump": "orchestrator.laws.jump:Jump",
})

CODES = Registry({
    "freefem": "orchestrator.blackbox.codes.freefem:FreeFem",
    "calculix": "orchestrator.blackbox.codes.calculix:CalculiX",
    "scikit-fem": "orchestrator.blackbox.codes.scikit_fem:ScikitFemCode",
})
