"""What is public: listed, light to import, and shown by examples that run."""

import doctest
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from method_case import config

import orchestrator
from orchestrator import Finished, InputError, Iteration, Subscriber, solve
from orchestrator.registry import CODES, LAWS

FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
# Values rather than things to call or to derive from: they are seen in the examples of others.
PLAIN = {"__version__", "Config", "Scene", "Iteration", "Finished", "OrchestratorError", "InputError", "Problem", "BlackBoxError",
         "LAWS", "CODES"}
MODULES = sorted({"orchestrator", *orchestrator._PUBLIC.values()})


@pytest.mark.parametrize("name", MODULES)
def test_examples(name, tmp_path, monkeypatch):
    """As written, with the real codes; files that they write are in a folder of their own."""
    monkeypatch.chdir(tmp_path)
    for registry in (LAWS, CODES):  # what examples add to them is theirs alone
        monkeypatch.setattr(registry, "_places", dict(registry._places))
    assert doctest.testmod(import_module(name), optionflags=FLAGS).failed == 0


def test_what_is_to_be_called_or_derived_from_has_an_example():
    finder = doctest.DocTestFinder(recurse=False)
    for name in set(orchestrator.__all__) - PLAIN:
        thing = getattr(orchestrator, name)
        assert any(test.examples for test in finder.find(thing, name)), name


def test_the_page_tells_every_name_without_the_site():
    page, _, reference = (Path(__file__).parents[1] / "docs/api.md").read_text(encoding="utf-8").partition("## Reference")
    for name in orchestrator.__all__:
        assert re.search(rf"`[^`]*\b{name}\b[^`]*`", page), name
    assert "eval-rst" not in page and "eval-rst" in reference


def test_all_names_are_there():
    for name in orchestrator.__all__:
        assert getattr(orchestrator, name) is not None and name in dir(orchestrator)
    with pytest.raises(AttributeError, match="no attribute 'slove'"):
        orchestrator.slove


def test_the_package_alone_imports_nothing():
    """Every server of a code imports it: no numpy, none of the rooms."""
    program = "import sys, orchestrator; print(*sorted(sys.modules))"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    assert [name for name in loaded if name.startswith(("numpy", "orchestrator."))] == []


class Ear(Subscriber):
    """Keeps what it hears."""

    def __init__(self) -> None:
        self.heard = []

    def stage(self, name):
        self.heard.append(name)

    def iteration(self, event):
        assert isinstance(event, Iteration) and np.isfinite(event.state).all()
        self.heard.append(event.iteration)

    def finished(self, event):
        self.heard.append(event)

    def failed(self, error):
        self.heard.append(error)


class Deaf(Subscriber):
    """Needs nothing: all methods are optional."""


class Impatient(Subscriber):
    """Interrupts at the third iteration."""

    def iteration(self, event):
        if event.iteration == 3:
            raise KeyboardInterrupt


def test_subscribers_hear_the_run_in_its_order():
    ear = Ear()
    solution = solve(config(), subscribers=[Deaf(), ear], reference=True)
    assert ear.heard == ["meshing", "solving undecomposed", "assembling and factorising",
                         *range(1, solution.iterations + 1), Finished(True, "converged", solution.iterations)]


def test_subscribers_hear_of_its_failure():
    ear, contact = Ear(), config(interfaces=[{"law": "contact"}])
    with pytest.raises(InputError) as refused:
        solve(contact, subscribers=[ear], reference=True)
    assert ear.heard == ["meshing", refused.value]
    ear = Ear()
    with pytest.raises(KeyboardInterrupt) as blow:
        solve(config(), subscribers=[ear, Impatient()])
    assert ear.heard[2:] == [1, 2, 3, blow.value]
