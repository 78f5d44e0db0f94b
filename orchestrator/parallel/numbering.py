"""Numbers of things that ranks have in parts, as one process would give them, without an array of all; and what is one and the same over
several ranks."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from orchestrator.parallel.team import Team
from orchestrator.scene.mesh.faces import components


def numbered(tags: np.ndarray, team: Team) -> tuple[np.ndarray, int]:
    """(k,) int, the place of each of this rank's tags among all that any rank has, and how many these are; all ranks ask together.

    tags : (k,) int, ascending, none twice

    Every rank has a range of the tags, is told which of them there are, and counts them.
    """
    low, high = team.max(*(np.array([-tags.min(), tags.max()]) if len(tags) else [-np.inf, -np.inf]))
    home = np.minimum(((tags + low) * (team.size / (high + low + 1))).astype(int), team.size - 1)
    asked = team.deliver([tags[home == rank] for rank in range(team.size)])
    known = np.unique(np.concatenate(asked))
    counts = team.all_gather(len(known))
    answers = team.deliver([sum(counts[: team.rank]) + np.searchsorted(known, some) for some in asked])
    return np.concatenate(answers).astype(int), sum(counts)


def runs(starts: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """(sum of lengths,) int, whole numbers from each start (k,) on, as many as its length (k,) says, run after run."""
    return np.repeat(starts - (np.cumsum(lengths) - lengths), lengths) + np.arange(lengths.sum())


def ordered(names: np.ndarray, values: np.ndarray, team: Team) -> np.ndarray:
    """(K, …) values (k, …) of all ranks, which ask together, in the order of their names (k, c) int."""
    every, found = (np.concatenate(each) for each in zip(*team.all_gather((names, values))))
    return found[np.lexsort(every.T[::-1])]


def met(tag: np.ndarray, label: np.ndarray, team: Team) -> tuple[np.ndarray, np.ndarray]:
    """(p, 2) int, ascending, pairs of labels that have tags in common, on any ranks, and (p,) int, how many; the same on all ranks.

    tag, label : (k,) int, a tag that a label has; in any order, and as often as it likes
    """
    home = tag % team.size
    arrived = team.deliver([np.column_stack([tag, label])[home == rank] for rank in range(team.size)])
    tag, label = np.concatenate(arrived).reshape(-1, 2).T.astype(int)
    order = np.lexsort((label, tag))
    tag, label = tag[order], label[order]
    once = np.concatenate([[True], (tag[1:] != tag[:-1]) | (label[1:] != label[:-1])])[: len(tag)]
    tag, label = tag[once], label[once]
    found = [np.empty((0, 2), dtype=int)]
    for step in range(1, int(np.unique(tag, return_counts=True)[1].max(initial=0))):
        same = np.flatnonzero(tag[step:] == tag[:-step])
        found.append(np.column_stack([label[same], label[same + step]]))
    told = np.concatenate(team.all_gather(np.column_stack(np.unique(np.concatenate(found), axis=0, return_counts=True))))
    pairs, which = np.unique(told[:, :2], axis=0, return_inverse=True)
    return pairs, np.bincount(which.ravel(), weights=told[:, 2], minlength=len(pairs)).astype(int)


def classes(names: np.ndarray, one: np.ndarray, two: np.ndarray, across: Mapping[int, np.ndarray], team: Team) -> np.ndarray:
    """(n,) int, the lowest name in the class of each of this rank's things; all ranks ask together.

    A class goes from rank to rank by way of its neighbours, a round of messages for each that lies between: on meshes a few.

    names : (n,) int below 2⁵³, no two alike on all ranks
    one, two : (k,) int, things of this rank that are one
    across : rank → (m,) int, things of this rank that are one with that rank's, which has its own in the same order; −1: none is
    """
    count, label = components(one, two, len(names))
    lowest = np.full(count, np.inf)
    np.minimum.at(lowest, label, names)
    changed = team.size > 1
    while changed:
        outgoing = {rank: np.where(at >= 0, lowest[label[at]], np.inf) if len(label) else np.full(len(at), np.inf)
                    for rank, at in across.items()}
        arrived, before = team.exchange(outgoing, {rank: np.empty(len(at)) for rank, at in across.items()}), lowest.copy()
        for rank, at in across.items():
            np.minimum.at(lowest, label[at[at >= 0]], arrived[rank][at >= 0])
        changed = bool(team.max(float((lowest < before).any()))[0])
    return lowest[label].astype(int)
