"""What a node pair does: a number for the files, a name and a colour for people, and what it holds.

Each law declares its own; ``BONDED`` is everybody's, as nodes that boundary conditions prescribe on both sides are
bonded whatever the law.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum


class Hold(IntEnum):
    """When the sides are kept from moving against each other in a direction."""

    NEVER = 0
    ALWAYS = 1
    PRESSED = 2  # only where they are pressed together
    PULLED = 3  # only where they are pulled apart


class Status(int):
    """A status, which is its number.

    number : in fields.npz and the interface files; unique among the laws of a scene
    name, colour : in tables and pictures, the colour as #rrggbb
    normal, tangential : when the sides are kept from moving along the normal, and across it
    """

    def __new__(cls, number: int, name: str, colour: str, normal: Hold, tangential: Hold):
        status = super().__new__(cls, number)
        status.name, status.colour, status.normal, status.tangential = name, colour, normal, tangential
        return status

    def __reduce__(self):
        return Status, (int(self), self.name, self.colour, self.normal, self.tangential)

    def __repr__(self) -> str:
        return f"Status({int(self)}, {self.name!r})"

    @property
    def holds(self) -> bool:
        """Whether any motion may be kept from."""
        return bool(self.normal or self.tangential)


BONDED = Status(3, "bonded", "#009E73", Hold.ALWAYS, Hold.ALWAYS)


def table(laws: Iterable) -> list[Status]:
    """All statuses of some laws, and ``BONDED``, by number.

    Raises ValueError: two laws give the same number different names
    """
    found = {int(BONDED): BONDED}
    for law in laws:
        for status in law.statuses:
            known = found.setdefault(int(status), status)
            if known.name != status.name:
                raise ValueError(f"law {law.name}: status {int(status)} is called {status.name!r}, but it is "
                                 f"{known.name!r} elsewhere; take another number")
    return [found[number] for number in sorted(found)]
