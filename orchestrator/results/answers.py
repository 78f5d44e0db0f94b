"""All that is answered of a solved scene, beside its fields: for the summary and for files; what
interfaces carry is told here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orchestrator.config.model import Config
from orchestrator.errors import some
from orchestrator.method.delivery.balance import Resultants
from orchestrator.method.delivery.deliver import Delivered
from orchestrator.method.delivery.met import Met
from orchestrator.results.extremes import COLUMNS, Extremes, NAME as EXTREMES, extremes
from orchestrator.results.fields.fields import Fields
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.probes import NAME as PROBES, read_paths, read_probes, write_paths
from orchestrator.results.summary.summary import place_text
from orchestrator.scene.conditions.probes import ProbeSection
from orchestrator.scene.model import Scene

INTERFACES = "interfaces.csv"
OF_INTERFACES = ("interface", "side_1", "side_2", "law", "load_step", "fx", "fy", "fz", "mx", "my",
                 "mz", "x", "y", "z",
                 "pressure_x", "pressure_y", "pressure_z", "pressure_max", "area", "work",
                 "dissipation")


@dataclass(frozen=True)
class Answers:
    """Answers of a run that has just been finished.

    extremes : of every part
    interfaces : what all interfaces carry
    probes : as ``probes.read_probes`` gives them
    steps : load steps
    kinds : of each entry of ``boundary``: support, or load
    paths : as ``probes.read_paths`` gives them
    box : (2, 3) around all nodes
    met : the interfaces that are not perfect; None where all are
    """

    extremes: Extremes
    interfaces: InterfaceTable
    probes: list[dict[str, object]]
    steps: int
    kinds: list[str]
    paths: list[dict[str, object]]
    box: np.ndarray
    met: Met | None = None

    @classmethod
    def of(cls, scene: Scene, delivered: Delivered, fields: Fields | None,
           detached: Sequence[list[str]] = ()) -> Answers:
        """Answers of a solved scene.

        fields : None: no probes are
        detached : names of bodies that nothing holds, per load step
        """
        lost = None
        if any(detached) or scene.stand_ins.any():  # what is inside these means nothing
            lost = np.array(
                [[stands or s.body in names for s, stands in zip(scene.subdomains, scene.stand_ins)]
                             for names in detached or [[]] * scene.steps])
        found = read_probes(scene.probes, fields.nodal, delivered.carried)
        return cls(extremes(fields.nodal, lost),
                   InterfaceTable.of(scene, delivered.resultants, delivered.met), found,
                   scene.steps,
                   ["load" if entry.forces else "support" for entry in scene.boundary],
                   read_paths(scene.probes, fields.nodal), scene.mesh.box, delivered.met)

    def summary(self, config: Config, delivered: Delivered) -> dict[str, object]:
        """The entry in summary.json."""
        about = np.array(config.output.moments_about, dtype=float)
        forces, moments = np.split(delivered.reactions, 2, axis=2)
        return {"peak_stress": self.extremes.largest("von_mises"),
                "peak_displacement": self.extremes.largest("|u|"),
                "reaction_names": reaction_names(config), "reaction_kinds": self.kinds,
                "reaction_moments": {
                "about": about, "moments": moments - np.cross(about, forces),
                "middle": self.box.mean(axis=0),
                "size": float(np.linalg.norm(np.ptp(self.box, axis=0)))}, "probes": self.probes,
                "paths": self.paths}

    def write(self, folder: ResultsFolder) -> None:
        """Writes extremes.csv, interfaces.csv and, where there are such probes, probes.csv and
        paths.csv.
        """
        folder.write_table(EXTREMES,
                           [COLUMNS,
                            *([*row[:3], *(f"{x:.9g}" for x in row[3:7]), row[7]]
                              for row in self.extremes.rows)])
        if self.interfaces.names:
            self.interfaces.write(folder)
        if self.probes:
            names, columns = zip(*((f"{probe['name']}.{name}", column) for probe in self.probes
                                   for name, column in probe["values"].items()))
            rows = [
                [step + 1, *("" if column is None else repr(column[step]) for column in columns)]
                for step in range(self.steps)]
            folder.write_table(PROBES, [["load_step", *names], *rows])
        if self.paths:
            write_paths(folder, self.paths)


def of_unheld(scene: Scene, detached: Sequence[list[str]]) -> list[str]:
    """Sentences on probes of displacements of bodies that nothing holds at some load step: they may
    be anywhere.

    detached : names of these bodies, per load step
    """
    told = []
    for probe in scene.probes:
        if isinstance(probe,
                      ProbeSection) or "displacement" not in (
                          probe.quantity,
                          getattr(probe, "of", "")) or probe.quantity == "resultant":
            continue
        bodies = {scene.subdomains[e].body for e in probe.subdomains}
        steps = [step for step, names in enumerate(detached, 1) if bodies & set(names)]
        if steps:
            told.append(
                f"probe {probe.name!r} tells displacements of {some(sorted(bodies))}, which "
                f"nothing holds at load step{'s' * (len(steps) > 1)} "
                f"{some([str(step) for step in steps])}: they mean nothing there")
    return told


def reaction_names(config: Config) -> list[str]:
    """Names of the entries of ``boundary``: by their own name, else by their place; then rigid
    tools.
    """
    return [*(place_text(entry.model_dump(exclude_none=True)["on"], entry.part)
              for entry in config.boundary), *config.tools]


@dataclass(frozen=True)
class InterfaceTable:
    """Table of all I interfaces, T load steps.

    names, sides, laws : (I,) texts, pairs of texts, texts
    resultants : forces and moments on side 1
    pressure : (T, I) the largest at a node; nan of bonded interfaces, where stresses tell
    work, dissipation : (T, I) since the unloaded state, nothing where sides cannot move; see
        ``delivery.met``
    """

    names: list[str]
    sides: list[tuple[str, str]]
    laws: list[str]
    resultants: Resultants
    pressure: np.ndarray
    work: np.ndarray
    dissipation: np.ndarray

    @classmethod
    def of(cls, scene: Scene, resultants: Resultants, met: Met | None) -> InterfaceTable:
        """Table of a solved scene."""
        every = scene.interfaces
        taken, lost = np.zeros((2, scene.steps, len(every)))
        pressure = np.full((scene.steps, len(every)), np.nan)
        moving = [i.index for i in scene.opening]
        if met is not None:
            pressure[:, moving], taken[:, moving], lost[:,
                                                        moving] = met.pressure.T, met.work.T, met.dissipation.T
        return cls([i.name for i in every],
                   [tuple(scene.subdomains[e].name for e in i.subdomains) for i in every],
                   [i.law.name for i in every], resultants, pressure, taken, lost)

    def write(self, folder: ResultsFolder) -> Path:
        """Writes the file; places without a centre of pressure are empty."""
        r, steps = self.resultants, len(self.work)
        numbers = np.concatenate([r.force, r.moment, np.broadcast_to(r.centre, r.force.shape),
                                  r.pressure_centre, self.pressure[:, :, None],
            np.broadcast_to(r.area[:, None], (steps, len(self.names), 1)), self.work[:, :, None],
                                  self.dissipation[:, :, None]], axis=2)
        return folder.write_table(INTERFACES,
                                  [OF_INTERFACES,
                                   *([name, *sides, law, step + 1,
                                      *("" if x != x else f"{x:.12g}" for x in row)]
            for k, (name, sides, law) in enumerate(zip(self.names, self.sides, self.laws))
            for step, row in enumerate(numbers[:, k].tolist()))])
