"""What a report begins with: what was asked. Model, matter, supports and loads, interfaces, as tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from orchestrator.config.method import Method
from orchestrator.results.report.document import heading, plain, table
from orchestrator.results.summary.words import place_text, units_of

_BESIDE = ("on", "history", "name")  # keys of an entry that are not what it prescribes


def question(summary: Mapping[str, object]) -> list[str]:
    """The question; nothing of a summary without a configuration."""
    config = summary.get("config") or {}
    if not config.get("boundary"):
        return []
    units = units_of(summary)
    parts = [heading("The question"), plain(_in_words(summary, config))]
    tables = [(("material", "on", "Young's modulus", "Poisson's ratio", "density"), list(_materials(config))),
              (("boundary", "prescribed", "value", "history"), list(_entries(config["boundary"]))),
              (("volumes", "load", "value", "history"), list(_entries(config.get("loads") or ()))),
              (("between", "law", "parameters"), list(_interfaces(config.get("interfaces") or ()))),
              (("bolt", "how it is tightened"), [(flow(bolt.get("on")), _rest(bolt, ("on",))) for bolt in config.get("bolts") or ()]),
              (("history", "factors, one per load step"), [(name, flow(f)) for name, f in (config.get("histories") or {}).items()])]
    parts += [table(head, rows) for head, rows in tables if rows]
    if units["length"]:
        parts.append(f"Lengths in{units['length']}, forces in{units['force']}, stresses and moduli in{units['stress']}.")
    return parts


def _in_words(summary: Mapping[str, object], config: Mapping[str, object]) -> str:
    mesh = config.get("mesh") or {}
    source = next((f"{key} {flow(mesh[key]) if isinstance(mesh[key], str) else ''}".strip() for key in
                   ("file", "step", "beam", "box", "polycrystal") if mesh.get(key)), "")
    made = f"mesh: {source}" if source else f"{len(config.get('parts') or ())} parts"
    code = config.get("blackbox") or {}
    codes = code if isinstance(code, list) else [code]
    element = {"P1": "four-node", "P2": "ten-node"}.get(str(summary.get("element") or codes[0].get("element"))[:2], "")
    size = f"{summary['dofs']:,} dofs, " if summary.get("dofs") else ""
    return (f"What displacements, stresses and forces follow from these supports and loads? {made[0].upper()}{made[1:]}; "
            f"{size}{element + ' tets, ' if element else ''}{summary.get('load_steps') or 1} load step(s).")


def _materials(config: Mapping[str, object]) -> Iterator[tuple[str, ...]]:
    own = [{**part["material"], "on": [part["name"]]} for part in config.get("parts") or () if part.get("material")]
    for k, matter in enumerate([*(config.get("materials") or ()), *own]):
        yield (str(k + 1), flow(matter.get("on", ["*"])), *(flow(matter.get(key, "")) for key in ("young", "poisson", "density")))


def _entries(entries: Sequence[Mapping[str, object]]) -> Iterator[tuple[str, ...]]:
    for entry in entries:
        on = entry["on"]
        place = ", ".join(on) if isinstance(on, list) else place_text(on)
        what = [key for key in entry if key not in _BESIDE]
        yield (place, ", ".join(what), "; ".join(flow(entry[key]) for key in what), flow(entry.get("history", "")))


def _interfaces(entries: Sequence[Mapping[str, object]]) -> Iterator[tuple[str, ...]]:
    for entry in entries:
        between = entry.get("between", "")
        yield (between if isinstance(between, str) else " – ".join(between), str(entry.get("law", "")), _rest(entry, ("between", "law")))


def _rest(entry: Mapping[str, object], known: Sequence[str]) -> str:
    return ", ".join(f"{key}: {flow(value)}" for key, value in entry.items() if key not in known)


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
        return ", ".join(map(flow, value)) if all(isinstance(x, str) for x in value) else "[" + ", ".join(map(flow, value)) + "]"
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "free"}[value]
    return f"{value:.6g}" if isinstance(value, (int, float)) else str(value)
