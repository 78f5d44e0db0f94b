"""Charts of a run: the curves of its convergence, the bars of its time; what they say and how long they are."""

import numpy as np
import pytest
import results_case as case

from orchestrator.results.figures.figures import convergence, time_per_stage, tolerance
from orchestrator.results.summary.summary import STAGES, View

BONDED = {"error_bound": "error bound", "residual": "residual ‖Δs‖", "indicator": "indicator η, a squared ratio",
          "displacement_jump": "displacement jump ‖B w‖", "force_imbalance": "force imbalance ‖A f‖"}


def curves(figure):
    """Label → (x, y) of the curves that the legend names."""
    axes, = figure.axes
    lines = {line.get_label(): line for line in axes.lines}
    return {text.get_text(): lines[text.get_text()].get_data() for text in axes.get_legend().get_texts()}


def test_curves_are_the_history():
    history = case.history()
    found = curves(convergence(View(case.summary(true_error=None)), history))
    assert set(found) == set(BONDED.values())
    for column, label in BONDED.items():
        known = np.isfinite(history[column]) & (history[column] > 1e-17)
        np.testing.assert_array_equal(found[label], [history["iteration"][known], history[column][known]])
    assert len(found[BONDED["error_bound"]][0]) == 5, "it begins with the third iteration"


def test_with_laws_the_largest_of_their_measures_is_drawn():
    """And the jump is not: interfaces that open are meant to jump. Each curve has a colour and a marker of its own."""
    history = case.history()
    history |= {"law_residual": history["residual"] * 2, "error_bound": np.full(7, np.nan), "penetration": history["residual"]}
    figure = convergence(View(case.summary(true_error=None, status_counts={"open": [1, 2]})), history)
    assert set(curves(figure)) == {"law residual, the largest", "residual ‖Δs‖", "indicator η, a squared ratio",
                                   "force imbalance ‖A f‖"}
    drawn = [line for line in figure.axes[0].lines if not line.get_label().startswith("_")]
    for looks in ([line.get_color() for line in drawn], [line.get_marker() for line in drawn]):
        assert len(set(looks)) == len(drawn)
    assert tolerance(View(case.summary(status_counts={"open": [1]}))) == ("law residual", 1e-6)


def test_bars_are_the_seconds():
    summary = case.summary()
    figure = time_per_stage(View(summary))
    axes, = figure.axes
    bars = dict(zip((label.get_text() for label in axes.get_yticklabels()), (bar.get_width() for bar in axes.patches)))
    timing = summary["timing"]
    for stage, label in STAGES.items():
        assert bars.get(label) == timing.get(stage)
    own = timing["blackbox"]
    assert {name: bars[name] for name in own} == own
    assert sum(bars.values()) == pytest.approx(timing["total"] + sum(own.values())), "with everything else"
    printed = [text.get_text() for text in axes.texts]
    assert "wall clock: 2.00 s" in printed and any(text.endswith("1.30 s, summed over its workers") for text in printed)
    assert f"{timing['linear_stage']:.2f}" in printed
    assert axes.get_xlim()[1] > max(bars.values())
