"""Figures of the meshes that an accuracy was asked of."""

import numpy as np
import pytest
import results_case as case

from orchestrator.results.figures.meshes import FIRST, errors_over_elements, first_and_last, keep_first
from orchestrator.scene.mesh.size_map import edge_lengths


def asked(count):
    """A summary of so many meshes; errors are halved from one to the next, those of the first iterations are not known."""
    meshes = [{"elements": 10**k, "error": 0.4 / 2**k, "iterations_error": None if k == 1 else 0.01,
               "quantities": {"tip": {"error": 0.1 / 4**k, "asked": 0.02}}} for k in range(1, count + 1)]
    return case.summary(accuracy={"asked": 0.1, "meshes": meshes})


def test_errors_over_elements():
    axes, = errors_over_elements(asked(3)).axes
    curves = {line.get_label(): line.get_data() for line in axes.get_lines()}
    assert curves["energy norm"][0].tolist() == [10, 100, 1000] and curves["tip"][1] == pytest.approx(0.1 / 4.0 ** np.arange(1, 4))
    assert np.isnan(curves["iterations' part of it"][1][0]) and [y for _, y in curves.values() if len(set(y)) == 1]
    assert errors_over_elements(asked(1)) is errors_over_elements(case.summary()) is None


def test_first_and_last(tmp_path):
    fields = case.fields()
    errors = np.linspace(0.1, 0.2, len(fields.cells))
    fields = fields.with_error(np.outer(np.linspace(0.5, 1.0, fields.steps), errors))
    assert first_and_last(tmp_path, fields, asked(2)) is None
    keep_first(tmp_path, 2 * fields.nodes, fields.cells, errors)
    sheet = first_and_last(tmp_path, fields, asked(2))
    larger, smaller, before, after = (set(np.round(view.values, 12)) for view in sheet.views)
    own = edge_lengths(fields.nodes, fields.cells[:, :4])
    assert smaller <= set(np.round(own, 12)) and larger <= set(np.round(2 * own, 12)) and before == after <= set(np.round(errors, 12))
    assert first_and_last(tmp_path, fields, asked(1)) is None
    (tmp_path / FIRST).unlink()
    assert first_and_last(tmp_path, fields, asked(2)) is None
