"""Draw rigid tools in front of free faces, and find those of a scene."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st

from benchmarks.metamorphic.layout import FACES, Body, rounded

ROUND = 20.0  # radius in cells, so that a face of three of them is .06 off its chord


def tools(data: dict[str, Any]) -> list[dict[str, Any]]:
    """The mappings of all tools in ``interfaces``."""
    return [e["between"][1] for e in data.get("interfaces", []) if isinstance(e["between"], list) and isinstance(e["between"][1], dict)]


def pressing(draw, found: list[Body], boundary: list[dict], unit: float, young: float, strain: float, words: set[str]) -> dict | None:
    """The entry of a tool in front of a face that nothing else is on; None where all have something."""
    free = [(body, face) for body in found for face in FACES
            if face not in body.used and all(e["on"] != body.surface(face) for e in boundary)]
    if not free:
        return None
    body, face = draw(st.sampled_from(free))
    kind, moved = draw(st.sampled_from(["plane", "sphere", "cylinder"])), draw(st.sampled_from(["pressed", "dragged", "pushed"]))
    gap, force = draw(st.sampled_from([0.0, 0.0, 1e-3, 0.05])), young * strain * unit**2 * draw(st.sampled_from([0.3, 2.0]))
    words |= {"tool", f"tool {kind}", f"tool {moved}"}
    friction = draw(st.sampled_from([0.0, 0.1, 0.3]))
    if friction:
        words.add("friction")
    return {"between": [body.name, _tool(body, face, kind, moved, gap, unit, strain, force)], "law": "contact", "friction": friction}


def _tool(body: Body, face: tuple[int, int], kind: str, moved: str, gap: float, unit: float, strain: float, force: float) -> dict[str, Any]:
    """A tool ``gap`` cells in front of a face of a body.

    Parameters
    ----------
    kind : plane, sphere or cylinder
    moved : pressed: by its way, a strain beyond the gap; dragged: along the face as well; pushed: by a force along the normal
    unit : length of a cell
    """
    axis, end = face
    out = np.zeros(3)
    out[axis] = 2.0 * end - 1.0
    at = body.low + body.size / 2
    at[axis] = body.low[axis] + end * body.size[axis] + out[axis] * gap
    across = (axis + 1) % 3
    shape = {"plane": {"at": rounded(at * unit), "normal": rounded(-out)},
             "sphere": {"centre": rounded((at + ROUND * out) * unit), "radius": ROUND * unit},
             "cylinder": {"axis": "xyz"[across], "at": rounded((at + ROUND * out) * unit), "radius": ROUND * unit}}[kind]
    if moved == "pushed":
        way: list[float | None] = [0.0, 0.0, 0.0]
        way[axis] = None
        return {kind: shape, "displacement": way, "force": rounded(-force * out)}
    way = -(gap + (1 if kind == "plane" else 10) * strain) * unit * out
    if moved == "dragged":
        way[across] = strain * unit
    return {kind: shape, "displacement": rounded(way)}
