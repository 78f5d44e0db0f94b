"""The joints of a program: nodes as it tells them itself, and the faces between them."""

from __future__ import annotations

import numpy as np

from orchestrator.config.foreign_parts import ProgramPart
from orchestrator.errors import InputError, KeyPath, Problem
from orchestrator.scene.foreign.covering import check_surface, missing_faces
from orchestrator.scene.foreign.flat import of_plane
from orchestrator.scene.foreign.joints import Joints, cut_in_triangles
from orchestrator.scene.foreign.program_run import JOINT, ProgramRuns
from orchestrator.scene.foreign.tables import checked_nodes, faces_of


def joints(part: ProgramPart, path: KeyPath, name: str) -> Joints:
    """The joint nodes in the program's order; of a flat joint that has no faces, triangles between all nodes."""
    runs = ProgramRuns(part, path, name)
    rows = runs.joints()
    table = [(line, [float(word) for word in words[:4]]) for line, words in enumerate(rows, 1)]
    ids, points = checked_nodes(table, JOINT, (*path, "run"))
    labels = [words[4] if len(words) == 5 else "joint" for words in rows]
    names = list(dict.fromkeys(labels))
    own = np.array([names.index(label) for label in labels])
    remarks: list[str] = []
    if part.facets is not None:
        faces = faces_of(part.facets, ids, (*path, "facets"))
    elif part.outward is not None and len(names) == 1:
        faces, remarks = of_plane(points, np.array(part.outward), (*path, "outward"), name)
    else:
        raise InputError(Problem(path, "neither facets nor outward" if len(names) == 1 else f"{len(names)} joints without facets",
                                 "the faces that it meets others on", "add facets: a file with the ids of each face's nodes; or, of "
                                 "one flat joint, outward: [0, 0, 1], its normal out of the part"))
    triangles, owner, face = cut_in_triangles(faces, points, path, f"'{name}'")
    if part.facets is not None:
        check_surface(ids, points, triangles, (*path, "facets"), name)
        remarks = missing_faces(points, triangles, np.delete(points, np.unique(triangles), axis=0), name)
    of_face = [own[table] for table in faces]
    mixed = next((ids[table[i, 0]] for table, labels in zip(faces, of_face)
                  for i in np.flatnonzero((labels != labels[:, :1]).any(axis=1))), None)
    if mixed is not None:
        raise InputError(Problem((*path, "facets"), f"a face at node {mixed} of '{name}' between nodes of two joints",
                                 "faces whose nodes are of one joint", f"name the joints in {JOINT} accordingly"))
    joint = np.concatenate([labels[:, 0] for labels in of_face])[owner]
    left = np.zeros((6, 0)) if part.held is True else np.eye(6)
    return Joints(ids, points, triangles, joint, names, np.zeros((len(ids), 3), dtype=bool), left,
                  any(table.shape[1] in (6, 8) for table in faces), np.zeros_like(face) if part.facets is None else face, remarks)
