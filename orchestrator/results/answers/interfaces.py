"""interfaces.csv: what every interface carries at every load step, bonded ones too."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.method.delivery.resultants import Resultants
from orchestrator.results.folder import ResultsFolder
from orchestrator.scene.model import Scene

NAME = "interfaces.csv"
COLUMNS = ("interface", "side_1", "side_2", "law", "load_step", "fx", "fy", "fz", "mx", "my", "mz", "x", "y", "z",
           "pressure_x", "pressure_y", "pressure_z", "pressure_max", "area", "work", "dissipation")


@dataclass(frozen=True)
class InterfaceTable:
    """Of all I interfaces, T load steps.

    names, sides, laws : (I,) texts, pairs of texts, texts
    resultants : forces and moments on side 1
    pressure : (T, I) the largest at a node; nan of bonded interfaces, where stresses tell
    work, dissipation : (T, I) since the unloaded state, nothing where sides cannot move; see ``work``
    """

    names: list[str]
    sides: list[tuple[str, str]]
    laws: list[str]
    resultants: Resultants
    pressure: np.ndarray
    work: np.ndarray
    dissipation: np.ndarray

    @classmethod
    def of(cls, scene: Scene, resultants: Resultants, fields: InterfaceFields | None) -> InterfaceTable:
        """Of a solved scene."""
        every = scene.interfaces
        taken, lost = np.zeros((2, scene.steps, len(every)))
        pressure = np.full((scene.steps, len(every)), np.nan)
        moving = [i.index for i in every if not i.law.perfect]
        if fields is not None:
            pressure[:, moving] = np.maximum.reduceat(fields.pressure, fields.offsets[:-1], axis=1)
            taken[:, moving], lost[:, moving] = work(fields, np.array([every[i].law.has_history for i in moving]))
        return cls([i.name for i in every], [tuple(scene.subdomains[e].name for e in i.subdomains) for i in every],
                   [i.law.name for i in every], resultants, pressure, taken, lost)

    def write(self, folder: ResultsFolder) -> Path:
        """Writes the file; places without a centre of pressure are empty.

        Raises InputError: disk full or folder not writable
        """
        r, text = self.resultants, io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(COLUMNS)
        steps = len(self.work)
        numbers = np.concatenate([
            r.force, r.moment, np.broadcast_to(r.centre, r.force.shape), r.pressure_centre, self.pressure[:, :, None],
            np.broadcast_to(r.area[:, None], (steps, len(self.names), 1)), self.work[:, :, None], self.dissipation[:, :, None]],
            axis=2)
        for k, (name, sides, law) in enumerate(zip(self.names, self.sides, self.laws)):
            writer.writerows([name, *sides, law, step + 1, *("" if x != x else f"{x:.12g}" for x in row)]
                             for step, row in enumerate(numbers[:, k].tolist()))
        return folder.write(NAME, text.getvalue())


def work(interfaces: InterfaceFields, rubs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T, I) W and D of the interfaces that are not perfect.

    rubs : (I,) bool, whether what acts along the interface is friction
    """
    i = interfaces
    push, opening = i.pressure * i.areas, i.gap - i.initial_gap
    drag = i.friction_traction * i.areas[:, :, None]
    before = [np.concatenate([np.zeros_like(x[:1]), x[:-1]]) for x in (push, opening, drag, i.slip)]
    there = i.areas > 0
    there[1:] &= there[:-1]
    moved, slid = np.where(there, opening - before[1], 0.0), i.slip - before[3]
    taken = -0.5 * (push + before[0]) * moved + 0.5 * np.einsum("tni,tni->tn", drag + before[2], slid)
    lost = np.einsum("tni,tni->tn", drag, slid)
    each = [np.add.reduceat(x, i.offsets[:-1], axis=1).cumsum(axis=0) for x in (taken, lost)]
    return each[0], each[1] * rubs
