"""figures/probes.png: what probes tell over the load steps, a plot for each kind of quantity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from orchestrator.results.figures.plotting import BLUE, BROWN, GREEN, OLIVE, ORANGE, PURPLE, RED, SKY, new_figure, tidy
from orchestrator.results.summary.summary import jsonable
from orchestrator.results.summary.units import units_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# of each kind, the components that are drawn: one number says most of a stress or a displacement
_DRAWN = {"displacement": ("ux", "uy", "uz"), "stress": ("von_mises",), "force": ("fx", "fy", "fz")}
_UNIT = {"displacement": "length", "stress": "stress", "force": "force"}
_COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, BROWN, OLIVE)


def probes_over_steps(summary: Mapping[str, object]) -> Figure | None:
    """The curves; None where there is a single load step, or nothing to tell."""
    found = [probe for probe in jsonable(summary.get("probes")) or () if not probe.get("why")]
    kinds = [kind for kind in _DRAWN if any(probe["of"] == kind for probe in found)]
    if (summary.get("load_steps") or 1) < 2 or not kinds:
        return None
    units, figure = units_of(summary), new_figure(7.2, 0.5 + 2.6 * len(kinds))
    for axes, kind in zip(figure.subplots(len(kinds), squeeze=False)[:, 0], kinds):
        curves = [(f"{probe['name']} {name}", probe["values"][name]) for probe in found if probe["of"] == kind for name in _DRAWN[kind]]
        curves = [(name, values) for name, values in curves if any(values)]
        for k, (name, values) in enumerate(curves):
            axes.plot(range(1, len(values) + 1), values, color=_COLOURS[k % len(_COLOURS)], marker="o", markersize=4, label=name)
        unit = units[_UNIT[kind]]
        axes.set(xlabel="load step", ylabel=("von Mises stress" if kind == "stress" else kind) + (unit and "," + unit))
        axes.xaxis.get_major_locator().set_params(integer=True)
        tidy(axes)
        if curves:
            axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.subplots_adjust(left=0.13, right=0.72, top=0.97, bottom=0.18 / len(kinds), hspace=0.35)
    return figure
