"""Where the energy error comes from: shares of bodies and interfaces, and what is a body's own."""

import numpy as np
from boxes import boxed
from in_process import IN_PROCESS
from test_certificate import Exact

from orchestrator import build_scene, config_from, solve
from orchestrator.results.report.tables import tables
from orchestrator.results.summary.lines import summary_rows

ASKED = 1e-3


def two_piles(lightly=1e-4, slabs=3, contrast=100.0):
    """Two piles that nothing joins: two blocks pressed by a hundredth, and slabs, soft and stiff, by a share of that."""
    heights = {"heavy": np.full(2, 0.5), "light": np.full(slabs, 1 / slabs)}
    names = {pile: [f"{pile} {k + 1}" for k in range(len(each))] for pile, each in heights.items()}
    parts = [boxed(name, [1, 1, float(h)], [3, 3, 2], [3.0 * (pile == "light"), 0, float(h * k)])
             for pile, each in heights.items() for k, (name, h) in enumerate(zip(names[pile], each))]
    top = {"heavy": 0.01, "light": 0.01 * lightly}
    boundary = [{"on": f"{name[0]}/zmin", "displacement": [0, 0, 0]} for name in names.values()]
    boundary += [{"on": f"{name[-1]}/zmax", "displacement": [0.5 * top[pile], 0, -top[pile]]} for pile, name in names.items()]
    config = config_from({
        "name": "piles", "parts": parts, "subdomains": "groups", "boundary": boundary,
        "materials": [{"young": 200e3, "poisson": 0.3},
                      *({"young": 200e3 / contrast, "poisson": 0.3, "on": name} for name in names["light"][1::2])],
        "interfaces": [{"law": "contact", "friction": 0.3}], "blackbox": IN_PROCESS,
        "method": {"tolerance": {"error": ASKED}}, "output": {"fields": False, "figures": False}})
    scene = build_scene(config)
    return solve(config, scene), scene


def true_errors(solved, scene):
    """Body → energy norm of v − u* over that of u*, both the largest of all load steps."""
    exact, found = Exact(scene), {}
    for s, a, b in zip(scene.subdomains, exact.monolithic.offsets[:-1], exact.monolithic.offsets[1:]):
        v = np.hstack([part.reshape(scene.steps, -1) for part in solved.sides])
        off, u = (exact.unmoved(x)[:, a:b] for x in (v - exact.u, exact.u))
        K = exact.K[a:b][:, a:b]
        found[s.body] = np.sqrt(max(x @ (K @ x) for x in off) / max(x @ (K @ x) for x in u))
    return found


def test_a_light_pile_beside_a_heavy_one():
    """All together are below the error asked, the light pile's bodies are not by far: they are named, about as far off as they are."""
    solved, scene = two_piles()
    summary = solved.summary
    found, true = summary["error_shares"], true_errors(solved, scene)
    assert summary["error_bound"] <= ASKED and np.isclose(sum(found["bodies"].values()) + sum(found["interfaces"].values()), 1.0)
    assert list(found["bodies"])[0].startswith("heavy") and list(found["own"])[0].startswith("light")
    assert all(0.5 * true[name] <= own <= 5 * true[name] for name, own in found["own"].items())
    told = dict(summary_rows(summary))["own errors"]
    assert max(true, key=true.get) in told and "heavy" not in told
    (table,) = (table for table in tables(solved) if table.title == "Where the error comes from")
    assert {row["name"] for row in table.entries} >= found["own"].keys()
