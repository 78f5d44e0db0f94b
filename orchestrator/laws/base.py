"""The interface law: one object that answers every question the other rooms have about it.

An instance holds the parameters of one interface. What works on node pairs is the same for all
interfaces of a law, whose points are joined: these methods are static and find the parameters in
``Points``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from orchestrator.config.boundary import Entry
from orchestrator.laws.points import Answer, BONDED, Carries, Points, Status


@dataclass(frozen=True)
class Measure:
    """A relative measure of how far fields are from a law.

    name : in history.csv and summary.json
    label : in the convergence figure
    formula, meaning : in the report
    length, pressure : powers of the scene's length scale and of the law's largest pressure that it
        is divided by
    """

    name: str
    label: str
    formula: str
    meaning: str
    length: int = 0
    pressure: int = 0


@dataclass(frozen=True)
class Stages:
    """Both stages at the points of a law, T load steps.

    force, jump : (T, 3, P) force on side 1 and jump u₂ − u₁ of the linear stage
    answered : (T, 3, P) jump of the local stage; before : (3, P) the jump before the first step
    status : (T, P) int
    own : name → (T, P) the law's own variables at the end of each step
    """

    force: np.ndarray
    jump: np.ndarray
    answered: np.ndarray
    before: np.ndarray
    status: np.ndarray
    own: Mapping[str, np.ndarray] = field(default_factory=dict)

    def at(self, step: int) -> Stages:
        """The stages at one of the load steps."""
        one = slice(step, step + 1)
        return Stages(self.force[one], self.jump[one], self.answered[one],
                      self.answered[step - 1] if step else self.before, self.status[one],
                      {name: x[one] for name, x in self.own.items()})


@dataclass(frozen=True)
class Written:
    """The results of one interface: T load steps, n nodes that are not prescribed altogether.

    opening : (T, n) what the sides have moved apart along the normal, a length
    slip : (T, n, 3) tangential displacement of side 2 relative to side 1
    pressure : (T, n) positive in compression
    shear : (T, n, 3) tangential traction on side 1
    chosen : (n,) int, where these nodes are among the interface's
    length : (n,) what is left of the unit normal within the components that are free
    own : name → (T, n) the law's own variables at the end of each step
    """

    opening: np.ndarray
    slip: np.ndarray
    pressure: np.ndarray
    shear: np.ndarray
    chosen: np.ndarray
    length: np.ndarray
    own: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class Variable:
    """A number that a law remembers of each pair from load step to load step: 0 before the first
    one.

    name : in ``points[name]``, in ``Answer.own`` and in the files of the interfaces
    meaning : in the report
    """

    name: str
    meaning: str


class Law:
    """An interface law; derive from it and enter the class in ``registry.LAWS``.

    name : in the YAML and in fields.npz
    Parameters : model of its entry in the YAML
    formula, meaning : in the report
    perfect : the sides move as one: its local stage is an exchange, the error bound holds where all
        laws are so
    as_one : the jump is given, whatever the force: the sides deform as one
    spread : springs per area as it is, however bent; others act on what is seen along the normal
    presses : what passes depends on whether sides are pressed or pulled
    axial : it acts along one axis, the mean normal of its interface or a bolt's, at all points
    joins : a body hangs on the interface whatever the load
    on_ground : side 2 is a rigid ground, which ``keeps`` the body from some motions (n, 3, m) of
        its nodes, as (q, m)
    has_history : the answer depends on earlier load steps, see ``docs/laws.md``
    rigidity : stiffness per area of the softest springs by which it acts; infinite where sides
        touch without any
    follows : the sides are paired anew as they slide, load step after load step
    statuses : what its pairs can do
    measures : of its residuals
    pairwise : it answers pair by pair, whatever other pairs of its interface do
    loops : the ``force`` that ``contact_loops`` computes, where it is this law's
    convex : its force is the slope of a convex energy of the jump, load step by load step: the
        energy error is guaranteed
    prices : it has a ``duality_gap``, and directions in which it gives way are free in what the
        error is measured with
    slips : what it holds across the normal may slip for a price, as Coulomb's law has it, with a
        parameter ``friction``
    variables : what it remembers of each pair beside its jump, such as a damage

    What is not overruled is on the safe side: history, a joint that holds nothing.

    A law of one's own: sides that have parted, between which nothing passes. Below, all rests;
    above, all moves.

    >>> import numpy as np
    >>> from orchestrator import LAWS, Law, config_from, solve
    >>> class Parted(Law):
    ...     name, Parameters = "parted", Entry    # an entry without keys of its own
    ...     statuses = (Status(20, "parted", "#999999", normal=False, tangential=False),)
    ...     @classmethod
    ...     def of(cls, entry, count, direction, distance=None):
    ...         return cls()
    ...     @staticmethod
    ...     def force(points, F, previous, derivative=False):
    ...         answer = Answer(np.zeros_like(F), np.full(len(points), 20))
    ...         if derivative:    # nowhere does the force change
    ...             answer.active, answer.derivative = np.zeros(0, int), np.zeros((3, 3, 0))
    ...         return answer
    >>> LAWS.add("parted", Parted)
    >>> solution = solve(config_from({
    ...     "name": "halves", "mesh": {"box": {"size": [1, 1, 2], "cells": [2, 2, 4]}},
    ...     "subdomains": {"slices": {"axis": "z", "count": 2}},
    ...     "materials": [{"young": 200e3, "poisson": 0.3}],
    ...     "interfaces": [{"law": "parted"}],
    ...     "boundary": [{"on": "zmin", "displacement": [0, 0, 0]},
    ...                  {"on": "zmax", "displacement": [0, 0, 0.1]}]}))
    >>> [np.allclose(side[0], (0, 0, moved), atol=1e-6)
    ...  for side, moved in zip(solution.sides, (0, 0.1))]
    [True, True]
    """

    def __init_subclass__(cls) -> None:
        """Raises TypeError: it prices what it cannot tell the price of, and the error would be too
        small.
        """
        super().__init_subclass__()
        if cls.prices and cls.duality_gap is Law.duality_gap:
            name = getattr(cls, "name", cls.__name__)
            raise TypeError(
                f"law {name} says prices = True and has no duality_gap: write one, or leave "
                "prices out")

    name: ClassVar[str]
    Parameters: ClassVar[type[Entry]]
    formula: ClassVar[str] = ""
    meaning: ClassVar[str] = ""
    perfect: ClassVar[bool] = False
    as_one: ClassVar[bool] = False
    spread: ClassVar[bool] = False
    pairwise: ClassVar[bool] = True
    loops: ClassVar[Callable[..., Answer] | None] = None
    axial: ClassVar[bool] = False
    joins: bool = False
    on_ground: ClassVar[bool] = False
    convex: bool = False
    prices: ClassVar[bool] = False
    slips: ClassVar[bool] = False
    rigidity: float = math.inf
    has_history: bool = True
    follows: bool = False
    statuses: ClassVar[tuple[Status, ...]] = (BONDED,)
    measures: ClassVar[tuple[Measure, ...]] = ()
    variables: ClassVar[tuple[Variable, ...]] = ()

    @classmethod
    def of(cls, entry: Entry, count: int, direction: float,
           distance: np.ndarray | None = None) -> Law:
        """The law of one interface.

        entry : of the YAML
        count : number of nodes n
        direction : 1 where the entry's first part is side 1, −1 where it is side 2
        distance : (n,) of the sides along the normal, where the entry has it read from the geometry
            (``apart``) and they share no faces
        """
        raise NotImplementedError

    @property
    def distance(self) -> np.ndarray | float:
        """(n,) or one for all: how far the sides are apart before loading; negative where pressed
        into each other.
        """
        return 0.0

    @property
    def imposed(self) -> float:
        """The largest displacement, a length ≥ 0, that the law asks for by itself, whatever the
        load.
        """
        return 0.0

    @property
    def acts(self) -> bool:
        """Whether the law loads the scene by itself: it asks for a displacement, or for a force."""
        return self.imposed > 0

    @property
    def given_jump(self) -> np.ndarray | None:
        """(3,) the jump that the law prescribes at every node, whatever the force; None where it is
        a matter of forces.
        """
        return None

    @property
    def constrained(self) -> np.ndarray | bool:
        """(n,) bool, nodes of side 1 that no other interface can move freely: the law holds them or
        moves them as one.
        """
        return False

    def forbids(self, jump: np.ndarray, known: np.ndarray, normal: np.ndarray,
                chosen: np.ndarray) -> np.ndarray:
        """(P,) by how much a jump breaks the law whatever the force, a length ≥ 0.

        jump, normal : (P, 3); known : (P, 3) bool, components of the jump that are prescribed
        chosen : (P,) int, among the interface's n nodes
        """
        if self.given_jump is None:
            return np.zeros(len(chosen))
        return np.where(known, np.abs(jump - self.given_jump), 0.0).max(axis=1)

    @property
    def presses(self) -> bool:
        return not self.as_one

    @property
    def caution(self) -> str:
        """Caution on these parameters for a reader of the results, to follow the interfaces' names;
        or nothing.
        """
        return ""

    def parameters(self, chosen: np.ndarray, length: np.ndarray,
                   area: np.ndarray) -> dict[str, np.ndarray]:
        """Name → (…, P) parameters at some of the nodes, for ``Points.own``.

        chosen : (P,) int, among the interface's n nodes
        length : (P,) what is left of the unit normal within the components that are free: there a
            jump d along the points' normal opens the interface by ``length`` d, and a pressure p
            has the force ``length`` p A
        area : (P,)
        """
        return {}

    @staticmethod
    def force(points: Points, F: np.ndarray, previous: np.ndarray,
              derivative: bool = False) -> Answer:
        """The force that the interface carries, b of eq. 3, with d = (F − f̂)/keq.

        F : (3, P) predicted force on side 1
        previous : (3, P) jump at the previous load step
        derivative : also return ∂f̂/∂F, wherever it is not zero
        """
        raise NotImplementedError

    @staticmethod
    def lagged(points: Points, force: np.ndarray) -> Points:
        """Return points whose law is convex: limits that forces set on each other are those of
        these (3, P).
        """
        return points

    @staticmethod
    def carries(points: Points) -> Carries:
        """The forces that the law allows at points, for the limit load of rigid bodies; what is not
        overruled carries anything.
        """
        return Carries.anything(len(points))

    @staticmethod
    def duality_gap(points: Points, force: np.ndarray, jump: np.ndarray,
                    previous: np.ndarray) -> np.ndarray:
        """(P,) γ = φ(d) + φ*(λ) − λ·d, an energy ≥ 0 and 0 where force λ and jump d (3, P) agree: φ
        is the law's energy.

        The force obeys the law, the jump does not break it. A law that ``prices`` nothing is kept
        to the letter instead.
        """
        return np.zeros(len(points))

    @staticmethod
    def residuals(points: Points, at: Stages) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Residuals of the law in the linear stage.

        Returns pressures that tell the size of what the interface carries, force/length², and for
        each name of ``measures`` what is to be made relative; of all arrays the largest entries
        count
        """
        return np.zeros(0), {}

    def violations(self, at: Written, length: float, pressure: float) -> dict[str, float]:
        """Say what of the law the written fields break, and by how much, relative.

        length, pressure : the scene's length scale; largest pressure on interfaces of this law, or
            what counts as next to nothing
        """
        return {}
