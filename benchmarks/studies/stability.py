"""Hard cases: each is solved within its bound, refused with a message, or stopped with its cause; none is wrong.

With perfect interfaces the true error, against the undecomposed solution, must not exceed the bound. With contact it is the energy
error that the run tells beside the true one, against a solution in one piece that shares no code with the method: guaranteed ones
are at least the true one, estimated ones half of it. Where either is not known the written fields are judged by what the run did
not compute itself: reactions that balance, the laws node by node, and a second run with soles of other stiffness.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.kit.drawing import BLUE, GREEN, between_lines, panels
from benchmarks.kit.study import Case, Study, first
from benchmarks.kit.truth import NOISE, Truth
from benchmarks.problems.cases import CONTACT_RATIO
from benchmarks.problems.hard_cases import BEFORE, Hard, cured, hard_cases
from orchestrator import InputError, OrchestratorError, Solution, build_scene, config_from, solve

CONVERGED, REFUSED, STOPPED = "converged", "refused", "stopped"
EFFECTIVITY, STAGES, ACCURATE, SHARE = 5.0, 60, 1e-6, 0.9
FLOOR = 1e-11  # rounding in the reference itself, relative
ESTIMATED = 2.0  # true over estimated energy error; 120 random scenes had 1.2 at most
LAWFUL, ALIKE = 1e-4, 1e-2  # laws and balance on written fields; two runs with different soles
OTHER_SOLES = 3.0
LIMIT = 200  # iterations


def run(study: Study) -> None:
    """The matrix, then what automatic soles and macro functions cure."""
    study.columns = ("axis", "value", "meaningful", "outcome", "iterations", "error_kind", "true_error", "error_bound",
                     "effectivity", "message", "silent_wrong")
    for hard in hard_cases(study.folder):
        attempt(study, hard)
    _targets(study)
    for name, problem in cured(study.folder):
        found = {}
        for settings, method in (("before", BEFORE), ("auto", {})):
            case = Hard(f"{settings}: {name}", settings, {**problem, "method": method})
            found[settings] = attempt(study, case, limit=100)
        before, auto = (row["stages_to_true_error"] for row in (found["before"], found["auto"]))
        study.target(f"{name}: true error ≤ 1e-6", f"at most {STAGES} stages",
                     f"{auto or 'never'}; before {before or 'not in 100'}", bool(auto) and auto <= STAGES)
    study.figure(_picture(study))


def attempt(study: Study, hard: Hard, limit: int = LIMIT) -> dict[str, Any]:
    """Solve a hard case, judge how it ended, add its row."""
    begin = time.perf_counter()
    data = dict(hard.config)
    data["method"] = {"max_iterations": limit, **data.get("method", {})}
    row: dict[str, Any] = {"meaningful": "yes" if hard.meaningful else "no", "iterations": 0, "silent_wrong": "",
                           "stages_to_true_error": None}
    history = {}
    try:
        with np.errstate(all="ignore"):
            solved = _solved(data)
            row |= _judged(solved, data)
            history = solved.history
    except InputError as error:
        row |= {"outcome": REFUSED, "message": f"{error.problems[0].found}"}
    except OrchestratorError as error:
        row |= {"outcome": STOPPED, "message": str(error).splitlines()[0]}
    except Exception as error:  # noqa: BLE001 - a traceback is what must never happen
        row |= {"outcome": "crashed", "message": repr(error), "silent_wrong": "traceback"}
    row |= {"stop_reason": row["outcome"], "seconds": round(time.perf_counter() - begin, 2)}
    case = Case(data, {"axis": hard.axis, "value": hard.value})
    study.add(case, row, history, row["silent_wrong"] or row.get("message") or "as it should be")
    return study.rows[-1]


def _solved(data: Mapping[str, Any]) -> Solution:
    config = config_from(dict(data))
    scene = build_scene(config)
    return solve(config, scene, reference=all(i.law.perfect for i in scene.interfaces))


def _judged(solved: Solution, data: Mapping[str, Any]) -> dict[str, Any]:
    """Outcome of a finished run, and what is silently wrong with it."""
    summary = solved.summary
    row: dict[str, Any] = {"iterations": solved.iterations, "outcome": CONVERGED if solved.converged else STOPPED,
                           "message": "" if solved.converged else _cause(summary)}
    if solved.interfaces is None:
        true, bound = summary["true_error"], summary["error_bound"]
        row |= {"true_error": true, "error_bound": bound, "effectivity": bound / true if true > FLOOR else np.nan,
                "stages_to_true_error": first(solved.history, "true_error", ACCURATE)}
        if solved.converged and not true <= max(bound, FLOOR):
            row["silent_wrong"] = f"true error {true:.1e} above the bound"
        return row
    row["law_residual"] = summary["residuals"]["law_residual"]
    if (error := true_error(solved)) is None:
        row |= {"true_error": None, "error_bound": None}
        wrong = _unlawful(solved) + _unlike(solved, data) if solved.converged else []
    else:
        kind, bound = summary["error_kind"], summary["error_bound"]
        row |= {"error_kind": kind, "true_error": error, "error_bound": bound, "effectivity": bound / error if error > NOISE else np.nan}
        wrong = beyond(kind, bound, error) if solved.converged else []
    return row | {"silent_wrong": "; ".join(wrong)}


def true_error(solved: Solution) -> float | None:
    """Against a solution in one piece; None where the run tells no error, or that solution is not found."""
    if not np.isfinite(solved.error_bound):
        return None
    truth = Truth(solved.scene)
    return truth.error(solved.sides) if truth.known else None


def beyond(kind: str, bound: float, error: float) -> list[str]:
    """Whether a true error is above what a run may say of it."""
    most = max(bound if kind == "guaranteed" else ESTIMATED * bound, NOISE)
    return [] if error <= most else [f"true error {error:.1e} above the {kind} {bound:.1e}"]


def _cause(summary: Mapping[str, Any]) -> str:
    """Why a run stopped, and what it says of the state it stopped in."""
    loose = sorted({name for step in summary.get("detached") or () for name in step})
    bound = summary["error_bound"]
    known = f", error bound {bound:.0e}" if bound is not None and np.isfinite(bound) else ""
    return summary["stop_reason"] + known + (f", nothing holds {', '.join(loose)}" if loose else "")


def _unlawful(solved: Solution) -> list[str]:
    """What the written fields of a contact run break."""
    wrong, i = [], solved.interfaces
    reactions = np.array([r for r in solved.summary["reactions"] if np.size(r)])
    balance, size = np.abs(reactions.sum(axis=0)).max(), np.abs(reactions).max()
    reach, friction = np.abs(solved.displacement).max() or 1.0, solved.scene.interfaces[0].law.friction
    stiff = max(m.young for m in solved.scene.materials)
    if balance > LAWFUL * max(size, 1e-6 * stiff * reach):
        wrong.append(f"reactions unbalanced by {balance / size:.0e}")
    push = max(np.abs(i.pressure).max(), 1e-6 * stiff * reach)
    shear = np.linalg.norm(i.friction_traction, axis=2)
    inner = i.status != 3
    broken = {"penetration": np.max(-i.gap[inner]) / reach, "tension": np.max(-i.pressure[inner]) / push,
              "cone": np.max((shear - friction * np.maximum(i.pressure, 0))[inner]) / push,
              "complementarity": np.minimum(i.gap[inner] / reach, i.pressure[inner] / push).max()}
    return wrong + [f"{name} {value:.0e}" for name, value in broken.items() if not value <= LAWFUL]


def _unlike(solved: Solution, data: Mapping[str, Any]) -> list[str]:
    """Whether a run with stiffer soles ends elsewhere; bodies that came loose may be anywhere."""
    if any(solved.summary["detached"]):
        return []
    method = dict(data["method"])
    method["sole"] = {**method.get("sole", {}), "contact_ratio": OTHER_SOLES * CONTACT_RATIO, "allow_extreme": True}
    other = _solved({**data, "method": method})
    if not other.converged:
        return []
    apart = np.abs(other.displacement - solved.displacement).max() / (np.abs(solved.displacement).max() or 1.0)
    return [f"other soles: {apart:.0e} apart"] if apart > ALIKE else []


def _targets(study: Study) -> None:
    rows = study.rows
    wrong = [f"{r['axis']} {r['value']}" for r in rows if r["silent_wrong"]]
    study.target("silent wrong rows", "none", ", ".join(wrong) or f"none of {len(rows)}", not wrong)
    meant = [r for r in rows if r["meaningful"] == "yes"]
    good = sum(r["outcome"] == CONVERGED for r in meant)
    study.target("physically meaningful rows that converge", f"at least {SHARE:.0%}",
                 f"{good} of {len(meant)}: {good / len(meant):.0%}", good >= SHARE * len(meant))
    converged = [r for r in rows if r["outcome"] == CONVERGED and np.isfinite(r.get("effectivity") or np.nan)]
    for kind in ("guaranteed", "estimated"):
        ratios = [r["effectivity"] for r in converged if r.get("error_kind") == kind]
        if ratios:
            study.target(f"error told over true error, converged rows with contact, {kind}",
                         f"at least {1 if kind == 'guaranteed' else 1 / ESTIMATED:g}",
                         f"{min(ratios):.2f} to {max(ratios):.2f} of {len(ratios)}",
                         min(ratios) >= (1 if kind == "guaranteed" else 1 / ESTIMATED))
    known = [r["effectivity"] for r in converged if "error_kind" not in r]
    study.target("bound over true error, converged rows with perfect interfaces", f"1 to {EFFECTIVITY:g}",
                 f"{min(known):.2f} to {max(known):.2f}; {sum(e > EFFECTIVITY for e in known)} of {len(known)} above",
                 1 <= min(known) and max(known) <= EFFECTIVITY)


def _picture(study: Study):
    """Bound against true error of all rows that know both."""
    figure, ((axes,),) = panels(size=(6.4, 5.2))
    between_lines(axes, EFFECTIVITY, (1e-12, 10))
    for outcome, colour, marker in ((CONVERGED, BLUE, "o"), (STOPPED, GREEN, "x")):
        rows = [r for r in study.rows if r["outcome"] == outcome and r.get("true_error") and np.isfinite(r["error_bound"])]
        axes.loglog([r["true_error"] for r in rows], [r["error_bound"] for r in rows], marker, color=colour,
                    label=f"{outcome}, {len(rows)} rows", markerfacecolor="none")
    axes.set_title("Hard cases: error told beside the true error (line), 5 times above (dashed)", fontsize=11)
    return figure
