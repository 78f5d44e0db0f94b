"""The joints of a CalculiX deck: node sets, and the elements' faces whose nodes are all in one of
them.

Nothing else of the deck is looked at but where it is supported, its first moduli, and its cards:
some no part can have.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from orchestrator.config.mesh import DeckPart
from orchestrator.errors import InputError, KeyPath, Problem, wrong
from orchestrator.scene.foreign.surfaces import forgotten, holes
from orchestrator.scene.foreign.joints import Joints, cut_in_triangles, supports_left
from orchestrator.scene.mesh.readers.inp import solid_nodes, SOLIDS
from orchestrator.scene.mesh.readers.inp_cards import (
    cards, cards_of_a_model, heading, Inclusion, numbers, CardLine)
from orchestrator.scene.mesh.readers.inp_model import InpModel, outer, place
from orchestrator.scene.mesh.readers.splitting import CORNERS, EDGES, SIDES

# CalculiX has none
SHAPES = {count: shape for count, shape in SOLIDS.items() if shape != "pyramid"}
# Faces of elements by their number of nodes, corners first; anticlockwise seen from outside.
_CORNERS = {size: SIDES[CORNERS.get(shape, (shape,))[0]] for size, shape in SHAPES.items()}
# Of elements with such nodes, which one is in the middle of two corners.
_EDGES = {size: {tuple(sorted(ends)): CORNERS[shape][1] + i
                 for i, ends in enumerate(EDGES[shape].tolist())}
          for size, shape in SHAPES.items() if shape in EDGES}

# Cards of matter and conditions whose answers are not proportional to forces.
NONLINEAR = {"PLASTIC", "CYCLIC HARDENING", "HYPERELASTIC", "HYPERFOAM", "CREEP",
             "DEFORMATION PLASTICITY", "MOHR COULOMB",
             "CONTACT PAIR", "GAP", "SURFACE BEHAVIOR", "USER MATERIAL"}
# What CalculiX keeps from one step to the next, and how many words of a line say where it acts.
KEPT = {"CLOAD": 2, "DLOAD": 2, "DSLOAD": 2, "BOUNDARY": 2, "TEMPERATURE": 1}
# Those that write to files, or read from files, that they name; CalculiX does not mind blanks.
OF_FILES = ("VIEWFACTOR", "SUBMODEL", "SUBSTRUCTURE", "CRACKPROPAGATION")
# What is said with a step, which is not the part's to say.
OF_STEPS = {"STEP", "END STEP", "STATIC", "FREQUENCY", "DYNAMIC", "HEAT TRANSFER", "BUCKLE",
            "RESTART"}


def joints(part: DeckPart, path: KeyPath, name: str) -> Joints:
    """The deck's joints, the nodes of all of them in ascending order of their numbers."""
    try:
        return _joints(part, path, name)
    except InputError as error:  # readers of cards know no more than the line
        raise InputError([p if p.path[:1] == path[:1]
                          else replace(p, path=(*path, "calculix"),
                                       cure="mend that line of the deck")
                          for p in error.problems]) from error


def _joints(part: DeckPart, path: KeyPath, name: str) -> Joints:
    deck = Deck(Path(part.calculix), (*path, "calculix"))
    for i, file in enumerate(part.loads or []):
        check_cards(Path(file), (*path, "loads", i), loads=True)
    check_kept([Path(file) for file in part.loads or []], (*path, "loads"))
    members = [deck.nodes_of(joint, (*path, "joints", i)) for i, joint in enumerate(part.joints)]
    ids = np.unique(np.concatenate(members))
    points = deck.places(ids)
    faces, joint, remarks = [], [], []
    for i, own in enumerate(members):
        tables = [outer[np.isin(outer, own).all(axis=1)] for outer in deck.outer_faces]
        if not any(len(table) for table in tables):
            raise wrong((*path, "joints", i),
                        f"the node set {part.joints[i]} of '{name}' holds no face of an element",
                        "all nodes of the faces that the part meets others on, those in the "
                        "middle of edges too",
                        "put every node of those faces in the set")
        faces.append([np.searchsorted(ids, table) for table in tables])
        joint.append([np.full(len(table), i) for table in tables])
    flat = [table for tables in faces for table in tables]
    triangles, owner, face = cut_in_triangles(flat, points, path, f"'{name}'")
    joint = np.concatenate([j for own in joint for j in own])[owner]
    quadratic = any(table.shape[1] in (6, 8) for table in flat)
    for i, own in enumerate(part.joints):
        own = f"{name}/{own}"
        remarks += forgotten(deck.outer_faces, members[i], deck.ids, deck.points, own) or \
            holes(points, triangles[joint == i], quadratic, own)
    for kind, options, rows in deck.cards:
        if kind == "TRANSFORM" and np.isin(ids, deck.nodes_of(options.get("NSET", ""), path)).any():
            rows[0].fail(
                f"*TRANSFORM on nodes of a joint of '{name}': forces would be turned and "
                "displacements not",
                         "joint nodes in the mesh's own axes")
    held, left = deck.supports(ids, points, [Path(file) for file in part.loads or []])
    if part.held != "auto":
        left = np.zeros((6, 0)) if part.held else np.eye(6)
    return Joints(ids, points, triangles, joint, list(part.joints), held, left,
                  quadratic, face, remarks, *deck.moduli())


def _solid(kind: str, row: CardLine) -> tuple[str, int] | None:
    if not kind.startswith("C3D"):
        return None
    if (count := solid_nodes(kind)) not in SHAPES:
        row.fail(f"solid elements of type {kind[:12]}", "C3D4, C3D6, C3D8, C3D10, C3D15 or C3D20")
    return SHAPES[count], count


class Deck(InpModel):
    """Contents of a deck, as far as they are read.

    file : the deck
    path : of its key in the YAML
    """

    def __init__(self, file: Path, path: KeyPath):
        self.path, self.file = path, file
        check_cards(file, path)
        self.cards = cards_of_a_model(file)
        for *_, rows in self.cards:
            if rows[0].scope.start:
                rows[0].fail("lines of a *PART: CalculiX knows no parts",
                             "one list of nodes and elements")
        super().__init__(self.cards, _solid, ["NSET"])
        if not len(self.nodes):
            raise wrong(path, f"{file}: no nodes", "*NODE with number, x, y, z",
                        "name the file that has the nodes, or that includes it")
        ids = self.nodes[::-1, 0].astype(int)
        self.ids, last = np.unique(ids, return_index=True)  # CalculiX takes the last
        self.points = self.nodes[::-1][last, 1:]

    def nodes_of(self, name: str, path: KeyPath) -> np.ndarray:
        """Numbers of a node set's nodes, ascending."""
        if (members := self.named("NSET", name)) is None:
            raise wrong(path, f"{self.file}: no node set {name}",
                        "a set of *NSET: " + (", ".join(self.sets["NSET"]) or "there is none"),
                        f"add *NSET, NSET={name} with the nodes of the joint")
        return members

    def places(self, ids: np.ndarray) -> np.ndarray:
        """(n, 3) where nodes are."""
        if ((at := place(self.ids, ids)) < 0).any():
            raise wrong(self.path,
                        f"{self.file}: node {ids[at < 0][0]} of a joint is not there",
                        "nodes that *NODE gives", "mend the node set")
        return self.points[at]

    @cached_property
    def outer_faces(self) -> list[np.ndarray]:
        """Tables (f, 3, 4, 6 or 8) of the outer faces of solid elements, by number of nodes."""
        found: dict[int, list[np.ndarray]] = {}
        for table in self.blocks.values():
            size = table.shape[1] - 1
            for corners in _CORNERS[size]:
                middles = _EDGES.get(size)
                own = corners + [middles[tuple(sorted(e))]
                                 for e in zip(corners,
                                              corners[1:] + corners[:1])] if middles else corners
                found.setdefault(len(own), []).append(table[:, 1:][:, own])
        return [outer(np.concatenate(tables)) for _, tables in sorted(found.items())]

    def solids(self) -> list[tuple[str, np.ndarray]]:
        """Solid elements by meshio's names, nodes as places in ``ids``; nodes of both programs come
        in the same order.
        """
        return [(shape, np.searchsorted(self.ids, self.blocks[shape][:, 1:]))
                for shape in SHAPES.values() if shape in self.blocks]

    def supports(self, ids: np.ndarray, points: np.ndarray,
                 loads: list[Path]) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3) bool, components of joint nodes that are held, and the rigid motions (6, r) that
        all supports leave.

        Raises InputError: loads that hold what the deck does not, or move what it holds on a joint
        """
        fixed = np.zeros((len(self.ids), 3), dtype=bool)
        for _, at, components in self._held(self.cards):
            fixed[np.ix_(at, components)] = True
        for file in loads:
            for row, at, components in self._held(cards(file)):
                if not fixed[np.ix_(at, components)].all():
                    row.fail(
                        "*BOUNDARY in the loads on dofs that the deck leaves free: its stiffness "
                        "would be another",
                             "supports in the deck; loads may move what the deck holds")
                if np.isin(self.ids[at], ids).any():
                    row.fail("*BOUNDARY in the loads on nodes of a joint",
                             "joint nodes that other parts move, or the deck holds")
        return fixed[np.searchsorted(self.ids, ids)], supports_left(points, self.points, fixed)

    def _held(self,
              given: Iterable[tuple[str, dict[str, str], list[CardLine]]]) -> Iterator[
                  tuple[CardLine, np.ndarray, list[int]]]:
        """Lines of *BOUNDARY, with the nodes that they hold, as places in ``ids``, and
        components.
        """
        for card, _, rows in given:
            for row in rows if card == "BOUNDARY" else ():
                words = row.words
                nodes = self.named("NSET", words[0])
                nodes = np.array([row.integer(words[0])]) if nodes is None else nodes
                first = row.integer(words[1])
                last = row.integer(words[2]) if len(words) > 2 and words[2] else first
                yield row, np.flatnonzero(np.isin(self.ids, nodes)), [
                    c - 1 for c in range(max(first, 1), min(last, 3) + 1)]

    def moduli(self) -> tuple[float, float] | tuple[None, float]:
        """A representative modulus and ratio: those of the first material, means of directions
        where it has several.
        """
        for card, options, rows in self.cards:
            if card == "ELASTIC":
                values, kind = numbers(rows), options.get("TYPE", "ISO").upper()
                if kind.startswith("ENGINEERING") and len(values) >= 9:
                    return float(values[:3].mean()), float(min(0.45, np.abs(values[3:6]).mean()))
                if kind.startswith("ORTHO") and len(values) >= 9:
                    # of isotropic matter of ratio .3, E is .74 of the stiffness with all other
                    # strains prevented
                    return float(0.74 * values[[0, 2, 5]].mean()), 0.3
                if kind.startswith("ISO") and len(values) >= 2:
                    return float(values[0]), float(min(values[1], 0.49))
        return None, 0.3


def headings(file: Path, path: KeyPath) -> Iterator[tuple[str, dict[str, str], str]]:
    """Keyword, options and place of every card, those without lines too; of files that are included
    as well.
    """
    try:
        for text, at, number in Inclusion(file).spliced():
            if text.startswith("*"):
                yield *heading(text), f"{at}:{number}"
    except InputError as error:
        raise InputError([Problem(path, p.found, p.expected, "mend the deck")
                          for p in error.problems]) from error


def files_of(file: Path) -> list[Path]:
    """A deck's file and those that it includes, as they are named."""
    deck = Inclusion(file)
    for _ in deck.spliced():
        pass
    return deck.opened


def check_cards(file: Path, path: KeyPath, loads: bool = False) -> None:
    """Raises InputError for cards that the deck of a part, or the file of its loads, cannot
    have.
    """
    for card, options, where in headings(file, path):
        if card in OF_STEPS and not (loads and "NLGEOM" in options):
            said = (f"*{card}", "what stands between *STATIC and *END STEP",
                    "leave this line out: steps are made here") if loads else (
                f"*{card}", "the deck up to its first *STEP",
                "put what stands between *STATIC and *END STEP in a file of its own, loads:, and "
                "leave the rest out")
        elif card.replace(" ", "").startswith(OF_FILES):
            said = (
                f"*{card[:20]}, which writes or reads files of its own",
                "cards of matter, supports and loads", "leave the card out")
        elif "NLGEOM" in options:
            said = (
                f"NLGEOM on *{card}: large displacements, to which joint forces are not "
                "proportional", "a linear part",
                    "leave NLGEOM out")
        elif card in NONLINEAR:
            said = (f"*{card}, which makes the part nonlinear",
                    "a linear part: its answers are superposed",
                    "leave the card out, or put the nonlinear part in the orchestrator's own "
                    "contact laws, or in a solver in Python with nonlinear: true")
        elif loads and card == "BOUNDARY" and _new(options):
            said = (
                "*BOUNDARY, OP=NEW takes the deck's supports away: its stiffness would be another",
                "supports that stay",
                     "leave OP=NEW out, and move what is to be back by 0")
        elif card == "AMPLITUDE" and "".join(options.get("TIME",
                                                         "").upper().split()) == "TOTALTIME":
            said = ("*AMPLITUDE, TIME=TOTAL TIME, which runs on from load step to load step",
                    "amplitudes of the time within a load step",
                    "leave TIME=TOTAL TIME out, and write a file of loads for each load step")
        elif loads and card == "MODEL CHANGE":
            said = (
                "*MODEL CHANGE makes the deck's stiffness another", "loads alone",
                "leave the elements out of the deck, or in it")
        else:
            continue
        raise wrong(path, f"{where}: {said[0]}", *said[1:])


def check_kept(files: list[Path], path: KeyPath) -> None:
    """Raises InputError where a file says nothing of a load of the file before: CalculiX would keep
    it from step to step, and
    here a file says all that acts in its load step."""
    before: dict[tuple[str, ...], CardLine] = {}
    for i, file in enumerate(files):
        new = {card for card, options, _ in headings(file, path) if _new(options)}
        said = {(card, *(word.upper() for word in row.words[: KEPT[card]])): row
                for card, _, rows in cards(file) if card in KEPT
                for row in rows}
        for key, row in before.items():
            if key not in said and key[0] not in new:
                raise wrong((*path, i),
                            f"{file} says nothing of {', '.join(key[1:])} under *{key[0]}, which "
                            "CalculiX would keep from the load step before "
                            f"({row.file}:{row.line})",
                            "in each file all that acts in its load step",
                            "write that line again with what it is now, which may be 0"
                            + ("" if key[0] == "BOUNDARY"
                               else f"; or *{key[0]}, OP=NEW if it ends"))
        before = said


def _new(options: dict[str, str]) -> bool:
    return options.get("OP", "").upper() == "NEW"
