"""Largest stresses that grow without limit are told from those that have one."""

import pytest
from accuracy_case import bent
from test_accuracy import refined

from orchestrator.accuracy.criteria import growth
from orchestrator.results.summary.lines import summary_rows
from orchestrator.scene.mesh.gmsh_session import gmsh, session

SIZES = (0.1, 0.04, 0.01)


@pytest.mark.parametrize("found, a", [(lambda h: h**-0.29, 0.29), (lambda h: h**-0.5, 0.5), (lambda h: 3 - 9 * h, None),
                                      (lambda h: 3 - 90 * h**2, None), (lambda h: 3 + h, None), (lambda h: 3.0, None)])
def test_laws_of_growth(found, a):
    assert growth([(found(h), h) for h in SIZES]) == (a and pytest.approx(a))
    assert growth([(found(h), h) for h in SIZES[:2]]) is None
    assert growth([(found(h), h) for h in (*SIZES[:2], 0.039)]) is None  # hardly finer: as if it were not there
    assert growth([*((found(h), h) for h in (*SIZES, 0.0099)), None]) == (a and pytest.approx(a))


@pytest.mark.long
def test_at_a_clamped_edge(tmp_path):
    """Of the right angle with a clamped side, λ = .711: stresses grow as h^-.289; three meshes are not far from that."""
    code, summary = refined(bent({"error": 0.001, "elements": 4000}), tmp_path)
    meshes = summary["accuracy"]["meshes"]
    assert code == 1 and len(meshes) == 3 and all(mesh["peak"][0] > 0 for mesh in meshes)
    assert 0.2 < summary["peak_stress"]["grows"] < 0.5
    assert "singular" in dict(summary_rows(summary))["peak stress"]


@pytest.mark.long
def test_at_a_smooth_hole(tmp_path):
    """A hole in a plate: three times the stress, and no more."""
    with session():
        made = gmsh.model.occ
        made.cut([(3, made.addBox(0, 0, 0, 1, 1, 0.2))], [(3, made.addCylinder(0, 0, -0.1, 0, 0, 0.4, 0.25))])
        made.synchronize()
        gmsh.write(str(tmp_path / "hole.brep"))
    held = [{"on": {"plane": axis, "at": 0}, "displacement": [0.0 if a == axis else None for a in "xyz"]} for axis in "xyz"]
    _, summary = refined(bent({"error": 0.001, "elements": 8000}, mesh={"step": str(tmp_path / "hole.brep"), "h": 0.25}, subdomains="groups",
                              boundary=[*held, {"on": {"plane": "x", "at": 1}, "traction": [1, 0, 0]}]), tmp_path / "run")
    assert len(summary["accuracy"]["meshes"]) > 2 and "grows" not in summary["peak_stress"]
    assert 3 < summary["peak_stress"]["value"] < 4  # of a plate that is only four times as wide as the hole
