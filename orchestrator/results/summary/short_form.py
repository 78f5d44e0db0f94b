"""The short form of a summary: a label and a text each, for the console and for the report."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from orchestrator.errors import some
from orchestrator.method.events import COUNTED
from orchestrator.results.summary.summary import STAGES, blackbox_seconds, jsonable
from orchestrator.results.summary.words import codes_text, nonlinear_text, units_of
from orchestrator.results.summary.workload import idle_text, ranks_text

LARGEST = 6  # stages named
SHOWN = 8  # reactions on screen
ROUNDED = 1e-10  # of the largest component of them: shown as zero


def print_summary(summary: Mapping[str, object], directory: str | os.PathLike[str] | None = None, console: object | None = None) -> None:
    """Prints what matters of a summary as a compact table.

    summary : as for ``write_summary``
    directory : the results folder, to say where the figures are
    console : a rich Console; default: standard output
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = console or Console(highlight=False, emoji=False)
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for label, text in summary_rows(summary):
        style = {"result": "green" if summary.get("converged") else "red", "warning": "yellow", "what to do": "yellow"}.get(label, "")
        table.add_row(label, Text(text, style=style))
    if directory is not None:
        figures = sorted(Path(directory).glob("figures/*.png"))
        table.add_row("results", Text(str(directory)))
        if figures:
            table.add_row("figures", Text("\n".join(map(str, figures))))
    console.print(table)


def summary_rows(summary: Mapping[str, object]) -> list[tuple[str, str]]:
    """Label and text of each line of the short summary; what is not known is left out."""
    def shown(key: str, form: str = "{:,}") -> str | None:
        value = jsonable(summary.get(key))
        return None if value is None else form.format(value)

    state = "converged" if summary.get("converged") else "NOT converged"
    reason = str(summary.get("stop_reason") or "")
    sweeps = summary.get("sweeps") or {}
    total = sweeps.get("total") if isinstance(sweeps, Mapping) else sweeps
    rows = [("run", shown("name", "{}")), ("result", state if reason in ("", "converged") else f"{state} ({reason})"),
            *answer_rows(summary), ("what to do", "\n".join(summary.get("advice") or ())),
            ("iterations", shown("iterations") and f"{shown('iterations')}"
             + (f", {total:.4g} sweeps (back-substitutions per subdomain and load step)" if total is not None else "")),
            ("error bound", shown("error_bound", "{:.2e}  (guaranteed, relative, energy norm)")),
            ("true error", shown("true_error", "{:.2e}  (against the undecomposed solution)")), ("law residual", _law_text(summary)),
            ("mesh's error", _mesh_text(summary)), ("interfaces", _status_text(summary)), ("nonlinear", nonlinear_text(summary)),
            ("bolts", "\n".join(bolt_sentences(summary))), ("stabilised", "\n".join(stabilised_sentences(summary))),
            ("places", "\n".join(place_sentences(summary))), ("not held", "\n".join(hold_sentences(summary))),
            ("warning", "\n".join(summary.get("warnings") or ())),
            ("size", ", ".join(f"{shown(key)} {word if summary[key] == 1 else word + 's'}"
                               for key, word in (("dofs", "dof"), ("subdomains", "subdomain"),
                                                 ("interfaces", "interface"), ("load_steps", "load step")) if shown(key))),
            ("element", shown("element", "{}")), ("time", _time_text(summary)), ("codes", codes_text(summary)),
            ("workers", idle_text(summary.get("workload"))), ("ranks", ranks_text(summary)), ("skipped", _skipped_text(summary)),
            ("memory", shown("memory_peak_mb", "{:,.0f} MB at the peak"))]
    return [(label, text) for label, text in rows if text]


def answer_rows(summary: Mapping[str, object]) -> list[tuple[str, str]]:
    """The numbers that are asked for first: peak stress and displacement with their places, reactions, probes."""
    units = units_of(summary)
    rows = [(label, _peak_text(summary, key, what, unit)) for label, key, what, unit in (
        ("peak stress", "peak_stress", "von Mises", units["stress"]), ("peak displ.", "peak_displacement", "", units["length"]))]
    names, reactions = summary.get("reaction_names") or [], jsonable(summary.get("reactions")) or []
    largest = max((abs(x) for steps in reactions if steps for x in steps[-1] if x is not None), default=0.0)
    texts = [f"{name}: {_vector(steps[-1], ROUNDED * largest)}{units['force']}" for name, steps in zip(names, reactions) if steps]
    if len(texts) > SHOWN:
        texts = [*texts[:SHOWN], f"… and {len(texts) - SHOWN} more in summary.json"]
    rows.append(("reactions", "\n".join(texts)))
    rows.append(("probes", "\n".join(_probe_text(probe, units) for probe in jsonable(summary.get("probes")) or ())))
    return rows


def _peak_text(summary: Mapping[str, object], key: str, what: str, unit: str) -> str | None:
    found = jsonable(summary.get(key))
    if not found:
        return None
    several = (summary.get("load_steps") or 1) > 1
    part = f" of {found['part']}" if found["part"] else ""
    when = f", load step {found['load_step']}" if several else ""
    return f"{found['value']:.5g}{unit}  ({', '.join(filter(None, [what, 'at ' + _vector(found['at'])]))}{part}{when})"


def _probe_text(probe: Mapping[str, object], units: Mapping[str, str]) -> str:
    """A probe at the last load step."""
    if probe.get("why"):
        return f"{probe['name']}: {probe['why']}"
    unit = {"displacement": units["length"], "stress": units["stress"], "force": ""}[probe["of"]]
    kind = "" if probe["quantity"] in ("point", "resultant") else f"{probe['quantity']} "
    values = ", ".join(f"{name} {values[-1] + 0.0:.5g}" for name, values in probe["values"].items())
    return f"{probe['name']}: {kind}{values}{unit}"


def _vector(values: Sequence[float | None], least: float = 0.0) -> str:
    """Components, those below ``least`` as zero: what rounding leaves of the others would be read as a number."""
    return "(" + ", ".join("–" if x is None else f"{x if abs(x) > least else 0.0:.5g}" for x in values) + ")"


def _law_text(summary: Mapping[str, object]) -> str | None:
    residuals = jsonable(summary.get("residuals"))
    value = residuals.get("law_residual") if isinstance(residuals, Mapping) else None
    return None if value is None else f"{value:.2e}  (equilibrium and interface laws, the largest relative residual)"


def _mesh_text(summary: Mapping[str, object]) -> str | None:
    value, config = jsonable(summary.get("discretisation_error")), summary.get("config") or {}
    if value is None:
        return None
    asked = (config.get("method") or {}).get("tolerance") or {}
    text = f"{value:.2e}  (estimated discretisation error, relative, energy norm)"
    if asked.get("error") == "auto":
        text += f"; tolerance {summary['tolerance']:.2e}, {asked['fraction']:g} of it"
    return text


def shown_statuses(counts: object) -> list[str]:
    """Names of the statuses that say something: open, stick and slip only where there are such."""
    if not isinstance(counts, Mapping):
        return []
    usual = [name for name in COUNTED if counts.get(name)]
    return (usual if any(any(counts[name]) for name in usual) else []) + [n for n in counts if n not in COUNTED]


def _status_text(summary: Mapping[str, object]) -> str | None:
    """Node pairs that are open, stick, slip … at the last load step."""
    counts = summary.get("status_counts")
    names = shown_statuses(counts)
    if not names:  # imposed jumps alone
        return None
    steps = len(counts[names[0]])
    when = f"  (node pairs, load step {steps} of {steps})" if steps > 1 else "  (node pairs)"
    return ", ".join(f"{counts[name][-1]:,} {name}" for name in names if any(counts[name])) + when


def bolt_sentences(summary: Mapping[str, object]) -> list[str]:
    """What bolts carry at the last load step."""
    return [f"{bolt['name']}: {bolt['force'][-1]:.5g}, {bolt['state'][-1]}, shortened by {bolt['shortening'][-1]:.4g}"
            for bolt in jsonable(summary.get("bolts")) or ()]


def hold_sentences(summary: Mapping[str, object]) -> list[str]:
    """Which bodies are detached or weakly held, at which load steps, in words."""
    result = []
    place = "where stabilisation leaves it" if jsonable(summary.get("stabilised")) else "undetermined"
    for key, what in (("detached", "pressed on by no held body"), ("weakly_held", "held, but free to move as a whole")):
        for steps, names in _alike(summary.get(key) or ()):
            result.append(f"{some(names, 6)}: {what} at load step {', '.join(map(str, steps))}; "
                          f"{'its' if len(names) == 1 else 'their'} rigid position is {place}")
    return result


def stabilised_sentences(summary: Mapping[str, object]) -> list[str]:
    """How much stabilisation carried, and which bodies live by it at which load steps, in words."""
    found = jsonable(summary.get("stabilised"))
    if not isinstance(found, Mapping):
        return []
    force, work = (f"{found[key]:.1e}" if found[key] is not None else "any number of times" for key in ("force", "work"))
    result = [f"springs of ε = {found['epsilon']:.1e} carry at most {force} of the largest contact force per area, and do "
              f"{work} of the largest strain energy in work"]
    if found.get("weakened"):  # what an older version has left has none
        result[0] += f"; weaker from iteration {', '.join(str(after + 1) for after in found['weakened'])} on"
    if found.get("withdrawn"):
        result[0] += (f"; from iteration {', '.join(str(after + 1) for after in found['withdrawn'])} on as before the last of these, "
                      "which led nowhere: what many loose bodies carry may be off by more than the tolerance")
    lived = {name for names in found["bodies"] for name in names}
    for steps, names in _alike(found["bodies"]):
        result.append(f"{some(names, 6)}: {'lives' if len(names) == 1 else 'live'} by them at load step "
                      f"{', '.join(map(str, steps))} (more than a tenth of the forces there)")
    return result if lived else [result[0] + "; no body lives by them"]


def place_sentences(summary: Mapping[str, object]) -> list[str]:
    """How far the places of loose bodies are determined, and which ones are beyond the tolerance, in words."""
    found, tolerance = jsonable(summary.get("places")), jsonable(summary.get("tolerance"))
    if not isinstance(found, Mapping) or not found["bodies"]:
        return []
    beyond = [f"{name} {_far(far)}" for name, far in found["bodies"].items() if None in (far, tolerance) or far > tolerance]
    return [f"rigid positions of loose bodies are determined to about {_far(found['open'])} of the largest displacement"
            + (": " + some(beyond, 6) if beyond else ", less than the tolerance")]


def _far(far: float | None) -> str:
    return "any number of times" if far is None else f"{far:.1e}"


def _alike(named: Iterable[list[str]]) -> list[tuple[tuple[int, ...], list[str]]]:
    """Load steps, and the names that are told at these and no others, from the names per load step."""
    when: dict[str, list[int]] = {}
    for step, names in enumerate(named, 1):
        for name in names:
            when.setdefault(name, []).append(step)
    alike: dict[tuple[int, ...], list[str]] = {}
    for name, steps in when.items():
        alike.setdefault(tuple(steps), []).append(name)
    return list(alike.items())


def _skipped_text(summary: Mapping[str, object]) -> str:
    """What was not done because the scene does not need it, and which switch of ``method.skip`` allowed it."""
    return "; ".join(f"{', '.join(f'{count:,} {what}' for what, count in entry['saved'].items())} ({entry['skip']})"
                     for entry in summary.get("skipped") or ())


def _time_text(summary: Mapping[str, object]) -> str | None:
    timing = jsonable(summary.get("timing")) or {}
    if timing.get("total") is None:
        return None
    stages = sorted(((timing[s], s) for s in STAGES if timing.get(s)), reverse=True)
    text = f"{timing['total']:.2f} s"
    shown = [f"{STAGES[name]} {seconds:.2f}" for seconds, name in stages[:LARGEST]]
    rest = timing["total"] - sum(seconds for seconds, _ in stages[:LARGEST])
    if shown:
        text += ": " + ", ".join(shown + ([f"the rest {rest:.2f}"] if rest >= 0.005 else []))
    own = blackbox_seconds(timing)
    if own:
        text += f"\nblack box {own:.2f} s of its own clock, summed over its workers"
        workers = summary.get("workers")
        if workers and timing["total"]:
            text += f" ({100 * own / (workers * timing['total']):.0f} % of {workers} × {timing['total']:.2f} s)"
    return text
