"""The graph of a scene as a picture: bodies where their centres are, seen so that they spread, pushed apart where they would overlap."""

from __future__ import annotations

from textwrap import shorten
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.results.figures.plotting import COLOURS, GREY, new_figure, png
from orchestrator.scene.graph import APART, Edge, Graph, Node, told

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDE, LINE = 2.1, 0.15  # inches: a node, and a line of its text
ROOM = 1.35  # distance of two nodes that just do not touch, over their size
TURNS = 500  # of pushing apart
FEW, THIN = 6, 0.05  # a chain: more nodes than that, whose second extent is less than so much of the first
LONG, SMALL = 34, 7  # letters of a line; points
LABELS = 60  # edges that have a text


def draw_graph(graph: Graph) -> bytes:
    """PNG of a graph that is ``readable``: nodes as boxes coloured by code, edges coloured by law, dashed where meshes do not match."""
    texts = [_text(node) for node in graph.nodes]
    size = np.array([[WIDE, LINE * (2 + text.count("\n"))] for text in texts])
    at = layout(np.array([node.place for node in graph.nodes]), ROOM * size)
    low, high = (at - 0.6 * size).min(axis=0) - 0.3, (at + 0.6 * size).max(axis=0) + 0.3
    codes = _colours([f"{node.code}, {node.element}" for node in graph.nodes], 0)
    laws = _colours([_law(edge) for edge in graph.edges], len(codes))
    high[1] += LINE * (4 + (len(codes) + len(laws)) // 3)  # what the legend takes
    figure = new_figure(*np.maximum(high - low, [6.5, 1]))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(low[0], low[0] + max(high[0] - low[0], 6.5)), ylim=(low[1], high[1]))
    axes.axis("off")
    _edges(axes, graph, at, size, laws)
    for node, text, (x, y) in zip(graph.nodes, texts, at):
        axes.text(x, y, text, ha="center", va="center", fontsize=SMALL, zorder=3, bbox={
            "boxstyle": "round", "facecolor": "white", "edgecolor": codes[f"{node.code}, {node.element}"], "linewidth": 2})
    _legend(axes, graph, codes, laws)
    return png(figure)


def layout(places: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(n, 2) where nodes are drawn, in inches: their places along the two directions in which they spread most, scaled so that they have
    room on average, and pushed apart until none overlap.

    places : (n, 3); size : (n, 2) that each needs
    """
    n = len(places)
    centred = places - places.mean(axis=0)
    spread, axes = np.linalg.eigh(centred.T @ centred)
    axes = axes[:, np.argsort(-spread, kind="stable")[:2]]
    axes = axes[:, np.argsort(np.abs(axes).argmax(axis=0), kind="stable")]  # x before y before z
    axes = axes * np.where(axes[np.abs(axes).argmax(axis=0), [0, 1]] < 0, -1, 1)
    at = centred @ axes
    extent = np.ptp(at, axis=0)
    if n > FEW and extent[1] < THIN * extent[0]:
        return _rows(at[:, 0], size.max(axis=0))
    at = at / max(extent.max(), 1e-300) * size.max(axis=0) * np.sqrt(n)
    angle = 2.399963 * np.arange(n)  # the golden angle: what lies in one place is pushed to all sides
    at = at + 1e-3 * np.column_stack([np.cos(angle), np.sin(angle)])
    for _ in range(TURNS):
        apart = at[:, None] - at[None]
        over = (size[:, None] + size[None]) / 2 - np.abs(apart)
        over[np.arange(n), np.arange(n)] = 0
        hit = (over > 0).all(axis=2)
        if not hit.any():
            break
        along = np.where(over[..., 0] / size.max(axis=0)[0] < over[..., 1] / size.max(axis=0)[1], 0, 1)  # the shorter way out
        push = np.where(np.arange(2) == along[..., None], over, 0) * np.where(apart < 0, -1, 1) * hit[..., None]
        at = at + 0.3 * push.sum(axis=1)
    return at


def _rows(along: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(n, 2) places of a chain, to and fro in rows."""
    wide = int(np.ceil(np.sqrt(len(along))))
    row, column = np.divmod(np.argsort(np.argsort(along, kind="stable")), wide)
    return np.column_stack([np.where(row % 2, wide - 1 - column, column), -row]) * size * [1.2, 2]


def _text(node: Node) -> str:
    head = node.name if node.bodies == 1 else f"{node.name} ({node.bodies} bodies)"
    size = f"{node.code}, {node.element}, {node.dofs:,} dofs" + (f", {node.pieces} pieces" if node.pieces > node.bodies else "")
    loose = [] if not node.loose else ["held by contact alone" if node.bodies == 1 else f"{node.loose} held by contact alone"]
    return "\n".join(shorten(line, LONG, placeholder=" …") for line in [head, size, *loose, *told(node.acts)])


def _colours(names: list[str], first: int) -> dict[str, str]:
    return {name: COLOURS[(first + k) % len(COLOURS)] for k, name in enumerate(dict.fromkeys(names))}


def _edges(axes: Axes, graph: Graph, at: np.ndarray, size: np.ndarray, laws: dict[str, str]) -> None:
    """Lines between nodes, beside each other where two are between the same; of a node with itself, its text below the box."""
    between: dict[tuple[int, int], list[Edge]] = {}
    for edge in graph.edges:
        between.setdefault(edge.ends, []).append(edge)
    for (a, b), edges in between.items():
        for k, edge in enumerate(edges):
            if a == b:
                x, y = at[a] - [0, size[a][1] / 2 + (k + 1) * LINE]
            else:
                aside = (k - (len(edges) - 1) / 2) * np.array([-1, 1]) * (at[b] - at[a])[::-1] / np.linalg.norm(at[b] - at[a]) * 2 * LINE
                axes.plot(*(np.array([at[a], at[b]]) + aside).T, color=laws[_law(edge)], linewidth=1.6, zorder=1,
                          linestyle="--" if edge.meshes == APART else "-")
                x, y = (at[a] + at[b]) / 2 + aside
            if len(graph.edges) <= LABELS or a == b:
                text = (f"{edge.interfaces} interfaces, " if edge.interfaces > 1 else "") + f"{edge.points} points"
                axes.text(x, y, text, fontsize=SMALL - 1, ha="center", va="center", color=laws[_law(edge)], zorder=2,
                          bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6})


def _law(edge: Edge) -> str:
    return f"{edge.law} ({edge.keys})" if edge.keys else edge.law


def _legend(axes: Axes, graph: Graph, codes: dict[str, str], laws: dict[str, str]) -> None:
    from matplotlib.lines import Line2D

    marks = [Line2D([], [], color=colour, marker="s", markerfacecolor="white", linestyle="none", label=name) for name, colour in codes.items()]
    marks += [Line2D([], [], color=colour, label=name) for name, colour in laws.items()]
    if any(edge.meshes == APART for edge in graph.edges):
        marks.append(Line2D([], [], color=GREY, linestyle="--", label="meshes do not match"))
    title = graph.lines()[0]
    axes.legend(handles=marks, loc="upper left", ncols=3, fontsize=SMALL, frameon=False, title=title, title_fontsize=SMALL + 1,
                alignment="left")
