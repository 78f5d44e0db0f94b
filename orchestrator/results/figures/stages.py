"""figures/time.png: where the time went."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from orchestrator.results.figures.plotting import BLUE, GREY, ORANGE, new_figure, tidy
from orchestrator.results.summary.codes import code_label
from orchestrator.results.summary.summary import BLACKBOX_STAGES, STAGES

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def time_per_stage(summary: Mapping[str, object]) -> Figure:
    """Bars: wall-clock seconds of each stage, and the black box's own seconds by kind of work."""
    timing = summary["timing"]
    total = float(timing["total"])
    wall = [(label, float(timing[stage])) for stage, label in STAGES.items() if timing.get(stage)]
    rest = total - sum(seconds for _, seconds in wall)
    if rest > 0.005 * total:
        wall.append(("everything else", rest))
    sections = [(f"wall clock: {total:.2f} s", wall, BLUE)]
    entries = summary.get("codes") or [{"code": "the black box", "seconds": timing.get("blackbox") or {}}]
    for entry in entries:
        own = [(stage, float(entry["seconds"].get(stage) or 0.0)) for stage in BLACKBOX_STAGES]
        if spent := sum(seconds for _, seconds in own):
            name = code_label(entry) if len(entries) > 1 else entry["code"]
            sections.append((f"{name}, on its own clock: {spent:.2f} s, summed over its workers", own, ORANGE))

    rows = sum(len(bars) + 1 for _, bars, _ in sections)
    height = 0.27 * rows + 0.9
    figure = new_figure(7.2, height)
    axes = figure.add_axes((0.26, 0.5 / height, 0.70, 1 - 0.95 / height))
    longest = max(seconds for _, bars, _ in sections for _, seconds in bars)
    y, ticks, labels = 0.0, [], []
    for heading, bars, colour in sections:
        axes.text(0, y, heading, fontsize=9, fontweight="bold", va="center")
        for label, seconds in bars:
            y += 1
            axes.barh(y, seconds, height=0.72, color=colour)
            axes.text(seconds + 0.008 * longest, y, f"{seconds:.2f}", fontsize=8, va="center", color=GREY)
            ticks.append(y)
            labels.append(label)
        y += 1.2
    axes.set_yticks(ticks, labels, fontsize=8.5)
    axes.tick_params(axis="y", length=0)
    axes.set(ylim=(y - 0.5, -0.7), xlim=(0, 1.1 * longest), xlabel="seconds")
    axes.set_title(f"{summary.get('name') or ''}: time per stage", fontsize=11)
    tidy(axes)
    axes.grid(False, axis="y")
    return figure
