"""Charts of a run: the curves of its convergence, the bars of its time; what they say and how long they are."""

import numpy as np
import pytest
import results_case as case

from orchestrator.method.events import HISTORY_COLUMNS
from orchestrator.registry import LAWS
from orchestrator.results.figures.charts import convergence, time_per_stage, tolerance
from orchestrator.results.figures.figures import write_figures
from orchestrator.results.figures.plotting import png
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.summary.summary import STAGES

BONDED = {"error_bound": "error bound", "residual": "residual ‖Δs‖", "indicator": "indicator η (a squared ratio)",
          "displacement_jump": "displacement jump ‖B w‖", "force_imbalance": "force imbalance ‖A f‖"}


def curves(figure):
    """Label → (x, y) of the curves that the legend names."""
    axes, = figure.axes
    lines = {line.get_label(): line for line in axes.lines}
    return {text.get_text(): lines[text.get_text()].get_data() for text in axes.get_legend().get_texts()}


def words(figure):
    return " | ".join(text.get_text() for text in (*figure.axes[0].texts, figure.axes[0].title))


def test_curves_are_the_history():
    history = case.history()
    found = curves(convergence(case.summary(true_error=None), history))
    assert set(found) == set(BONDED.values())
    for column, label in BONDED.items():
        known = np.isfinite(history[column]) & (history[column] > 1e-17)
        np.testing.assert_array_equal(found[label], [history["iteration"][known], history[column][known]])
    assert len(found[BONDED["error_bound"]][0]) == 5, "it begins with the third iteration"


def test_what_is_solved_at_once_has_no_curves():
    """One subdomain: no error, no jump; its chart is drawn all the same."""
    history = case.history()
    figure = convergence(case.summary(true_error=None), history | {column: np.zeros(7) for column in BONDED})
    assert png(figure) and figure.axes[0].get_yscale() == "log" and "all of it is zero" in words(figure)


def test_the_tolerance_and_how_it_ended():
    figure = convergence(case.summary(), case.history())
    assert words(figure) == "tolerance on the error bound: 1e-06 | made_up: converged after 7 iterations"
    level, = (line for line in figure.axes[0].lines if line.get_linestyle() == "--")
    assert set(level.get_ydata()) == {1e-6} and figure.axes[0].get_yscale() == "log"
    assert curves(figure)["true error 9.0e-08"] == ([7], [9e-8])
    figure = convergence(case.summary(converged=False, config={}), case.history())
    assert words(figure) == "made_up: not converged after 7 iterations"
    assert not [line for line in figure.axes[0].lines if line.get_linestyle() == "--"]
    assert tolerance(case.summary(tolerance=3e-5, config={"method": {"tolerance": {"error": "auto"}}})) == ("error bound", 3e-5)
    assert tolerance(case.summary(config={"method": {"tolerance": {"indicator": 1e-5}}})) == ("indicator η", 1e-5)


def test_with_laws_their_measures_are_drawn():
    """And the jump is not: interfaces that open are meant to jump."""
    measures = {measure.name: measure.label for law in LAWS.values() for measure in law.measures}
    assert measures, "some law has measures"
    history = case.history()
    others = {name: history["residual"] / (k + 2) for k, name in enumerate(measures)}
    history |= {"law_residual": history["residual"] * 2, "error_bound": np.full(7, np.nan), **others}
    found = curves(convergence(case.summary(true_error=None, status_counts={"open": [1, 2]}), history))
    assert set(found) == {"law residual (the largest)", "residual ‖Δs‖", "indicator η (a squared ratio)",
                          "force imbalance ‖A f‖", *measures.values()}
    for name, label in measures.items():
        np.testing.assert_array_equal(found[label][1], history[name])
    assert tolerance(case.summary(status_counts={"open": [1]})) == ("law residual", 1e-6)
    assert not set(others) & set(HISTORY_COLUMNS)


def test_bars_are_the_seconds():
    summary = case.summary()
    figure = time_per_stage(summary)
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


def test_bars_of_several_codes():
    own = case.summary()["timing"]["blackbox"]
    codes = [{"code": "freefem", "transport": "pipe", "seconds": own},
             {"code": "mine", "transport": "file", "seconds": {stage: 2 * s for stage, s in own.items()}}]
    axes, = time_per_stage(case.summary(codes=codes)).axes
    widths = [bar.get_width() for bar in axes.patches]
    assert widths[-4:] == [2 * s for s in own.values()] and widths[-8:-4] == list(own.values())
    assert [t.get_text() for t in axes.texts if "on its own clock" in t.get_text()] == [
        f"{name}, on its own clock: {total:.2f} s, summed over its workers"
        for name, total in (("freefem (pipe)", 1.3), ("mine (file)", 2.6))]


@pytest.mark.long
def test_files_hold_the_figures(tmp_path):
    """With what is known of a run: no more, no less."""
    folder = ResultsFolder(tmp_path)
    assert [p.name for p in write_figures(folder, case.summary(), {})] == ["time.png"]
    assert write_figures(folder, {"name": "early"}, {}) == []
    written = write_figures(folder, case.summary(), case.history())
    assert [p.name for p in written] == ["convergence.png", "time.png"]
    expected = [png(convergence(case.summary(), case.history())), png(time_per_stage(case.summary()))]
    assert [p.read_bytes() for p in written] == expected
