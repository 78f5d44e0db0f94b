"""All that is answered of a solved scene, beside its fields: for the summary and for files of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.config.model import Config
from orchestrator.method.delivery.deliver import Delivered
from orchestrator.results.answers import extremes as largest
from orchestrator.results.answers import interfaces as carried
from orchestrator.results.answers import probes as asked
from orchestrator.results.answers.extremes import Extremes, extremes, write_extremes
from orchestrator.results.answers.interfaces import InterfaceTable
from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.piece import Piece
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.summary.words import place_text
from orchestrator.scene.model import Scene

FILES = (largest.NAME, carried.NAME, asked.NAME)


@dataclass(frozen=True)
class Answers:
    """Of a run that has just been finished.

    extremes : of every part
    interfaces : what all interfaces carry
    probes : as ``probes.read_probes`` gives them
    steps : load steps
    """

    extremes: Extremes
    interfaces: InterfaceTable
    probes: list[dict[str, object]]
    steps: int

    @classmethod
    def of(cls, scene: Scene, delivered: Delivered, fields: Fields, detached: Sequence[list[str]] = (),
           piece: Piece | None = None) -> Answers:
        """Of a solved scene.

        detached : names of bodies that nothing holds, per load step
        piece : rank 0's, where there are several; the others ask for the extremes of theirs
        """
        lost = None
        if any(detached) or any(s.foreign for s in scene.subdomains):  # of a mesh that is not ours what is inside means nothing
            lost = np.array([[s.foreign or s.body in names for s in scene.subdomains] for names in detached or [[]] * scene.steps])
        ends = extremes(fields.nodal, lost) if piece is None else piece.extremes(fields.believed, lost)
        found = asked.read_probes(scene, fields.nodal, delivered.parts) if scene.probes else []
        return cls(ends, InterfaceTable.of(scene, delivered.resultants, delivered.interfaces), found, scene.steps)

    def summary(self, config: Config, delivered: Delivered) -> dict[str, object]:
        """What summary.json says of it."""
        about = np.array(config.output.moments_about, dtype=float)
        forces, moments = np.split(delivered.reactions, 2, axis=2)
        return {
            "peak_stress": self.extremes.largest("von_mises"), "peak_displacement": self.extremes.largest("|u|"),
            "reaction_names": reaction_names(config), "reaction_moments": {"about": about, "moments": moments - np.cross(about, forces)},
            "probes": self.probes,
        }

    def write(self, folder: ResultsFolder) -> None:
        """Writes extremes.csv, interfaces.csv and, where there are probes, probes.csv.

        Raises InputError: disk full or folder not writable
        """
        write_extremes(folder, self.extremes)
        if self.interfaces.names:
            self.interfaces.write(folder)
        if self.probes:
            asked.write_probes(folder, self.probes, self.steps)


def reaction_names(config: Config) -> list[str]:
    """What the entries of ``boundary`` are called: by their own name, else by their place."""
    return [place_text(entry.model_dump(exclude_none=True)["on"]) for entry in config.boundary]
