"""The protocol's checks: all codes pass them, wrong adapters are caught, each with a message of its own."""

import shutil
import time
from pathlib import Path

import numpy as np
import pytest
from blackbox_case import box, forces, settings
from in_process import IN_PROCESS, InProcess, InProcessWorker
from processes import gone
from quick import late
from yaml_case import call

from orchestrator.blackbox.trial import conformance
from orchestrator.blackbox.start import find_codes, make_blackbox
from orchestrator.blackbox.pool import Pool
from orchestrator.blackbox.transport.worker import Worker
from orchestrator.errors import BlackBoxError, InputError
from orchestrator.registry import CODES

ROOT = Path(__file__).parents[1]
TEMPLATE = ROOT / "orchestrator" / "blackbox" / "codes" / "template.py"


def unguarded(**changes) -> Pool:
    """A code as it is: no layer judges what it answers."""
    return Pool(find_codes([settings(**changes)]))


def verdicts(**changes) -> dict[str, str]:
    """What is wrong, by check; empty texts for what passed."""
    return {name: wrong for name, _, wrong in conformance.run_checks(lambda: unguarded(**changes))}


@pytest.mark.parametrize("changes", [
    {"code": "freefem"}, late({"code": "freefem", "transport": "file"}), late({"code": "calculix", "transport": "file"}),
    late({"code": "scikit-fem"}), late({"code": str(TEMPLATE)}), IN_PROCESS], ids=lambda c: "-".join(map(str, c.values())).rpartition("/")[2])
def test_every_adapter_keeps_the_protocol(changes):
    found = verdicts(**changes)
    assert [name for name, wrong in found.items() if wrong] == []
    assert len(found) == len(conformance.CHECKS) + 1


# what is wrong with it: the body of the method, words of the message
PROTOTYPE = '''
import numpy as np
from orchestrator.blackbox.codes import template

class Solver(template.Solver):
    def solve(self, prepared, forces):
        u = super().solve(prepared, forces)
        {solve}

    def stiffness(self, model):
        k = super().stiffness(model)
        {stiffness}
'''
MORE = {  # methods beside the two
    "the last model prepared": """
    def prepare(self, model):
        self.last = super().prepare(model)
        return self.last
""",
    "the last model of that size": """
    def prepare(self, model):
        self.last = {**getattr(self, "last", {}), model.fixed.size: super().prepare(model)}
        return self.last[model.fixed.size]
"""}
WRONG = {
    "sign": ("return -u", "return k", "the opposite sign"),
    "component after component": ("return u.reshape(len(u), -1, 3).swapaxes(1, 2).reshape(u.shape)", "return k",
                                  "3 * node + component is expected"),
    "node order": ("return u.reshape(len(u), -1, 3)[:, ::-1].reshape(u.shape)", "return k",
                   "nodes are numbered otherwise"),
    "units": ("return u / 1e6", "return k * 1e6", "are forces, lengths and moduli in the units of the model?"),
    "float32": ("return u.astype(np.float32)", "return k", "single precision"),
    "dropped load case": ("u[-1] = 0 if len(u) > 1 else u[-1]; return u", "return k", "was not answered"),
    "load cases reversed": ("return u[::-1]", "return k", "load cases in another order"),
    "a load case too few": ("return u[:-1]", "return k", "a row per load case"),
    "dofs too few": ("return u[:, :-3]", "return k", "a column per dof"),
    "not finite": ("u[0, -1] = np.nan; return u", "return k", "not finite"),
    "clamped dofs move": ("return u + 1e-3 * np.abs(u).max() * (u == 0)", "return k", "clamped dofs move"),
    "not linear": ("return u if len(u) > 1 else 1.001 * u", "return k", "not linear"),
    "not repeatable": ("self.n = getattr(self, 'n', 0) + 1; return u * (1 + 1e-3 * (self.n > 10))", "return k",
                       "otherwise the second time"),
    "a stiffness without symmetry": ("return u", "k.data[::7] *= 1.0001; return k", "not symmetric"),
    "held stiffness": ("return u", "k = k.tolil(); k[0, 0] *= 2; return k.tocsr()",
                       "stiffness of the body: relative difference"),
    "wrong units from the third region on": (
        "return u", "import copy; m = copy.copy(model); m.materials = m.materials * np.array([[1, 1], [1, 1], [1e-3, 1], "
        "[1e-3, 1]])[: len(m.materials)]; return super().stiffness(m)", "region 3 of 4 counts 0.001 times"),
    "the last model prepared": ("return super().solve(self.last, forces)", "return k", "any more, now that 4 models are prepared"),
    "the last model of that size": ("return super().solve(self.last[forces.shape[1]], forces)", "return k",
                                    "any more, now that 4 models are prepared"),
    "512 load cases at most": ("u[512:] = u[:1]; return u", "return k", "of 600 load cases at once"),
    "zeros are answered": ("u[~forces.any(axis=1)] = u[0]; return u", "return k", "a load case of zeros"),
    "one size for all rows": ("return u if len(u) < 13 else np.rint(u / abs(u).max() * 1e9) * abs(u).max() / 1e9",
                              "return k", "forces of twelve orders of magnitude"),
    "forces overwritten": ("forces *= 1.0; return u", "return k", "read-only"),
    "the order of preparing": ("return u", "self.seen = getattr(self, 'seen', []) + [model.name]; "
                               "return k * (1 + 1e-3 * (self.seen[0] == 'twin body'))", "in which models are prepared"),
    "an exception": ("raise RuntimeError('out of licences')", "return k", "out of licences"),
}


@pytest.mark.parametrize("name", WRONG)
@pytest.mark.long
def test_wrong_adapters_are_caught(name, tmp_path):
    solve, stiffness, words = WRONG[name]
    path = tmp_path / "wrong.py"
    path.write_text(PROTOTYPE.format(solve=solve, stiffness=stiffness) + MORE.get(name, ""))
    found = [wrong for wrong in verdicts(code=str(path)).values() if wrong]
    assert any(words in wrong for wrong in found), found


@pytest.mark.parametrize("changed, words", [
    ("k = -k", "against them"), ("k = k + 1e-3 * k.max() * sp.eye_array(k.shape[0])", "rigid motions of the body"), ("pass", "")],
    ids=["negated", "held", "sound"])
@pytest.mark.long
def test_matter_of_ones_own_is_asked_for(tmp_path, changed, words):
    """Of models without a place in a mesh all is soles, which are plain."""
    path = tmp_path / "own.py"
    path.write_text(f"""
import scipy.sparse as sp
from orchestrator.blackbox.codes.adapter import Adapter
from orchestrator.blackbox.codes.template import Solver as Plain

class Solver(Adapter):
    own_matter = True

    def stiffness(self, model):
        k = Plain().stiffness(model)
        if not model.sole.all():
            {changed}
        return k
""")
    found = verdicts(code=str(path))
    assert [name for name, wrong in found.items() if wrong] == (["matter of a volume"] if words else [])
    assert words in found["matter of a volume"]


def test_models_that_are_mixed_up_are_told_as_such():
    """By a code whose server tests nothing: the bodies are equal but for where they are held."""
    class Mixed(InProcessWorker):
        def load(self, index, model):
            super().load(index, model)
            for other in self.models:
                if self.models[other].fixed.size == model.fixed.size:
                    self.prepared[other] = self.prepared[index]

    code = type("MixedCode", (InProcess,), {"worker": lambda self: Mixed})(settings(**IN_PROCESS))
    found = [wrong for _, _, wrong in conformance.run_checks(lambda: Pool({0: code})) if wrong]
    assert any("of the body: those of another model of the same size, the twin body" in wrong for wrong in found), found


@pytest.mark.parametrize("name", ["sign", "dropped load case", "load cases reversed", "a load case too few", "not finite"])
@pytest.mark.long
def test_a_run_stops_at_them_too(name, tmp_path):
    """Loading a subdomain suffices: the message quotes what is wrong and names the subdomain."""
    solve, stiffness, words = WRONG[name]
    path = tmp_path / "wrong.py"
    path.write_text(PROTOTYPE.format(solve=solve, stiffness=stiffness))
    with make_blackbox(settings(code=str(path))) as blackbox:
        with pytest.raises(BlackBoxError) as caught:
            blackbox.load([box(name="punch")])
    assert caught.value.subdomain == "punch" and words in str(caught.value)


def test_the_command(tmp_path):
    """Exit code 0 and a table; 3 for a wrong adapter; 2 for one that is not there."""
    (tmp_path / "wrong.py").write_text(PROTOTYPE.format(solve="return -u", stiffness="return k"))

    def command(*arguments):
        result = call("conformance", *arguments)
        return result.exit_code, " ".join(result.output.split())

    code, shown = command("freefem", "--transport", "pipe")
    assert code == 0 and "It keeps the protocol." in shown
    code, shown = command(str(tmp_path / "wrong.py"), "--transport", "pipe")
    assert code == 3 and "the opposite sign" in shown
    for name, words in (("abaqus", "one of freefem"), ("nowhere.py", "template.py"), ("no.such:Thing", "no Python module")):
        code, shown = command(name)
        assert code == 2 and words in shown, shown


# ---- bad surroundings ---------------------------------------------------------------------------


def wrapped(path: Path, body: str) -> str:
    """An executable in front of CalculiX; ``$REAL`` is CalculiX, the second argument the job."""
    path.write_text(f"#!/bin/bash\nREAL={shutil.which('ccx')}\n{body}\n")
    path.chmod(0o755)
    return str(path)


def calculix(**changes):
    return make_blackbox(settings(**{"code": "calculix", "transport": "file", **changes}))


def test_calculix_is_missing(monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(InputError, match="no ccx in the path") as caught:
        calculix()
    assert "apt-get install calculix-ccx" in str(caught.value) and caught.value.exit_code == 2


def test_scikit_fem_is_missing(monkeypatch):
    monkeypatch.setattr(CODES["scikit-fem"], "package", "scikit-fem-that-is-nowhere")
    with pytest.raises(InputError, match="pip install scikit-fem-that-is-nowhere"):
        make_blackbox(settings(code="scikit-fem"))


@pytest.mark.parametrize("lost, words", [("eig", "no file of Green functions"), ("rout", "no restart file"),
                                         ("sti", "no stored matrix")])
def test_a_calculix_without_a_needed_feature(lost, words, tmp_path, monkeypatch):
    """An older version that ignores what it does not know and writes one file less."""
    script = f'case "$1" in -v) echo "This is Version 2.07";; *) "$REAL" "$@"; rm -f "$2".{lost};; esac'
    monkeypatch.setenv("ORCHESTRATOR_CALCULIX", wrapped(tmp_path / "old-ccx", script))
    with pytest.raises(InputError) as caught:
        calculix()
    assert words in str(caught.value) and "2.07" in str(caught.value) and "calculix-ccx" in str(caught.value)


def test_a_deck_that_calculix_rejects():
    """Its own words are quoted."""
    model = box(name="inside out")
    model.cells[5] = model.cells[5][[1, 0, 2, 3]]
    with calculix() as blackbox, pytest.raises(BlackBoxError, match="it rejected the deck: .*ERROR.*jacobian") as caught:
        blackbox.load([box(), model])
    assert caught.value.subdomain == "inside out" and caught.value.log_tail


@pytest.mark.parametrize("code", ["freefem", "calculix", late("scikit-fem")])
def test_a_model_whose_nodes_are_all_held_is_sound(code):
    """The layer that a foundation stands on, cut so that nothing else is in it."""
    model = box(name="held")
    model.fixed, model.trace = np.ones_like(model.fixed), model.trace[:0]
    with make_blackbox(settings(code=code)) as blackbox:
        blackbox.load([model])
        assert not blackbox.fields({0: np.zeros((2, model.fixed.size))})[0].any()
        assert blackbox.traces({0: np.zeros((2, 0))})[0].shape == (2, 0)


@pytest.mark.parametrize("fault", ["free", "no stiffness"])
def test_a_model_that_calculix_cannot_hold(fault):
    model = box(name="loose", hold=False)
    if fault == "no stiffness":
        model = box(name="loose")
        model.materials[:, 0] = 0.0
    with calculix() as blackbox, pytest.raises(BlackBoxError) as caught:
        blackbox.load([model])
    assert caught.value.subdomain == "loose"


def test_a_calculix_that_hangs(tmp_path, monkeypatch):
    """``blackbox.timeout`` ends it, and its process."""
    monkeypatch.setenv("ORCHESTRATOR_CALCULIX", wrapped(tmp_path / "slow-ccx", 'echo $$ > "$0".pid; exec sleep 30'))
    told, allowed = tmp_path / "slow-ccx.pid", Worker.deadline

    def once_it_hangs(worker):
        while not told.exists() or not told.read_text():
            time.sleep(0.01)
        return allowed(worker)

    monkeypatch.setattr(Worker, "deadline", once_it_hangs)
    with pytest.raises(BlackBoxError, match="no answer within the time allowed .blackbox.timeout."):
        with calculix(timeout=0.3) as blackbox:
            blackbox.load([box()])
    assert gone([int(told.read_text())])


def test_forces_that_are_not_finite():
    model = box(name="poisoned")
    for some in (3, len(model.trace)):  # run by run, and through the compliance
        with calculix() as blackbox:
            blackbox.load([model])
            f = forces(model, some)
            f[0, 0] = np.nan
            with pytest.raises(BlackBoxError, match="not finite") as caught:
                blackbox.traces({0: f})
            assert caught.value.subdomain == "poisoned"
