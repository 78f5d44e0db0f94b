"""The interface law: one object that answers every question the other rooms have about it.

An instance holds the parameters of one interface. What works on node pairs is the same for all
interfaces of a law, whose points are joined: these methods are static and find the parameters in
``Points``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar

import numpy as np

from orchestrator.config.boundary import Entry
from orchestrator.laws.points import Answer, BONDED, Carries, Hold, Points, Status


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


class Moves(IntEnum):
    """How the sides of an interface may move against each other."""

    FREE = 0  # the jump goes with the force
    TOGETHER = 1  # the sides move as one: perfect
    GIVEN = 2  # the jump is given at each point, or goes with the force alone there
    AXIAL = 3  # one jump of all points along an axis, the mean normal of the interface or a bolt's
    RIGID = 4  # the motion of a rigid body, or such a motion in the mean


class Facts:
    """Facts that a law declares of itself; those that are left out are on the safe side. In the
    report stand the first two paragraphs of its docstring: what it means, and its formula.

    name : in the YAML and in fields.npz
    Parameters : model of its entry in the YAML
    statuses : what its pairs can do
    measures : of its residuals
    variables : names of numbers that it remembers of each pair from load step to load step, such as
        a damage: 0 before the first one; in ``points[name]``, in ``Answer.own`` and in the files of
        the interfaces
    moves : how the sides may move
    joins : a body hangs on the interface whatever the load
    convex : its force is the slope of a convex energy of the jump, whatever happened before: load
        steps do not depend on each other, the energy error is guaranteed
    rigidity : stiffness per area of the softest springs by which it acts, which act on all of a
        face, however bent; infinite where sides touch without any, and a pressure acts on what is
        seen along the normal
    slips : what it holds across the normal slips as Coulomb's law has it, with a parameter
        ``friction``
    distance : (n,) or one for all: how far the sides are apart before loading; negative where
        pressed into each other
    given_jump : (3,) the jump that it prescribes at every node, whatever the force; None where it
        is a matter of forces
    loops : the ``force`` that ``contact_loops`` computes, where it is this law's
    """

    name: ClassVar[str]
    Parameters: ClassVar[type[Entry]]
    statuses: ClassVar[tuple[Status, ...]] = (BONDED,)
    measures: ClassVar[tuple[Measure, ...]] = ()
    variables: ClassVar[tuple[str, ...]] = ()
    moves: ClassVar[Moves] = Moves.FREE
    convex: bool = False
    rigidity: float = math.inf
    slips: ClassVar[bool] = False
    distance: np.ndarray | float = 0.0
    given_jump: np.ndarray | None = None
    loops: ClassVar[Callable | None] = None

    @property
    def joins(self) -> bool:
        return self.as_one

    @property
    def acts(self) -> bool:
        """Whether the law loads the scene by itself: it asks for a displacement, or for a force."""
        return self.imposed > 0

    # ---- what follows ----------------------------------------------------------------------------

    perfect: ClassVar[bool]  # the local stage is an exchange, the error bound of bonds holds
    as_one: ClassVar[bool]  # the sides deform as one
    axial: ClassVar[bool]
    pairwise: ClassVar[bool]  # it answers pair by pair, whatever other pairs do

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.perfect, cls.as_one = cls.moves is Moves.TOGETHER, cls.moves is not Moves.FREE
        cls.axial, cls.pairwise = cls.moves is Moves.AXIAL, cls.moves < Moves.AXIAL

    @property
    def imposed(self) -> float:
        """The largest displacement, a length ≥ 0, that the law asks for by itself, whatever the
        load.
        """
        if self.given_jump is not None:
            return float(np.linalg.norm(self.given_jump))
        return float(np.max(-self.distance, initial=0.0))

    @property
    def caution(self) -> str:
        """Caution on these parameters for a reader of the results, to follow the interfaces' names;
        or nothing.
        """
        return (
            f"with friction {self.friction:g}: above 1, which few surfaces have, and with which "
                "convergence is not assured" if self.slips and self.friction > 1 else "")

    def forbids(self, jump: np.ndarray, known: np.ndarray, normal: np.ndarray,
                chosen: np.ndarray) -> np.ndarray:
        """(P,) by how much a jump breaks the law whatever the force, a length ≥ 0: it is another
        than is given; or sides that nothing springs apart, and that hold where pressed, are inside
        each other where all that the normal has is prescribed.

        jump, normal : (P, 3); known : (P, 3) bool, components of the jump that are prescribed
        chosen : (P,) int, among the interface's n nodes
        """
        if self.given_jump is not None:
            return np.where(known, np.abs(jump - self.given_jump), 0.0).max(axis=1)
        told = (known | (np.abs(normal) < 1e-6)).all(axis=1)
        if self.rigidity < np.inf or not any(s.normal == Hold.PRESSED for s in self.statuses):
            told[:] = False
        distance = np.ravel(self.distance)  # of one for all the only one
        inside = -(distance[chosen % len(distance)] + np.einsum("pc,pc->p", normal, jump))
        return np.where(told, np.maximum(inside, 0.0), 0.0)


class Law(Facts):
    """An interface law: ``force``, six hooks beside it, and the facts that it declares; derive from
    it and enter the class in ``registry.LAWS``.

    force : the law
    of : from its entry
    parameters : what ``force`` needs at points
    residuals : of the law's ``measures``
    carries : forces that it allows
    duality_gap : its energy; without one it is kept to the letter where an error is guaranteed
    violations : what written results break

    A law of one's own: sides that have parted, between which nothing passes. Below, all rests;
    above, all moves.

    >>> import numpy as np
    >>> from orchestrator import LAWS, Law, config_from, solve
    >>> class Parted(Law):
    ...     name, Parameters = "parted", Entry    # an entry without keys of its own
    ...     statuses = (Status(20, "parted", "#999999", normal=False, tangential=False),)
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

    @classmethod
    def of(cls, entry: Entry, count: int, direction: float,
           distance: np.ndarray | None = None) -> Law:
        """The law of one interface: by default its fields are those of the entry.

        entry : of the YAML
        count : number of nodes n
        direction : 1 where the entry's first part is side 1, −1 where it is side 2
        distance : (n,) of the sides along the normal, where the entry has it read from the geometry
            (``apart``) and they share no faces
        """
        return cls(*(getattr(entry, name) for name in getattr(cls, "__dataclass_fields__", ())))

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

    # (points, force, jump, previous) → (P,) γ = φ(d) + φ*(λ) − λ·d, an energy ≥ 0 and 0 where force
    # λ and jump d (3, P) agree: φ is the law's energy. The force obeys the law, the jump does not
    # break it. Directions in which the law gives way are free in what the error is measured with
    duality_gap: ClassVar[Callable | None] = None

    @staticmethod
    def carries(points: Points) -> Carries:
        """The forces that the law allows at points, for the limit load of rigid bodies; what is not
        overruled carries anything.
        """
        return Carries.anything(len(points))

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


class GroundLaw(Law):
    """A law of a rigid ground, side 2, with a body, side 1."""

    convex = True

    @property
    def held(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(3, 3, n) directions at [which, component, node], (3, n) bool, which of them are held,
        and (3, n) displacements along these.
        """
        raise NotImplementedError

    @property
    def constrained(self) -> np.ndarray:
        """(n,) bool, nodes that no other interface can move freely: the law holds them or moves
        them as one.
        """
        raise NotImplementedError

    def within(self, free: np.ndarray, moved: np.ndarray) -> GroundLaw | None:
        """The law in the components (n, 3) that are free, where the others are ``moved`` (n, 3),
        which is zero where they are free; None where it cannot be.
        """
        raise NotImplementedError

    def keeps(self, moved: np.ndarray) -> np.ndarray:
        """(q, m) what of motions (n, 3, m) of the nodes is kept from happening."""
        raise NotImplementedError

    @property
    def imposed(self) -> float:
        return float(np.abs(self.held[2]).max(initial=0.0))
