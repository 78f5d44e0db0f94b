"""The node pairs a law works on, what it answers, and what a pair does: its status, a number for
the files, a name and a colour for
people, and what it holds. Each law declares its own; ``BONDED`` is everybody's, as nodes that
boundary conditions prescribe on both sides are bonded whatever the law.

Vectors are rows of components, (3, P): numpy is several times faster along long rows than across
short ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np


class Hold(IntEnum):
    """The state in which the sides may not move against each other in a direction."""

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
        status.name, status.colour = name, colour
        status.normal, status.tangential = normal, tangential
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
                raise ValueError(
                    f"law {law.name}: status {int(status)} is called {status.name!r}, but it is "
                    f"{known.name!r} elsewhere; take another number")
    return [found[number] for number in sorted(found)]


@dataclass
class Points:
    """Node pairs that share a law. n points from side 1 to side 2.

    normal : (3, P) unit normals
    stiff_n, stiff_t : (P,) keq = k₁k₂/(k₁ + k₂) of the search direction, along n and across it
    area : (P,) share of the interface's area
    own : name → (…, P), the law's parameters
    stepped : name → (T, …, P), those of them that differ from load step to load step, at all steps
        of the scene
    interface : (P,) int, which interface each is on, for laws whose pairs answer together

    ``points[name]`` is a parameter, or one of the law's own variables at the end of the load step
    before.
    """

    normal: np.ndarray
    stiff_n: np.ndarray
    stiff_t: np.ndarray
    area: np.ndarray
    own: dict[str, np.ndarray] = field(default_factory=dict)
    stepped: dict[str, np.ndarray] = field(default_factory=dict)
    interface: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))

    def __len__(self) -> int:
        return len(self.area)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.own[name]

    def some(self, part: slice | np.ndarray) -> Points:
        """Some of the points."""
        return Points(np.ascontiguousarray(self.normal[:, part]), self.stiff_n[part],
                      self.stiff_t[part], self.area[part],
                      *({name: values[..., part] for name, values in own.items()}
                        for own in (self.own, self.stepped)),
                      interface=self.interface[part] if len(self.interface) else self.interface)

    def at(self, step: float, before: Mapping[str, np.ndarray] | None = None) -> Points:
        """The points at a load step, counted from 0, or at a part of one: with the law's
        parameters, and its variables ``before`` it.
        """
        if not self.stepped and not before:
            return self
        own = self.own | (self._at(step) if self.stepped else {}) | dict(before or {})
        return replace(self, own=own, stepped={})

    def missed(self, force: np.ndarray, jump: np.ndarray, normal: np.ndarray,
               across: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (…, P) tractions of forces (…, 3, P), and of what they differ by from those of
        springs ``normal`` and ``across`` (…, P) that a jump stretches, as the predicted force would
        have it: neither soft nor stiff springs make it a difference of large numbers.
        """
        e = self.scaled(self.stiff_n / (self.stiff_n + normal),
                        self.stiff_t / (self.stiff_t + across),
                        force - self.scaled(normal, across, jump))
        return norm(force) / self.area, norm(e) / self.area

    def _at(self, step: float) -> dict[str, np.ndarray]:
        """Parameters between two load steps in proportion; before the first one, and where what is
        no number changes, as of a bolt
        that is locked, the later ones."""
        later = math.ceil(step)
        share = later - step
        if not share or not later:
            return {name: values[later] for name, values in self.stepped.items()}
        same = np.ones(len(self), dtype=bool)
        for values in self.stepped.values():
            if values.dtype != float:
                same &= (values[later] == values[later - 1]).reshape(-1, len(self)).all(axis=0)
        return {name: np.where(same, share * values[later - 1] + (1 - share) * values[later],
                               values[later])
                if values.dtype == float else values[later]
                for name, values in self.stepped.items()}

    @property
    def search(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Normals and stiffness along and across them, as loops take them."""
        return self.normal, self.stiff_n, self.stiff_t

    def along(self, x: np.ndarray) -> np.ndarray:
        """(…, P) normal components of (…, 3, P)."""
        return dot(x, self.normal)

    def across(self, x: np.ndarray) -> np.ndarray:
        """(…, 3, P) tangential parts."""
        return x - self.along(x)[..., None, :] * self.normal

    def scaled(self, normal: np.ndarray, aside: np.ndarray, x: np.ndarray) -> np.ndarray:
        """(…, 3, P) x times ``normal`` (…, P) along the normal and ``aside`` (…, P) across it."""
        return aside[..., None, :] * x + ((normal - aside)
                                          * self.along(x))[..., None, :] * self.normal

    def blocks(self, normal: np.ndarray, aside: np.ndarray) -> np.ndarray:
        """(3, 3, P) the matrices of ``scaled``."""
        result = (normal - aside) * self.normal[:, None, :] * self.normal
        result[range(3), range(3)] += aside
        return result

    def stiffness(self, x: np.ndarray) -> np.ndarray:
        """(…, 3, P) keq x."""
        return self.scaled(self.stiff_n, self.stiff_t, x)

    def compliance(self, x: np.ndarray) -> np.ndarray:
        """(…, 3, P) x / keq."""
        return x / self.stiff_t + ((1 / self.stiff_n - 1 / self.stiff_t)
                                   * self.along(x))[..., None, :] * self.normal


@dataclass
class Answer:
    """A law's answer.

    force : (3, P) f̂ on side 1
    status : (P,) int, one of the law's statuses
    active : (Q,) pairs whose force changes with F, only if the derivative is asked for
    derivative : (3, 3, Q) ∂f̂/∂F at these
    collective : what else F changes, where pairs answer together; None: nothing
    own : name → (P,) the law's own variables at the end of the load step, all of ``Law.variables``
    """

    force: np.ndarray
    status: np.ndarray
    active: np.ndarray | None = None
    derivative: np.ndarray | None = None
    collective: Collective | None = None
    own: dict[str, np.ndarray] = field(default_factory=dict)


@dataclass
class Collective:
    """The pairs' joint share of the derivative: ∂f̂_p/∂F_q = −given_p takenᵀ_q for p and q of one
    group.

    group : (R,) int, of the pairs ``at``; all pairs of a group belong to one interface
    at : (R,) int, ascending within a group
    given, taken : (3, R)
    """

    group: np.ndarray
    at: np.ndarray
    given: np.ndarray
    taken: np.ndarray

    def groups(self) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Pairs, given and taken of each group."""
        for number in np.unique(self.group):
            own = self.group == number
            yield self.at[own], self.given[:, own], self.taken[:, own]


@dataclass
class Carries:
    """The forces λ on side 1 that a law allows at P points, whatever the sides do, as far as rigid
    bodies are concerned:

        λ = q s n + x,    q ≥ 0,    x along ``directions``,    |x| ≤ limit + friction q

    directions : (3, 3, P) at [which, component, P], orthonormal or zero; where the limit is
        infinite they need not be
    side : (P,) s: −1 where sides push each other, 1 where they pull, 0 where there is neither
        beside x
    limit : (P,) force; infinite: any
    friction : (P,)
    motions : (m, 3, P) jumps that all points of an interface together make freely, beside x of no
        limit: a bolt's shortening
    works : (m, P) what the law's force does in each, at all points together; the same at all points
        of an interface
    apart : (P,) how far apart sides that push each other are before loading, a length
    """

    directions: np.ndarray
    side: np.ndarray
    limit: np.ndarray
    friction: np.ndarray
    motions: np.ndarray
    works: np.ndarray
    apart: np.ndarray

    @classmethod
    def anything(cls, count: int) -> Carries:
        """Any force, at so many points."""
        return cls(np.repeat(np.eye(3)[:, :, None], count, axis=2), np.zeros(count),
                   np.full(count, np.inf), np.zeros(count),
                   np.zeros((0, 3, count)), np.zeros((0, count)), np.zeros(count))

    @classmethod
    def pressed(cls, normal: np.ndarray, friction: np.ndarray | float = 0.0,
                side: np.ndarray | float = -1.0,
                limit: np.ndarray | float = 0.0, apart: np.ndarray | float = 0.0) -> Carries:
        """A push (or pull) along normals (3, P), and what goes across them."""
        count = normal.shape[1]
        first = np.cross(normal.T, np.eye(3)[np.argmin(np.abs(normal), axis=0)]).T
        first = first / norm(first)
        across = np.stack([first, np.cross(normal.T, first.T).T, np.zeros_like(first)])
        side, limit, friction, apart = (np.broadcast_to(np.asarray(x, float), count).copy()
                                        for x in (side, limit, friction, apart))
        return cls(across, side, limit, friction, np.zeros((0, 3, count)), np.zeros((0, count)),
                   apart)


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(…, P) products of vectors (…, 3, P)."""
    return a[..., 0, :] * b[..., 0, :] + a[..., 1, :] * b[..., 1, :] + a[..., 2, :] * b[..., 2, :]


def norm(x: np.ndarray) -> np.ndarray:
    """(…, P) lengths of vectors (…, 3, P)."""
    return np.sqrt(dot(x, x))
