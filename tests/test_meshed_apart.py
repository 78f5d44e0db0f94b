"""Parts meshed each on its own, solved: against Lamé, and against the conforming mesh. More of it: the study meshed_apart."""

import numpy as np
import pytest
from in_process import IN_PROCESS
from quick import late

from orchestrator.config.load import config_from
from orchestrator.run import solve
from benchmarks.problems import assemblies


def solved(problem: dict, error: float):
    """By the in-process code, with the problem's element."""
    code = {**IN_PROCESS, **problem.get("blackbox", {})}
    found = solve(config_from({**problem, "blackbox": code, "method": {"tolerance": {"error": error}}}))
    assert found.converged, found.stop_reason
    return found


@pytest.mark.parametrize("element, sizes, mean, most", [("P1", (0.12, 0.16), 0.02, 0.1), late("P2", (0.2, 0.15), 0.01, 0.025)])
def test_a_ring_shrunk_on_a_shaft(element, sizes, mean, most, tmp_path):
    """The pressure is Lamé's, all round; so is where the ring goes."""
    made = solved(assemblies.shrunk_ring(tmp_path, sizes, element), 1e-5)
    (interface,), fields = made.scene.interfaces, made.interfaces
    points = interface.mortar.points
    pressure, area = fields.pressure[-1][points], fields.area[points]
    exact = assemblies.lame_pressure()
    assert area @ pressure / area.sum() == pytest.approx(exact, rel=mean)
    assert np.abs(pressure / exact - 1).max() < most
    ring = next(s for s in made.scene.subdomains if s.name == "ring")
    x, u = made.scene.mesh.nodes[ring.nodes][:, :2], made.parts[ring.index][-1][:, :2]
    radius = np.linalg.norm(x, axis=1)
    assert np.einsum("ni,ni->n", u, x) / radius == pytest.approx(assemblies.lame_displacement(radius), rel=0.01)
    assert made.error_bound <= 1e-5


@pytest.mark.long
def test_a_bonded_assembly_gives_way_as_with_the_conforming_mesh(tmp_path):
    """Thirteen pairs, curved and plane ones, of solids at sizes of their own."""
    moved = []
    for mesh in ({"h": 8}, {"h": {"*": 6, "solid_[12]": 8}, "conforming": False}):
        made = solved(assemblies.flange(tmp_path, mesh, True), 1e-4)
        entry = next(e for e in made.scene.boundary if e.kind == "traction")
        moved.append(float((made.displacement[-1, entry.nodes] @ entry.forces.amounts[-1, 0]).mean()))
        force = np.array(made.summary["reactions"])[0][-1]
        assert force[2] / force[1] == pytest.approx(5.0, rel=1e-3)
    assert moved[1] == pytest.approx(moved[0], rel=0.02)


@pytest.mark.long
def test_bodies_that_meet_beyond_their_pair_are_told(tmp_path):
    """A ball whose pair is found near its foot alone sinks in around it; found from farther apart, it does not."""
    told = []
    for within in (0.02, 0.5):
        problem = assemblies.ball_on_block(tmp_path, (0.4, 0.4))
        problem["interfaces"][0]["within"] = within
        problem["boundary"][-1]["displacement"] = [None, None, -0.6]
        made = solve(config_from({**problem, "blackbox": IN_PROCESS, "method": {"tolerance": {"error": 1e-3}}}))
        told.append([w for w in made.summary["warnings"] if "pass through each other" in w])
    assert len(told[0]) == 1 and "'ball' and 'block'" in told[0][0] and not told[1]
