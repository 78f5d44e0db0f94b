"""Small models of other programs: stiffness matrices with their tables, and CalculiX decks, of a block 2 × 1 × 1."""

import struct
from types import SimpleNamespace as Entry

import numpy as np
import scipy.io
import scipy.sparse as sp

from orchestrator.blackbox.models import Matter
from orchestrator.scene.mesh.faces import faces_of
from orchestrator.scene.mesh.sources import box

SIZE = (2.0, 1.0, 1.0)
EDGES = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]  # of a tet, in the order of C3D10
HEAT = """*MATERIAL,NAME=WOOD
*ELASTIC,TYPE=ENGINEERING CONSTANTS
140e3,10e3,12e3,.3,.3,.4,5e3,6e3,
4e3,20.
*EXPANSION,TYPE=ORTHO
1e-6,2e-5,3e-5
*ORIENTATION,NAME=TURNED
1.,.5,.2,-.5,1.,.1
*SOLID SECTION,ELSET=EALL,MATERIAL=WOOD,ORIENTATION=TURNED
"""
STEEL = "*MATERIAL,NAME=STEEL\n*ELASTIC\n200e3,.3\n*SOLID SECTION,ELSET=EALL,MATERIAL=STEEL\n"


def tets(cells=(2, 1, 1), at=(0, 0, 0), size=SIZE):
    """Nodes and four-node tets."""
    mesh = box(Entry(box=Entry(size=list(size), cells=list(cells))))
    return mesh.nodes + np.array(at, dtype=float), mesh.cells


def stiffness(nodes, cells, young=200e3):
    return Matter(nodes, cells, np.full(len(cells), young), np.full(len(cells), 0.3)).stiffness()


def write_matrix(folder, digits=17, change=lambda K, nodes: (K, nodes), clamp=True, loads=(1.0, 2.0, -3.0), turned=False,
                 cells=(2, 1, 1), without=(), size=SIZE):
    """K.mtx, nodes.csv, facets.csv (but for the faces ``without``), f.mtx of the block, its end x = 0 clamped, its joint at the
    other; returns K, nodes and forces."""
    x, t = tets(cells, size=size)
    kept = np.flatnonzero(x[:, 0] > 0) if clamp else np.arange(len(x))
    dofs = (3 * kept[:, None] + np.arange(3)).ravel()
    K, f = sp.csr_array(stiffness(x, t)[dofs][:, dofs]), np.tile(loads, len(kept))
    outer = faces_of(t, len(x)).triangles[faces_of(t, len(x)).outer]
    joint = np.delete(outer[(x[outer][:, :, 0] == size[0]).all(axis=1)], list(without), axis=0)
    table = np.column_stack([1 + kept, x[kept]])
    changed, table = change(K, table)
    scipy.io.mmwrite(folder / "K.mtx", sp.coo_matrix(changed), precision=digits, symmetry="general")
    scipy.io.mmwrite(folder / "f.mtx", f[:, None], precision=17)
    (folder / "nodes.csv").write_text("id,x,y,z\n" + "".join(f"{int(r[0])},{r[1]!r},{r[2]!r},{r[3]!r}\n" for r in table.tolist()))
    (folder / "facets.csv").write_text("".join(" ".join(str(1 + i) for i in row[:: -1 if turned else 1]) + "\n" for row in joint))
    return K, x[kept], f


def elements(kind, cells, at=(0, 0, 0), turned=False, size=SIZE):
    """Nodes and elements of the block: C3D4, C3D10 (tets), C3D8, C3D20, C3D20R (bricks; ``turned``: see ``write_deck``)."""
    if kind in ("C3D4", "C3D10"):
        x, t = tets(cells, at, size)
        if kind == "C3D4":
            return x, t
        ends = np.sort(t[:, EDGES].reshape(-1, 2), axis=1)
        edges, place = np.unique(ends, axis=0, return_inverse=True)
        return np.vstack([x, x[edges].mean(axis=1)]), np.hstack([t, len(x) + place.reshape(-1, 6)])
    corners = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [0, 0, 2], [2, 0, 2], [2, 2, 2], [0, 2, 2]])
    if turned:
        corners = corners[[4, 5, 1, 0, 7, 6, 2, 3]]
    local = corners
    if kind != "C3D8":
        ring = [(i, (i + 1) % 4) for i in range(4)]
        along = [*ring, *((a + 4, b + 4) for a, b in ring), *((i, i + 4) for i in range(4))]
        local = np.vstack([corners, [(corners[a] + corners[b]) // 2 for a, b in along]])
    first = 2 * np.array(list(np.ndindex(*cells)))
    grid = (first[:, None] + local).reshape(-1, 3)
    nodes, place = np.unique(grid, axis=0, return_inverse=True)
    return nodes * np.array(size) / (2 * np.array(cells)) + np.array(at), place.reshape(len(first), -1)


def numbered(nodes):
    """Lines of *NODE for nodes (n, 3)."""
    return "".join(f"{i},{p[0]!r},{p[1]!r},{p[2]!r}\n" for i, p in enumerate(nodes.tolist(), 1))


def write_deck(folder, kind="C3D8", cells=(2, 1, 1), matter=STEEL, heat=False, clamp="ROOT,1,3\n", more="", loads="", at=(0, 0, 0),
               turned=False,
               size=SIZE):
    """part.inp and loads.inp: joint FLANGE at the far end in x, ROOT at the near one; returns nodes.

    Parameters
    ----------
    turned : bricks numbered so that faces across x are cut along their other diagonal, as those of our tets beyond it are
    """
    x, cells = elements(kind, cells, at, turned, size)
    rows = np.column_stack([np.arange(1, len(cells) + 1), 1 + cells]).tolist()
    text = "*NODE,NSET=NALL\n" + numbered(x)
    text += f"*ELEMENT,TYPE={kind},ELSET=EALL\n"
    for row in rows:
        text += ",\n".join(",".join(map(str, row[i : i + 12])) for i in range(0, len(row), 12)) + "\n"
    for name, place in (("FLANGE", x[:, 0].max()), ("ROOT", x[:, 0].min())):
        text += f"*NSET,NSET={name}\n" + "".join(f"{i},\n" for i in 1 + np.flatnonzero(x[:, 0] == place))
    text += matter + ("*INITIAL CONDITIONS,TYPE=TEMPERATURE\nNALL,20.\n" if heat else "")
    more = more if isinstance(more, str) else more(x)
    (folder / "part.inp").write_text(text + (f"*BOUNDARY\n{clamp}" if clamp else "") + more)
    warm = "".join(f"{i},{20 + 50 * p[0] + 30 * p[1] * p[2]!r}\n" for i, p in enumerate(x.tolist(), 1))
    (folder / "loads.inp").write_text(loads or (f"*TEMPERATURE\n{warm}" if heat else "") + "*CLOAD\nFLANGE,3,-5.\n")
    return x


def more_inside(x):
    """Cards of a skin of shells, an equation and a node that nothing has, on a block of bricks, and of a
    support on one of its joint's nodes."""
    def at(*point):
        return 1 + int(np.argmin(np.linalg.norm(x - np.array(point), axis=1)))

    third = SIZE[0] / 3
    skin = "".join(f"{100 + i},{at(i * third, 0, 1)},{at((i + 1) * third, 0, 1)},{at((i + 1) * third, 1, 1)},{at(i * third, 1, 1)}\n"
                   for i in (0, 1))
    return (f"*ELEMENT,TYPE=S4,ELSET=SKIN\n{skin}*MATERIAL,NAME=FOIL\n*ELASTIC\n70e3,.3\n*SHELL SECTION,ELSET=SKIN,MATERIAL=FOIL\n.02\n"
            "*NODE\n777,9.,9.,9.\n"
            f"*EQUATION\n2\n{at(2 * third, 0, 0)},2,1.,{at(2 * third, 1, 0)},2,-1.\n*BOUNDARY\n{at(SIZE[0], 0, 0)},1,3\n")


def restart_displacements(path, name):
    """(nodes, 3) of a restart file, by the name of the first material."""
    data, found, at = path.read_bytes(), [], 0
    while at + 4 <= len(data):
        (length,) = struct.unpack_from("<i", data, at)
        found.append((at + 4, length))
        at += 8 + length
    first = next(i for i, (start, length) in enumerate(found) if length % 80 == 0 and data[start : start + 80] == name.encode().ljust(80))
    start, length = found[first + 2]
    return np.frombuffer(data, float, length // 8, start).reshape(-1, 4)[:, 1:]
