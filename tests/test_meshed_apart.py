"""Parts meshed each on its own, solved: against Lamé, and against the conforming mesh. More of it: the study meshed_apart."""

import numpy as np
import pytest
from in_process import IN_PROCESS
from quick import late

from orchestrator.config.load import config_from
from orchestrator.run import solve
from benchmarks.problems import assemblies

AS_FAR = 1.1  # meshes of one size differ by as much


def solved(problem: dict, error: float):
    """By the in-process code, with the problem's element."""
    code = {**IN_PROCESS, **problem.get("blackbox", {})}
    found = solve(config_from({**problem, "blackbox": code, "method": {"tolerance": {"error": error}}}))
    assert found.converged, found.stop_reason
    return found


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def off_lame(made) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What nodal pressures, their means through the depth, displacements of the ring are off."""
    (interface,), fields = made.scene.interfaces, made.interfaces
    there = fields.area > 0
    pressure, area = fields.pressure[-1][there] / assemblies.lame_pressure(), fields.area[there]
    sectors = assemblies.through_depth(made.scene.points(interface)[there], area, pressure)
    nodes = [made.scene.mesh.nodes[s.nodes] for s in made.scene.subdomains]
    ring = int(np.argmax([np.linalg.norm(x[:, :2], axis=1).max() for x in nodes]))
    x, u = nodes[ring][:, :2], made.parts[ring][-1][:, :2]
    radius = np.linalg.norm(x, axis=1)
    outward = np.einsum("ni,ni->n", u, x) / radius
    return pressure - 1, sectors - 1, outward / assemblies.lame_displacement(radius) - 1


@pytest.mark.parametrize("element, sizes, mean, most", [
    ("P1", (0.12, 0.16), 0.02, 0.04), late("P1", (0.16, 0.12), 0.02, 0.04),
    late("P2", (0.2, 0.15), 0.01, 0.01)])
@pytest.mark.long
def test_a_ring_shrunk_on_a_shaft(element, sizes, mean, most, tmp_path):
    """The pressure is Lamé's, all round; so is where the ring goes.

    Node by node both are off no more than where faces match, all as coarse as the coarser side.
    """
    apart = solved(assemblies.shrunk_ring(tmp_path, sizes, element), 1e-5)
    whole = solved(assemblies.conforming_ring(tmp_path, max(sizes), element), 1e-5)
    (nodal, sectors, moved), (nodal_whole, _, moved_whole) = off_lame(apart), off_lame(whole)
    assert abs(sectors.mean()) < mean and np.abs(sectors).max() < most and rms(moved) < 0.005
    assert rms(nodal) < AS_FAR * rms(nodal_whole)
    assert np.abs(moved).max() < AS_FAR * np.abs(moved_whole).max()
    assert apart.error_bound <= 1e-5


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
