"""Parameters of a test, of which `make test` runs some and `make test-all` the others too."""

from collections.abc import Iterable

import pytest


def quick(values: Iterable, *kept) -> list:
    """All values, those that are not among ``kept`` marked as long."""
    return [value if value in kept else late(value) for value in values]


def quick_sets(values: Iterable, *kept) -> list:
    """The same for sets of values, one for each of several names."""
    return [value if value in kept else late(*value) for value in values]


def late(*values, **how):
    """One set of values, marked as long."""
    return pytest.param(*values, marks=pytest.mark.long, **how)
