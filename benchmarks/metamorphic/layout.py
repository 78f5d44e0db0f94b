"""Draw boxes beside each other: matching or not, apart, inside each other, or meeting in an edge or a vertex alone.

A body is drawn in units of one cell length; ``Body`` tells where its faces are in the world, however its mesh is turned.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
from hypothesis import strategies as st

AXES = "xyz"
FACES = [(axis, end) for axis in range(3) for end in (0, 1)]
# distance of a face to its neighbour's, in cells
GAPS = {"touching": 0.0, "gap .01 h": 0.01, "gap .05 h": 0.05, "gap .2 h": 0.2, "gap .5 h": 0.5, "gap h": 1.0, "gap 2 h": 2.0,
        "interference .002 h": -0.002, "interference .02 h": -0.02, "interference .2 h": -0.2}
NAMES = ["a", "lid", "Part 1", "b.2", "a-b", "base", "x", "00", "Ö", "a_1", "a.1", "grain_3.1"]


@dataclass
class Body:
    """A box in the world; ``quarter`` turns about ``axis`` have brought its mesh there."""

    name: str
    low: np.ndarray
    size: np.ndarray
    cells: tuple[int, int, int]
    axis: int = 2
    quarter: int = 0
    used: set[tuple[int, int]] = field(default_factory=set)

    @property
    def turn(self) -> np.ndarray:
        """(3, 3) from its own axes to the world's."""
        return quarter_turn(self.axis, self.quarter)

    def surface(self, face: tuple[int, int]) -> str:
        """The name of its face at the world's ``face``."""
        normal = np.zeros(3)
        normal[face[0]] = 2 * face[1] - 1
        own = self.turn.T @ normal
        axis = int(np.argmax(np.abs(own)))
        return f"{self.name}/{AXES[axis]}{'max' if own[axis] > 0 else 'min'}"

    def entry(self, unit: float) -> dict:
        """Its entry under ``parts``, with cells of length ``unit``."""
        back = self.turn.T
        size, cells = np.abs(back @ self.size) * unit, np.abs(back @ np.array(self.cells))
        mesh = {"box": {"size": rounded(size), "cells": [int(round(c)) for c in cells]}}
        shift = self.low * unit - np.minimum(self.turn @ size, 0.0)
        move: dict = {}
        if self.quarter:
            move["rotate"] = {"axis": AXES[self.axis], "degrees": 90 * self.quarter}
        if shift.any():
            move["translate"] = rounded(shift)
        return {"name": self.name, "mesh": mesh, **({"move": move} if move else {})}


def rounded(x: np.ndarray) -> list[float]:
    """Numbers as a file has them: twelve digits, and no zero with a sign."""
    return [float(f"{value:.12g}") + 0.0 for value in x]


@dataclass(frozen=True)
class Pair:
    """Two bodies drawn beside each other: first's face, how far the second is from it, in cells, and how they meet."""

    first: Body
    second: Body
    face: tuple[int, int]
    gap: float
    kind: str

    @property
    def faces(self) -> bool:
        """Whether their faces overlap."""
        across = [axis for axis in range(3) if axis != self.face[0]]
        a, b = self.first, self.second
        return bool((np.minimum(a.low + a.size, b.low + b.size) - np.maximum(a.low, b.low))[across].min() > 1e-9)


def quarter_turn(axis: int, times: int) -> np.ndarray:
    """(3, 3) of whole numbers, a right-handed turn by quarters."""
    one = np.eye(3)
    b, c = (axis + 1) % 3, (axis + 2) % 3
    one[b, b] = one[c, c] = 0.0
    one[c, b], one[b, c] = 1.0, -1.0
    return np.linalg.matrix_power(one, times % 4)


@st.composite
def bodies(draw, most: int = 4) -> tuple[list[Body], list[Pair], set[str]]:
    """Bodies, the pairs that they were drawn as, and words for what is remarkable about them."""
    count = draw(st.integers(1, most))
    names = draw(st.permutations(NAMES))[:count]
    found, pairs, words = [_body(draw, names[0], words := set())], [], words
    for name in names[1:]:
        body = _body(draw, name, words)
        face = draw(st.sampled_from(FACES))
        parents = [b for b in found if face not in b.used]
        if not parents:
            break
        parent = draw(st.sampled_from(parents))
        kind = draw(st.sampled_from(["touching"] * 20 + list(GAPS)))
        _beside(draw, parent, body, face, GAPS[kind], words)
        if any(_overlap(body, other) for other in found if other is not parent):
            continue
        parent.used.add(face)
        body.used.add((face[0], 1 - face[1]))
        found.append(body)
        pairs.append(Pair(parent, body, face, GAPS[kind], kind))
        words.add(kind)
    words.add(f"{len(found)} parts")
    return found, pairs, words


def _body(draw, name: str, words: set[str]) -> Body:
    whole = np.array([draw(st.integers(1, 3)) for _ in AXES])
    finer = draw(st.sampled_from([1, 1, 1, 1, 2, "4/3"]))
    cells = whole if finer == 1 else whole * 2 if finer == 2 else np.ceil(whole * 4 / 3).astype(int)
    if cells.prod() > 60:
        cells, finer = whole, 1
    if finer != 1:
        words.add("meshed finer")
    size = whole.astype(float)
    thin = draw(st.sampled_from([None] * 12 + [0.1, 0.001]))
    if thin is not None:
        size[draw(st.integers(0, 2))] *= thin
        words.add(f"thin {thin:g}")
    axis, quarter = draw(st.sampled_from([(2, 0)] * 6 + [(a, q) for a in range(3) for q in (1, 2, 3)]))
    if quarter:
        words.add("turned mesh")
    return Body(name, np.zeros(3), size, tuple(int(c) for c in cells), axis, quarter)


def _beside(draw, parent: Body, body: Body, face: tuple[int, int], gap: float, words: set[str]) -> None:
    """Places the body at a face of its parent."""
    axis, end = face
    low = parent.low.copy()
    low[axis] = parent.low[axis] + parent.size[axis] + gap if end else parent.low[axis] - gap - body.size[axis]
    borders = 0
    for other in {0, 1, 2} - {axis}:
        how = draw(st.sampled_from(["aligned"] * 12 + ["cells", "cells", "off", "off", "border"]))
        if how == "cells":
            low[other] += draw(st.integers(1 - int(np.ceil(body.size[other])), max(int(np.ceil(parent.size[other])) - 1, 0)))
            words.add("shifted by cells")
        elif how == "off":
            low[other] += draw(st.sampled_from([0.5, 0.25, -0.3, 1e-3]))
            words.add("shifted off the grid")
        elif how == "border":
            low[other] += draw(st.sampled_from([parent.size[other], -body.size[other]]))
            borders += 1
    body.low = low
    if borders:
        words.add("edge only" if borders == 1 else "vertex only")


def _overlap(a: Body, b: Body) -> bool:
    """Whether two boxes are inside each other."""
    return bool((np.minimum(a.low + a.size, b.low + b.size) - np.maximum(a.low, b.low) > 1e-9).all())


def corners(body: Body) -> np.ndarray:
    """(8, 3) in cells."""
    return body.low + np.array(list(product((0, 1), repeat=3))) * body.size
