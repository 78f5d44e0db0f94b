"""What several ranks have of a solution: each its piece of the fields; rank 0 the states of all, for its subscribers.

What is computed of fields is computed by all ranks, each of its own cells and displacements. Nobody holds stresses of the whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from orchestrator.method.checkpoint import Numbers
from orchestrator.method.delivery.recovery import Parts, at_nodes
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.method.events import Finished, Iteration, Subscriber, Subscribers
from orchestrator.method.stopping.discretisation import Estimate, leaping, leaps
from orchestrator.method.stopping.element_problems import kind_of
from orchestrator.parallel.numbering import Meeting
from orchestrator.parallel.team import Team
from orchestrator.results.extremes import Extremes, extremes
from orchestrator.results.fields.fields import Fields, shown_moduli
from orchestrator.results.probes import Reader
from orchestrator.scene.conditions.probes import Line, Point, Section, Surface
from orchestrator.scene.interface import Interface
from orchestrator.scene.model import Scene, Subdomain


@dataclass
class Piece:
    """A rank's piece of the results. Every rank asks the same of its own, in the same order.

    fields : of its cells, bodies with nodes of their own where interfaces open
    cells : (k,) int, their numbers in the whole
    team : the ranks
    body_force : (T, k, 1 or 4, 3) force/volume of each cell, as a scene's; None where there is none
    loads : (T, n, 3) forces at its nodes
    number : (n,) int, its nodes' numbers in the whole mesh
    copy : (n,) int, ascending, where bodies have nodes of their own: which of all these nodes its are; None where they have not
    probes : of the scene, those over faces with what is on its cells
    counts : (subdomains,) int, how many each subdomain of the scene has
    lame : (k, 2) of its matter; ours : (k,) bool, cells that stand for nothing else
    leaps : some of its cells and their η² of leaps between bonded sides that do not match, see ``stopping.leaps``
    """

    fields: Fields
    cells: np.ndarray
    team: Team
    body_force: np.ndarray | None
    loads: np.ndarray
    lame: np.ndarray
    ours: np.ndarray
    leaps: list[tuple[np.ndarray, np.ndarray]]
    number: np.ndarray
    copy: np.ndarray | None
    counts: np.ndarray
    probes: Sequence[Point | Line | Section | Surface]
    interfaces: InterfaceFields | None = None  # of those whose first side is its, where some interface is not perfect

    @classmethod
    def of(cls, scene: Scene, own: Sequence[Subdomain], continuous: Parts, opens: bool, meeting: Meeting) -> Piece:
        """This rank's own; all ranks make theirs together.

        scene : its part of the scene; ``meeting`` came with it
        own : the subdomains that are its
        continuous : per subdomain of the scene (T, n_E, 3), of its own ones at least
        opens : whether bodies have nodes of their own
        """
        starts, sides = np.cumsum([0, *(len(s.nodes) for s in own)]), [continuous[s.index] for s in own]
        chosen = np.sort(np.concatenate([s.cells for s in own]))
        cells = np.empty((len(scene.mesh.cells), scene.mesh.cells.shape[1]), dtype=int)
        for s, start in zip(own, starts):
            cells[s.cells] = s.connectivity + start
        nodes, cells, joined, copy = np.concatenate([s.nodes for s in own]), cells[chosen], None, None
        counts = scene.overview.nodes
        loads, body_force = np.concatenate([s.loads for s in own], axis=1), scene.body_force
        if opens:
            joined, displacement = np.unique(meeting.label, return_inverse=True)[1].ravel(), np.concatenate(sides, axis=1)
            first = np.cumsum(counts) - counts
            copy = np.concatenate([np.arange(first[s.index], first[s.index] + len(s.nodes)) for s in own])
        else:
            nodes, place = np.unique(nodes, return_inverse=True)
            cells, displacement = place[cells], _mean(np.split(place, starts[1:-1]), sides, meeting)
            loads = at_nodes(np.split(place, starts[1:-1]), np.split(loads, starts[1:-1], axis=1), len(nodes))[0]
        fields = Fields(scene.mesh.nodes[nodes], cells, scene.cell_subdomain[chosen], shown_moduli(scene)[chosen], displacement,
                        part=scene.mesh.volume[chosen], parts=tuple(scene.mesh.volumes), joined=joined,
                        thermal=None if scene.thermal is None else scene.thermal[:, chosen], meeting=meeting)
        found = [(np.searchsorted(chosen, cells), squares) for cells, squares in _leaps(scene, own, continuous, meeting.team)]
        probes = [replace(p, cells=np.searchsorted(chosen, p.cells)) if isinstance(p, Surface) else p for p in scene.probes]
        return cls(fields, scene.cell_number[chosen], meeting.team, None if body_force is None else body_force[:, chosen], loads, scene.lame[chosen],
                   ~scene.stand_ins[scene.cell_subdomain[chosen]], found, scene.number[nodes], copy, counts, probes)

    def estimate(self, wanted: bool, known: Estimate | None = None, gathered: bool = True, numbers: Sequence[int] | None = None) -> Estimate | None:
        """Estimate of the discretisation error, where it is wanted, with the shares of this rank's cells.

        known : on rank 0, what has been estimated of the whole already
        gathered : whether rank 0 gets the shares of all cells
        numbers : (T,) which load steps of the scene the displacements are of; none: all
        """
        wanted, there = self.team.share((wanted, known is not None))
        if there:
            cells = self.team.gather(self.cells)
            self._know(discretisation_error=self.team.hand_out(lambda rank: known.cells[:, cells[rank]]))
            return known
        if not wanted:
            return None
        f = self.fields
        estimator = kind_of(f.cells.shape[1])(f.nodes, f.cells, f.meeting, self.lame, f.thermal, self.body_force, [self.loads])
        estimator.ours = self.ours
        estimator.leaps = lambda _: self.leaps
        found = estimator([f.displacement], numbers)
        self._know(discretisation_error=found.cells)
        return self._whole(found) if gathered else found

    def _whole(self, found: Estimate) -> Estimate:
        everyone = self.team.gather((self.cells, found.cells))
        if everyone is None:
            return found
        cells = np.empty((len(found.cells), sum(len(chosen) for chosen, _ in everyone)))
        for chosen, own in everyone:
            cells[:, chosen] = own
        return Estimate(found.relative, cells)

    def interface_displacement(self, side: int) -> np.ndarray:
        """As that of ``Fields``, of its ``interfaces``: ranks tell each other how their bodies move there."""
        i, f, team = self.interfaces, self.fields, self.team
        home, body, node = np.empty(len(self.counts), dtype=int), i.subdomains[i.interface_of_node, side], (i.nodes, i.others)[side]
        for rank, own in enumerate(team.all_gather(np.unique(f.subdomain))):
            home[own] = rank
        asked = [np.flatnonzero(home[body] == rank) for rank in range(team.size)]
        wanted = [rows.reshape(-1, 2).astype(int) for rows in team.deliver([np.column_stack([body[at], node[at]]) for at in asked])]
        total = 1 + int(self.number.max(initial=-1))
        keys = np.searchsorted(np.cumsum(self.counts), self.copy, side="right") * total + self.number  # ascending, as bodies and nodes are
        told = team.deliver([f.displacement[:, np.searchsorted(keys, rows @ [total, 1])] for rows in wanted])
        result = np.empty((f.steps, len(node), 3))
        for at, moved in zip(asked, told):
            result[:, at] = moved.reshape(f.steps, -1, 3)
        return result

    def disbelieve(self, unsound: Sequence[int] = ()) -> None:
        """Take in subdomains, which rank 0 knows, whose stresses are not to be believed."""
        if len(unsound := self.team.share(unsound)):
            self._know(believed=~np.isin(self.fields.subdomain, unsound))

    def extremes(self, lost: np.ndarray | None = None) -> Extremes | None:
        """Those of the whole, on rank 0, which knows ``lost``, see ``extremes``."""
        everyone = self.team.gather(extremes(self.fields.nodal, self.team.share(lost)))
        return None if everyone is None else Extremes.joined(everyone)

    @property
    def reader(self) -> Reader:
        """Reads probes of the whole, with the others'."""
        return Reader(self.fields.nodal, self.cells, self.team)

    def answer(self) -> None:
        """What the other ranks do while rank 0 reads its answers."""
        self.extremes()
        self.reader.answer(self.probes)

    def _know(self, **more: np.ndarray) -> None:
        """Take in what is only known later; what was computed without it goes."""
        self.fields = replace(self.fields, **more)


def _leaps(scene: Scene, own: Sequence[Subdomain], continuous: Parts, team: Team) -> list[tuple[np.ndarray, np.ndarray]]:
    """Leaps of the interfaces whose slaves are this rank's, which learns how their masters move that are others'."""
    mine, there = {s.index for s in own}, leaping(scene)

    def traces(i: Interface, side: int) -> np.ndarray:
        e = i.subdomains[side]
        return continuous[e][:, i.nodes[side]] if e in mine else known[i.index]

    asked = [i for i in there if i.subdomains[1] in mine and i.subdomains[0] not in mine]
    known = {index: moved for one in team.all_gather({i.index: traces(i, 1) for i in asked}) for index, moved in one.items()}
    return [leaps(scene, i, traces) for i in there if i.subdomains[0] in mine]


def _mean(nodes: Sequence[np.ndarray], sides: Sequence[np.ndarray], meeting: Meeting) -> np.ndarray:
    """(T, n, 3) means at a rank's nodes of what all subdomains have there, other ranks' included; parameters as of ``at_nodes``."""
    count = len(meeting.label)
    total, copies = at_nodes(nodes, sides, count)
    sums = np.concatenate([total.transpose(0, 2, 1).reshape(-1, count), copies[None]])
    sums = meeting.borders(np.arange(count))(sums)
    return (sums[:-1] / sums[-1]).reshape(len(total), 3, count).transpose(0, 2, 1).copy()


class OnRanks(Subscriber):
    """Rank 0's subscribers, on all ranks: who wants checkpoints has a copy on each, who wants states gets the whole on rank 0.

    The volume of states is that of all traces, to one rank: right for some hundreds of ranks.

    numbers : which columns of the whole scene's arrays are this rank's
    """

    def __init__(self, subscribers: Sequence[Subscriber], numbers: Numbers, team: Team):
        self.team, writers = team, team.share([s for s in subscribers if s.wants_checkpoints])
        self.told = Subscribers(writers if team.rank else subscribers)
        self.states = team.share(any(s.wants_states for s in subscribers)) and team.size > 1
        self.numbers = team.all_gather(numbers["trace"]) if self.states else []
        for writer in writers:
            writer.begins(team, numbers)

    def iteration(self, event: Iteration) -> None:
        whole = replace(event, state=self._whole(event.state)) if self.states else event
        for each in self.told.all:
            each.iteration(whole if each.wants_states else event)

    def _whole(self, state: np.ndarray) -> np.ndarray | None:
        """On rank 0, from every rank's columns."""
        arrived = self.team.gather(state)
        if arrived is None:
            return None
        whole = np.zeros((len(state), 1 + max(own.max(initial=-1) for own in self.numbers)))
        for part, own in zip(arrived, self.numbers):
            whole[:, own] = part
        return whole

    def warned(self, sentence: str) -> None:
        self.told.warned(sentence)

    def finished(self, event: Finished) -> None:
        self.told.finished(event)
