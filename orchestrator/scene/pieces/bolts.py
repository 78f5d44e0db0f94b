"""Bolts of a mesh that ranks have in pieces: who has all of one finds its plane, and tells the others which of its cells are ahead of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from orchestrator.errors import Problems
from orchestrator.parallel.team import Team
from orchestrator.scene.bolts import Plane, Shanks, across_shank, bolt_cells, cut_at, ends_beside, planes
from orchestrator.scene.pieces.piece import Piece


def cut(piece: Piece, bolts: Sequence[Any], team: Team) -> Piece | None:
    """A piece with the bolts cut that it has cells of; None, on all ranks, where something is wrong with one. All ranks ask together."""
    mesh, faces, partition, problems = piece.mesh, piece.faces, piece.partition, Problems()
    own = {i: bolt_cells(mesh, bolt) for i, bolt in enumerate(bolts)}
    here = [i for i, cells in own.items() if len(cells) and partition.here[partition.subdomain[cells]].all()]
    shanks = {i: shank for told in team.all_gather({i: across_shank(mesh, faces, own[i]) for i in here}) for i, shank in told.items()}
    ends = team.all_gather({i: np.unique(ends_beside(mesh, faces, own[i], shank)) for i, shank in shanks.items() if shank is not None})
    beside = {i: np.concatenate([told[i] for told in ends]) for i in ends[0]}
    found = planes(mesh, faces, partition, bolts, Shanks(shanks, beside), problems)
    told = [one for each in team.all_gather([replace(plane, own=piece.cell_number[plane.own[plane.ahead]], ahead=None) for plane in found])
            for one in each]
    every = [Plane(one.index, one.name, one.axis, one.point, own[one.index], np.isin(piece.cell_number[own[one.index]], one.own))
             for one in sorted(told, key=lambda plane: plane.index) if len(own[one.index])]
    partition, cuts, keys = cut_at(every, faces, partition, problems)
    if team.max(float(bool(problems.found)))[0] or len(told) < len(bolts):
        return None
    return replace(piece, partition=partition, present=2 * piece.present[keys // 2] + keys % 2, count=2 * piece.count, cuts=cuts,
                   cautions=problems.warnings)
