"""Nodes, elements and sets that the cards of an .inp file give."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from orchestrator.scene.mesh.readers.inp_cards import Card, numbers, CardLine, Scope


def node_table(options: dict[str, str], rows: list[CardLine]) -> np.ndarray:
    """(n, 4) float, numbers and coordinates of nodes, a line each: what follows the third
    coordinate (a normal) is passed over,
    coordinates that are left out are 0.

    Raises InputError: what is no number; coordinates that are not Cartesian
    """
    if options.get("SYSTEM", "R").upper() != "R":
        rows[0].fail(f"nodes in SYSTEM={options['SYSTEM'][:12]}", "Cartesian coordinates")
    full = rows
    if any(row.text.count(",") != 3 or ",," in row.text.replace(" ", "") for row in rows):
        full = [replace(row, text=",".join([word or "0" for word in row.words[:4]]
                                           + ["0"] * (4 - len(row.words)))) for row in rows]
    table = numbers(full).reshape(-1, 4)
    bad = np.flatnonzero(~((table[:, 0] >= 1) & (table[:, 0] == np.floor(table[:, 0]))))
    if len(bad):
        rows[bad[0]].fail(f"'{rows[bad[0]].words[0]}' as the number of a node",
                          "a whole number from 1")
    return table


class InpModel:
    """Nodes, elements and sets of a file.

    cards : of the file
    shape : type of an element, and the line that has it → a name for its shape and its number of
        nodes; None: passed over
    sets : kinds of sets that are read
    nodes : (n, 4) float, numbers and coordinates; of equal numbers CalculiX takes the last
    blocks : shape → (m, 1 + nodes) int, numbers of elements and of their nodes
    sets : kind → name → members, ascending; names as they are written first, capitals do not count
    """

    def __init__(self, cards: list[Card], shape: Callable[[str, CardLine], tuple[str, int] | None],
                 sets: Sequence[str] = ("NSET", "ELSET")):
        nodes, blocks, tables, self._parts = [np.empty((0, 4))], {}, [], {kind: {} for kind in sets}
        for card, options, rows in cards:
            if card == "NODE":
                nodes.append(node_table(options, rows))
                nodes[-1][:, 0] += rows[0].scope.start
                tables.append(("NSET", nodes[-1][:, 0].astype(int)))
            elif card == "ELEMENT" and (known := shape(options.get("TYPE", "").upper(), rows[0])):
                kind, count = known
                table = numbers(rows).astype(int)
                if len(table) % (count + 1):
                    rows[0].fail(f"{len(table)} numbers for elements of {count} nodes",
                                 f"a number and {count} nodes for each")
                table = table.reshape(-1, count + 1) + rows[0].scope.start
                blocks.setdefault(kind, []).append(table)
                tables.append(("ELSET", blocks[kind][-1][:, 0]))
            else:
                tables.append(("", np.empty(0, dtype=int)))
        self.nodes, self.blocks = np.vstack(nodes), {kind: np.vstack(tables)
                                                     for kind, tables in blocks.items()}
        self.scopes = {row[0].scope.name.upper(): row[0].scope for *_, row in cards}
        known = {kind: np.unique(np.concatenate(
            [np.empty(0, dtype=int), *(own for of, own in tables if of == kind)]))
            for kind in ("NSET", "ELSET")}
        for (card, options, rows), (kind, own) in zip(cards, tables):
            if kind:
                self._put(kind, options, rows[0].scope, [own])
            elif card in self._parts:
                members = self._members(card, options, rows, known[card])
                self._put(card, {card: "", **options}, rows[0].scope, members)
        self.sets = {kind: {name: np.unique(np.concatenate(parts)) for name, parts in sets.items()}
                     for kind, sets in self._parts.items()}

    def named(self, kind: str, name: str) -> np.ndarray | None:
        """Members of the set of a name; None where there is none."""
        return next((members for own, members in self.sets[kind].items()
                     if own.upper() == name.upper()), None)

    def _put(self, kind: str, options: dict[str, str], scope: Scope,
             members: list[np.ndarray]) -> None:
        if kind in options and kind in self._parts:
            sets, name = self._parts[kind], scope.prefix + options[kind]
            name = next((own for own in sets if own.upper() == name.upper()), name)
            sets.setdefault(name, []).extend(members)

    def _members(self, kind: str, options: dict[str, str], rows: list[CardLine],
                 known: np.ndarray) -> list[np.ndarray]:
        """Return members that a card gives a set; of a range those that are ``known`` numbers."""
        sets = {name.upper(): parts for name, parts in self._parts[kind].items()}
        instance = options.get("INSTANCE", "").upper()
        scope = self.scopes.get(instance) if instance else rows[0].scope
        if scope is None:
            rows[0].fail("a set of an instance that has no nodes", "the name of an *INSTANCE")
        found: list[np.ndarray] = [np.empty(0, dtype=int)]
        for row in rows:
            if "GENERATE" in options:
                first, last, *step = (row.integer(word) for word in row.words)
                own = known[(known >= first + scope.start) & (known <= last + scope.start)]
                every = max(step[0] if step else 1, 1)
                found.append(own[(own - scope.start - first) % every == 0])
                continue
            for word in filter(None, row.words):
                of, _, last = word.rpartition(".")
                inner = self.scopes.get(of.upper(), scope) if of else scope  # ARM-1.5: its node 5
                number = word if inner is scope else last
                found += sets.get((scope.prefix + word).upper()) or sets.get(word.upper()) or [
                    np.array([row.integer(number) + inner.start])]
        return found


def outer(faces: np.ndarray) -> np.ndarray:
    """Outer faces: those of faces (f, n) of elements that only one has."""
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True,
                                return_counts=True)
    return faces[np.sort(first[count == 1])]


def place(ids: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Places of numbers among ``ids`` (n,); -1 of what is none of them."""
    if not len(ids):
        return np.full(np.shape(wanted), -1)
    order = np.argsort(ids, kind="stable")
    at = order[np.minimum(np.searchsorted(ids, wanted, sorter=order), len(ids) - 1)]
    return np.where(ids[at] == wanted, at, -1)
