"""What every bolt carries and how much it has been shortened, load step by load step, from the interface at its cut."""

from __future__ import annotations

import numpy as np

from orchestrator.laws.status import BONDED
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.scene.model import Scene


def bolt_forces(scene: Scene, interfaces: InterfaceFields) -> list[dict[str, object]]:
    """Per bolt its name, the interface at its cut, its axis, and per load step

    - force, positive where it is pulled: that of side 2 on side 1 along the axis, which leads from side 1 to side 2
    - shortening, a length: how much the cut's sides have gone into each other along the axis
    - state: what its law says it does
    """
    told, kinds = [], dict(zip(interfaces.kinds.tolist(), interfaces.kind_names.tolist()))
    for bolt in scene.bolts:
        at = np.flatnonzero(interfaces.names == bolt.interface.name)
        if not len(at):
            continue
        own = slice(*interfaces.offsets[[at[0], at[0] + 1]])
        area, status = interfaces.area[own], interfaces.status[:, own]
        shortening = -(interfaces.gap[:, own] @ area) / area.sum()
        states = [kinds[int(next(iter(row[row != BONDED]), BONDED))] for row in status]
        told.append({"name": bolt.name, "interface": bolt.interface.name, "axis": bolt.axis.tolist(),
                     "force": (interfaces.resultant[:, at[0]] @ bolt.axis).tolist(), "shortening": shortening.tolist(),
                     "state": states})
    return told
