"""A summary in words: a label and a text for each line, for the screen and for the report, and the sentences that these share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import hypot, inf, isfinite

from orchestrator.errors import some
from orchestrator.method.events import COUNTED
from orchestrator.results.summary.intervals import sentences as intervals
from orchestrator.results.summary.verdict import verdict
from orchestrator.results.summary.summary import blackbox_seconds, code_label, jsonable, stage_seconds, units_of

LARGEST = 6  # stages named
SHOWN = 8  # reactions on screen, ranks
OWN = 10.0  # errors asked, told of a body's own beside its own energy from which it is named
NAMES = 6  # bodies in a sentence
FAR = 3.0  # tolerances, told of a body's place from which it is named: what is off by ten has been told to be off by four at least
SURE = 1e-6  # of the largest number of its kind: an error that is not told
ROUNDED = 1e-10  # of the largest of them: shown as zero


def summary_rows(summary: Mapping[str, object]) -> list[tuple[str, str]]:
    """Label and text of each line of the short summary; what is not known is left out."""
    found = {key: jsonable(value) for key, value in summary.items() if key != "config"} | {"config": summary.get("config") or {}}
    rows = [(label, told(found) if callable(told) else _numbers(found, *told)) for label, told in _LINES]
    return [(label, text) for label, text in rows if text]


def _numbers(summary: Mapping[str, object], key: str, form: str) -> str:
    """A format of the entry ``key``, which may be within another one: ``sweeps.total``."""
    value: object = summary
    for name in key.split("."):
        value = value.get(name) if isinstance(value, Mapping) else None
    return "" if value is None else form.format(value)


def _sentences(key: str) -> Callable[[Mapping[str, object]], str]:
    return lambda summary: "\n".join(summary.get(key) or ())


def _result(summary: Mapping[str, object]) -> str:
    reason = str(summary.get("stop_reason") or "")
    return ("converged" if summary.get("converged") else "NOT converged") + (f" ({reason})" if reason not in ("", "converged") else "")


def _iterations(summary: Mapping[str, object]) -> str:
    return _numbers(summary, "iterations", "{:,}") and _numbers(summary, "iterations", "{:,}") + _numbers(
        summary, "sweeps.total", ", {:.4g} sweeps (back-substitutions per subdomain and load step)")


def _error(summary: Mapping[str, object]) -> str:
    """Sentence on the distance from the discrete solution."""
    kind = summary.get("error_kind") or "guaranteed"
    kind += _numbers(summary, "error_factor", ", {:.3g} times what it is with limits of friction that are known")
    return _numbers(summary, "error_bound", f"{{:.2e}}  ({kind}, relative, energy norm)")


def _backward(summary: Mapping[str, object]) -> str:
    """Sentence on the surfaces for which the result is exact."""
    if not (found := summary.get("backward")):
        return ""
    normal, tangential = (f"{found[name]:.1e}{units_of(summary)['length']}" for name in ("normal", "tangential"))
    return f"exact for surfaces shifted by at most {normal} along the normal, {tangential} across it"


def balance_sentences(summary: Mapping[str, object]) -> list[str]:
    """Sentences where no energy error is known for want of balanced forces near the run's; a limit load says more."""
    return [f"{some(names, NAMES)}: near the forces of load step {steps} none were found that the laws allow and that balance "
            f"{'it' if len(names) == 1 else 'them'}: no error is known"
            for steps, names in _alike(summary.get("unbalanced") or ()) if not summary.get("limit_load")]


def _peak(key: str, what: str, unit: str) -> Callable[[Mapping[str, object]], str]:
    """A largest value with its place."""
    def told(summary: Mapping[str, object]) -> str:
        if not (found := summary.get(key)):
            return ""
        part = f" of {found['part']}" if found["part"] else ""
        when = f", load step {found['load_step']}" if (summary.get("load_steps") or 1) > 1 else ""
        at = _vector(found["at"], ROUNDED * max(map(abs, found["at"])))
        grows = found.get("grows")
        endless = f"\nsingular: from mesh to mesh it grows as h^-{grows:.2f}, h the size of elements there, without limit" if grows else ""
        return f"{found['value']:.5g}{units_of(summary)[unit]}  ({what}at {at}{part}{when}){endless}"

    return told


def _forces(loads: bool) -> Callable[[Mapping[str, object]], str]:
    """Sentences on the forces of supports, or the sum of loads, at the last load step."""
    def told(summary: Mapping[str, object]) -> str:
        names, reactions = summary.get("reaction_names") or [], summary.get("reactions") or []
        kinds = summary.get("reaction_kinds") or ["support"] * len(names)
        largest = max((abs(x) for steps in reactions for force in steps or () for x in force if x is not None), default=0.0)
        texts = [f"{name}: {_vector(steps[-1], ROUNDED * largest)}{units_of(summary)['force']}"
                 for name, steps, kind in zip(names, reactions, kinds) if steps and (kind == "load") == loads]
        count = summary.get("load_steps") or 1
        if texts and count > 1:
            texts[0] += f"  (load step {count} of {count})"
        return "\n".join(texts[:SHOWN] + [f"… and {len(texts) - SHOWN} more in summary.json"] * (len(texts) > SHOWN))

    return told


def _tools(summary: Mapping[str, object]) -> str:
    """Sentences on each tool's place at the last load step."""
    units = units_of(summary)
    return "\n".join(f"{tool['name']}: {_vector(move := tool['displacement'][-1], ROUNDED * max(map(abs, move)))}{units['length']}"
                     + (f", turned by {_vector(turn, ROUNDED * max(map(abs, turn)))}°" if any(turn := tool["rotation"][-1]) else "")
                     for tool in summary.get("tools") or ())


def quantity_text(name: str, told: Mapping[str, object], unit: str = "") -> str:
    """The length of a displacement or force with what mesh and iterations leave of error."""
    if told["error"] is None:
        return f"|{name}| is zero but for rounding"
    beside = "not known" if told["iterations"] is None else f"{told['iterations']:.1e}"
    return (f"|{name}| {told['value']:.6g} ± {told['error'] * told['value']:.1e}{unit} ({told['error']:.2%}: mesh's {told['mesh']:.2%} estimated, "
            f"iterations' {beside})")


def _probes(summary: Mapping[str, object]) -> str:
    """Values of probes at the last load step."""
    units, texts = units_of(summary), []
    for probe in summary.get("probes") or ():
        kind = "" if probe["quantity"] in ("point", "resultant", "section") else f"{probe['quantity']} "
        unit = {"displacement": units["length"], "stress": units["stress"], "force": ""}[probe["of"]]
        least = ROUNDED * max((abs(values[-1]) for values in probe["values"].values() if values), default=0.0)
        texts.append(f"{probe['name']}: " + (probe.get("why") or kind + ", ".join(
            f"{name} {values[-1] if abs(values[-1]) > least else 0.0:.5g}" for name, values in probe["values"].items()) + unit))
        if told := probe.get("accuracy"):
            texts.append(quantity_text(probe["name"], told, unit or units["force"]) + f", asked: {told['asked']:.2%}")
    return "\n".join(texts)


def _vector(values: Sequence[float | None], least: float = 0.0) -> str:
    """Components, those below ``least`` as zero: what rounding leaves of the others would be read as a number."""
    return "(" + ", ".join("–" if x is None else f"{x if abs(x) > least else 0.0:.5g}" for x in values) + ")"


def _mesh(summary: Mapping[str, object]) -> str:
    asked = (summary["config"].get("method") or {}).get("tolerance") or {}
    text = _numbers(summary, "discretisation_error", "{:.2e}  (estimated discretisation error, relative, energy norm)")
    return text + (f"; tolerance {summary['tolerance']:.2e}, {asked['fraction']:g} of it" if text and asked.get("error") == "auto" else "")


def _mesh_bound(summary: Mapping[str, object]) -> str:
    if "mesh_bound" not in summary or not ((summary.get("config") or {}).get("output") or {}).get("mesh_bound"):
        return ""
    return _numbers(summary, "mesh_bound", "{:.2e}  (guaranteed, mesh and iterations, energy norm)") or \
        "none: the mesh is too coarse for one, or sides are inside each other"


def _accuracy(summary: Mapping[str, object]) -> str:
    if not (found := summary.get("accuracy")):
        return ""
    last = found["meshes"][-1]
    asked = f", {found['asked']:.2%} asked" if found["asked"] else ""
    checked = "measured against the mesh before" if last["told"] is not None else "an estimate that nothing has checked"
    return (f"{found['reached']:.2%} reached{asked}, energy norm, of mesh and iterations together; {len(found['meshes'])} meshes, "
            f"the last of {last['elements']:,} elements; the mesh's error is {checked}")


def _off(summary: Mapping[str, object]) -> str:
    """What numbers are off by, where an accuracy was asked for; components of a vector together, what is rounding left out."""
    if not (found := (summary.get("accuracy") or {}).get("numbers")):
        return ""
    values, together = summary["accuracy"]["meshes"][-1]["numbers"], {}
    for name, error in found.items():
        head, _, axis = name.rpartition(".")
        together.setdefault(head if axis in ("x", "y", "z") and head.startswith("reaction.") else name, []).append((values[name], error))
    kinds = {name.partition(".")[0]: 0.0 for name in together}
    for name, each in together.items():
        kinds[name.partition(".")[0]] = max(kinds[name.partition(".")[0]], hypot(*(value for value, _ in each)))
    told = [f"{name.replace('_', ' ').replace('reaction.', '')} ± {error:.1e}" for name, each in together.items()
            if (error := hypot(*(error for _, error in each))) > SURE * kinds[name.partition(".")[0]]]
    return "; ".join(told[:SHOWN]) + (f"; … and {len(told) - SHOWN} more in summary.json" if len(told) > SHOWN else "") + (
        "  (estimated, by what the last meshes have changed)" if told else "")


def shown_statuses(counts: Mapping[str, list[int]] | None) -> list[str]:
    """Names of the statuses that say something: open, stick and slip only where there are such."""
    usual = [name for name in COUNTED if (counts or {}).get(name)]
    return (usual if any(any(counts[name]) for name in usual) else []) + [name for name in counts or () if name not in COUNTED]


def _statuses(summary: Mapping[str, object]) -> str:
    """Node pairs that are open, stick, slip … at the last load step."""
    counts = summary.get("status_counts")
    if not (names := shown_statuses(counts)):  # imposed jumps alone
        return ""
    steps = len(counts[names[0]])
    when = f"  (node pairs, load step {steps} of {steps})" if steps > 1 else "  (node pairs)"
    return ", ".join(f"{counts[name][-1]:,} {name}" for name in names if any(counts[name])) + when


def _nonlinear(summary: Mapping[str, object]) -> str:
    found = summary.get("nonlinear")
    return (f"{some(found['subdomains'], NAMES)}: load steps one after the other, {found['answers']:,} answers from the last committed "
            f"one; no error bound is claimed, residuals are; off: {', '.join(found['off'])}") if found else ""


def _bolts(summary: Mapping[str, object]) -> str:
    """Sentences on the bolts' forces at the last load step."""
    return "\n".join(f"{bolt['name']}: {bolt['force'][-1]:.5g}, {bolt['state'][-1]}, shortened by {bolt['shortening'][-1]:.4g}" + (
        f"; shear {bolt['shear'][-1]:.3g}, bending {bolt['bending'][-1]:.3g}" if bolt.get("shear") else "")
        for bolt in summary.get("bolts") or ())


def hold_sentences(summary: Mapping[str, object], brief: bool = False) -> list[str]:
    """Sentences on bodies that are detached or weakly held, and at which load steps; ``brief``: one sentence of each kind."""
    place = "where stabilisation leaves it" if summary.get("stabilised") else "undetermined"
    return [f"{some(names, NAMES)}: {what} at load step {steps}; {'its' if len(names) == 1 else 'their'} rigid position is {place}"
            for key, what in (("detached", "pressed on by no held body"), ("weakly_held", "held, but free to move as a whole"))
            for steps, names in _alike(summary.get(key) or (), brief)]


def stabilised_sentences(summary: Mapping[str, object], brief: bool = False) -> list[str]:
    """Sentences on what stabilisation carried, and the bodies that live by it at which load steps; ``brief``: one sentence of these."""
    if not (found := summary.get("stabilised")):
        return []
    force, work = map(_times, (found["force"], found["work"]))
    text = (f"springs of ε = {found['epsilon']:.1e} carry at most {force} of the largest contact force per area, and do "
            f"{work} of the largest strain energy in work")
    weakened = ", ".join(str(after + 1) for after in found.get("weakened") or ())
    text += f"; weaker from iteration {weakened} on" if weakened else ""
    lived = [f"{some(names, NAMES)}: {'lives' if len(names) == 1 else 'live'} by them at load step {steps} (more than a tenth of the "
             "forces there)" for steps, names in _alike(found["bodies"], brief)]
    return [text, *lived] if lived else [f"{text}; no body lives by them"]


def place_sentences(summary: Mapping[str, object]) -> list[str]:
    """Sentence on how far places of bodies are determined: which are beyond a few tolerances, and which not at all."""
    found, tolerance = summary.get("places"), summary.get("tolerance")
    if not found:
        return []
    known = {name: far for name, far in found["bodies"].items() if far is not None and isfinite(far)}
    beyond = [f"{name} {far:.1e}" for name, far in known.items() if tolerance is None or far > FAR * tolerance]
    text = [f"{some(sorted(found['bodies'].keys() - known), NAMES)}: not determined, as next to nothing holds "
            f"{'it' if len(found['bodies']) == len(known) + 1 else 'them'}"] * (len(known) < len(found["bodies"]))
    rest = "all others" if text else "bodies"
    return ["; ".join(text + ([f"{rest} stand within {max(known.values()):.1e} of the largest displacement of their places"
                               + (": " + some(beyond, NAMES) if beyond else "")] if known else []))]


def own_errors(summary: Mapping[str, object]) -> str:
    """Bodies whose own error, beside their own energy, is far beyond the one that is told of all together; empty without any."""
    found, asked = summary.get("error_shares"), summary.get("tolerance")
    known = {name: inf if own is None else own for name, own in (found or {"own": {}})["own"].items()}
    beyond = [f"{name} {own:.1e}" if isfinite(own) else f"{name} all of it" for name, own in known.items() if asked and own > OWN * asked]
    return (f"{some(beyond, NAMES)}, beside their own energy, which is little of all bodies'; where that matters, a smaller tolerance.error"
            if beyond else "")


def _times(share: float | None) -> str:
    return "any number of times" if share is None else f"{share:.1e}"


def _alike(named: Iterable[list[str]], brief: bool = False) -> list[tuple[str, list[str]]]:
    """Load steps, and the names that are told at these and no others, from the names per load step; ``brief``: all in one."""
    when: dict[str, list[str]] = {}
    for step, names in enumerate(named, 1):
        for name in names:
            when.setdefault(name, []).append(str(step))
    alike: dict[str, list[str]] = {}
    for name, steps in when.items():
        alike.setdefault(", ".join(steps), []).append(name)
    if brief and len(alike) > 1:
        steps = sorted({step for each in when.values() for step in each}, key=int)
        return [(f"{', '.join(steps)}, or some of these", list(when))]
    return list(alike.items())


def _size(summary: Mapping[str, object]) -> str:
    words = {"dofs": "dof", "subdomains": "subdomain", "interfaces": "interface", "load_steps": "load step"}
    return ", ".join(f"{summary[key]:,} {word}{'s' * (summary[key] != 1)}" for key, word in words.items() if summary.get(key) is not None)


def _time(summary: Mapping[str, object]) -> str:
    timing = summary.get("timing") or {}
    if (total := timing.get("total")) is None:
        return ""
    stages = sorted(stage_seconds(timing)[:-1], key=lambda stage: -stage[1])[:LARGEST]
    rest = total - sum(seconds for _, seconds in stages)
    parts = [f"{label} {seconds:.2f}" for label, seconds in stages] + [f"the rest {rest:.2f}"] * (bool(stages) and rest >= 0.005)
    text = f"{total:.2f} s" + (": " + ", ".join(parts) if parts else "")
    if own := blackbox_seconds(timing):
        text += f"\nblack box {own:.2f} s of its own clock, summed over its workers"
        if (workers := summary.get("workers")) and total:
            text += f" ({100 * own / (workers * total):.0f} % of {workers} × {total:.2f} s)"
    return text


def told_by_code(summary: Mapping[str, object]) -> bool:
    """Whether it is worth saying what each code has taken: there are several, or one was asked for a compliance."""
    codes = summary.get("codes") or ()
    return len(codes) > 1 or any(entry["compliances"] for entry in codes)


def _codes(summary: Mapping[str, object]) -> str:
    """Seconds in each code and in the orchestrator."""
    rows = []
    for entry in summary["codes"] if told_by_code(summary) else ():
        count, asked = len(entry["subdomains"]), entry["compliances"]
        rows.append(f"{code_label(entry)}: {entry['seconds']['total']:.2f} s of CPU for {count} subdomain{'s' * (count != 1)}" + (
            f"; asked once for the interface compliance of {len(asked)} of them ({sum(note['unit_loads'] for note in asked):,} unit loads, "
            f"{sum(note['seconds'] for note in asked):.2f} s), cheaper than a run per iteration" if asked else ""))
    return "\n".join(rows + [_numbers(summary, "orchestrator_seconds", "orchestrator: {:.2f} s of wall clock, between requests")]
                     * bool(rows))


def _workers(summary: Mapping[str, object]) -> str:
    """Sentence on the workers' idleness in the iterations."""
    period = (summary.get("workload") or {}).get("iterations") or {}
    if not (workers := period.get("workers")):
        return ""
    total = sum(row["seconds"] for row in workers)
    waiting, idle, messages = (100 * sum(row[name] for row in workers) / total for name in ("waiting", "idle", "messages"))
    return (f"idle for {waiting + idle:.0f} % of the {period['seconds']:.2f} s of iterations (for the orchestrator {idle:.0f} %, for each "
            f"other {waiting:.0f} %); messages {messages:.0f} %")


def _ranks(summary: Mapping[str, object]) -> str:
    """Sentence on what ranks send each other and hold."""
    ranks = ((summary.get("workload") or {}).get("iterations") or {}).get("ranks") or ()
    if len(ranks) < 2 or not (count := summary.get("iterations")):
        return ""
    idle, messages, sums, sent, memory = ([row[name] for row in ranks]
                                          for name in ("idle_share", "messages", "reductions", "bytes", "memory_peak_mb"))
    memory = summary.get("rank_memory_peak_mb") or memory
    each = [f"{100 * share:.0f}" for share in idle]
    told = ", ".join(each) if len(each) <= SHOWN else f"{100 * min(idle):.0f} to {100 * max(idle):.0f}"
    return (f"idle for {told} % of the iterations, waiting for each other; per iteration and rank at most "
            f"{max(messages) / count:.1f} messages, {max(sums) / count:.1f} of them sums over all ranks, {max(sent) / count / 1e6:.2f} MB; "
            f"{min(memory):,.0f} to {max(memory):,.0f} MB at the peak, codes not counted; "
            + ("each made its part of the scene" if summary.get("scene_in_pieces") else "rank 0 made the scene"))


def _skipped(summary: Mapping[str, object]) -> str:
    """Sentence on what was not done because the scene does not need it, and which switch of ``method.skip`` allowed it."""
    return "; ".join(f"{', '.join(f'{count:,} {what}' for what, count in entry['saved'].items())} ({entry['skip']})"
                     for entry in summary.get("skipped") or ())


# label → a function of the summary, or a key of it and the format of what is there
_LINES: tuple[tuple[str, object], ...] = (
    ("run", ("name", "{}")), ("result", _result), ("verdict", lambda summary: "\n".join(verdict(summary))),
    ("peak stress", _peak("peak_stress", "von Mises, ", "stress")),
    ("peak displ.", _peak("peak_displacement", "", "length")), ("reactions", _forces(loads=False)),
    ("tools", _tools), ("loads", _forces(loads=True)), ("probes", _probes), ("certified", intervals),
    ("what to do", _sentences("advice")), ("iterations", _iterations),
    ("load path", lambda summary: "\n".join(found["sentence"] for found in summary.get("load_path") or ())),
    ("error bound", _error), ("own errors", own_errors), ("backward", _backward),
    ("true error", ("true_error", "{:.2e}  (against the undecomposed solution)")),
    ("law residual", ("residuals.law_residual", "{:.2e}  (equilibrium and interface laws, the largest relative residual)")),
    ("no balance", lambda summary: "\n".join(balance_sentences(summary))),
    ("mesh's error", _mesh), ("mesh bound", _mesh_bound), ("accuracy", _accuracy), ("off by", _off), ("interfaces", _statuses), ("nonlinear", _nonlinear), ("bolts", _bolts),
    ("stabilised", lambda summary: "\n".join(stabilised_sentences(summary, brief=True))),
    ("places", lambda summary: "\n".join(place_sentences(summary))),
    ("not held", lambda summary: "\n".join(hold_sentences(summary, brief=True))), ("warning", _sentences("warnings")), ("size", _size),
    ("element", ("element", "{}")), ("time", _time), ("codes", _codes), ("workers", _workers), ("ranks", _ranks), ("skipped", _skipped),
    ("memory", ("memory_peak_mb", "{:,.0f} MB at the peak")))
