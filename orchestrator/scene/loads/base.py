"""Base of kinds of loads and supports: what each takes, where it acts, and its effect.

Whatever acts is a sum of few fields in space, each times what the load steps multiply it with: Σ_m
a_m(t) φ_m(x).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from orchestrator.config.base import no_direction
from orchestrator.config.paths import get
from orchestrator.errors import KeyPath, Problem, Problems
from orchestrator.linalg import PLACED, SAME
from orchestrator.scene.mesh.geometry import format_point, summed, unit
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.quadratic import TET_MOMENTS


ROUNDING = 1e-14  # of the largest value, what sines and cosines leave of zero


@dataclass(frozen=True)
class Forces:
    """Consistent forces on the nodes of elements, Σ_m amounts[t, m] shapes[m].

    amounts : (steps, m, 3 or 1)
    shapes : (m, k, p, 1 or 3), of k elements with p nodes: a share for all components, or a force
    """

    amounts: np.ndarray
    shapes: np.ndarray

    def of(self, elements: np.ndarray) -> Forces:
        """Forces of some elements alone, indices or bool."""
        return replace(self, shapes=self.shapes[:, elements])

    def add_to(self, loads: np.ndarray, at: np.ndarray) -> None:
        """Add them to ``loads`` (steps, N, 3) at the elements' nodes (k, p)."""
        for m, shape in enumerate(self.shapes):
            sums = summed(at, shape, loads.shape[1])
            loads += self.amounts[:, m, None] * sums

    def densities(self, volumes: np.ndarray) -> np.ndarray:
        """(steps, k, 1 or 4, 3) force/volume that loads tets of some volumes (k,) so: at their
        corners, or the same all over each.
        """
        at = np.einsum("cp,mkpx->mkcx", np.linalg.pinv(TET_MOMENTS[self.shapes.shape[2]]),
                       self.shapes) / volumes[:, None, None]
        if np.ptp(at, axis=2).max(initial=0.0) <= SAME * np.abs(at).max(initial=0.0):
            at = at.mean(axis=2, keepdims=True)
        return np.einsum("tmx,mkcx->tkcx", self.amounts + np.zeros(3), at + np.zeros(3))

    def resultant(self, points: np.ndarray, about: np.ndarray) -> np.ndarray:
        """(steps, 6) the force, and its moment about a point (3,), from the places (k, p, 3) of the
        nodes.
        """
        force = (self.amounts * self.shapes.sum(axis=(1, 2))).sum(axis=1) + np.zeros(3)
        first = np.einsum("kpx,mkpc->mxc", points - about, self.shapes)
        product = (self.amounts[:, :, None] * first).sum(axis=1) + np.zeros((3, 3))  # Σ x F
        return np.concatenate(
            [force,
             np.stack([product[:, y, z] - product[:, z, y] for y, z in ((1, 2), (2, 0), (0, 1))],
                      axis=1)], axis=1)

    @property
    def largest(self) -> np.ndarray:
        """(3,) how large components get, at any node and load step."""
        return (np.abs(self.amounts).max(axis=0)
                * np.abs(self.shapes).max(axis=(1, 2), initial=0.0)).max(axis=0) + np.zeros(3)


class Field(ABC):
    """Displacements in space, m of them, of a size of one."""

    turns: ClassVar[bool] = False  # along directions that differ from node to node

    @abstractmethod
    def at(self, points: np.ndarray) -> np.ndarray:
        """(m, n, 3) at points (n, 3)."""

    def change(self, amounts: np.ndarray, size: float) -> np.ndarray:
        """(steps,) how much Σ amounts (steps, m) field changes over a length at most: so does its
        rounding at every node.
        """
        return np.zeros(len(amounts))


class Uniform(Field):
    """One along x, y and z each."""

    def at(self, points: np.ndarray) -> np.ndarray:
        return np.broadcast_to(np.eye(3)[:, None], (3, len(points), 3))


@dataclass(frozen=True)
class Prescribed:
    """Displacements Σ_m amounts[t, m] field_m(x), in components ``fixed`` (3,) bool.

    amounts : (steps, m)
    """

    fixed: np.ndarray
    amounts: np.ndarray
    field: Field

    def at(self, points: np.ndarray) -> np.ndarray:
        """(steps, n, 3) at points (n, 3)."""
        return np.einsum("tm,mnc->tnc", self.amounts, self.field.at(points))


class Ground(ABC):
    """A rigid ground behind a surface, which does to it what a law says."""

    whole: ClassVar[bool] = False  # the surface moves as one, so that it is of one subdomain

    @abstractmethod
    def laws(self, points: np.ndarray, triangles: np.ndarray) -> list[Any]:
        """The law at every load step, at the nodes (n, 3) of a patch of triangles (k, 3 or 6)."""

    def gives(self, points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
        """(3,) along x, y and z the largest stiffness of springs by which it acts on such a patch;
        zero where it has none.
        """
        return np.zeros(3)


@dataclass(frozen=True)
class FacePlace:
    """Place and time of an entry of ``boundary``.

    path : of what the entry says, in the YAML
    nodes : (n, 3), all of the mesh
    triangles : (k, 3 or 6) int, outward
    factors : (steps,) what its history multiplies it with
    frame : directions that its components are along; None: x, y and z
    """

    path: KeyPath
    nodes: np.ndarray
    triangles: np.ndarray
    factors: np.ndarray
    frame: Cylindrical | None
    problems: Problems

    def rows(self, vector: Sequence[Any]) -> tuple[np.ndarray, np.ndarray]:
        """Rows of a vector, or one per load step: which components (3,) bool are numbers, and
        (steps, 3) their values, 0 for others.
        """
        several = vector if isinstance(vector[0], list) else [vector]
        values = np.array([[0.0 if x is None else x for x in row] for row in several])
        # as at all steps: the configuration's rules see to that
        fixed = np.array([x is not None for x in several[0]])
        return fixed, values if isinstance(vector[0], list) else np.outer(self.factors, values[0])

    @property
    def corners(self) -> np.ndarray:
        """(k, 3, 3) where the corners of the faces are."""
        return self.nodes[self.triangles[:, :3]]

    def check_frame(self, values: np.ndarray) -> None:
        """Adds a problem where nothing is radial and values (…, 3) are: zero is so in any
        direction.
        """
        if self.frame is not None and np.any(values[..., :2]):
            self.frame.check(self.nodes, self.triangles, (*self.path[:-1], "frame"), self.problems)


@dataclass(frozen=True)
class VolumePlace:
    """Place and time of an entry of ``loads``.

    path : of what the entry says, in the YAML
    cells : (k,) int; volume : (k,) of each
    matter : entries of ``materials``, None for parts of other programs; material : (k,) int, index
        into them
    factors : (steps,) what its history multiplies it with
    """

    path: KeyPath
    mesh: Mesh
    cells: np.ndarray
    volume: np.ndarray
    matter: Sequence[Any]
    material: np.ndarray
    factors: np.ndarray
    problems: Problems

    def of_matter(self, key: str, cure: str) -> np.ndarray | None:
        """(k,) a property of the cells' matter; None, with a problem, where some matter has
        none.
        """
        values = [getattr(one, key, None) for one in self.matter]
        without = sorted({int(m) for m in self.material if m >= 0 and values[m] is None})
        if without:
            self.problems.add(self.path, f"matter without {key}: materials[{without[0]}]",
                              f"a {key} of all the matter it acts on", cure)
            return None
        return np.array([values[m] for m in self.material], dtype=float)


@dataclass(frozen=True)
class Strain:
    """Strain without stress, the same in all directions: (steps, k, 4) at the corners of cells."""

    values: np.ndarray


class Kind:
    """A kind of entry, of ``boundary`` or of ``loads``; its name is its key there.

    takes : type of what stands under the key
    meaning : what that is, in words
    listed : whether vectors may be listed there, one per load step
    files : keys of a mapping there that name files
    axes : keys, from one mapping to the next, at which it has an axis
    """

    takes: ClassVar[Any]
    meaning: ClassVar[str]
    listed: ClassVar[bool] = False
    files: ClassVar[tuple[str, ...]] = ()
    axes: ClassVar[tuple[tuple[str, ...], ...]] = ()

    @classmethod
    def broken(cls, path: KeyPath, value: Any, entry: dict[str, Any]) -> Iterator[Problem]:
        """Rules that a model of single keys does not know: of the raw value at a path, and the
        entry that it is in.
        """
        for axis in cls.axes:
            yield from no_direction((*path, *axis), get(value, *axis))

    @classmethod
    def broken_among(cls,
                     entries: Sequence[tuple[KeyPath, Any, dict[str, Any]]]) -> Iterator[Problem]:
        """Rules that concern several entries of the kind: the path of each, its raw value, and
        itself.
        """
        return iter(())

    @classmethod
    def turned(cls, value: Any) -> bool:
        """Whether a frame beside a raw value has something to turn."""
        return False

    @classmethod
    def made(cls, value: Any, where: Any) -> Any:
        """The effect of a value: ``Forces``, ``Prescribed`` or a ``Ground`` on faces; ``Forces``,
        ``Strain`` or None (with a
        problem) in volumes."""
        raise NotImplementedError


@dataclass(frozen=True)
class Cylindrical:
    """Directions about an axis (3,), of length one, through a point (3,)."""

    axis: np.ndarray
    at: np.ndarray

    @classmethod
    def of(cls, frame: Any) -> Cylindrical | None:
        """The value of the YAML's entry; None without one."""
        return None if frame is None else cls(np.array(frame.direction),
                                              np.array(frame.at, dtype=float))

    def directions(self, points: np.ndarray) -> np.ndarray:
        """(…, 3, 3) radial, tangential and axial directions at points (…, 3), as rows; nothing
        radial on the axis.
        """
        arm = points - self.at
        radial = unit(arm - (arm @ self.axis)[..., None] * self.axis)
        return np.stack([radial, np.cross(self.axis, radial),
                         np.broadcast_to(self.axis, radial.shape)], axis=-2)

    def check(self, nodes: np.ndarray, triangles: np.ndarray, path: KeyPath,
              problems: Problems) -> None:
        """Neither nodes nor faces may meet the axis: nothing is radial there.

        nodes : (n, 3); triangles : (k, 3 or 6), the corners first
        """
        if not len(triangles):
            return
        used = np.unique(triangles)
        arm = nodes[used] - self.at
        r = np.linalg.norm(np.cross(arm, self.axis), axis=1)
        if r.min() <= PLACED * (r.max() or 1.0):
            problems.add(path,
                         "a node on the frame's axis, at "
                         f"{format_point(nodes[used[int(r.argmin())]])}, where nothing is radial",
                         "nodes off the axis",
                         "move the frame's axis, or select faces that do not meet it")
            return
        corners = nodes[triangles[:, :3]] - self.at
        turns = np.cross(corners, corners[:, [1, 2, 0]]) @ self.axis  # of each edge about the axis
        pierced = (turns > 0).all(axis=1) | (turns < 0).all(axis=1)
        if pierced.any():
            centre = nodes[triangles[np.flatnonzero(pierced)[0], :3]].mean(axis=0)
            problems.add(path,
                         f"a face that the frame's axis runs through, at {format_point(centre)}: "
                         "nothing is radial there",
                         "faces beside the axis",
                         "move the frame's axis, or select faces that do not meet it")
