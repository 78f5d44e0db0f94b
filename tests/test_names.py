"""Names mean themselves, whatever characters they have; only what names nothing is a wildcard."""

import pytest

from orchestrator import config_from
from orchestrator.scene.interfaces.governing import Laws
from orchestrator.scene.mesh.gmsh_session import leave_out
from orchestrator.scene.mesh.cad import Sizing, sizes_of
from orchestrator.scene.names import matching

# pairs of which the first, read as a wildcard, means the second too, or the second instead
PAIRS = [("v[1]", "v1"), ("M8*20", "M8x20"), ("a?", "ab"), ("rod", "rod/head"), ("v[!1]", "v2"), ("[", "("), ("Rod", "rod")]


@pytest.mark.parametrize("one, other", PAIRS)
def test_a_name_means_itself_alone(one, other):
    """Wherever names are written: the pairs are taken as two plain names are."""
    both = [other, one]
    assert matching(one, both) == [one] and matching(other, both) == [other] and matching("*", both) == both
    assert leave_out("bolt.stp", both, [one], both) == [0]
    assert sizes_of(both, {"*": 1.0, one: 2.0}) == {other: Sizing(1.0), one: Sizing(2.0)}
    laws = Laws([config_from(bar(interfaces=[{"law": "contact", "between": [one, "c"]}])).interfaces[0]], [*both, "c"])
    assert laws.between([one], ["c"]) == 0 and laws.between([other], ["c"]) == -1


@pytest.mark.parametrize("pattern, names, meant", [
    ("base", ["base/rod", "base/nut", "baseplate"], ["base/rod", "base/nut"]), ("b*", ["base/rod", "lid"], ["base/rod"]),
    ("v[1]", ["v[1]/a", "v1/a"], ["v[1]/a"]), ("v[12]", ["v1", "v2", "v3"], ["v1", "v2"]), ("*/rod", ["a/rod", "a/nut"], ["a/rod"]),
    ("*", ["*", "a"], ["*", "a"]), ("[*]", ["*", "a"], ["*"]), ("rod ", ["rod"], [])])
def test_what_names_nothing_is_a_part_or_a_wildcard(pattern, names, meant):
    assert matching(pattern, names) == meant


def bar(**changes) -> dict:
    return {"name": "bar", "mesh": {"box": {"size": [2, 1, 1], "cells": [2, 1, 1]}}, "subdomains": {"groups": True},
            "materials": [{"young": 1000.0, "poisson": 0.3}], "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}], **changes}
