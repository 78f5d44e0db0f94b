"""Fixtures shared by all tests."""

from pathlib import Path

import pytest


@pytest.fixture
def configs_dir() -> Path:
    """The folder of the configurations shipped with the project."""
    return Path(__file__).parents[1] / "configs"
