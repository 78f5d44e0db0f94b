"""Fixtures shared by all tests."""

import gc
import os
import sys
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path

# Whatever the environment says, modules are compiled once: tests start some hundred processes.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

import orchestrator  # noqa: E402, F401 - before numpy, as in a run: it asks for one BLAS thread
import pytest  # noqa: E402
import typer.testing  # noqa: E402
from processes import end_all, hear_signals  # noqa: E402

hear_signals()
# The command line is built once in each process, not at every call: that takes longer than most of what they ask.
typer.testing._get_command = cache(typer.testing._get_command)


@pytest.fixture(autouse=True)
def nothing_goes_on():
    """Whatever a test that fails has started ends with it."""
    yield
    end_all()


@pytest.fixture
def configs_dir() -> Path:
    """The folder of the configurations shipped with the project."""
    return Path(__file__).parents[1] / "configs"


def pytest_addoption(parser):
    parser.addoption("--freefem", action="store_true", help="solve with FreeFEM what is solved in process otherwise")


def pytest_configure(config):
    config.addinivalue_line("markers", "long: seconds of the processor, for `make test-all`")
    config.addinivalue_line("markers", "xdist_group(name): one process runs these where several share the tests")
    if config.getoption("freefem"):
        import in_process

        in_process.IN_PROCESS.update(in_process.FREEFEM)


def pytest_sessionstart(session):
    """Of several processes that run all tests each begins with other modules: in an empty clone it takes seconds to compile them, which
    none then does of all."""
    config = session.config
    worker = getattr(config, "workerinput", None)
    if worker is None or config.args != config.getini("testpaths"):
        return
    names = sorted(path.stem for path in Path(__file__).parent.glob("test_*.py"))
    first = int(worker["workerid"].removeprefix("gw")) * len(names) // worker["workercount"]
    for name in [*names[first:], *names[:first]]:
        with suppress(Exception, pytest.skip.Exception):  # collection tells
            import_module(name)


def pytest_collection_finish(session):
    """What is imported by now stays: no collection of garbage looks through it again."""
    gc.collect()
    gc.freeze()
    if session.config.getoption("loadgroup", False):  # else each process makes what one makes for all, and nothing tells
        kept = all("@" in item.nodeid for item in session.items if item.get_closest_marker("xdist_group"))
        assert kept, "tests are not run in their groups: pytest and pytest-xdist do not go together; make setup-tests installs versions that do"


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups
def pytest_collection_modifyitems(items):
    """What is made or kept once for a module is made by one process. Ranks first: what one process does one after the other is done while others
    do the rest."""
    for item in items:
        shared = any(known[-1].scope == "module" for known in item._fixtureinfo.name2fixturedefs.values())
        kept = any(hasattr(made, "cache_info") and made.__module__ == item.module.__name__ for made in vars(item.module).values())
        if (shared or kept) and not item.get_closest_marker("xdist_group"):
            item.add_marker(pytest.mark.xdist_group(item.module.__name__))
    items.sort(key=lambda item: not any(mark.kwargs.get("name", *mark.args) == "ranks" for mark in item.iter_markers("xdist_group")))
