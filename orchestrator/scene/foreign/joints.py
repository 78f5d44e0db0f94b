"""Joints of parts whose mesh is not ours: the nodes and faces that they meet others on, and who
reads them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module

import numpy as np

from orchestrator.config.model import Config
from orchestrator.config.mesh import ForeignPart, OnePart
from orchestrator.errors import InputError, KeyPath, Problem, wrong
from orchestrator.scene.conditions.rigid import motions_about, null_space, size_of
from orchestrator.scene.mesh.geometry import areas
from orchestrator.scene.mesh.mesh import FLAT
from orchestrator.scene.mesh.quadratic import QUARTERS

# Triangles between the nodes of a face by their number, corners first, then those in the middle of
# the edges. Between
# the nodes of a quadratic face displacements are taken as linear: its own functions know more than
# the other side asks.
CUT = {3: [[0, 1, 2]], 4: [[0, 1, 2], [0, 2, 3]], 6: QUARTERS,
       8: [[0, 4, 7], [1, 5, 4], [2, 6, 5], [3, 7, 6], [4, 5, 6], [4, 6, 7]]}


@dataclass(frozen=True)
class Joints:
    """The joints of a part.

    ids : (n,) int, the part's own numbers of the joints' nodes
    points : (n, 3) where they are
    triangles : (k, 3) int, their faces cut in triangles, indices into these nodes, outward
    joint : (k,) int, index into ``names``
    names : of the joints
    held : (n, 3) bool, components that the part itself prescribes there; they are no unknowns of
        any interface
    left : (6, r) combinations of rigid motions about ``centre``, divided by ``size``, that its
        supports leave
    quadratic : faces have nodes in the middle of edges
    face : (k,) int, which of the part's own faces each triangle is of, and -1 where its nodes can
        be cut in one way only
    remarks : sentences on how its faces were made
    young, poisson : a representative modulus and ratio, None: not known
    """

    ids: np.ndarray
    points: np.ndarray
    triangles: np.ndarray
    joint: np.ndarray
    names: list[str]
    held: np.ndarray
    left: np.ndarray
    quadratic: bool = False
    face: np.ndarray = field(default_factory=lambda: np.empty(0, int))
    remarks: list[str] = field(default_factory=list)
    young: float | None = None
    poisson: float = 0.3

    @cached_property
    def centre(self) -> np.ndarray:
        """(3,) what rotations of ``left`` are about."""
        return self.points.mean(axis=0)

    @cached_property
    def size(self) -> float:
        """A length: the joints' extent."""
        return size_of(self.points)


def supports_left(points: np.ndarray, nodes: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """(6, r) the rigid motions, about the mean of points (n, 3) and divided by their size, that
    supports leave.

    nodes : (s, 3) where the supports are; fixed : (s, 3) bool, what they prescribe
    """
    return null_space(motions_about(nodes, points.mean(axis=0),
                                    size_of(points)).reshape(-1, 6)[fixed.ravel()])


def cut_in_triangles(faces: Sequence[np.ndarray], points: np.ndarray, path: KeyPath,
                     name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles (k, 3) of faces, which face (k,) each is of, and the same where it has another
    diagonal too, else -1.

    faces : tables (f, 3, 4, 6 or 8) int, indices of points
    points : (n, 3)
    path, name : for messages
    Raises InputError: a face without area
    """
    found, owner, other, first = [np.empty((0, 3), int)], [np.empty(0, int)], [np.empty(0, int)], 0
    for table in faces:
        cut = np.array(CUT[table.shape[1]])
        found.append(table[:, cut].reshape(-1, 3))
        owner.append(first + np.repeat(np.arange(len(table)), len(cut)))
        other.append(owner[-1] if table.shape[1] in (4, 8) else np.full(len(owner[-1]), -1))
        first += len(table)
    triangles, owner = np.concatenate(found), np.concatenate(owner)
    corners = points[triangles]
    longest = np.max([np.sum((corners[:, i] - corners[:, i - 1]) ** 2, axis=1) for i in range(3)],
                     axis=0)
    bad = np.flatnonzero(areas(points, triangles) <= FLAT * longest)
    if len(bad):
        raise wrong(path,
                    f"{name}: a face of its joints without area, at {corners[bad[0]].mean(axis=0)}",
                    "faces of distinct nodes, the corners in order round the face, then the nodes "
                    "in the middle of "
                    "edges", "look at the nodes of that face: two of them may be the same")
    return triangles, owner, np.concatenate(other)


def components_held(joints: Joints, inner: np.ndarray) -> np.ndarray | None:
    """(3,) bool: which components of all points inside (m, 3), if held, leave the very rigid
    motions that the part's supports
    leave; None: no choice of them does."""
    for bits in range(8):
        components = np.array([bool(bits >> c & 1) for c in range(3)])
        left = supports_left(joints.points, inner, np.broadcast_to(components, inner.shape))
        if left.shape[1] == joints.left.shape[1] and \
                np.linalg.matrix_rank(np.hstack([left, joints.left]), tol=1e-6) == left.shape[1]:
            return components
    return None


def read_joints(part: ForeignPart, path: KeyPath, name: str) -> Joints:
    """Return the joints of a part, whose kind is a module of this folder with a function
    ``joints(part, path, name)``.

    path : of its entry in the YAML; name : of the part
    Raises InputError: files that cannot be read, joints that are none
    """
    return import_module(f"orchestrator.scene.foreign.{part.kind}").joints(part, path, name)


OPTION = "--run-programs"


def not_asked(config: Config) -> list[str]:
    """A sentence for each program, interpreter and form that is not run without ``OPTION``, and
    what is not checked therefore.
    """
    told = dict.fromkeys(sentence for entry in config.codes for sentence in entry.unasked)
    return [f"not checked: {sentence} ({OPTION} does)" for sentence in told]


def check_asked(parts: list[OnePart]) -> None:
    """Raises InputError for programs among the parts."""
    if problems := [Problem(("parts", i, "program", "run"),
                            f"'{part.name}': a program, and nobody has asked for it to be started",
                            f"the user's word: {OPTION}, in Python build_scene(config, "
                            "run_programs=True)",
                            "look at the program first, if it is not yours; orchestrator run "
                            "starts it")
                    for i, part in enumerate(parts) if part.program is not None]:
        raise InputError(problems)
