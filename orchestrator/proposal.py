"""Proposals of ``orchestrator init`` for parts that touch: contact and bonds, bolts with a
pretension, load steps.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace

import numpy as np

from orchestrator.linalg import WRITTEN
from orchestrator.scene.fits import ClampingBolt, Fit, bolts, fits, round_faces
from orchestrator.scene.inspection import ROOM, SurfaceRow, pairs_of_mesh
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.names import INSIDE, unique_names
from orchestrator.scene.shanks import shank_of

# Half the yield limit of bolts of class 8.8, N/mm²: what a first pretension may put on the shank's
# section.
STRESS = 320.0
# Search distance of gaps, of the largest clearance: chords of holes and shanks are off them by some
# per cent.
FARTHER = 1.3
# Of what friction holds the pull that is proposed, in so many equal steps: it slips within the last
# ones.
PULL, STEPS, FRICTION = 1.2, 4, 0.15
# A shaft is thicker than its hole, rather than rounded, from this share of its radius on.
DRAWN = 1e-5


@dataclass
class Proposal:
    """Proposal for a mesh of several volumes.

    roles : name of a volume → a better one, where it is a bolt or a nut; new_names : those of them
        that are taken
    cuts : of each bolt, as the configuration has them
    """

    mesh: Mesh
    fits: list[Fit]
    bolts: list[ClampingBolt]
    pairs: int
    roles: dict[str, str]
    cuts: list[str] = field(default_factory=list)
    new_names: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, mesh: Mesh, faces: Faces) -> Proposal:
        """Finds what there is."""
        if len(mesh.volumes) < 2:
            return cls(mesh, [], [], 0, {})
        found = fits(round_faces(mesh, faces))
        clamps = bolts(mesh, faces, found)
        roles = {}
        for number, bolt in enumerate(clamps, 1):
            for volume, what in ((bolt.volume, f"bolt_{number}"), *(
                (nut, f"nut_{number}{'b' * k}") for k, nut in enumerate(bolt.nuts))):
                inside, sign, _ = mesh.volumes[volume].rpartition(INSIDE)
                roles[mesh.volumes[volume]] = f"{inside}{sign}{what}"
        pairs = sum(row.meshes != ROOM for row in pairs_of_mesh(mesh, faces))
        return cls(mesh, found, clamps, pairs, roles,
                   [_cut(mesh, faces, bolt) for bolt in clamps])

    def renamed(self, new_names: dict[str, str]) -> Mesh:
        """The mesh with other names of volumes, and of their surfaces, which are told from now
        on.
        """
        known = set(self.mesh.volumes) - set(new_names)
        self.new_names = {old: new for old, new in new_names.items() if new not in known}
        volumes = [self.new_names.get(name, name) for name in self.mesh.volumes]

        def of_surface(name: str) -> str:
            volume, sign, number = name.rpartition(":")
            return f"{self.new_names.get(volume, volume)}{sign}{number}"

        self.mesh = replace(self.mesh, volumes=unique_names(volumes),
                            surfaces={of_surface(s): t for s, t in self.mesh.surfaces.items()},
                            smooth={of_surface(s): shape for s, shape in self.mesh.smooth.items()})
        return self.mesh

    @property
    def room(self) -> list[Fit]:
        """Shafts that have room in their holes."""
        return [fit for fit in self.fits if not fit.same and fit.clearance > 0]

    @property
    def threads(self) -> list[Fit]:
        """Threads of the bolts."""
        return [fit for bolt in self.bolts for fit in bolt.threads]

    @property
    def presses(self) -> list[str]:
        """Entries for shafts that are a little thicker than their holes, threads apart."""
        held = [fit.volumes for fit in self.threads]
        return [f"  - {{between: {self._pair(fit)}, law: contact, friction: {FRICTION:g}, gap: "
                f"{fit.clearance:.3g}}}   # EDIT: the friction of a press "
                "fit\n" for fit in self.fits
                if -fit.clearance > DRAWN * fit.shaft.radius and not fit.overlaps
                and fit.volumes not in held]

    def _pair(self, fit: Fit) -> str:
        return json.dumps([self.mesh.volumes[v] for v in fit.volumes])

    @property
    def tolerance(self) -> str:
        """Tolerance of the run: bonded parts cost little to the last digit."""
        return "1.0e-4" if self.bolts or self.room or self.presses else "1.0e-6"

    @property
    def force(self) -> float:
        """A first pretension of a bolt."""
        return float(f"{STRESS * np.pi * min(bolt.shank.radius for bolt in self.bolts) ** 2:.2g}")

    def boundary(self, held: SurfaceRow, loaded: SurfaceRow) -> str:
        """Supports and loads, and for bolts the load steps."""
        one, other = json.dumps(held.name), json.dumps(loaded.name)
        if not self.bolts:
            return f"""boundary:                           # EDIT: what is held and what acts
  - {{on: {one}, displacement: [0, 0, 0]}}      # a plane surface at one end; null \
leaves a component free
  - {{on: {other}, resultant: {{force: [0, 0, -1]}}}}   # at the other end; or traction: \
[..], pressure: 1, motion: {{..}}
"""
        normal = np.zeros(3) if loaded.shape.direction is None else loaded.shape.direction
        axis = int(np.abs(normal).argmax())
        size = float(f"{PULL * FRICTION * len(self.bolts) * self.force:.2g}")
        force = [float(size * np.sign(normal[axis])) if k == axis else 0 for k in range(3)]
        rest = ", ".join("null" if k == axis else "0" for k in range(3))
        names = [json.dumps(self.mesh.volumes[bolt.volume]) for bolt in self.bolts]
        lines = "\n".join(f"  - {{on: {name}, force: {self.force:g}, history: tighten{cut}}}"
                          for name, cut in zip(names, self.cuts))
        return f"""boundary:                           # EDIT: what is held and what acts
  - {{on: {one}, displacement: [0, 0, 0]}}      # a plane surface at one end; null \
leaves a component free
  - {{on: {other}, resultant: {{force: [{', '.join(f'{x:g}' for x in force)}]}}, history: \
pull}}     # EDIT: the force
  - {{on: {other}, displacement: [{rest}]}}     # guided; leave it out if the part is free there

histories:                          # a factor per load step: tighten, then pull
  tighten: [{', '.join('1' for _ in range(STEPS + 1))}]
  pull:    [{', '.join(f'{k / STEPS:g}' for k in range(STEPS + 1))}]

bolts:                              # EDIT: the force; the cut is across the shank, \
between head and thread
{lines}
"""

    def interfaces(self) -> str:
        """Laws of what touches and of what is in holes with room."""
        room = self.room
        count = "one pair of parts lies" if self.pairs == 1 else f"{self.pairs} pairs of parts lie"
        if not self.pairs and not room:
            return ""
        if not room and not self.bolts:
            return f"""
interfaces:                         # {count} on each other
  - {{between: auto, law: perfect}}   # EDIT: bonded; or law: contact, \
friction: {FRICTION:g}, between: auto or [one, other]
{"".join(self.presses)}"""
        within, what = "", f"# {count} on each other; the last match wins"
        text = f"\ninterfaces:                         {what}\n"
        if room:
            within = f", within: {FARTHER * max(fit.clearance + fit.eccentric for fit in room):.2g}"
            holes = f"{len(room)} shafts are" if len(room) > 1 else "one shaft is"
            low, high = (f"{end(fit.clearance for fit in room):.3g}" for end in (min, max))
            wide = low if low == high else f"{low} to {high}"
            text += (
                f"  # {holes} in holes with room, {wide} all round: contact over that gap, which "
                "is read from the geometry\n")
        text += (
            f"  - {{between: auto, law: contact, friction: {FRICTION:g}{within}}}   # EDIT: the "
            "friction\n")
        for fit in self.threads:
            inside = (
                f", drawn {-fit.clearance:.3g} inside each other: give both one radius in CAD, "
                "else check refuses them" * fit.overlaps)
            text += f"  - {{between: {self._pair(fit)}, law: perfect}}   # a thread{inside}\n"
        return text + "".join(self.presses)


def _cut(mesh: Mesh, faces: Faces, bolt: ClampingBolt) -> str:
    """The cut of a bolt between its head and what its thread is bonded to, as a key of its entry;
    empty where it has no round shank.
    """
    own = np.flatnonzero(mesh.volume == bolt.volume)
    held = {mesh.volumes[fit.hole.volume] for fit in bolt.threads}
    if (shank := shank_of(mesh, faces, own, sorted(held))) is None:
        return ""
    point = shank.cut
    axis = int(np.abs(shank.axis).argmax())
    if abs(shank.axis[axis]) > 1 - WRITTEN:
        return f", cut: {{plane: {'xyz'[axis]}, at: {point[axis]:.4g}}}"
    plane, at = (", ".join(f"{x:.4g}" for x in vector) for vector in (shank.axis, point))
    return f", cut: {{plane: [{plane}], at: [{at}]}}"
