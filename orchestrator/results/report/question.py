"""What was asked, as sections of a report: model, matter, supports and loads, interfaces; settings that are not the defaults."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from orchestrator.config.method import Method
from orchestrator.results.report.document import heading, plain, table
from orchestrator.results.summary.summary import place_text, units_of

_BESIDE = ("on", "part", "history", "name")  # keys of an entry that are not what it prescribes


def question(summary: Mapping[str, object]) -> list[str]:
    """Model, matter, supports and loads, interfaces, as tables; nothing of a summary without a configuration."""
    config = summary.get("config") or {}
    if not config.get("boundary"):
        return []
    units, rest = units_of(summary), lambda entry, known: ", ".join(f"{k}: {flow(v)}" for k, v in entry.items() if k not in known)
    own = [{**part["material"], "on": [part["name"]]} for part in config.get("parts") or () if part.get("material")]
    matter = [(str(k), flow(entry.get("on", ["*"])), *(flow(entry.get(key, "")) for key in ("young", "poisson", "density")))
              for k, entry in enumerate([*(config.get("materials") or ()), *own], 1)]
    between = [(b if isinstance(b := entry.get("between", ""), str) else " – ".join(s if isinstance(s, str) else flow(s) for s in b),
                str(entry.get("law", "")), rest(entry, ("between", "law"))) for entry in config.get("interfaces") or ()]
    tables = [(("material", "on", "Young's modulus", "Poisson's ratio", "density"), matter),
              (("boundary", "prescribed", "value", "history"), list(_entries(config["boundary"]))),
              (("volumes", "load", "value", "history"), list(_entries(config.get("loads") or ()))),
              (("between", "law", "parameters"), between),
              (("bolt", "how it is tightened"), [(flow(bolt.get("on")), rest(bolt, ("on",))) for bolt in config.get("bolts") or ()]),
              (("history", "factors, one per load step"), [(name, flow(f)) for name, f in (config.get("histories") or {}).items()])]
    told = f"Lengths in{units['length']}, forces in{units['force']}, stresses and moduli in{units['stress']}."
    return [heading("The question"), plain(_asked(summary, config)), *(table(head, rows) for head, rows in tables if rows),
            *[told] * bool(units["length"])]


def _asked(summary: Mapping[str, object], config: Mapping[str, object]) -> str:
    mesh = config.get("mesh") or {}
    source = next((f"{key} {mesh[key] if isinstance(mesh[key], str) else ''}".strip() for key in
                   ("file", "step", "beam", "box", "polycrystal") if mesh.get(key)), "")
    made = f"Mesh: {source}" if source else f"{len(config.get('parts') or ())} parts"
    code = config.get("blackbox") or {}
    element = str(summary.get("element") or (code[0] if isinstance(code, list) else code).get("element"))[:2]
    size = f"{summary['dofs']:,} dofs, " if summary.get("dofs") else ""
    return (f"What displacements, stresses and forces follow from these supports and loads? {made}; {size}"
            f"{ {'P1': 'four-node tets, ', 'P2': 'ten-node tets, '}.get(element, '')}{summary.get('load_steps') or 1} load step(s).")


def _entries(entries: Sequence[Mapping[str, object]]) -> Iterator[tuple[str, ...]]:
    for entry in entries:
        what = [key for key in entry if key not in _BESIDE]
        where = ", ".join(entry["on"]) if isinstance(entry["on"], list) else place_text(entry["on"], entry.get("part"))
        yield (where, ", ".join(what),
               "; ".join(flow(entry[key]) for key in what), flow(entry.get("history", "")))


def settings(config: Mapping[str, object]) -> list[tuple[str, str]]:
    """Key and value of what is not the default of ``method``, and of ``subdomains`` and ``blackbox``."""
    usual = dict(_flat("method", Method().model_dump(mode="json", exclude_none=True)))
    rows = [row for row in _flat("method", config.get("method") or {}) if usual.get(row[0]) != row[1]]
    return [*_flat("subdomains", config.get("subdomains")), *rows, *_flat("blackbox", config.get("blackbox"))]


def _flat(name: str, value: object) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _flat(f"{name}.{key}", item)
    elif isinstance(value, list) and value and isinstance(value[0], Mapping):
        for k, item in enumerate(value):
            yield from _flat(f"{name}[{k}]", item)
    elif value is not None:
        yield name, flow(value)


def flow(value: object) -> str:
    """A value as one would write it in the YAML, on one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        text = ", ".join(map(flow, value))
        return text if all(isinstance(x, str) for x in value) else f"[{text}]"
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "free"}[value]
    return f"{value:.6g}" if isinstance(value, (int, float)) else str(value)
