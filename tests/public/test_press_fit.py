"""A ring on a shaft by a press fit: what ``init`` writes, Lamé's pressure, the torque at which it slips."""

import math
import re

import gmsh
import pytest
from helpers import call, run

E, MU, INTERFERENCE, R1, R2, LENGTH = 210e3, 0.12, 0.02, 20.0, 40.0, 20.0
PRESSURE = E * INTERFERENCE * (R2**2 - R1**2) / (2 * R1 * R2**2)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """Return a folder with two STEP files, the shaft drawn thicker than the bore."""
    folder = tmp_path_factory.mktemp("fit")
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Verbosity", 0)
    occ = gmsh.model.occ
    for name, outer, inner in (("shaft", R1 + INTERFERENCE, 0.0), ("ring", R2, R1)):
        gmsh.model.add(name)
        solid = occ.addCylinder(0, 0, 0, 0, 0, LENGTH, outer)
        if inner:
            occ.cut([(3, solid)], [(3, occ.addCylinder(0, 0, 0, 0, 0, LENGTH, inner))])
        occ.synchronize()
        gmsh.write(str(folder / f"{name}.step"))
    gmsh.finalize()
    assert call("init", folder / "fit.yaml", folder / "shaft.step", folder / "ring.step").code == 0
    return folder


def test_init_writes_the_interference_that_is_drawn(drawn):
    """And no bond: the last match wins."""
    text = (drawn / "fit.yaml").read_text()
    assert re.search(r'between: \["shaft", "ring"\], law: contact, friction: [\d.]+, gap: -0.02}', text)
    assert text.index("law: perfect") < text.index("gap: -0.02") and "error: 1.0e-4" in text


def test_a_ring_is_pressed_on_as_by_lame_and_slips_at_the_torque_that_friction_holds(drawn, tmp_path):
    """Four-node tets of twelve chords on a circle: chords and stiff tets make the pressure 7 % too large. The
    torque is what friction holds of it, to what the sides' normals are off the radius."""
    text = re.sub(r" *# EDIT.*", "", (drawn / "fit.yaml").read_text())
    held = "coupling: {kind: distributed, displacement: [0, 0, 0], rotation: [0, 0, 0]}"
    turned = "coupling: {kind: distributed, rotation: [null, null, 0.1]}, history: turn"
    text = re.sub(r"boundary:(\n  -.*)*", f'boundary:\n  - {{on: "shaft/solid:3", {held}}}\n  - {{on: "ring/solid:1", {turned}}}\n'
                  "histories: {turn: [0, 0.5, 1]}", text)
    text = re.sub(r"friction: [\d.]+, gap", f"friction: {MU}, gap", text).replace("200e3", "210e3")
    text = re.sub(r"curvature: 12, min: [\d.]+", "curvature: 12", text).replace("element: auto", "element: P1, workers: 1")
    (drawn / "turned.yaml").write_text(text)
    summary = run(drawn / "turned.yaml", tmp_path / "out")
    face, = summary["contact_faces"]
    pressure = face["normal"][0] / (2 * math.pi * R1 * LENGTH)
    assert pressure == pytest.approx(PRESSURE, rel=0.08) and pressure > PRESSURE
    torque = [moment[2] for moment in summary["reaction_moments"]["moments"][1]]
    assert torque[1:] == pytest.approx([R1 * capacity for capacity in face["capacity"][1:]], rel=0.01)
    assert face["slips"]["step"] == 2 and abs(torque[0]) < 0.05 * torque[-1]
