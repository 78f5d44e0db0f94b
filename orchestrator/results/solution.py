"""One run as one object: summary, history and fields; as solved, or read from the files of its
folder.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from orchestrator.blackbox.codes.parts import fields_of_parts
from orchestrator.config.model import Config
from orchestrator.errors import Problems, wrong
from orchestrator.method.delivery.deliver import Delivered
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.method.delivery.reference import Reference
from orchestrator.method.iterated import Iterated
from orchestrator.method.delivery.balance import Resultants
from orchestrator.method.delivery.met import Met
from orchestrator.results.probes import (
    at_points, read_paths, read_probes, read_tables, Reader, Rows, tables_of)
from orchestrator.results.extremes import extremes, peak
from orchestrator.results.fields.fields import Fields, read_npz
from orchestrator.results.fields.files import write_fields
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.history import columns, read_history, write_history
from orchestrator.results.summary.content import summarise
from orchestrator.results.summary.summary import known, read_summary, write_summary
from orchestrator.results.summary.workload import Spent, codes_of_all
from orchestrator.scene.conditions.probes import Finder
from orchestrator.scene.elasticity import von_mises
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Scene
from orchestrator.scene.names import matching
from orchestrator.timing import Stopwatch


@dataclass(frozen=True)
class Solution:
    """Solution of a run; T load steps, n nodes.

    summary : the content of summary.json, in the types of JSON
    history : column of history.csv → (iterations,) array
    tables : file → rows of texts, the head first: extremes, what interfaces carry, probes, paths
    fields : displacements on the undecomposed mesh and what follows from them, as in fields.npz;
        None if none were asked for, where they were read
    directory : the folder that it was read from
    scene : what was solved; None, as all that follows, where it was read from a folder
    iterated : what the iterations ended with: traces and interface forces, statuses, error bound,
        events
    parts : per subdomain (T, n_E, 3), in equilibrium with its interface forces, before sides are
        averaged
    reference : the undecomposed solution, if asked for
    met : the interfaces that are not perfect; None where all are
    resultants : forces and moments of all interfaces
    joints : per subdomain (T, n_E, 3), the interfaces' forces at the nodes of a part whose mesh is
        not ours; None elsewhere
    config : what was asked for

    Examples
    --------
    Two blocks pressed together by 10 per unit area, kept in files and read again:

    >>> from orchestrator import Solution, config_from, solve
    >>> solution = solve(config_from({
    ...     "name": "blocks", "mesh": {"box": {"size": [1, 1, 2], "cells": [2, 2, 4]}},
    ...     "subdomains": {"slices": {"axis": "z", "count": 2}},
    ...     "materials": [{"young": 200e3, "poisson": 0.0}],
    ...     "interfaces": [{"law": "contact", "friction": 0.2}],
    ...     "boundary": [{"on": "zmin", "displacement": [0, 0, 0]}, {"on": "zmax",
    ...     "traction": [0, 0, -10]}]}))
    >>> solution.write("blocks").name
    'blocks'
    >>> again = Solution.read("blocks")
    >>> again
    Solution(blocks: converged after ... iterations, error bound ...)
    >>> (again.displacement == solution.displacement).all()
    np.True_
    >>> print(f"{again.interfaces.pressure.min():.4f}", again.summary["status_counts"]["stick"])
    10.0000 [9]
    """

    summary: dict[str, object]
    history: dict[str, np.ndarray]
    fields: Fields | None = None
    tables: dict[str, Rows] = field(default_factory=dict)
    directory: Path | None = None
    scene: Scene | None = None
    iterated: Iterated | None = None
    parts: list[np.ndarray] | None = None
    reference: Reference | None = None
    met: Met | None = None
    resultants: Resultants | None = None
    joints: list[np.ndarray | None] | None = None
    config: Config | None = None

    @classmethod
    def of(cls, config: Config, scene: Scene, delivered: Delivered, fields: Fields,
           setup_sweeps: float, reference: Reference | None, ranks: Sequence[Spent],
           watch: Stopwatch) -> Solution:
        """Solution of a run that has just been finished; nothing is written. Parameters are those
        of ``summarise``.
        """
        summary = summarise(config, scene, delivered, setup_sweeps, reference, ranks, watch)
        nodal, detached, lost = fields.nodal, summary.get("detached") or (), None
        if any(detached) or scene.stand_ins.any():  # what is inside these means nothing
            bodies = [s.body for s in scene.subdomains]
            lost = np.array([scene.stand_ins | np.isin(bodies, names) for names in detached
                             or [[]] * scene.steps])
        extreme = extremes(nodal, lost)
        reader = Reader(nodal, delivered.carried)
        probes, paths = (read(scene.probes, reader) for read in (read_probes, read_paths))
        summary = known(summary | {"peak_stress": peak(extreme, "von_mises"),
                                   "peak_displacement": peak(extreme, "|u|"),
                                   "probes": probes, "paths": paths})
        return cls(summary, columns(delivered.iterated.history), fields,
                   tables_of(scene, delivered.resultants, delivered.met, extreme, probes, paths),
                   None, scene, delivered.iterated, delivered.parts, reference, delivered.met,
                   delivered.resultants, delivered.joints, config)

    @classmethod
    def read(cls, directory: str | os.PathLike[str]) -> Solution:
        """Read a results folder.

        Raises InputError: missing folder, or not one that a run has written
        """
        # first: its message says best what is wrong with a foreign folder
        summary, path = read_summary(directory), Path(directory)
        return cls(summary, read_history(path), read_npz(path), read_tables(path), path)

    def write(self, directory: str | os.PathLike[str]) -> Path:
        """Write what ``orchestrator run`` leaves in its folder, figures and state excepted:
        summary, history, fields, tables. ``read`` gives the same back. What an earlier run has left
        there goes, as with ``run``; programs that are parts are not told of their results.

        Returns the folder
        Raises InputError: it cannot be written to, or files that are not this program's are in the
        way
        """
        folder = ResultsFolder(directory)
        own = self.directory
        if own is None or not own.exists() or not own.samefile(folder.path):
            folder.clear()
        write_history(folder, self.history)
        self.write_results(folder)
        write_summary(folder, self.summary)
        return folder.path

    def write_results(self, folder: ResultsFolder) -> None:
        """Write fields, where they are wanted, and tables."""
        wanted = ((self.summary.get("config") or {}).get("output") or {}).get("fields", True)
        if wanted and self.fields is not None:
            foreign = self.scene is not None and self.config is not None and self.parts is not None
            beside = fields_of_parts(self.config.codes, self.scene, self.parts,
                                     self.joints) if foreign else []
            write_fields(folder, self.fields, beside)
        for name, rows in self.tables.items():
            folder.write_table(name, rows)

    @property
    def converged(self) -> bool:
        return bool(self.summary["converged"])

    @property
    def stop_reason(self) -> str:
        """Why it ended: converged, max_iterations, diverged, stagnated …, guard: …, interrupted,
        failed: …
        """
        return str(self.summary["stop_reason"])

    @property
    def iterations(self) -> int:
        return int(self.summary["iterations"])

    @property
    def error_bound(self) -> float:
        """Guaranteed bound on the relative error in the energy norm; nan where there is none, as
        with contact.
        """
        bound = self.summary.get("error_bound")
        return math.nan if bound is None else float(bound)

    @property
    def energy(self) -> np.ndarray:
        """(T,) strain energy, force × length."""
        return np.array(self.summary["energy"], float)

    @property
    def reactions(self) -> np.ndarray:
        """(entries, T, 3) resultant force on every entry of ``boundary``, in their order: what
        supports carry, or
        what the loads add up to."""
        return np.array(self.summary["reactions"],
                        float).reshape(len(self.summary["reactions"]), -1, 3)

    @property
    def displacement(self) -> np.ndarray | None:
        """(T, n, 3) in the node order of the input mesh, where interfaces open the mean of the
        sides; None without
        fields."""
        return None if self.fields is None else self.fields.displacement

    def at(self, points: ArrayLike, part: str = "*") -> dict[str, np.ndarray]:
        """Return displacement (T, k, 3), stress (T, k, 6) and von_mises (T, k) at any points, nan
        outside the body; stress in the order XX, YY, ZZ, XY, YZ, XZ, as probes have it.

        points : (k, 3), or (3,) for one
        part : name of the part that is meant where several meet, shell wildcards allowed
        Raises InputError: the run was asked for no fields

        Examples
        --------
        >>> from orchestrator import config_from, solve
        >>> solution = solve(config_from({
        ...     "name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
        ...     "subdomains": {"slices": {"axis": "x", "count": 4}},
        ...     "materials": [{"young": 200e3, "poisson": 0.0}],
        ...     "boundary": [{"on": "xmin", "displacement": [0, 0, 0]},
        ...                  {"on": "xmax", "traction": [10, 0, 0]}]}))
        >>> found = solution.at([[1.0, 0.3, 0.5], [3.0, 0.3, 0.5]])
        >>> print(found["displacement"][0, :, 0].round(7), found["stress"][0, :, 0].round(4))
        [5.0e-05 1.5e-04] [10. 10.]
        """
        if self.fields is None:
            raise wrong(("output", "fields"), "a run that was asked for no fields",
                        "the displacements of all nodes", "run it again without fields: false")
        fields, at = self.fields, np.atleast_2d(np.array(points, float))
        volume = np.zeros(len(fields.cells), int) if fields.part is None else fields.part
        mesh = Mesh(fields.nodes, fields.cells, volume, [*fields.parts, ""])
        allowed = np.isin(mesh.volumes, matching(part, mesh.volumes))[volume]
        finder = Finder(mesh, None, fields.subdomain, (), (), Problems())
        within = [finder.around(point, allowed) for point in at]
        cells = np.array([next(iter(tets.number), -1) for tets in within])
        weights = np.array([next(iter(tets.weights), np.zeros(4)) for tets in within])
        u, sigma = (at_points(quantity, cells, weights, fields.nodal)
                    for quantity in ("displacement", "stress"))
        return {"displacement": u, "stress": sigma, "von_mises": von_mises(sigma)}

    @property
    def sides(self) -> list[np.ndarray] | None:
        """Per subdomain (T, n_E, 3) on its own nodes, continuous over perfect interfaces; None
        without fields.
        """
        if self.fields is None or self.fields.sides is not None:
            return self.fields and self.fields.sides
        split = self.fields.numbering
        return [self.fields.displacement[:, nodes]
                for nodes in np.split(split.nodes, split.offsets[1:-1])]

    @property
    def interfaces(self) -> InterfaceFields | None:
        """Gap, slip, pressure, friction and status on the interfaces that are not perfect; None
        where there are none, and without fields.
        """
        return self.fields and self.fields.interfaces

    def __repr__(self) -> str:
        state = "converged" if self.converged else f"stopped ({self.summary.get('stop_reason')})"
        bound = "" if math.isnan(self.error_bound) else f", error bound {self.error_bound:.1e}"
        return (
            f"Solution({self.summary.get('name')}: {state} after {self.iterations} "
            f"iterations{bound})")


def unsound(scene: Scene, ranks: Sequence[Spent]) -> list[int]:
    """Subdomains whose stresses are those of moduli that are not theirs; ``ranks`` tell which codes
    have matter of their own.
    """
    own = [number for number, code in codes_of_all([rank.codes for rank in ranks]).items()
           if code["own_matter"]]
    return [s.index for s in scene.subdomains if s.foreign or s.code in own]
