"""The graph of a scene: its bodies with their codes, the interfaces between them, supports and loads. ``results.figures.graph`` draws it."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from orchestrator.config.boundary import Entry
from orchestrator.config.model import Config
from orchestrator.errors import Problems
from orchestrator.scene.conditions.supports import loose_bodies
from orchestrator.scene.conditions.selection import volumes_named
from orchestrator.scene.inspection import columns
from orchestrator.scene.model import Scene, Subdomain

MOST = 40  # nodes of a graph that can be read: beyond, bodies alike in name become one node, then those of one code
SHOWN = 6  # supports and loads of a node that are named
OWN_MESH, MATCHING, APART = "own mesh", "matching", "not matching"


@dataclass(frozen=True)
class Node:
    """Bodies: one, or those that are shown as one.

    name : of the body, or what their names have in common
    bodies, pieces, loose : how many there are, subdomains in all, and bodies that nothing but contact holds
    place : (3,) mean of the nodes
    code, element : of the entry of ``blackbox`` that solves it; P1, P2 or own mesh
    dofs : displacement components, counted in each body that a node belongs to
    acts : supports and loads, in words
    """

    name: str
    bodies: int
    pieces: int
    loose: int
    place: np.ndarray
    code: str
    element: str
    dofs: int
    acts: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Edge:
    """Interfaces of one law between two nodes, which are the same where these are shown as one.

    ends : of ``Graph.nodes``
    law, keys : its name, and what the entry of the YAML says beside it
    meshes : whether nodes match
    interfaces, points : how many; points are pairs of nodes, or what stands in their place
    """

    ends: tuple[int, int]
    law: str
    keys: str
    meshes: str
    interfaces: int
    points: int


@dataclass(frozen=True)
class Graph:
    """Nodes and edges; together: what its nodes are, if they are not one body each."""

    name: str
    nodes: list[Node]
    edges: list[Edge]
    together: str = ""

    def readable(self) -> Graph:
        """A graph with at most ``MOST`` nodes, or one for each code and element."""
        for key, together in ((lambda node: (re.sub(r"\d+", "*", node.name), node.code, node.element), "bodies alike in name are one"),
                              (lambda node: ("*", node.code, node.element), "bodies of one code are one")):
            graph = self if len(self.nodes) <= MOST else self._joined(key, together)
            if len(graph.nodes) <= MOST:
                break
        return graph

    def _joined(self, key: Callable[[Node], tuple[str, str, str]], together: str) -> Graph:
        keys = [key(node) for node in self.nodes]
        chosen = {k: [node for node, one in zip(self.nodes, keys) if one == k] for k in dict.fromkeys(keys)}
        place = {k: index for index, k in enumerate(chosen)}
        nodes = [Node(those[0].name if len(those) == 1 else k[0], len(those), sum(n.pieces for n in those), sum(n.loose for n in those),
                      np.mean([n.place for n in those], axis=0), k[1], k[2], sum(n.dofs for n in those),
                      list(dict.fromkeys(act for n in those for act in n.acts))) for k, those in chosen.items()]
        moved = [replace(edge, ends=tuple(sorted(place[keys[e]] for e in edge.ends))) for edge in self.edges]
        return Graph(self.name, nodes, _summed(moved), together)

    def lines(self) -> list[str]:
        """The graph as text: a line for each node, then one for each edge."""
        bodies = [(n.name, str(n.bodies), n.code, n.element, str(n.dofs), str(n.pieces), str(n.loose) if n.loose else "-",
                   "; ".join(told(n.acts)) or "-") for n in self.nodes]
        met = [(" | ".join(self.nodes[e].name for e in edge.ends), edge.law, edge.keys or "-", edge.meshes, str(edge.interfaces),
                str(edge.points)) for edge in self.edges]
        head = f"graph of {self.name}: {sum(n.bodies for n in self.nodes)} bodies, {sum(e.interfaces for e in self.edges)} interfaces"
        return [head + (f"; {self.together}" if self.together else ""), "",
                *columns(("part", "bodies", "code", "element", "dofs", "pieces", "loose", "supports and loads"), bodies), "",
                *columns(("interface", "law", "with", "meshes", "number", "points"), met)]


def told(acts: Sequence[str]) -> list[str]:
    """Names that are told, and how many are not."""
    return [*acts[:SHOWN], *([f"and {len(acts) - SHOWN} more"] if len(acts) > SHOWN else [])]


def graph_of(config: Config, scene: Scene, names: Sequence[str]) -> Graph:
    """The graph, a node for each body.

    names : of the entries of ``boundary``
    """
    bodies: dict[str, list[Subdomain]] = {}
    for s in scene.subdomains:
        bodies.setdefault(s.body, []).append(s)
    number = {name: b for b, name in enumerate(bodies)}
    body = np.array([number[s.body] for s in scene.subdomains])
    acts, loose, nodes = _acts(config, scene, names, body, len(bodies)), loose_bodies(scene), []
    for b, (name, pieces) in enumerate(bodies.items()):
        at = np.unique(np.concatenate([s.nodes for s in pieces]))
        element = OWN_MESH if pieces[0].foreign else "P2" if pieces[0].connectivity.shape[1] == 10 else "P1"
        nodes.append(Node(name, 1, len(pieces), int(any(loose[s.index] for s in pieces)), scene.mesh.nodes[at].mean(axis=0),
                          Path(config.codes[pieces[0].code].code).name, element, 3 * len(at), acts[b]))
    edges = [Edge(ends, i.law.name, _keys(config.interfaces[i.entry]) if i.entry >= 0 else "", MATCHING if i.paired else APART, 1,
                  len(i.global_nodes) if i.mortar is None else len(i.mortar))
             for i in scene.interfaces if (ends := tuple(sorted(body[list(i.subdomains)].tolist())))[0] != ends[1]]
    return Graph(scene.name, nodes, _summed(edges))


def _summed(edges: Sequence[Edge]) -> list[Edge]:
    """An edge of each kind, with its interfaces and points added up."""
    kinds: dict[tuple, list[Edge]] = {}
    for edge in edges:
        kinds.setdefault((edge.ends, edge.law, edge.keys, edge.meshes), []).append(edge)
    return [replace(those[0], interfaces=sum(e.interfaces for e in those), points=sum(e.points for e in those)) for those in kinds.values()]


def _keys(entry: Entry) -> str:
    """Keys of an entry's law, in words."""
    said = entry.model_dump(exclude_unset=True, exclude=set(Entry.model_fields) - {"history"})
    return ", ".join(f"{key} {value}" for key, value in said.items())


def _acts(config: Config, scene: Scene, names: Sequence[str], body: np.ndarray, count: int) -> list[list[str]]:
    """Supports and loads of every body."""
    found: list[list[str]] = [[] for _ in range(count)]
    for entry in scene.boundary:
        for b in np.unique(body[scene.cell_subdomain[entry.cells[:, 0]]]):
            found[b].append(f"{entry.kind} on {names[entry.index]}")
    for k, load in enumerate(config.loads):
        cells = np.isin(scene.mesh.volume, volumes_named(scene.mesh, load.on, ("loads", k, "on"), Problems()))
        for b in np.unique(body[scene.cell_subdomain[cells]]):
            found[b].append(load.acts)
    for bolt in scene.bolts:
        found[body[bolt.interface.subdomains[0]]].append("tightened")
    return found
