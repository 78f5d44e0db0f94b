"""Faces laid flat, one beside the other: planes as one looks along their normal, round faces unrolled, others projected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.method.delivery.faces import shape
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.results.figures.plotting import short
from orchestrator.scene.mesh.quadratic import TRIANGLE_EDGES, edges_of

# Of the sheet's width: gap between faces, height of a name below one, width of a letter; of the sheet's height over its width.
_GAP, _LINE, _LETTER, _TALLEST = 0.03, 0.026, 0.0095, 0.6
_SLIMMEST = 1 / 6  # a face that is flatter or slimmer is stretched to that
_FLAT = 0.966  # cosine of 15 degrees, by which normals may turn in what is projected as a plane is: less than a thirtieth is lost
_SMALLER = 0.93  # from one trial size to the next
LONGEST = 34  # letters of a name


@dataclass(frozen=True)
class Flat:
    """Faces on a sheet of width 1, from its lower left corner.

    corners : (m, 3, 3) of their triangles, the last coordinate zero
    rims : (e, 2, 3) edges that one triangle has
    names : under each face, place (3,) of the line's upper middle and text
    frame : (4, 3) corners of what is used of the sheet
    """

    corners: np.ndarray
    rims: np.ndarray
    names: list[tuple[np.ndarray, str]]
    frame: np.ndarray


def laid_flat(nodes: np.ndarray, i: InterfaceFields, length: str = "") -> Flat:
    """The interfaces, each to a scale of its own, larger ones larger; a name tells how wide and high each truly is.

    nodes : (n, 3) of the mesh; length : name of its unit, a space before
    """
    corners = np.zeros((len(i.triangles), 3, 3))
    sizes, names = [], []
    for k, own in i.each():
        mine = i.owner == k
        points, normal = nodes[i.nodes[own]], i.normal[own]
        flat, how = _flat(points[i.triangles[mine] - own.start], points, normal)
        flat -= flat.reshape(-1, 2).min(axis=0, initial=np.inf)
        true = flat.reshape(-1, 2).max(axis=0, initial=0.0)
        name = " | ".join(body.rpartition("/")[2] for body in str(i.names[k]).split(" | "))  # without the parts that solids are of
        name = name if len(name) <= LONGEST else name[:LONGEST - 1] + "…"
        names.append((name, f"{short(true[0])} × {short(true[1])}{length}{how}"))
        shown = np.maximum(true, _SLIMMEST * true.max())
        shown = np.where(true > 0, shown, 1.0) / np.sqrt(max(shown.max(), 1e-300))  # nine times as large is drawn three times as large
        corners[mine, :, :2] = flat / np.where(true > 0, true, 1.0) * shown
        sizes.append(shown)
    sizes, wide = np.array(sizes), np.array([_LETTER * max(map(len, lines)) for lines in names])
    scale, places, height = _packed(sizes, wide)
    corners *= scale
    corners[:, :, :2] += places[i.owner][:, None]
    middles = np.column_stack([places[:, 0] + 0.5 * scale * sizes[:, 0], places[:, 1], np.zeros(len(sizes))])
    frame = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, height, 0.0], [0.0, height, 0.0]])
    edge = edges_of(i.triangles, TRIANGLE_EDGES)[1]
    rims = corners[:, TRIANGLE_EDGES][np.bincount(edge.ravel())[edge] == 1]
    return Flat(corners, rims, [(place, "\n".join(lines)) for place, lines in zip(middles, names)], frame)


def _flat(corners: np.ndarray, points: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, str]:
    """(k, 3, 2) triangles' corners in the plane, and what was done to them; corners : (k, 3, 3); points, normal : (n, 3)."""
    kind, axis, through = shape(points, normal, np.zeros(len(points)), ())
    mean = normal.sum(axis=0)
    if (normal @ mean >= _FLAT * np.linalg.norm(mean)).all():
        kind, axis = "plane", mean / np.linalg.norm(mean)
    if kind == "round":
        return _unrolled(corners, points, axis, through), ", unrolled"
    if kind == "face":
        spread = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
        axis = mean / np.linalg.norm(mean) if np.linalg.norm(mean) > 1e-6 * len(normal) else spread[-1]
    return corners @ _upright(axis), ", projected" * (kind == "face")


def _upright(normal: np.ndarray) -> np.ndarray:
    """(3, 2) right and up in a plane, seen from where x, or else y, grows to the right; up is z, or y where one looks along z."""
    up = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    up = up - (up @ normal) * normal
    up /= np.linalg.norm(up)
    right = np.cross(up, normal)
    return np.column_stack([right * np.sign(right[np.abs(right).argmax()]), up])


def _unrolled(corners: np.ndarray, points: np.ndarray, axis: np.ndarray, through: np.ndarray) -> np.ndarray:
    """Along the circumference and the axis, slit where the widest gap is; a triangle across the slit stays whole."""
    across, axis = _upright(axis), axis * np.sign(axis[np.abs(axis).argmax()])
    angle = np.sort(np.arctan2(*((points - through) @ across).T[::-1]))
    gaps = np.diff(np.r_[angle, angle[0] + 2 * np.pi])
    start = angle[gaps.argmax()] + 0.5 * gaps.max()
    flat = (corners - through) @ across
    turned = np.mod(np.arctan2(flat[..., 1], flat[..., 0]) - start, 2 * np.pi)
    turned += 2 * np.pi * ((np.ptp(turned, axis=1)[:, None] > np.pi) & (turned < np.pi))
    radius, way = np.linalg.norm((points - through) @ across, axis=1).mean(), np.sum((turned - turned.mean()) * flat[..., 0])
    return np.stack([(1.0 if way >= 0 else -1.0) * radius * turned, (corners - through) @ axis], axis=-1)


def _packed(sizes: np.ndarray, wide: np.ndarray) -> tuple[float, np.ndarray, float]:
    """Pack as large as they fit, in rows, the tallest first: scale, lower left corners (k, 2), height of the sheet.

    sizes : (k, 2); wide : (k,) width of each one's name
    """
    order = np.argsort(-sizes[:, 1], kind="stable")
    scale = 1.0 / sizes[:, 0].max()
    while True:
        box = np.maximum(scale * sizes[:, 0], wide) + _GAP
        left, top, x, y, deep = np.zeros(len(sizes)), np.zeros(len(sizes)), 0.0, 0.0, 0.0
        for k in order:
            if x > 0 and x + box[k] > 1 + _GAP + 1e-9:
                x, y, deep = 0.0, y + deep, 0.0
            left[k], top[k] = x, y
            x, deep = x + box[k], max(deep, scale * sizes[k, 1] + 2 * _LINE + _GAP)
        height = y + deep
        if height <= _TALLEST or scale * sizes.max() < _LINE:
            break
        scale *= _SMALLER
    spare = 1.0 - (left + box - _GAP).max()  # what the longest row leaves, half on either side
    middle = left + 0.5 * (box - _GAP - scale * sizes[:, 0] + spare)
    return scale, np.column_stack([middle, height - top - scale * sizes[:, 1]]), height


def shares(corners: np.ndarray) -> np.ndarray:
    """(m, 3, 2, 3, 3) what of each triangle is nearest to which corner, in two triangles: a sixth of its area each."""
    middle, centre = 0.5 * (corners + corners[:, [1, 2, 0]]), np.broadcast_to(corners.mean(axis=1)[:, None], corners.shape)
    return np.stack([np.stack([corners, middle, centre], axis=2), np.stack([corners, centre, middle[:, [2, 0, 1]]], axis=2)], axis=2)
