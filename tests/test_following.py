"""Sides that are paired anew as they slide: constant states pass over many elements, and what remembers keeps remembering."""

import numpy as np
import pytest
from boxes import boxed
from in_process import IN_PROCESS
from method_case import decomposed
from mortar_case import POISSON, YOUNG
from quick import late, quick

from orchestrator.config.load import config_from, Loaded
from orchestrator.errors import InputError
from orchestrator.method.delivery.met import work as work_of
from orchestrator.method.monitors.following import FollowingMonitor, paired_as
from orchestrator.method.monitors.weakening import anchored, weakened
from orchestrator.results.solution import Solution
from orchestrator.run import run, solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.mesh.geometry import area_vectors

FRICTION, PRESSURE = 0.3, 1000.0
WHERE = (2.0, 5.0, 4.0)  # of the block, per load step: on, and back


def sliding(path, block=(3, 1, 1), slab=(8, 2, 1), error=1e-10, **law):
    """A block of length 2 on a slab of length 8 with elements of length 1; the block's top is moved along a path (T, 3)."""
    return config_from({
        "name": "sliding", "parts": [boxed("slab", [8, 1, 1], slab), boxed("block", [2, 1, 1], block, [0, 0, 1])],
        "subdomains": "groups", "materials": [{"young": YOUNG, "poisson": POISSON}],
        "interfaces": [{"between": ["slab", "block"], "law": "contact", "friction": FRICTION, "pairing": "follow", **law}],
        "boundary": [{"on": "slab/zmin", "displacement": [0, 0, 0]}, {"on": "block/zmax", "displacement": path}],
        "blackbox": IN_PROCESS, "method": {"tolerance": {"law": error}, "max_iterations": 300}})


def in_constant_stress(scene):
    """Loads and prescribed displacements of the block at its places, all of it under constant pressure and friction.

    Returns the displacements, per subdomain (T, n, 3): u = H x, plane where they touch, and the block's own (1 + H) a.
    """
    exact = []
    forth = np.sign(np.diff(WHERE, prepend=0.0))
    for s in scene.subdomains:
        x, cells = scene.mesh.nodes[s.nodes], s.connectivity
        slopes = np.linalg.inv(x[cells[:, 1:]] - x[cells[:, :1]])
        slopes = np.concatenate([-slopes.sum(axis=2)[:, :, None], slopes], axis=2)
        volume = np.abs(np.linalg.det(x[cells[:, 1:]] - x[cells[:, :1]])) / 6
        side = next(k for k, e in enumerate(scene.interfaces[0].subdomains) if e == s.index)
        facets = scene.interfaces[0].nodes[side][scene.interfaces[0].triangles_on(side)]
        area, middle = np.linalg.norm(area_vectors(x, facets), axis=1), x[facets].mean(axis=1)[:, 0]
        up, u = (1.0 if s.name == "slab" else -1.0), []
        for t, (a, sign) in enumerate(zip(WHERE, forth)):
            shear = sign * FRICTION * PRESSURE
            stress = np.array([[300.0, 0, shear], [0, -200.0, 0], [shear, 0, -PRESSURE]])
            strain = ((1 + POISSON) * stress - POISSON * np.trace(stress) * np.eye(3)) / YOUNG
            H = np.diag(np.diag(strain))
            H[0, 2] = 2 * strain[0, 2]
            u.append(x @ H.T + (a * (np.eye(3) + H)[:, 0] if s.name == "block" else 0.0))
            s.loads[t] = 0.0  # tractions all round, but for where the two touch
            for k, corner in enumerate(cells.T):
                np.add.at(s.loads[t], corner, volume[:, None] * (slopes[:, :, k] @ stress))
            touching = (middle > a) & (middle < a + 2) if s.name == "slab" else middle > -1
            np.add.at(s.loads[t], facets[touching], np.broadcast_to(
                -up * area[touching, None, None] / 3 * stress[:, 2], (touching.sum(), 3, 3)))
        exact.append(np.array(u))
        s.prescribed[:] = np.where(s.fixed, exact[-1], 0.0)
    return exact


@pytest.mark.parametrize("slave", quick(["block", "slab"], "slab"))
def test_constant_pressure_slides_over_five_elements(slave):
    """Pressure and friction stay what they are, on whatever elements the block is, and friction turns with the slip."""
    made = sliding([[0, 0, 0]] * len(WHERE), slave=slave)
    scene = build_scene(made)
    exact = in_constant_stress(scene)
    solved = solve(made, scene)
    assert solved.converged, solved.stop_reason
    assert scene.subdomains[scene.interfaces[0].subdomains[0]].name == slave
    for part, theirs in zip(solved.parts, exact):
        assert np.abs(part - theirs).max() < 1e-10
    fields, sign = solved.interfaces, 1.0 if slave == "block" else -1.0
    on = fields.status == 2
    assert (on.sum(axis=1) == (8 if slave == "block" else 9)).all() and (fields.status[~on] == 0).all()
    assert np.abs(fields.pressure[on] - PRESSURE).max() < 1e-8 * PRESSURE
    assert np.abs(np.linalg.norm(fields.friction_traction[on], axis=1) - FRICTION * PRESSURE).max() < 1e-8 * PRESSURE
    assert np.abs(fields.gap[on]).max() < 1e-10
    for t, forth in enumerate((1, 1, -1)):
        assert np.abs(fields.resultant[t, 0] - sign * 2 * PRESSURE * np.array([-forth * FRICTION, 0, 1])).max() < 1e-8 * PRESSURE
    if slave == "block":  # the way there and back, in all
        stretched = 1 + (300.0 + POISSON * (200.0 + PRESSURE)) / YOUNG
        assert np.abs(fields.slip[-1] + [WHERE[0] + (WHERE[-1] - WHERE[0]) * stretched, 0,
                                         0]).max() < 1e-9  # at first the slab is not stretched


def test_slip_beyond_an_element_is_told_where_pairs_do_not_follow():
    path = [[1.5, 0, -0.004]]
    fixed, follow = (solve(sliding(path, error=1e-4, pairing=p)) for p in ("fixed", "follow"))
    told = [[w for w in each.summary["warnings"] if "slid by more than an element" in w] for each in (fixed, follow)]
    assert len(told[0]) == 1 and "slab | block" in told[0][0].replace("block | slab", "slab | block") and not told[1]
    assert follow.interfaces.resultant[0, 0, 2] == pytest.approx(fixed.interfaces.resultant[0, 0, 2], rel=0.3)


ON, OVER, ASIDE, ABOVE = [0, 0, -0.002], [-3, 0, -0.002], [0, 1.5, -0.002], [0, 0, 2.0]


@pytest.mark.parametrize("away, law", [late(OVER, {}), late(ASIDE, {}), late(ABOVE, {}), late(OVER, {"slave": "slab"}), (OVER, {"friction": 0.3})],
                         ids=["over the end", "aside", "above", "slab as slave", "friction"])
def test_a_block_that_leaves_the_slab_altogether_comes_back(away, law):
    """Nothing meets any more: no force; back where it was without friction, it is pressed as before."""
    solved = solve(sliding([ON, away, ON], block=(2, 1, 1), error=1e-6, **{"friction": 0.0, **law}))
    assert solved.converged and solved.summary["residuals"]["law_residual"] <= 1e-6
    fields, force = solved.interfaces, solved.interfaces.resultant[:, 0]
    assert (force[1] == 0).all() and (fields.status[1] == 0).all() and (fields.pressure[1] == 0).all()
    assert [sum(counts[t] for counts in fields.counts.values()) for t in range(3)] == ([9, 0, 9] if "slave" in law else [6, 0, 6])
    lost = work_of(fields, np.array([True]))[1][:, 0]
    if "friction" in law:  # dragged on from where it had been
        assert np.hypot(*force[2, :2]) == pytest.approx(law["friction"] * np.abs(force[2, 2]), rel=1e-3)
        slid = np.linalg.norm(fields.slip[2] - fields.slip[1], axis=1)
        rubbed = np.linalg.norm(fields.friction_traction[2], axis=1) * fields.areas[2]
        assert lost[2] - lost[1] == pytest.approx(slid @ rubbed, rel=1e-3) and lost[1] == lost[0] > 0
    else:
        assert np.abs(force[2] - force[0]).max() < 1e-5 * np.abs(force[0]).max()
        assert np.abs(solved.parts[0][2] - solved.parts[0][0]).max() < 1e-5 * np.abs(solved.parts[0][0]).max()


def test_nonlinear_parts_do_not_slide_on():
    made = sliding([[0, 0, 0]])
    scene = build_scene(made)
    scene.subdomains[0].remembers = True
    with pytest.raises(InputError, match="nonlinear"):
        solve(made, scene)


@pytest.mark.parametrize("changes, told", [
    ({"parts": None, "mesh": {"box": {"size": [1, 1, 2], "cells": [1, 1, 2]}}, "subdomains": {"grid": [1, 1, 2]},
      "interfaces": [{"law": "contact", "pairing": "follow"}],
      "boundary": [{"on": "zmin", "displacement": [0, 0, 0]}]}, "share faces of one mesh"),
    ({"subdomains": {"groups": True, "split_above": 60}}, "cut further"),
    ({"interfaces": [{"law": "elastic", "stiffness_n": 1.0, "stiffness_t": 1.0, "pairing": "follow"}]}, "pairing"),
    ({"method": {"macro": {"on": "all"}}}, "macro"),
], ids=["shared", "cut", "law", "macro"])
def test_where_pairs_cannot_follow(changes, told):
    made = sliding([[0, 0, 0]]).model_dump(exclude_unset=True)
    with pytest.raises(InputError, match=told):
        build_scene(config_from({k: v for k, v in {**made, **changes}.items() if v is not None}))


def test_distances_are_those_of_the_jump_where_points_stand_for_their_neighbours():
    """Nodes that are held altogether have no point, and what they stand for goes to those beside: the distance of the sides has to go with it."""
    made = sliding([[0, 0, 0]], slab=(8, 4, 1), slave="block", block=(3, 3, 1)).model_dump(exclude_unset=True)
    held = [{"on": f"block/{end}", "displacement": [0, 0, 0]} for end in ("ymin", "ymax")]
    interface, = build_scene(config_from({**made, "boundary": [*made["boundary"], *held]})).interfaces
    moving = interface.moving
    bent = np.zeros_like(moving.surfaces.points[1])
    bent[:, 2] = -0.01 * moving.surfaces.points[1][:, 1] ** 2
    mortar = moving.at((np.zeros_like(moving.surfaces.points[0]), bent))
    there = mortar.carrying
    assert 0 < there.sum() < len(np.unique(moving.surfaces.triangles[0]))
    jump = np.einsum("pi,pi->p", mortar.normal, (mortar.second @ bent.ravel()).reshape(-1, 3))
    assert np.abs(mortar.gap - jump)[there].max() < 1e-12


def dragged(*path, **more):
    """The block's top moved on a slab, nothing said of pairs."""
    data = sliding([*path], error=ROUGH).model_dump(exclude_unset=True)
    data["interfaces"][0].pop("pairing")
    return {**data, **more}


DRAGGED, ROUGH = ([0, 0, -0.002], [1.7, 0, -0.002], [0.6, 0, -0.002]), 1e-4


@pytest.mark.long
def test_sides_that_have_slid_are_paired_anew():
    """As if they had been asked to follow; below a fifth of an element, and where it is asked for, pairs stay."""
    solved, follow = solve(config_from(dragged(*DRAGGED))), solve(sliding([*DRAGGED], error=ROUGH))
    assert solved.converged and all((u == v).all() for u, v in zip(solved.parts, follow.parts))
    told, *_ = solved.summary["warnings"]
    fixed = solved.iterations - follow.iterations
    assert told.endswith(f"paired anew where they are, in {follow.iterations} more iterations; of sides that follow no energy error is known")
    near, stays = solve(config_from(dragged(DRAGGED[0], [0.1, 0, -0.002]))), solve(sliding([*DRAGGED], error=ROUGH, pairing="fixed"))
    assert stays.iterations == fixed and not any("anew" in w for each in (near, stays) for w in each.summary["warnings"])


@pytest.mark.parametrize("more, why", [
    ({"parts": None, "mesh": {"box": {"size": [2, 1, 2], "cells": [2, 1, 2]}}, "subdomains": {"grid": [1, 1, 2]}, "interfaces": [
        {"law": "contact"}], "boundary": [{"on": "zmin", "displacement": [0, 0, 0]}, {"on": "zmax", "displacement": [
            [0.5, 0, -0.002]]}]}, "they share faces of one mesh"),
    late({"subdomains": {"groups": True, "split_above": 60}}, "bodies are cut further"),
    ({"method": {"tolerance": {"law": 1e-7}, "macro": {"on": "all"}}}, "the macro problem is on all interfaces"),
], ids=["shared", "cut", "macro"])
def test_sides_that_cannot_follow_stay_and_it_is_said_why(more, why):
    data = {key: value for key, value in dragged([1.2, 0, -0.002], **more).items() if value is not None}
    solved = solve(config_from(data))
    assert solved.converged and any(f"not paired anew where sides have slid to: {why}" in w for w in solved.summary["warnings"])


@pytest.mark.long
def test_a_run_killed_while_sides_are_paired_anew_goes_on(tmp_path, monkeypatch):
    """From the end of the first one: no iteration of that is lost."""
    loaded = Loaded(config_from({**dragged(*DRAGGED), "output": {"figures": False}}), None)
    assert run(loaded, output=tmp_path / "whole", quiet=True) == 0

    def killed(*_):
        raise KeyboardInterrupt
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(FollowingMonitor, "judge", killed)
        run(loaded, output=tmp_path / "killed", quiet=True)
    assert run(loaded, output=tmp_path / "killed", quiet=True, resume=True) == 0
    whole, resumed = (Solution.read(tmp_path / name) for name in ("whole", "killed"))
    assert resumed.iterations == whole.iterations == len(resumed.history["iteration"]) and (resumed.displacement == whole.displacement).all()


def test_springs_that_stay_in_one_load_step_begin_anew_in_the_next():
    """Else nothing would weaken them there; the block is held by a tool and friction alone."""
    d = decomposed(config_from({
        "name": "pushed", "parts": [boxed("slab", [3, 1, 1], (3, 1, 1)), boxed("block", [1, 1, 1], (1, 1, 1), [1, 0, 1])],
        "subdomains": "groups", "materials": [{"young": YOUNG, "poisson": POISSON}], "blackbox": IN_PROCESS,
        "boundary": [{"on": "slab/zmin", "displacement": [0, 0, 0]}, {"on": "block/zmax", "pressure": 1.0}],
        "interfaces": [{"between": ["slab", "block"], "law": "contact", "friction": FRICTION, "pairing": "follow"},
                       {"between": ["block", {"plane": {"at": [1, 0.5, 1.5], "normal": "x"}, "displacement": [[0.1, 0, 0], [0.2, 0, 0]]}],
                        "law": "contact"}]}))
    assert d.coarse.anew
    stay = anchored(weakened(d, 0.1))
    after = paired_as(d, stay)
    assert not stay.coarse.anew and after.coarse.anew
    assert stay.local.pairs.springs == 0.1 and after.local.pairs.springs == 1
