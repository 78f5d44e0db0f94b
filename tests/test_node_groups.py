"""Pairs that meet at nodes of bodies: their laws hold together, and a body feels the sum of their forces alone."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from contact_case import CASES, contact
from in_process import IN_PROCESS
from method_case import box_of, prepared

from benchmarks.problems.cases import pressed_cubes
from benchmarks.problems.hard_scenes import halves
from benchmarks.studies.contact_race import scene_of
from orchestrator import config_from, solve
from orchestrator.laws.base import Law
from orchestrator.laws.points import Answer
from orchestrator.method.delivery.deliver import unsolved
from orchestrator.method.interface.node_groups import NodeGroups
from orchestrator.method.interface.node_stage import NodeStage
from orchestrator.scene.build import build_scene


@pytest.fixture(scope="module", params=[0.2, 1.0])
def eight(request):
    """Eight cubes; the upper four and the lower four have nodes that are prescribed on the middle planes."""
    made = contact(request.param, **CASES["eight cubes"], method={"sole": {"fit": False}, "tolerance": {"error": 1e-6}})
    with box_of(made) as blackbox:
        yield prepared(made, build_scene(made), blackbox)


BETWEEN = {"between": ["*-0", "*-1"], "law": "contact", "friction": 0.3}  # above and below, each bonded


def rough(d, seed=5):
    return d.stage(1e2 * np.random.default_rng(seed).normal(size=(d.steps, d.space.size)))


def test_groups_are_the_edges_and_the_corner_of_all(eight):
    """Four cubes meet at an edge, in four pairs; eight at the corner of all, in twelve."""
    groups = NodeGroups.of(eight.space, eight.local.pairs)
    sizes = np.bincount(groups.members)
    assert sizes[12] == 1 and sizes[4] == 6 * 2 - 2  # six edges of two nodes beside; bonded where both sides are held
    assert sizes.sum() == sizes[12] + sizes[4]


def test_where_two_bodies_meet_there_are_none():
    made = contact(0.2, **CASES["eight cubes"], method={"sole": {"fit": False}})
    data = {**made.model_dump(exclude_unset=True, by_alias=True), "subdomains": {"slices": {"axis": "z", "count": 2}}}
    scene = build_scene(config_from(data))
    with box_of(config_from(data)) as blackbox:
        d = prepared(config_from(data), scene, blackbox)
        assert d.local.groups is None and d.local(rough(d)).fields is None


def test_all_laws_of_a_group_hold_together(eight):
    """Forces come to rest where q = law(q + keq d), with the jumps that all forces of the group leave."""
    d, fields = eight, rough(eight)
    w, f = fields.extended
    pairs, groups = d.local.pairs, d.local.groups
    stage, before = NodeStage(groups, pairs, w, f, d.local.before, None), d.local.before.take(groups.chosen)
    stage.rms, b, lacks = np.sqrt(stage.left[0] / stage.left[1]), stage.b[0], stage._lacks(stage.q)[0]
    for _ in range(30):
        F, _ = stage.predicted(0)
    law = groups.laws.force(F, before, 0).force
    laws = groups.laws
    together = laws.masked(laws.points.stiffness(b)) + (groups.felt @ law.ravel()).reshape(law.shape)
    r = laws.force(together, before, 0).force - law
    left = np.sqrt(np.bincount(groups.group, (r**2).sum(axis=0)))
    assert (left <= 0.1 * np.sqrt(np.mean(lacks**2) * groups.members)).all() and not stage.unsolved.any()


def test_a_body_feels_the_same(eight):
    """Sharing forces among a node's traces leaves what bodies are loaded with, and what they answer."""
    d, fields = eight, rough(eight)
    shared = d.local(fields).fields
    load = d.space.loads(fields.s)
    assert np.abs(shared.s - fields.s).max() > 1e-2 * np.abs(fields.s).max()
    np.testing.assert_allclose(d.space.loads(shared.s), load, atol=1e-10 * np.abs(load).max())
    answered = d.stage(shared.s)
    np.testing.assert_allclose(answered.f, shared.f, atol=1e-9 * np.abs(shared.f).max())


@pytest.fixture(scope="module")
def cut():
    """Two blocks in contact, each cut in four."""
    made = contact(law=[BETWEEN], **CASES["eight cubes"], method={"sole": {"fit": False}, "tolerance": {"error": 1e-6}})
    with box_of(made) as blackbox:
        yield prepared(made, build_scene(made), blackbox)


def test_bonds_at_nodes_in_contact_answer_with_it(cut):
    """Pieces of a body do not part there, and balance what laws bring; they feel the same as before."""
    d, fields = cut, rough(cut)
    pairs, joint = d.local.pairs, d.local.joint
    shared = fields
    for _ in range(20):
        local = d.local(shared)
        shared = local.fields
    bonds = slice(len(pairs), len(joint))
    assert len(joint) == len(pairs) + 2 * (8 + 4)  # bonds of either block along the cuts, four where they cross
    jump = joint.transfer.jump(local.hats[0])[:, :, bonds]
    before = joint.transfer.jump(fields.w)[:, :, bonds]
    assert np.abs(jump).max() < 0.02 * np.abs(before).max()
    load = d.space.loads(fields.s)
    np.testing.assert_allclose(d.space.loads(shared.s), load, atol=1e-10 * np.abs(load).max())


@pytest.mark.parametrize("cuts, most", [(1, 30), (2, 45)])
def test_stiff_and_soft_cells_in_contact_take_few_iterations(tmp_path, cuts, most):
    """Springs follow the softer body node by node, soles take in the cells of diagonal neighbours, and bonds at nodes in
    contact answer with it: with less of that a hundred and more."""
    made = halves(tmp_path, 1e3, cuts)
    solution = solve(config_from({**made, "blackbox": IN_PROCESS, "method": {"tolerance": {"error": 1e-4}}}))
    assert solution.converged and solution.iterations <= most


def test_a_node_that_a_support_holds_gives_no_way():
    """Where a support holds one body and not the one beside it, the local stage moves the other alone."""
    cube = {"box": {"size": [1, 1, 1], "cells": [2, 2, 2]}}
    made = config_from({
        "name": "held", "blackbox": IN_PROCESS, "subdomains": "groups",
        "parts": [{"name": "low", "mesh": cube}, {"name": "top", "mesh": cube, "move": {"translate": [0, 0, 1]}}],
        "materials": [{"young": 200e3, "poisson": 0.3}],
        "interfaces": [{"between": "auto", "law": "contact", "friction": 0.3}],
        "boundary": [{"on": "low/zmin", "displacement": [0, 0, 0]}, {"on": "low/xmax", "displacement": [0, None, None]},
                     {"on": "top/zmax", "displacement": [6e-4, 0, -1e-3]}]})
    scene = build_scene(made)
    with box_of(made) as blackbox:
        d = prepared(made, scene, blackbox)
        fields, held = rough(d), d.space.held_everywhere
        w = d.local(fields).hats[0]
        both = d.local.pairs.nodes.there & held
        assert both.any() and (d.local.pairs.nodes.there & ~held).any()
        np.testing.assert_array_equal(w[:, both], fields.w[:, both])
        moved = d.local.pairs.nodes.there & ~held
        assert np.abs(w - fields.w)[:, moved].min(axis=1).max() > 0


class Erratic(Law):
    """What a pair answers says nothing about what it answers beside that."""

    @staticmethod
    def force(points, F, previous, derivative=False):
        slope = np.zeros((3, 3, len(points))) if derivative else None
        return Answer(1e3 * np.sign(np.sin(1e3 * F)), np.zeros(len(points), int), np.arange(len(points)), slope)


def test_groups_that_no_forces_answer_are_told(eight):
    """They are given up, and a sentence names the interfaces."""
    d, fields = eight, rough(eight)
    groups = d.local.groups
    laws = replace(groups.laws, runs=[replace(run, law=Erratic) for run in groups.laws.runs])
    stage = NodeStage(replace(groups, laws=laws), d.local.pairs, *fields.extended, d.local.before, None)
    stage.rms = np.sqrt(stage.left[0] / stage.left[1])
    stage.predicted(0)
    assert stage.unsolved[0].sum() == len(groups.members)
    said, = unsolved(d, SimpleNamespace(local=SimpleNamespace(unsolved=stage.unsolved)))
    assert said.startswith(f"{len(groups.members)} groups of node pairs") and d.scene.interfaces[0].name in said


@pytest.mark.parametrize("scene, seed", [("27 free", 1), ("27 rollers", 1)])
def test_forces_do_not_jump_to_and_fro_where_friction_folds_them_away(scene, seed):
    """At nodes of three grains and more laws allow several answers, far apart: the residual falls all the same."""
    data = {**scene_of(scene, 0.3, seed), "blackbox": IN_PROCESS,
            "method": {"tolerance": {"error": 1e-4}, "max_iterations": 50}}
    solution = solve(config_from(data))
    assert solution.converged and solution.history["unsolved"][-1] == 0
    late = np.array(solution.history["residual"][8:])
    assert (late[1:] < 1.7 * late[:-1]).all()


@pytest.mark.long
def test_cubes_whose_edges_nearly_stick():
    made = config_from({**pressed_cubes(0.1, elements=2), "blackbox": IN_PROCESS,
                        "method": {"tolerance": {"error": 1e-6}, "max_iterations": 60, "contact": {"stabilisation": 2.5e-9}}})
    assert solve(made).converged
