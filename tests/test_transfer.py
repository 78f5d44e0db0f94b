"""Whatever crosses an interface goes through its transfer: with products in the place of index arrays, the same results."""

from dataclasses import replace

import numpy as np
import pytest
from quick import late

from contact_case import contact
from in_process import IN_PROCESS
from method_case import CUBES, SLICES, config, method
from orchestrator.method.interface.transfer import Transfer
from orchestrator.run import solve
from orchestrator.scene.build import build_scene


@pytest.mark.parametrize("case", [
    config(**CUBES),
    late(config(**CUBES, **method(macro={"strategy": "none"}, search_direction={"kplus": "full"}, tolerance={"error": 1e-3}))),
    config(subdomains=SLICES, **method(macro={"strategy": "continuity"}, sole={"kind": "layer"})),
    late(contact(0.2, mesh={"box": {"size": [1, 1, 1], "cells": [4, 4, 4]}}, blackbox={**IN_PROCESS, "element": "P2"})),
    contact(law=[{"law": "perfect"}, {"law": "contact", "friction": 0.3, "between": ["block 0-0-0", "*"]}],
            subdomains={"grid": [2, 1, 2]}),
], ids=["equilibrium", "mono-scale", "continuity", "contact of ten-node tets", "two laws"])
def test_products_give_what_index_arrays_give(case, monkeypatch):
    picked = solve(case, build_scene(case))
    by_index = Transfer.of
    monkeypatch.setattr(Transfer, "of", lambda *sides: replace(found := by_index(*sides), operators=found.products))
    multiplied = solve(case, build_scene(case))
    assert multiplied.summary["iterations"] == picked.summary["iterations"]
    size = np.abs(picked.displacement).max()
    assert np.abs(multiplied.displacement - picked.displacement).max() <= 1e-11 * size
    assert multiplied.summary["error_bound"] == pytest.approx(picked.summary["error_bound"], rel=1e-4, nan_ok=True)
    assert multiplied.summary.get("status_counts") == picked.summary.get("status_counts")
