"""What the study of grains is judged by: convergence, iterations, the share of the coarse problem, a thousand grains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.kit.study import Study

FIRST, MOST, GROWTH = 64, 50, 1.3  # iterations: at most, and as a multiple of those of so many grains
USUAL, TIGHTER = 1e-4, 2.5  # the tolerance that this is about; iterations of tighter ones over its own
SHARES = ((343, 0.25), (1000, 0.40))  # up to so many grains: share of the coarse problem in the iterations' wall time
LARGE, DOFS, SECONDS, MEMORY = 1000, 500_000, 600, 16  # grains; their decomposed dofs at least; limits, GB


def judge(study: Study) -> None:
    """The targets, of what has been run."""
    rows = [row for row in study.rows if row["tolerance"] == USUAL]
    if rows:
        _judge_usual(study, rows)
    for tolerance in sorted({row["tolerance"] for row in study.rows} - {USUAL}):
        _judge_other(study, [row for row in study.rows if row["tolerance"] == tolerance], rows)
    large = [row for row in rows if row["grains"] >= LARGE]
    if large:
        finished = [row for row in large if "iterations" in row]
        shown = "; ".join(f"{row['dofs_decomposed']:,} dofs, {row['seconds']:.0f} s, {row['GB']:.1f} GB" for row in finished)
        study.target(f"{LARGE} grains, at least {DOFS:,} decomposed dofs, everything included",
                     f"at most {SECONDS} s and {MEMORY} GB", shown or None, len(finished) == len(large) and all(
                         row["dofs_decomposed"] >= DOFS and row["seconds"] <= SECONDS and row["GB"] <= MEMORY
                         and row["stop_reason"] == "converged" for row in large))


def _judge_usual(study: Study, rows: Sequence[Mapping[str, Any]]) -> None:
    """Convergence, iterations, and the share of the coarse problem."""
    good = [row for row in rows if row["stop_reason"] == "converged"]
    study.target(f"law residual {USUAL:g}: runs that converge", f"all {len(rows)}", len(good), len(good) == len(rows))
    if good:
        most = max(good, key=lambda row: row["iterations"])
        study.target("the most iterations", f"at most {MOST}", f"{most['iterations']}: {most['grains']} grains, seed "
                     f"{most['seed']}", len(good) == len(rows) and most["iterations"] <= MOST)
    mean = {count: _mean([row for row in rows if row["grains"] == count]) for count in sorted({r["grains"] for r in rows})}
    larger = [count for count in mean if count > FIRST]
    if FIRST in mean and larger:
        known = mean[FIRST] is not None and all(mean[count] is not None for count in larger)
        growth = max(mean[count] for count in larger) / mean[FIRST] if known else None
        study.target(f"mean iterations, {_range([row for row in rows if row['grains'] > FIRST])} over {FIRST}",
                     f"at most {GROWTH:g}", growth and f"{growth:.2f}", known and growth <= GROWTH)
    least = 0
    for most, limit in SHARES:
        those = [row for row in rows if least < row["grains"] <= most and "coarse_share" in row]
        if those:
            share = max(row["coarse_share"] for row in those)
            study.target(f"share of the coarse problem in the iterations' wall time, {_range(those)}",
                         f"at most {100 * limit:.0f} %", f"{100 * share:.0f} %", share <= limit)
        least = most


def _judge_other(study: Study, rows: Sequence[Mapping[str, Any]], usual: Sequence[Mapping[str, Any]]) -> None:
    """Convergence to another tolerance, and how many more iterations it takes on the same grains."""
    tolerance = rows[0]["tolerance"]
    good = [row for row in rows if row["stop_reason"] == "converged"]
    study.target(f"law residual {tolerance:g}: runs that converge", f"all {len(rows)}", len(good), len(good) == len(rows))
    before = {(row["grains"], row["seed"]): row["iterations"] for row in usual if row["stop_reason"] == "converged"}
    ratios = [row["iterations"] / before[key] for row in good if (key := (row["grains"], row["seed"])) in before]
    if tolerance < USUAL and ratios:
        study.target(f"the same: iterations over those to {USUAL:g}", f"at most {TIGHTER:g}", f"{max(ratios):.2f}",
                     max(ratios) <= TIGHTER)


def _range(rows: Sequence[Mapping[str, Any]]) -> str:
    """The numbers of grains of rows that are in their order."""
    first, last = rows[0]["grains"], rows[-1]["grains"]
    return f"{first} grains" if first == last else f"{first} … {last} grains"


def _mean(rows: Sequence[Mapping[str, Any]]) -> float | None:
    """Mean iterations of runs; None if one of them did not converge."""
    if any(row["stop_reason"] != "converged" for row in rows):
        return None
    return sum(row["iterations"] for row in rows) / len(rows)
