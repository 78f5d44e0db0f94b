"""Bodies that move further than small displacements allow: told while it runs, listed in the summary, with what is missing."""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from contact_case import BOTTOM, TOP, contact

from orchestrator import Subscriber
from orchestrator.method.delivery.reach import softest_modes
from orchestrator.method.monitors import Verdict
from orchestrator.method.monitors.far_bodies import FarBodies, PATIENCE
from orchestrator.method.stopping.law_residuals import Lengths
from orchestrator.run import solve
from orchestrator.scene.build import build_scene

LOWER, UPPER = "block 0-0-0", "block 0-0-1"


class Heard(Subscriber):
    """What is told, and after which iteration."""

    def __init__(self):
        self.sentences, self.far = [], []

    def warned(self, sentence):
        self.sentences.append((1 + len(self.far), sentence))

    def iteration(self, event):
        self.far.append(event.far_bodies)


def pushed(shear: float):
    """A block that lies on another one, μ = 0.2, pressed by 100 and pushed aside in the second load step."""
    made = contact(0.2, boundary=[BOTTOM, {"on": TOP, "traction": [[0, 0, -100.0], [shear, 0, -100.0]]}],
                   method={"tolerance": {"error": 1e-4}, "max_iterations": 60})
    heard = Heard()
    return solve(made, build_scene(made), [heard]), heard


def test_a_block_that_slides_away_is_told_while_it_runs():
    solved, heard = pushed(shear=50.0)
    (iteration, sentence), = heard.sentences
    assert iteration == heard.far.index(1) + 1 < solved.iterations
    assert sentence.startswith(f"{UPPER} has moved by ") and "at load step 2 (since" in sentence
    assert f"slides on {LOWER}" in sentence and f"more friction on {LOWER}" in sentence
    found, = solved.summary["far_bodies"]
    assert found["body"] == UPPER and found["load_step"] == 2 and found["iteration"] <= iteration and found["shift"] > 0.1
    assert found["along"][0] > 0.99
    limit, = solved.summary["limit_load"]  # friction holds 20 of 50
    assert solved.stop_reason == "limit load" and limit["load_step"] == 2 and limit["factor"] == pytest.approx(0.4, rel=1e-6)
    assert found["sliding"] == [LOWER] and not found["sticking"] and not found["apart"]
    moved = np.abs(solved.parts[1][1]).max()
    assert found["shift"] == pytest.approx(moved / np.linalg.norm([1, 1, 0.5]), rel=0.05)
    assert heard.far[-1] == 1 and str(solved.iterated.found["far_bodies"][0]) in solved.summary["warnings"]


def test_a_block_that_friction_holds_is_not_told():
    solved, heard = pushed(shear=10.0)
    assert solved.converged and not heard.sentences and not solved.summary["far_bodies"] and not any(heard.far)


# --- who is told when -------------------------------------------------------------------------------------


def watch(bodies=3, steps=2):
    """Bodies of half-diagonal 2 in a row, touching; all pairs stick at the second step, none touches at the first."""
    from orchestrator.laws.contact import OPEN, STICK, Contact
    law = Contact(0.1, np.zeros(1))
    interfaces = [SimpleNamespace(index=i, subdomains=(i, i + 1), law=law) for i in range(bodies - 1)]
    pairs = SimpleNamespace(each=lambda: [(i, slice(i.index, i.index + 1)) for i in interfaces])
    team = SimpleNamespace(max=lambda *values: values)
    problem = SimpleNamespace(steps=steps, local=SimpleNamespace(pairs=pairs), scene=SimpleNamespace(interfaces=interfaces),
                        space=SimpleNamespace(team=team))
    lengths = SimpleNamespace(count=bodies, names=list("abc"), body=np.arange(bodies))
    status = np.array([[int(OPEN)] * (bodies - 1), [int(STICK)] * (bodies - 1)])
    monitor, local = FarBodies(lengths, [4, 7]), SimpleNamespace(status=status)

    def judge(iteration, rigid, ended=False):
        """Bodies that are warned of."""
        said = Verdict(reason="converged" if ended else "", lengths=Lengths(1.0, 1.0, rigid, np.full(bodies, 2.0)))
        warned = monitor.judge(SimpleNamespace(number=iteration, problem=problem, local=local, verdict=said)).warnings
        return [body for body in monitor.far if str(body) in warned]

    return monitor, judge


def motion(body, step, component, size, bodies=3, steps=2):
    rigid = np.zeros((bodies, steps, 6))
    rigid[body, step, component] = size
    return rigid


def test_only_what_lasts_is_told_and_once():
    far, judge = watch()
    moved = motion(1, 0, 2, -0.5)  # an eighth of the box's diagonal
    told = [judge(i, moved if i != 2 else 0 * moved) for i in range(1, PATIENCE + 6)]
    assert [bool(new) for new in told].index(True) == PATIENCE + 1  # the second iteration began anew
    assert sum(map(len, told)) == 1 and len(far.far) == 1
    body = far.far[0]
    assert (body.body, body.load_step, body.iteration, body.along, body.apart) == ("b", 4, 3, [0, 0, -1], ["a", "c"])
    assert "a law that joins it to a, c" in str(body) and "moved by 12%" in str(body)
    judge(20, 0 * moved)
    assert not far.far


def test_a_run_goes_on_with_what_it_knew():
    far, judge = watch()
    moved = motion(1, 0, 0, 0.5)
    for i in range(1, PATIENCE):
        assert not judge(i, moved)
    again, judge = watch()
    again.restore(far.state(), None)
    assert [b.iteration for b in judge(PATIENCE, moved)] == [1]
    third, judge = watch()
    third.restore(again.state(), None)
    assert third.far == again.far and not judge(PATIENCE + 1, moved)


def test_motions_that_nothing_holds_are_all_found():
    """As with hundreds of loose grains, where Lanczos' method breaks down: 70 that nothing holds, 80 that next to nothing does."""
    stiffness = np.repeat([1.0, 1e-9, 0.0], [150, 80, 70])
    for count in (60, 100):
        values, vectors = softest_modes(sp.csr_array(sp.diags_array(stiffness)), count)
        assert np.abs(values - np.sort(stiffness)[:count]).max() < 1e-15
        assert np.abs(vectors.T @ vectors - np.eye(count)).max() < 1e-12
