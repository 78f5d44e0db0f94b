"""Dense blocks of the macro problem, one per subdomain, kept once where subdomains are alike.

A subdomain answers to the macro forces of its own interfaces alone: NᵀG and V = M⁻¹NᵀG are rows of its boundary dofs and
columns of the macro unknowns that it sees. Where congruent subdomains have congruent interfaces all around, their
blocks are one and the same; blocks of one shape are multiplied together.

Its columns tell something of the answers of subdomains without soles, for no back-substitution. With S the Schur complement of a subdomain and k its soles, (S + k) V = NᵀG holds for its columns of V: S V = NᵀG − k V is
known. Of all that its own columns span,

    x = V (VᵀS V)⁻¹ Vᵀh

is nearest to S⁺h in the energy norm. Here every subdomain takes its columns by itself, whatever its neighbours do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import blake2b

import numpy as np
import scipy.sparse as sp


@dataclass(frozen=True)
class Blocks:
    """Blocks of m subdomains that have the same shape, s macro unknowns and t boundary dofs."""

    sees: np.ndarray  # (m, s) int, macro unknowns of each
    columns: np.ndarray  # (m, t) int, boundary dofs of each
    forces: np.ndarray  # (k, s, t) rows of NᵀG and of V; k is m, or 1 where all subdomains share theirs
    answers: np.ndarray

    def displace(self, alpha: np.ndarray, result: np.ndarray) -> None:
        """Write V α (T, B) of macro unknowns (T, size) into these subdomains' boundary dofs."""
        seen = alpha[:, self.sees]
        if len(self.answers) == 1:
            result[:, self.columns] = seen @ self.answers[0]
        else:
            result[:, self.columns] = (seen.transpose(1, 0, 2) @ self.answers).transpose(1, 0, 2)

    def work(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values, rows and columns of GᵀNV, on and below the diagonal: each (m, s (s + 1) / 2)."""
        each = self.forces @ self.answers.transpose(0, 2, 1)
        each = (each + each.transpose(0, 2, 1)) / 2
        row, column = np.tril_indices(self.sees.shape[1])
        rows, columns = self.sees[:, row], self.sees[:, column]
        return np.broadcast_to(each[:, row, column], rows.shape), rows, columns


def force_blocks(forces: sp.csr_array, parts: Sequence[slice]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Macro unknowns (s,) that each subdomain sees, and its macro forces (s, t): equal ones are the same array.

    forces : (B, size) NᵀG
    parts : boundary dofs of each subdomain
    """
    forces.sort_indices()
    ends, place = forces.indptr, np.zeros(forces.shape[1], dtype=np.int32)
    sees, blocks, known = [], [], {}
    for part in parts:
        entries = slice(ends[part.start], ends[part.stop])
        column, values, count = forces.indices[entries], forces.data[entries], np.diff(ends[part.start : part.stop + 1])
        seen = np.unique(column).astype(np.int32)
        place[seen] = np.arange(len(seen))
        local = place[column]
        key = blake2b(count.tobytes(), digest_size=16)
        key.update(local.tobytes())
        key.update(values.tobytes())
        if key.digest() not in known:
            block = np.zeros((len(seen), len(count)))
            block[local, np.repeat(np.arange(len(count)), count)] = values
            known[key.digest()] = block
        sees.append(seen)
        blocks.append(known[key.digest()])
    return sees, blocks


def joined(sees: Sequence[np.ndarray], parts: Sequence[slice], forces: Sequence[np.ndarray],
           answers: Mapping[int, np.ndarray]) -> list[Blocks]:
    """Blocks of all subdomains that have any: where arrays are the same, once; the others by their shapes."""
    alike: dict[tuple[int, int], list[int]] = {}
    for e, answer in answers.items():
        alike.setdefault((id(forces[e]), id(answer)), []).append(e)
    groups: list[list[int]] = [members for members in alike.values() if len(members) > 1]
    shapes: dict[tuple[int, int], list[int]] = {}
    for members in alike.values():
        if len(members) == 1:
            shapes.setdefault(forces[members[0]].shape, []).extend(members)
    starts, result = np.array([part.start for part in parts], dtype=int), []
    for members, shared in [(g, True) for g in groups] + [(g, False) for g in shapes.values()]:
        different = members[:1] if shared else members
        result.append(Blocks(np.stack([sees[e] for e in members]),
                             starts[members][:, None] + np.arange(forces[members[0]].shape[1]),
                             np.stack([forces[e] for e in different]), np.stack([answers[e] for e in different])))
    return result


def assembled(blocks: Sequence[Blocks], size: int) -> sp.csr_array:
    """(size, size) the lower triangle of GᵀNV, the sum over all subdomains."""
    parts = [[x.ravel() for x in b.work()] for b in blocks]
    if not parts:
        return sp.csr_array((size, size))
    values, rows, columns = (np.concatenate(same) for same in zip(*parts))
    return sp.csr_array((values, (rows, columns)), shape=(size, size))


# Of the largest entry of VᵀS V, added to its diagonal: rigid motions cost nothing. Forces are in balance to 1e-7, so that what these
# do in them is next to nothing; and columns softer than that are left to whoever goes on from here.
LEAST = 1e-8


class MacroAnswers:
    """Approximate answers S⁺h of all subdomains, from their columns.

    blocks : of the macro problem, solved
    soles : k on the boundary dofs of subdomains, at least of the first that has each array of the blocks
    starts : first boundary dof → subdomain
    """

    def __init__(self, blocks: Sequence[Blocks], soles: Mapping[int, sp.csr_array], starts: Mapping[int, int]):
        self.blocks, self.inverse = blocks, []
        for block in blocks:
            energy = np.stack([v @ (f - (soles[starts[int(at)]] @ v.T).T).T
                               for v, f, at in zip(block.answers, block.forces, block.columns[:, 0])])
            energy = (energy + energy.transpose(0, 2, 1)) / 2
            size = np.abs(energy).max(axis=(1, 2), initial=0.0)[:, None, None]
            self.inverse.append(np.linalg.inv(energy + (LEAST * size + np.finfo(float).tiny) * np.eye(energy.shape[1])))

    def __call__(self, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x (T, B), and (S + k) x, for boundary forces h (T, B)."""
        x, robin = np.zeros((2, *h.shape))
        for block, inverse in zip(self.blocks, self.inverse):
            weights = (h[:, block.columns].transpose(1, 0, 2) @ block.answers.transpose(0, 2, 1)) @ inverse
            x[:, block.columns] = (weights @ block.answers).transpose(1, 0, 2)
            robin[:, block.columns] = (weights @ block.forces).transpose(1, 0, 2)
        return x, robin
