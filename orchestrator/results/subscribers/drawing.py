"""Has figures of the structure drawn as soon as they can be: its shape while it is solved, its pictures once it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orchestrator.config import Config
from orchestrator.method.events import Subscriber
from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures.artist import Artist
from orchestrator.results.figures.figures import Solved, look_of, prepare, sketch
from orchestrator.scene.model import Scene


class Drawing(Subscriber):
    """Tells an artist what is known.

    Parameters
    ----------
    artist : who draws
    several : whether there are several ranks: then no process has the stresses of the whole
    """

    def __init__(self, artist: Artist, config: Config, several: bool):
        self._artist, self._look, self._several = artist, look_of({"config": config.complete()}), several
        self._title, self._begun = config.name, False

    def begin(self, scene: Scene) -> None:
        """The scene is known."""
        opens = not all(i.law.perfect for i in scene.interfaces)
        self._prepare(Fields.of(scene, np.empty((0, len(scene.mesh.nodes), 3)),
                                [np.empty((0, len(s.nodes), 3)) for s in scene.subdomains] if opens else None))

    def solved(self, fields: Fields) -> None:
        if not self._begun:
            self._prepare(replace(fields, displacement=fields.displacement[:0], interfaces=None, thermal=None, believed=None,
                                  sides=fields.sides and [side[:0] for side in fields.sides]))
        self._artist.prepare(sketch, Solved.of(fields, not self._several))

    def _prepare(self, fields: Fields) -> None:
        self._artist.prepare(prepare, replace(fields, thermal=None), self._look, self._title)
        self._begun = True
