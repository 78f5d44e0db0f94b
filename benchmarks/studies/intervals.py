"""Intervals of displacements and forces beside true values: the random scenes of ``certified``, bonded ones beside them.

Of every scene displacements at two random points and the mean stresses of the tets there, all reactions and all forces of interfaces,
what matter carries across a random plane and what acts on a random face of the cube, with their moments, are certified. All components at
all load steps are compared with a solution in one piece that shares no code with the method. One hundred of them, drawn by chance, are the
sample that the target speaks of; all are told beside it. *Width* is half of an interval's, over the largest value of its kind in the scene,
of sections and resultants over the largest reaction; of those that have one: without friction the forces across normals are known to be
none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.kit.drawing import BLUE, ORANGE, panels
from benchmarks.kit.settings import RandomScenes
from benchmarks.kit.study import Study
from benchmarks.kit.truth import EXACT, solved_in
from benchmarks.monolithic import Monolithic
from benchmarks.problems.random_contact import drawn
from orchestrator import Scene
from orchestrator.method.delivery.flux import FORCES, Carrier
from orchestrator.results.extremes import RESULTANT
from orchestrator.scene.copies import Copies

SAMPLE, PER_SCENE = 100, 4  # quantities in the sample, at most so many of a scene
POINTS = 2  # at which displacements are asked for
ROUNDED = 1e-9  # of the largest value of a kind: what the solution in one piece leaves open, at residuals of 1e-11
DISPLACEMENT, STRESS = ("ux", "uy", "uz"), ("sxx", "syy", "szz", "sxy", "syz", "sxz", "von_mises")
BONDED = 4  # every so many scenes one with bonds in the place of some contacts
KINDS = ("displacement", "stress", "reaction", "force", "section", "resultant", "moment")
LIKE = {"section": "reaction", "resultant": "reaction"}  # kinds of which all may be none, and whose largest value is theirs


def run(study: Study, settings: RandomScenes = RandomScenes()) -> None:
    """All scenes."""
    study.columns = ("scene", "kind", "bodies", "friction", "steps", "element", "asked", "error_kind", "error_bound",
                     *(f"{kind}_width" for kind in KINDS), "outside", "without", "seconds")
    values: dict[int, list] = {}
    for number in range(settings.first, settings.first + settings.scenes):
        data, labels = asked(number, settings.code)
        row = {"scene": number, **labels, **study.kept(f"scene-{number}", data, lambda: compared(data))}
        values[number] = row.pop("values", [])
        study.note(row, f"scene {number}, {', '.join(f'{key} {value}' for key, value in labels.items())}: " + (
            f"failed, {row['failure']}" if "failure" in row else f"{row['error_kind']} {row['error_bound']:.1e}, {row['outside']} of "
            f"{len(values[number])} outside"))
    study.figure(_picture(study.rows))
    judge(study, values)


def asked(number: int, code: str = "freefem") -> tuple[dict[str, Any], dict[str, Any]]:
    """A scene of ``certified`` with what is to be certified."""
    data, labels = drawn(number, code)
    rng = np.random.default_rng([number, 1])
    if number % BONDED == 0 and labels["kind"] in ("grid", "slices", "grains") and not labels["gap"]:
        bonded = {"grid": ["block *-0-*"] * 2, "slices": ["slice 0", "slice 1"], "grains": ["grain_1", "grain_*"]}
        data["interfaces"] = [*data["interfaces"], {"between": bonded[labels["kind"]], "law": "perfect"}]
        labels["kind"] += ", some bonded"
    places = [{"at": rng.uniform(0.05, 0.95, 3).round(4).tolist(), "certified": True} for _ in range(POINTS)]
    probes = [{"name": f"{quantity} {k + 1}", "quantity": quantity, **place} for quantity in ("displacement", "stress")
              for k, place in enumerate(places)]
    layers = data["mesh"].get("box", {}).get("cells") if "mesh" in data else [2 * len(data["parts"])] * 3  # where no sides may part
    height = 1 / layers[2] if layers else float(rng.uniform(0.3, 0.7))
    face = {"plane": str(rng.choice(["x", "z"])), "at": float(rng.integers(2))}
    probes += [{"name": "section", "section": {"plane": "z", "at": height}, "certified": True},
               {"name": "resultant", "on": face, "quantity": "resultant", "certified": True}]
    data["output"] = {"fields": False, "figures": False, "probes": probes, "certified": ["reactions", "sections", "resultants"]}
    return data, labels


def compared(data: Mapping[str, Any]) -> dict[str, Any]:
    """Columns of a run, and its intervals: kind, least, greatest and true value of each component at each load step."""
    if isinstance(run := solved_in(data), str):
        return {"failure": run}
    scene, solved, seconds = run
    found = solved.summary["intervals"]
    row = {"bodies": solved.summary["subdomains"], "error_kind": found["kind"] or "unknown", "error_bound": solved.error_bound,
           "seconds": round(seconds, 2), "stop_reason": solved.stop_reason, "values": [], "outside": 0, "without": 0}
    if not found["kind"]:
        return row
    exact = Exact(scene)
    if exact.residual > EXACT:
        return {**row, "error_kind": "no solution in one piece"}
    for kind, low, high, true in exact.beside(found):
        low, high, true = (np.asarray(x, dtype=float).ravel() for x in (low, high, true))
        known = np.isfinite(low) & np.isfinite(high)
        row["without"] += int((~known).sum())
        row["values"] += [(kind, *map(float, each)) for each in zip(low[known], high[known], true[known])]
    sizes = {kind: max((abs(true) for one, _, _, true in row["values"] if one == LIKE.get(kind, kind)), default=0.0) for kind in KINDS}
    row["values"] = [(kind, low, high, true, sizes[kind]) for kind, low, high, true in row["values"]]
    row["outside"] = sum(not inside(*value) for value in row["values"])
    for kind in KINDS:
        widths = [0.5 * (high - low) / size for one, low, high, _, size in row["values"] if one == kind and high - low > ROUNDED * size]
        row[f"{kind}_width"] = float(np.median(widths)) if widths else float("nan")
    return row


def inside(kind: str, low: float, high: float, true: float, size: float) -> bool:
    """Whether an interval has the true value, but for what that is known to."""
    return low - ROUNDED * size <= true <= high + ROUNDED * size


class Exact:
    """True values from a solution in one piece.

    Attributes
    ----------
    residual : of equilibrium and laws, largest of all load steps
    """

    def __init__(self, scene: Scene):
        self.scene, self.whole = scene, Monolithic(scene)
        self.steps = self.whole.solve()
        self.residual = max(step.residual for step in self.steps)

    def beside(self, found: Mapping[str, Any]):
        """Kind, least, greatest and true values of all that has been certified, (T, 3) each."""
        for probe, one in zip(self.scene.probes, found["probes"]):
            if probe.quantity in FORCES:
                low, high = (np.array([one["values"][name][end] for name in RESULTANT], dtype=float).T for end in ("low", "high"))
                true = self.carried(probe)
                yield probe.quantity, low[:, :3], high[:, :3], true[:, :3]
                yield "moment", low[:, 3:], high[:, 3:], true[:, 3:]
                continue
            names, true = (STRESS, self.stress) if probe.quantity == "stress" else (DISPLACEMENT, self.displacement)
            ends = [[one["values"][name][end] for name in names] for end in ("low", "high")]
            yield probe.quantity, *(np.array(x, dtype=float).T for x in ends), true(probe)
        for entry, one in zip(self.scene.boundary, found["reactions"]):
            if not entry.forces:
                forces = self.reaction(entry.index)
                yield "reaction", one["low"], one["high"], forces.sum(axis=1)
                yield "moment", one["moment"]["low"], one["moment"]["high"], self.moment(np.concatenate(
                    [self.scene.mesh.nodes[s.nodes] for s in self.scene.subdomains]), forces, one["moment"]["about"])
        number = {i.name: i for i in self.scene.interfaces}
        for one in (*found.get("sections", ()), *found.get("resultants", ())):
            interface = number[one["name"]]
            forces = self.force(interface)
            yield "force", one["low"], one["high"], forces.sum(axis=1)
            yield "moment", one["moment"]["low"], one["moment"]["high"], self.moment(
                self.scene.side_points(interface, 0), forces, one["moment"]["about"])

    def carried(self, probe: Any) -> np.ndarray:
        """(T, 6) force and moment across a section, or through faces."""
        parts = [np.array([step.parts[e] for step in self.steps]) for e in range(len(self.scene.subdomains))]
        carrier = Carrier(probe, Copies.of(self.scene))
        found = carrier.measured.of(parts)[:, :6]
        for rim in carrier.rims() if probe.quantity == "resultant" else ():
            found -= np.einsum("tni,cni->tc", self.on_side(self.scene.interfaces[rim.interface], rim.side)[:, rim.nodes], rim.motions)
        return found

    def on_side(self, interface: Any, side: int) -> np.ndarray:
        """(T, n, 3) nodal forces of an interface on one of its sides."""
        bounds, start = self.whole.pairs.bounds[interface.index], self.whole.offsets[interface.subdomains[side]]
        D = self.whole.pairs.D[3 * bounds.start: 3 * bounds.stop]
        dofs = start + 3 * interface.nodes[side][:, None] + np.arange(3)
        return np.array([-(D.T @ step.force[bounds].ravel())[dofs] for step in self.steps])

    def displacement(self, probe: Any) -> np.ndarray:
        """(T, 3) at a point."""
        scene = self.scene
        s = scene.subdomains[scene.cell_subdomain[probe.cell]]
        nodes, at = s.connectivity[np.flatnonzero(s.cells == probe.cell)[0]], probe.weights
        ends = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
        shape = at if len(nodes) == 4 else np.concatenate([at * (2 * at - 1), 4 * at[ends[:, 0]] * at[ends[:, 1]]])
        return np.array([shape @ step.parts[s.index][nodes] for step in self.steps])

    def stress(self, probe: Any) -> np.ndarray:
        """(T, 7) the mean over the tet at a point, and von Mises' of it."""
        scene, ends = self.scene, np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
        s = scene.subdomains[scene.cell_subdomain[probe.cell]]
        nodes = s.connectivity[np.flatnonzero(s.cells == probe.cell)[0]]
        corners = scene.mesh.nodes[s.nodes[nodes[:4]]]
        slopes = np.linalg.inv(np.column_stack([np.ones(4), corners]))[1:].T
        if len(nodes) == 10:  # at the centre
            slopes = np.vstack([np.zeros((4, 3)), slopes[ends].sum(axis=1)])
        matter = scene.materials[scene.cell_material[probe.cell]]
        mu, lam = matter.young / (2 + 2 * matter.poisson), matter.young * matter.poisson / (1 + matter.poisson) / (1 - 2 * matter.poisson)
        found = []
        for step in self.steps:
            gradient = step.parts[s.index][nodes].T @ slopes
            sigma = mu * (gradient + gradient.T) + lam * np.trace(gradient) * np.eye(3)
            off = sigma - np.trace(sigma) / 3 * np.eye(3)
            found.append([*sigma[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]], np.sqrt(1.5 * np.sum(off**2))])
        return np.array(found)

    def moment(self, points: np.ndarray, forces: np.ndarray, about: Sequence[float]) -> np.ndarray:
        """(T, 3) of forces (T, n, 3) at points (n, 3) about another one."""
        return np.cross(points - about, forces).sum(axis=1)

    def reaction(self, entry: int) -> np.ndarray:
        """(T, N, 3) of the supports of an entry of ``boundary``, at all bodies' nodes one after the other."""
        whole, found = self.whole, []
        mine = np.concatenate([s.fixed & (s.held_by == entry) for s in self.scene.subdomains])
        for t, step in enumerate(self.steps):
            u = np.concatenate([part.ravel() for part in step.parts])
            forces = whole.K @ u - whole._loads(t) + whole.pairs.D.T @ step.force.ravel()
            found.append(np.where(mine, forces.reshape(-1, 3), 0.0))
        return np.array(found)

    def force(self, interface: Any) -> np.ndarray:
        """(T, n, 3) of side 2 on the nodes of side 1."""
        forces = np.array([step.force[self.whole.pairs.bounds[interface.index]] for step in self.steps])
        if interface.mortar is None:
            return forces
        return np.array([(interface.mortar.first.T @ f.ravel()).reshape(-1, 3) for f in forces])


def judge(study: Study, intervals: Mapping[int, Sequence]) -> None:
    """The targets, of what has been run; ``intervals``: of each scene, by its number."""
    rng, rows, sample = np.random.default_rng(0), [row for row in study.rows if intervals[row["scene"]]], []
    for row in rows:
        own = intervals[row["scene"]]
        chosen = rng.choice(len(own), min(PER_SCENE, len(own)), replace=False)
        sample += [own[k] for k in chosen if row["error_kind"] == "guaranteed"]
    sample = sample[:SAMPLE]
    held = sum(inside(*value) for value in sample)
    study.target("guaranteed: random intervals that have the true value", f"all of {len(sample)}", held, held == len(sample) > 0)
    for kind in ("guaranteed", "estimated"):
        those = [row for row in rows if row["error_kind"] == kind]
        values = [value for row in those for value in intervals[row["scene"]]]
        if not values:
            continue
        count = sum(not inside(*value) for value in values)
        study.target(f"{kind}: intervals without the true value", "none" if kind == "guaranteed" else "told",
                     f"{count} of {len(values)}, {len(those)} scenes", kind == "estimated" or not count)
        for what in KINDS:
            own = [(0.5 * (high - low), abs(true - 0.5 * (low + high)), size, row["error_bound"]) for row in those
                   for one, low, high, true, size in intervals[row["scene"]] if one == what and high - low > ROUNDED * size]
            wide = np.array([half / (size * bound) for half, _, size, bound in own if bound > 0])
            off = np.array([half / far for half, far, size, _ in own if far > ROUNDED * size])
            if len(wide):
                words = "half width over largest value and error bound; over distance from the middle; median"
                middle = np.median(off) if len(off) else np.nan
                study.target(f"{kind}, {what}: {words}", "told", f"{np.median(wide):.2g}; {middle:.2g}", True)
    study.target("intervals that are not known", "told", sum(row["without"] for row in study.rows if "without" in row), True)


def _picture(rows: Sequence[Mapping[str, Any]]):
    """Half widths over energy errors, both relative."""
    figure, (axes,) = panels(1, len(KINDS), (3.6 * len(KINDS), 4.0))
    for ax, kind in zip(axes, KINDS):
        for told, colour, marker in (("guaranteed", BLUE, "o"), ("estimated", ORANGE, "^")):
            those = [row for row in rows if row.get("error_kind") == told and row.get(f"{kind}_width", 0) > 0]
            ax.loglog([row["error_bound"] for row in those], [row[f"{kind}_width"] for row in those], marker, color=colour, markersize=4,
                      markerfacecolor="none", label=told)
        ax.set(xlabel="energy error that the run tells", title=kind)
    axes[0].set_ylabel("half width over the largest value, median")
    axes[0].legend()
    return figure
