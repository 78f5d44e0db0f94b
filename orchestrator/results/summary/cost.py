"""Sentences on what a run has taken: seconds of stages, codes, workers and ranks, and what was not done as the scene does not need it."""

from __future__ import annotations

from collections.abc import Mapping

from orchestrator.results.summary.summary import blackbox_seconds, code_label, stage_seconds

LARGEST = 6  # stages named
SHOWN = 8  # ranks


def time_sentences(summary: Mapping[str, object]) -> str:
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


def code_sentences(summary: Mapping[str, object]) -> list[str]:
    """Seconds in each code and in the orchestrator."""
    rows = []
    for entry in summary["codes"] if told_by_code(summary) else ():
        count, asked = len(entry["subdomains"]), entry["compliances"]
        rows.append(f"{code_label(entry)}: {entry['seconds']['total']:.2f} s of CPU for {count} subdomain{'s' * (count != 1)}" + (
            f"; asked once for the interface compliance of {len(asked)} of them ({sum(note['unit_loads'] for note in asked):,} unit loads, "
            f"{sum(note['seconds'] for note in asked):.2f} s), cheaper than a run per iteration" if asked else ""))
    if rows and (own := summary.get("orchestrator_seconds")) is not None:
        rows.append(f"orchestrator: {own:.2f} s of wall clock, between requests")
    return rows


def worker_sentence(summary: Mapping[str, object]) -> str:
    """Sentence on the workers' idleness in the iterations."""
    period = (summary.get("workload") or {}).get("iterations") or {}
    if not (workers := period.get("workers")):
        return ""
    total = sum(row["seconds"] for row in workers)
    waiting, idle, messages = (100 * sum(row[name] for row in workers) / total for name in ("waiting", "idle", "messages"))
    return (f"idle for {waiting + idle:.0f} % of the {period['seconds']:.2f} s of iterations (for the orchestrator {idle:.0f} %, for each "
            f"other {waiting:.0f} %); messages {messages:.0f} %")


def rank_sentence(summary: Mapping[str, object]) -> str:
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
            + ("each made its part of the scene" if summary.get("scene_in_pieces") else f"rank 0 made the scene: {summary.get('scene_left_to_one')}"))


def skipped_sentence(summary: Mapping[str, object]) -> str:
    """Sentence on what was not done because the scene does not need it, and which switch of ``method.skip`` allowed it."""
    return "; ".join(f"{', '.join(f'{count:,} {what}' for what, count in entry['saved'].items())} ({entry['skip']})"
                     for entry in summary.get("skipped") or ())
