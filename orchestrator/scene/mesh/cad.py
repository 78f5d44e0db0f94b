"""A CAD model beside its mesh, as gmsh knows it: shapes of faces without any fit, element sizes
where they are asked for.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from orchestrator.config.mesh import Curved
from orchestrator.errors import Problems, some
from orchestrator.scene.mesh.checks import check_size
from orchestrator.scene.mesh.gmsh_session import TRIANGLE, elements, gmsh
from orchestrator.scene.mesh.size_map import SizeMap
from orchestrator.scene.names import matching, suggestion
from orchestrator.scene.shapes import Shape

# gmsh's names of surfaces that have a radius, and ours
ROUND = {"Cylinder": "cylinder", "Sphere": "sphere"}


def face_shape(tag: int) -> Shape:
    """The shape of a face of the model that gmsh holds and has meshed, with the face's normals at
    the corners of its triangles;
    ``curved`` where it is neither plane, cylinder nor sphere."""
    return replace(_kind(tag), normals=_normals(tag))


def _normals(tag: int) -> np.ndarray:
    """(k, 3, 3) unit normals of a face at the corners of its triangles; nan where it has none, as
    at the pole of a sphere.
    """
    tags, at, _ = gmsh.model.mesh.getNodes(2, tag, includeBoundary=True,
                                           returnParametricCoord=False)
    normals = np.reshape(gmsh.model.getNormal(tag, gmsh.model.getParametrization(2, tag, at)),
                         (-1, 3))
    with np.errstate(invalid="ignore", divide="ignore"):
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    order = np.argsort(tags)
    return normals[order[np.searchsorted(tags[order], elements(TRIANGLE, [tag])[0])]]


def _kind(tag: int) -> Shape:
    """Shape of a face."""
    kind = gmsh.model.getType(2, tag)
    if kind != "Plane" and kind not in ROUND:
        return Shape("curved")
    low, high = np.array(gmsh.model.getParametrizationBounds(2, tag))
    at = [low + share * (high - low) for share in ((0.5, 0.5), (0.75, 0.5))]
    points, normals = (np.reshape(f(np.concatenate(at)), (2, 3)) for f in (
        lambda uv: gmsh.model.getValue(2, tag, uv), lambda uv: gmsh.model.getNormal(tag, uv)))
    if kind == "Plane":
        return Shape("plane", normals[0], through=points[0])
    curvatures = gmsh.model.getPrincipalCurvatures(tag, at[0])
    radius = 1 / float(max(abs(curvatures[0][0]), abs(curvatures[1][0])))
    # normals turn towards the axis along a way within a hollow face
    outward = float(np.sign((points[1] - points[0]) @ (normals[1] - normals[0])))
    through = points[0] - outward * radius * normals[0]
    if kind == "Sphere":
        return Shape("sphere", None, radius, through)
    axis = np.array(curvatures[2 if abs(curvatures[0][0]) < abs(curvatures[1][0]) else 3])
    return Shape("cylinder", axis * np.sign(axis[np.abs(axis).argmax()]), radius, through)


@dataclass(frozen=True)
class Sizing:
    """Size of a solid's elements.

    largest, least : lengths; none: gmsh's own choice
    per_circle : elements on a full circle; 0: curvature does not count
    """

    largest: float | None = None
    least: float | None = None
    per_circle: float = 0.0

    @classmethod
    def of(cls, h: Any) -> Sizing:
        """The sizing for a value of ``h`` in the YAML."""
        return cls(h.max, h.min, h.curvature) if isinstance(h,
                                                            Curved) else cls(None if h is None
                                                                             else float(h))

    def apply(self, per_circle: float, finest: float | None) -> None:
        """Tells gmsh.

        per_circle : elements on a full circle that an attempt has at least
        finest : the smallest size that is asked for somewhere, None where none is
        """
        least = 0.0 if self.least is None else min(self.least,
                                                   self.least if finest is None else finest)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 1e22 if self.largest is None else self.largest)
        gmsh.option.setNumber("Mesh.MeshSizeMin", least)
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", max(per_circle, self.per_circle))

    def __str__(self) -> str:
        told = "auto" if self.largest is None else f"{self.largest:g}"
        return told + (f", curvature {self.per_circle:g}" if self.per_circle else "")


def check_curvature(solids: Iterable[tuple[Iterable[int], Sizing]]) -> None:
    """Raises InputError for elements on curved faces so small that no memory holds them; solids by
    the tags of their faces.
    """
    count, most = 0.0, 0.0
    for faces, sizing in solids:
        for tag in faces if sizing.per_circle else ():
            low, high = np.array(gmsh.model.getParametrizationBounds(2, tag))
            bent = max(float(abs(k[0]))
                       for k in gmsh.model.getPrincipalCurvatures(tag, (low + high) / 2)[:2])
            per_length = bent * sizing.per_circle / (2 * np.pi)
            per_length = min(per_length, 1 / sizing.least) if sizing.least else per_length
            count, most = count + 1.15 * gmsh.model.occ.getMass(2, tag) * per_length**2, max(
                most, sizing.per_circle)
    check_size(count, ("mesh", "h"), f"curvature: {most:g}",
               lambda factor: f"take elements {factor:.2g} times as large on curved faces: "
               f"curvature: {most / factor:.2g}, or a larger min")


def sizes_of(names: list[str], h: Any) -> dict[str, Sizing]:
    """Sizes by name of a solid; of several patterns that match, the last wins.

    Raises InputError: patterns that match nothing, solids that none matches
    """
    if not isinstance(h, dict):
        return dict.fromkeys(names, Sizing.of(h))
    problems, sizes = Problems(), {}
    for pattern, size in h.items():
        if not (own := matching(pattern, names)):
            problems.add(("mesh", "h"), f"no solid is called {pattern!r}",
                         "names of solids, shell wildcards allowed",
                         suggestion(pattern, names, "solid"))
        sizes.update(dict.fromkeys(own, Sizing.of(size)))
    if left := [name for name in names if name not in sizes]:
        problems.add(("mesh", "h"), f"no element size for {some(left, 8)}",
                     "an element size for each solid",
                     "begin with one for all: '*': 5")
    problems.raise_if_any()
    return sizes


def refined_faces(refine: Sequence[Any], faces: Mapping[str, int]) -> dict[float, list[int]]:
    """Tags of the faces that elements of a size are asked for on, by that size.

    refine : entries with names ``on`` and ``h``; faces : name ``solid:3`` → tag
    Raises InputError: names that match no face and no solid
    """
    problems, found = Problems(), {}
    solids = list(dict.fromkeys(name.rpartition(":")[0] for name in faces))
    for i, entry in enumerate(refine):
        for pattern in entry.on:
            own = matching(pattern, faces) or [
                face for solid in matching(pattern, solids) for face in faces
                if face.startswith(f"{solid}:")]
            if not own:
                problems.add(("mesh", "refine", i, "on"),
                             f"no face and no solid is called {pattern!r}",
                             "names of faces or solids, shell wildcards allowed",
                             suggestion(pattern, [*solids, *faces], "face"))
            found.setdefault(entry.h, []).extend(faces[name] for name in own)
    problems.raise_if_any()
    return found


def apply_refinement(refined: Mapping[float, list[int]],
                     sizes: SizeMap | None = None) -> float | None:
    """Has gmsh make elements of a size on faces, given by their tags, and what is around them grow
    from there; and follow a map.

    Nothing is left of what has been asked of the solid before. With a map elements do not grow from
    edges and corners.
    Returns the smallest size that is asked for, None where none is
    """
    for tag in gmsh.model.mesh.field.list():
        gmsh.model.mesh.field.remove(tag)
    for tag in gmsh.view.getTags():
        gmsh.view.remove(tag)
    for option in ("ExtendFromBoundary", "FromPoints"):
        gmsh.option.setNumber(f"Mesh.MeshSize{option}", sizes is None)
    fields = [] if sizes is None else [sizes.apply()]
    for size, tags in refined.items():
        fields.append(gmsh.model.mesh.field.add("Constant"))
        gmsh.model.mesh.field.setNumbers(fields[-1], "SurfacesList", tags)
        gmsh.model.mesh.field.setNumber(fields[-1], "VIn", size)
        gmsh.model.mesh.field.setNumber(fields[-1], "VOut", 1e22)
    if fields:
        both = gmsh.model.mesh.field.add("Min")
        gmsh.model.mesh.field.setNumbers(both, "FieldsList", fields)
        gmsh.model.mesh.field.setAsBackgroundMesh(both)
    return min([*refined, *([] if sizes is None else [float(sizes.size.min())])], default=None)
