"""A part brought to its joints: S, what it opposes to displacements there, and what its own loads
amount to there.

With K = [[K_jj, K_ji], [K_ij, K_ii]], S = K_jj − K_ji K_ii⁻¹ K_ij and b = f_j − K_ji K_ii⁻¹ f_i. No
matrix from outside is believed: symmetry, sign, and what rigid motions cost tell of lost digits,
mixed-up nodes and supports that nobody declared.

One elimination stops at the joints: with their dofs last, K = L U has L_jj U_jj = S, the factors'
last blocks are all that is asked of them, and no column is solved. K_jj gets a diagonal that makes
it positive whatever holds K, and loses it afterwards. Of 28,611 dofs, 867 of them joints', this
takes 4.8 s, a solve for each column 57 s. The others are eliminated in METIS's order, which fills
least.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from orchestrator.errors import InputError, KeyPath, wrong
from orchestrator.scene.conditions.rigid import motions_about
from orchestrator.scene.foreign.joints import Joints
from orchestrator.scene.mesh.geometry import local_size
from orchestrator.linalg import dissection, PLACED, SAME, symmetric_lu

# Share of the diagonal that makes a pivot other than zero, where one is: rounding.
LEAST = 1e-15


class JointElimination:
    """K (n, n) without the dofs ``last`` (j,).

    loose : parts of what is eliminated may move by themselves, as a bar between two nodes turns
        about itself: with a pivot ε of mere rounding they leave rounding²/ε in the complement
    Raises ZeroDivisionError: what is eliminated is singular
    complement : (j, j) the Schur complement, symmetric
    """

    def __init__(self, K: sp.csr_array, last: np.ndarray, loose: bool = False):
        inside = np.setdiff1d(np.arange(K.shape[0]), last)
        diagonal = K.diagonal()
        if not (diagonal[inside] > 0).all():
            raise ZeroDivisionError
        shift = np.full(len(last), max(diagonal.max(), np.finfo(float).tiny))
        self.order, self.count = np.concatenate([inside[dissection(K[inside][:, inside])],
                                                 last]), len(inside)
        held = sp.csc_array(K[self.order][:, self.order]
                            + sp.diags_array(np.r_[np.zeros(len(inside)), shift]))
        try:
            self.factor = symmetric_lu(held, "NATURAL")
        except RuntimeError as error:  # a pivot is exactly zero
            if not loose:
                raise ZeroDivisionError from error
            self.factor = symmetric_lu(held + sp.diags_array(LEAST * held.diagonal()), "NATURAL")
        rows, columns = (place[self.count :] for place in (self.factor.perm_r, self.factor.perm_c))
        L, U = (sp.csr_array(x) for x in (self.factor.L, self.factor.U))
        place = self.factor.perm_c[: self.count]
        if not np.array_equal(self.factor.perm_r, self.factor.perm_c) or \
                not (loose or (U.diagonal()[place] > SAME * held.diagonal()[: self.count]).all()):
            raise ZeroDivisionError  # a pivot that is no diagonal one was tiny, too
        right = np.random.default_rng(0).uniform(-1.0, 1.0, len(self.order))
        left = np.abs(held @ (found := self.factor.solve(right)) - right).max()
        if not left <= PLACED * (held.diagonal().max() * np.abs(found).max() + 1.0):
            raise ZeroDivisionError
        both = (L[rows][:, columns] @ U[rows][:, columns]).toarray()
        self._shifted = (both + both.T) / 2
        self.complement = self._shifted - np.diag(shift)

    def loads(self, f: np.ndarray) -> np.ndarray:
        """(cases, j) f_j − K_ji K_ii⁻¹ f_i of loads (cases, n)."""
        u = self.factor.solve(np.ascontiguousarray(f[:, self.order].T))
        return u[self.count :].T @ self._shifted

    def carried(self) -> np.ndarray:
        """(n, j) how everything moves with the dofs that are left, [−K_ii⁻¹ K_ij; 1]."""
        n, j = len(self.order), len(self._shifted)
        unit = np.zeros((n, j))
        unit[self.count :] = self._shifted
        moved = np.empty((n, j))
        moved[self.order] = self.factor.solve(unit)
        return moved


# Share of the entries' size that rounding leaves of rigid motions: above the first, digits are
# missing, and the error they
# cause is told; above the second (four digits leave 1e-4) it is no rounding: nodes are mixed up, or
# supports hidden.
DIGITS, WRONG = 1e-13, 3e-4
# Of parts whose elements are no slabs or needles, diagonal entries are .1 to 20 times the modulus
# times the size of the faces
# there (measured, .02 to 300 where they are): units that are mixed up make a thousand of it.
OTHER_UNIT = 100.0


@dataclass(frozen=True)
class Condensed:
    """A part on its joints.

    joints : where it meets others
    stiffness : (3n, 3n) S, symmetric; rows of held components are zero
    loads : (cases, 3n) b, one for all load steps or one for each
    error : (3n, 3n) symmetric, a sample of what S may be off by where digits are missing; None:
        they are not
    """

    joints: Joints
    stiffness: np.ndarray
    loads: np.ndarray
    error: np.ndarray | None = None

    @property
    def free(self) -> np.ndarray:
        """(f,) int, dofs of the joints that the part itself does not hold."""
        return np.flatnonzero(~self.joints.held)

    @cached_property
    def floor(self) -> float:
        """Relative error in energy that missing digits leave in a result: S u = f and (S + E)(u +
        δ) = f give ‖δ‖_S ≤ ‖S^-½ E S^-½‖
        ‖u‖_S on what is no rigid motion, to first order, and a part that others hold as well does
        no worse."""
        if self.error is None:
            return 0.0
        rigid = motions_about(self.joints.points, self.joints.centre,
                              self.joints.size).reshape(-1, 6) @ self.joints.left
        strained = la.null_space(rigid[self.free].T) if rigid.shape[1] else np.eye(len(self.free))
        values, vectors = np.linalg.eigh(strained.T @ self.stiffness[np.ix_(self.free, self.free)]
                                         @ strained)
        scaled = strained @ vectors / np.sqrt(np.maximum(values, np.finfo(float).eps * values[-1]))
        return float(np.linalg.norm(scaled.T @ self.error[np.ix_(self.free, self.free)] @ scaled,
                                    2))


def condense(K: sp.csr_array, loads: np.ndarray, joint: np.ndarray, path: KeyPath, name: str,
             rounding: float = 0.0,
             loose: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """S (j, j) and b (cases, j) of a stiffness (n, n) and loads (cases, n) on the dofs ``joint``
    (j,).

    rounding : relative error of K's entries; where there is one, a sample E of random signs comes
        third, brought to the joints as the stiffness is: Tᵀ E T, T = [1; −K_ii⁻¹ K_ij]
    loose : whether something inside may move by itself, see ``schur``
    Raises InputError: what is not on the joints can move by itself
    """
    sample = _sample(K, rounding) if rounding else None
    if len(joint) == K.shape[0]:  # by whoever has made it
        own = None if sample is None else sample[joint][:, joint].toarray()
        return K[joint][:, joint].toarray(), loads[:, joint].copy(), own
    try:
        eliminated = JointElimination(K, joint, loose)
    except ZeroDivisionError as error:
        raise wrong(path,
                    f"'{name}': with its joints held, something inside can still move, or has no "
                    "stiffness",
                    "parts that hang together, and whose joints hold all of them",
                    "look for nodes that nothing is attached to, for pieces that nothing connects, "
                    "and for joints on one line") from error
    moved = None if sample is None else eliminated.carried()
    return eliminated.complement, eliminated.loads(loads), None if moved is None else moved.T @ (
        sample @ moved)


def _sample(K: sp.csr_array, rounding: float) -> sp.csr_array:
    """Symmetric errors of K's entries, as large as they may be, of random sign and size."""
    upper = sp.triu(K, format="coo")
    error = sp.coo_array(
        (rounding * upper.data * np.random.default_rng(1).uniform(-1, 1, upper.nnz),
         (upper.row, upper.col)), K.shape)
    return sp.csr_array(error + error.T - sp.diags_array(error.diagonal()))


def judged(joints: Joints, S: np.ndarray, loads: np.ndarray, path: KeyPath, name: str,
           error: np.ndarray | None = None) -> Condensed:
    """The part, if it can be one.

    S : (3n, 3n) as it has come, symmetric but for rounding; loads : (cases, 3n)
    path : of what it was read from; name : of the part
    error : (3n, 3n) a sample of what S may be off by, where that is known from elsewhere
    Raises InputError: S is not finite or ≥ 0, or rigid motions cost what they cannot cost
    """
    free = np.flatnonzero(~joints.held)
    S, b = S.copy(), loads.copy()
    S[joints.held.ravel()] = S[:, joints.held.ravel()] = b[:, joints.held.ravel()] = 0.0
    if not (np.isfinite(S).all() and np.isfinite(b).all()):
        raise wrong(path, f"'{name}': numbers that are not finite", "numbers",
                    "write the files again")
    size, S = np.abs(S).max(initial=0.0), (S + S.T) / 2
    share, motions, energies = _rigid(joints, S, free)
    if joints.left.shape[1] and share > WRONG:
        raise _not_rigid(path, name, share, motions)
    if joints.left.shape[1] < 6 and motions.max(initial=0.0) <= WRONG:
        raise wrong(path, f"'{name}' is said to be held inside, and rigid motions cost nothing",
                    "supports in the matrix or deck, or none "
                    "said", "write held: false, or put the supports in")
    # against a rigid motion the end of a slender part has 2e-4 of the largest entry at a length of
    # six sides, 6e-8 at two hundred
    lost = max(PLACED,
               0.0 if error is None else 10 * float(np.abs(error).max(initial=0.0) / (size or 1.0)))
    if joints.left.shape[1] < 6 and (energies <= lost * size).sum() > joints.left.shape[1]:
        least = max(energies[0] / (size or 1.0), 0.0)
        raise wrong(path,
                    f"'{name}' is said to be held inside, and some rigid motion costs {least:.0e} "
                    f"of its stiffness, no more than its digits tell ({lost:.0e})",
                    "supports that hold all of it, or of slender parts a matrix with all digits",
                    "put the supports in that are missing; write the matrix with 17 digits")
    rounding = share if share > DIGITS else 0.0
    if error is None and rounding:
        error = _sample(sp.csr_array(S), rounding).toarray()
    off = np.abs(S).max(initial=0.0) * rounding if error is None else np.abs(error).max(initial=0.0)
    values = np.linalg.eigvalsh(S[np.ix_(free, free)])
    # of a random matrix, twice √n times its entries
    if values[0] < -max(PLACED * values[-1], 10 * off * np.sqrt(len(free))):
        raise wrong(path,
                    f"'{name}': a stiffness that gives way: an eigenvalue of {values[0]:.3g} "
                    f"beside {values[-1]:.3g}",
                    "a stiffness ≥ 0",
                    "look for a wrong sign, or for loads that make the part buckle")
    return Condensed(joints, S, b, error)


def check_modulus(part: Condensed, young: float | None, path: KeyPath, name: str) -> None:
    """Raises InputError where the stiffness speaks of another modulus than the representative one,
    by what only units explain.
    """
    joints, diagonal = part.joints, np.diag(part.stiffness).reshape(-1, 3)
    free = ~joints.held & (diagonal > 0)
    if young is None or not free.any() or not len(joints.triangles):
        return
    found = float(
        np.median((diagonal / local_size(joints.points, joints.triangles)[:, None])[free]))
    if not young / OTHER_UNIT <= found <= young * OTHER_UNIT:
        raise wrong(path,
                    f"'{name}': a stiffness as of a modulus of some {found:.1g}, and material: "
                    f"young: {young:g}, a factor of {max(found / young, young / found):.1g}",
                    "forces and lengths of the matrix in the units of the scene, and a "
                    "representative modulus of the part's own matter",
                    "scale the matrix to the scene's units; if they are the same, write material: "
                    f"{{young: {found:.1g}, poisson: 0.3}}, which sets no more than how fast "
                    "iterations are")


def _rigid(joints: Joints, S: np.ndarray, free: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Energy of rigid motions, which should be none: the relative error of S's entries that would
    explain it; the cost of each of the six
    motions; and the stiffness against independent ones, ascending. Where entries have relative
    errors r of random signs, (S R)_i is about
    r/√3 · √Σ_j S_ij² R_j²."""
    R = motions_about(joints.points, joints.centre, joints.size).reshape(-1, 6)
    own = S[np.ix_(free, free)]

    def cost(fields: np.ndarray) -> np.ndarray:
        expected = np.sqrt(((own**2) @ (fields[free] ** 2)).sum(axis=0))
        return np.sqrt(3 * ((own @ fields[free]) ** 2).sum(axis=0)) / np.where(
            expected > 0, expected, 1.0)

    left = R @ joints.left
    share = float(cost(left).max(initial=0.0))
    Q = la.orth(R[free])
    values = np.linalg.eigvalsh(Q.T @ own @ Q) if Q.shape[1] else np.ones(0)
    return share, cost(R), values


def _not_rigid(path: KeyPath, name: str, share: float, motions: np.ndarray) -> InputError:
    if motions[:3].max() <= WRONG:
        return wrong(path,
                     f"'{name}': rotations cost force, {share:.1e} of the stiffness, and "
                     "translations do not",
                     "a stiffness that vanishes on rigid motions of the nodes that the table gives",
                     "the table of nodes is in another order than the matrix, or in other units "
                     "than the model was, or displacements are turned: write it in the matrix's "
                     "own order and axes")
    return wrong(path,
                 f"'{name}': rigid motions cost force, {share:.1e} of the stiffness: supports "
                 "that hold it are inside",
                 "a stiffness of the part alone, or supports that are declared",
                 "write held: true if it is meant to be held, else leave supports out when the "
                 "matrix is made; digits, if there are fewer than five")
