"""What a node pair does: a number for the files, a name and a colour for people, and what it holds.

Each law declares its own; here are the two that no law needs to declare: a pair that nothing holds together, and
one that nothing moves apart. Nodes that boundary conditions prescribe on both sides are bonded whatever the law.
"""

from __future__ import annotations

from collections.abc import Iterable


class Status(int):
    """A status, which is its number.

    Parameters
    ----------
    number : in fields.npz and the interface files; unique among the laws of a scene
    name, colour : in tables and pictures, the colour as #rrggbb
    normal, tangential : whether the sides are kept from moving along the normal, and across it
    pressed : whether that needs the sides to be pressed together
    """

    def __new__(cls, number: int, name: str, colour: str, *, normal: bool, tangential: bool, pressed: bool = False):
        status = super().__new__(cls, number)
        status.name, status.colour = name, colour
        status.normal, status.tangential, status.pressed = normal, tangential, pressed
        return status

    def __reduce__(self):
        return _again, (int(self), self.name, self.colour, self.normal, self.tangential, self.pressed)

    def __repr__(self) -> str:
        return f"Status({int(self)}, {self.name!r})"

    @property
    def holds(self) -> bool:
        """Whether any motion is kept from."""
        return self.normal or self.tangential


def _again(number: int, name: str, colour: str, normal: bool, tangential: bool, pressed: bool) -> Status:
    return Status(number, name, colour, normal=normal, tangential=tangential, pressed=pressed)


BONDED = Status(3, "bonded", "#009E73", normal=True, tangential=True)


def table(laws: Iterable) -> list[Status]:
    """All statuses of some laws, and ``BONDED``, by number.

    Raises
    ------
    ValueError : two laws give the same number different names
    """
    found = {int(BONDED): BONDED}
    for law in laws:
        for status in law.statuses:
            known = found.setdefault(int(status), status)
            if known.name != status.name:
                raise ValueError(f"law {law.name}: status {int(status)} is called {status.name!r}, but it is "
                                 f"{known.name!r} elsewhere; take another number")
    return [found[number] for number in sorted(found)]
