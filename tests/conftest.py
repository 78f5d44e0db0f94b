"""Fixtures shared by all tests."""

from pathlib import Path

import orchestrator  # noqa: F401 - before numpy, as in a run: it asks for one BLAS thread
import pytest
from processes import end_all, hear_interrupts

hear_interrupts()


@pytest.fixture(autouse=True)
def nothing_goes_on():
    """Whatever a test that fails has started ends with it."""
    yield
    end_all()


@pytest.fixture
def configs_dir() -> Path:
    """The folder of the configurations shipped with the project."""
    return Path(__file__).parents[1] / "configs"
