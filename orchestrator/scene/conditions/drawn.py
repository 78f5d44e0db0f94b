"""Whether what figures are to show is there."""

from __future__ import annotations

import numpy as np

from orchestrator.config.output import Figures
from orchestrator.errors import KeyPath, Problems
from orchestrator.scene.names import matching, suggestion


def check_figures(nodes: np.ndarray, volumes: list[str], figures: Figures, path: KeyPath, problems: Problems) -> None:
    """Parts that are drawn exist, and a cut leaves something on either side.

    Parameters
    ----------
    nodes : (n, 3); volumes : names of the parts
    path : of ``figures`` in the YAML
    """
    for name in figures.parts or ():
        if not matching(name, volumes):
            problems.add((*path, "parts"), f"no volume is called {name!r}", "names of volumes, shell wildcards allowed",
                         suggestion(name, volumes, "volume"))
    if (cut := figures.cut) is not None:
        along = nodes[:, "xyz".index(cut.plane)]
        if not along.min() < cut.at < along.max():
            problems.add((*path, "cut", "at"), f"{cut.plane} = {cut.at:g}, which cuts nothing", f"a plane through the model, "
                         f"which spans {cut.plane} from {along.min():.6g} to {along.max():.6g}",
                         f"take at: {(along.min() + along.max()) / 2:.6g} for its middle")
