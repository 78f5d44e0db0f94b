"""Large problems beside the strongest other solvers, and what grows with the number of subdomains.

Whole pipelines, mesh, assembly and solution, to the same relative error of 1e-6 in the energy norm. Ours is the command
line's wall time, from the start of Python to the summary, and ends when the guaranteed bound is small enough. A rival is
charged for the mesh as we make it, for FreeFEM's assembly in one process, and for what it does with that matrix until its
true error is small enough, which it is told (``rivals``). That both solved the same problem is seen from the energies.

Parts: ``rivals``, easy and hard cubes; ``many``, the same cube in ever more subdomains, more of the same subdomains, and
what surrounds the codes; ``cuts``, iterations of hard cubes cut into 64 and more; ``million``, a million dofs; ``beam``,
a small run with all that is written and drawn;
``direct``, not run unless asked for, FreeFEM's direct solvers, whose memory does not suffice for a million.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import Field, PositiveFloat, PositiveInt

from benchmarks.kit.commands import CORES, codes_seconds, cpu_of_children, whole_command
from benchmarks.kit.drawing import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY, panels
from benchmarks.kit.settings import Keys
from benchmarks.kit.study import ACCURATE, Study
from benchmarks.problems.cases import beam, cube
from benchmarks.problems.cubes import named
from benchmarks.studies import in_one_piece
from benchmarks.studies.rivals.layers import layers_of, layers_of_rival, tell
from benchmarks.studies.rivals.rivals import RIVALS, Written, compete, present, write_problem
from orchestrator import BlackBoxError

OURS, UNLIKE = "ours", "ours, no use of congruence"
_COLOURS = {OURS: BLUE, UNLIKE: SKY, "PETSc, GAMG": ORANGE, "PETSc, hypre": RED, "pyamg": PURPLE, "PETSc, MUMPS": GREEN}

Case = Literal["easy", "random", "incompressible", "thin", "squeezed"]
Method = Literal["gamg", "hypre", "pyamg", "mumps", "pardiso", "cholmod"]


class Settings(Keys):
    """What to run."""

    parts: list[Literal["rivals", "many", "cuts", "million", "beam", "direct"]] = Field(
        ["rivals", "many", "cuts", "million", "beam"], description="parts of the study")
    cases: list[Case] = Field(["easy", "random", "incompressible", "thin"], description="cubes for the rivals")
    rivals: list[Method] = Field(list(RIVALS), description="the other solvers")
    ranks: PositiveInt = Field(2, description="of PETSc")
    blocks: Annotated[int, Field(ge=2)] = Field(4, description="subdomains along the side of the rivals' cubes")
    elements: Annotated[int, Field(ge=2)] = Field(10, description="bricks along the side of each; with 4 blocks, 206,763 dofs")
    counts: list[Annotated[int, Field(ge=2)]] = Field(
        [4, 10, 20], description="subdomains along the side of the same cube cut ever finer, each a divisor of its bricks")
    growth: list[Annotated[int, Field(ge=2)]] = Field(
        [4, 8, 16], description="subdomains along the side, each of 4³ bricks")
    cuts: list[Annotated[int, Field(ge=2)]] = Field(
        [4, 5, 7, 8, 10], description="subdomains along the side of the cube with moduli at random")
    around: tuple[int, int] = Field((10, 6), description="subdomains along the side, and bricks, for what surrounds the codes")
    million: tuple[int, int] = Field((7, 10), description="the same of the million dofs")
    patience: PositiveFloat = Field(120.0, description="seconds after which a rival has failed")
    most: PositiveInt = Field(100, description="iterations after which ours has failed")


def run(study: Study, settings: Settings = Settings()) -> None:
    """The parts, one after the other; table and figure grow with each row."""
    study.columns = ("part", "case", "method", "dofs", "subdomains", "stop_reason", "iterations", "bound", "before", "codes",
                     "seconds", "cpu_seconds", "memory_mb", "others")
    bench = Bench(study, settings)
    for part, function in (("rivals", rivals), ("many", many), ("cuts", cuts),
                           ("million", million), ("beam", small)):
        if part in settings.parts:
            function(bench)
    if bench.rows:
        study.figure(picture(bench.rows))
    if "direct" in settings.parts:
        in_one_piece.run(study)


class Bench:
    """Runs and keeps rows.

    Parameters
    ----------
    study, settings : as for ``run``

    Attributes
    ----------
    rows : so far, of this study's own parts
    layers : of the rivals' cubes, pipeline → where its seconds go
    """

    def __init__(self, study: Study, settings: Settings):
        self.study, self.settings = study, settings
        self.rows: list[dict[str, Any]] = []
        self.layers: dict[str, dict[str, float]] = {}

    def row(self, name: str, asked: Mapping[str, Any], labels: Mapping[str, Any], measure) -> dict[str, Any]:
        """A row, kept or measured.

        Parameters
        ----------
        name : of the file that keeps it; asked : what it depends on; measure : () → its columns
        """
        def measured() -> dict[str, Any]:
            others = round(os.getloadavg()[0], 1)
            return {**labels, **measure(), "others": others}

        row = dict(self.study.kept(f"row-{name}", asked, measured))
        if (layers := row.pop("layers", None)) and row["part"] == "rivals":
            self.layers[f"{row['case']}, {row['method']}"] = layers
        self.rows.append(row)
        self.study.note(row, told(row))
        return row

    def ours(self, part: str, case: str, config: dict[str, Any], method: str = OURS, **more: Any) -> dict[str, Any]:
        """The whole command on a configuration, as a row; a failure is one of the results."""
        config = {**config, "method": {"tolerance": {"error": ACCURATE}, "max_iterations": self.settings.most, **more}}

        def measure() -> dict[str, Any]:
            begin = cpu_of_children()
            try:
                summary, seconds = whole_command(self.study, config["name"], config, output="run")
            except BlackBoxError as error:
                return {"stop_reason": " ".join(str(error).split())[:120], "failed": True}
            return {"dofs": summary["dofs"], "subdomains": summary["subdomains"], "iterations": summary["iterations"],
                    "stop_reason": summary["stop_reason"], "failed": not summary["converged"],
                    "bound": summary["error_bound"], "energy": max(summary["energy"]),
                    "codes": codes_seconds(summary), "seconds": seconds, "layers": layers_of(summary["timing"], seconds),
                    "cpu_seconds": cpu_of_children() - begin, "memory_mb": round(summary["memory_peak_mb"])}

        name = f"{part}-{case}-{'unlike' if method == UNLIKE else 'ours'}".replace(" ", "-").replace("³", "")
        return self.row(name, {"config": config}, {"part": part, "case": case, "method": method}, measure)

    def unlike(self, part: str, case: str, config: dict[str, Any]) -> dict[str, Any]:
        """The same, no use made of subdomains' being alike."""
        return self.ours(part, case, config, UNLIKE, skip={"congruent": False})


def rivals(bench: Bench) -> None:
    """Ours and all that are installed, on every cube."""
    settings, study = bench.settings, bench.study
    here = present(settings.rivals, lambda sentence: study.console.print(f"  {sentence}"))
    better = []
    for case in settings.cases:
        config = named(case, study.folder, settings.blocks, settings.elements)
        found = [bench.ours("rivals", case, config)]
        if case == "easy":
            found.append(bench.unlike("rivals", case, config))
        written: list[Written] = []  # once, and only where a rival has to run

        def problem() -> Written:
            if not written:
                written.append(write_problem({"blackbox": {}, **config}, study.folder / "matrix"))
            return written[0]

        others = [bench.row(f"rivals-{case}-{rival.method}", {"config": config, "ranks": settings.ranks,
                                                              "patience": settings.patience},
                            {"part": "rivals", "case": case, "method": rival.label},
                            lambda rival=rival: _competing(rival, problem(), settings)) for rival in here]
        judge(study, case, found, others, better)
    if bench.layers:
        tell(study, bench.layers)
    hard = [case for case in settings.cases if case not in ("easy", "squeezed")]
    if len(hard) > 1 and here:
        study.target("hard cubes on which ours takes no longer than the best rival", f"at least {len(hard) - 1} of {len(hard)}",
                     f"{len(set(better) & set(hard))}: {', '.join(better) or 'none'}", len(set(better) & set(hard)) >= len(hard) - 1)


def _competing(rival, problem: Written, settings: Settings) -> dict[str, Any]:
    answer = compete(rival, problem, settings.ranks, settings.patience, ACCURATE)
    before = problem.mesh + problem.assembly
    row = {"dofs": problem.dofs, "subdomains": 1, "failed": not answer["solved"], "before": before,
           "stop_reason": "solved" if answer["solved"] else answer["failure"]}
    if answer["solved"]:
        row |= {"iterations": answer["iterations"], "energy": answer["energy"], "seconds": before + answer["seconds"],
                "layers": layers_of_rival(problem.mesh, problem.assembly, answer["set_up"], answer["seconds"]),
                "assembly": problem.assembly, "cpu_seconds": before + answer["cpu_seconds"], "memory_mb": round(answer["memory_mb"])}
    return row


def judge(study: Study, case: str, ours: Sequence[Mapping[str, Any]], others: Sequence[Mapping[str, Any]],
          better: list[str]) -> None:
    """Targets of one cube; ``better`` takes its name where ours is."""
    solved = [row for row in others if not row["failed"]]
    for row in solved:
        for own in ours:
            if not own["failed"] and not abs(own["energy"] / row["energy"] - 1) <= ACCURATE:
                study.target(f"{case}: energies of {own['method']} and {row['method']}", f"within {ACCURATE:g}",
                             f"{own['energy']:.12g}, {row['energy']:.12g}", False)
    if case == "easy":
        strong = next((row for row in solved if row["method"] == RIVALS["gamg"].label), None)
        limits = (1.0, 1.5)
    else:
        strong, limits = min(solved, key=lambda row: row["seconds"], default=None), (1.0,)
    if strong is None:
        return
    for own, limit in zip(ours, limits):
        if own["failed"]:
            study.target(f"{case}: {own['method']}", "converged", own["stop_reason"], False)
            continue
        ratio = own["seconds"] / strong["seconds"]
        shared = own["seconds"] / (strong["seconds"] - strong["assembly"] * (1 - 1 / CORES))
        study.target(f"{case}: {own['method']} over {strong['method']}, wall", f"at most {limit:g}",
                     f"{own['seconds']:.1f} / {strong['seconds']:.1f} s = {ratio:.2f} ({shared:.2f} were its assembly shared by "
                     f"all cores; CPU {own['cpu_seconds'] / strong['cpu_seconds']:.2f})", ratio <= limit)
        if own is ours[0] and ratio <= limit:
            better.append(case)


def many(bench: Bench) -> None:
    """The same cube in ever more subdomains; ever more of the same subdomains; what surrounds the codes."""
    settings, target = bench.settings, bench.study.target
    bricks = settings.blocks * settings.elements
    finer = [bench.ours("many", f"{n}³ subdomains", _plain(n, bricks // n)) for n in settings.counts]
    if len(finer) > 1 and not any(row["failed"] for row in finer):
        few, more, *_ = finer
        ratio = more["seconds"] / few["seconds"]
        target(f"{more['subdomains']:,} subdomains over {few['subdomains']:,} of the same cube, wall", "at most 1",
               f"{more['seconds']:.1f} / {few['seconds']:.1f} s = {ratio:.2f}; CPU {more['cpu_seconds'] / few['cpu_seconds']:.2f}",
               ratio <= 1)
    for row in finer[2:]:
        target(f"{row.get('subdomains', 0):,} subdomains", "60 s, 4 GB", _size(row),
               not row["failed"] and row["seconds"] <= 60 and row["memory_mb"] <= 4000)
    weak = [bench.ours("many", f"{n}³ of 4³ bricks", _plain(n, 4)) for n in settings.growth]
    if len(weak) > 1 and not any(row["failed"] for row in weak):
        each = [row["seconds"] / row["subdomains"] for row in weak]
        growth = max(b / a for a, b in zip(each, each[1:]))
        target("seconds per subdomain, from one number of subdomains of 4³ bricks to eight times as many", "at most × 1.3",
               f"{', '.join(f'{1000 * s:.1f}' for s in each)} ms: × {growth:.2f}", growth <= 1.3)
    row = bench.unlike("many", f"{settings.around[0]}³ of {settings.around[1]}³ bricks", _plain(*settings.around))
    if not row["failed"]:
        ratio = row["seconds"] / (row["codes"] / CORES)
        target(f"{row['subdomains']:,} different subdomains, {row['dofs']:,} dofs: wall over the codes' CPU seconds per core",
               "at most 2", f"{row['seconds']:.1f} / {row['codes'] / CORES:.1f} s = {ratio:.2f}", ratio <= 2)


def cuts(bench: Bench) -> None:
    """Iterations of the rivals' cubes: moduli at random in ever more subdomains, METIS's parts, ν = .49, .4999, a plate."""
    settings, folder = bench.settings, bench.study.folder
    blocks, bricks = settings.blocks, settings.blocks * settings.elements
    easy = named("easy", folder, blocks, settings.elements)
    cases = [(f"random, {n}³ subdomains", named("random", folder, n, bricks // n), 22) for n in settings.cuts]
    squeezed = [(f"ν = {ratio}", {**easy, "name": f"squeezable-{ratio}", "materials": [{"young": 200e3, "poisson": ratio}]}, most)
                for ratio, most in ((0.49, 36), (0.4999, 100))]
    cases += [(f"{blocks**3} METIS parts", {**easy, "name": "metis", "subdomains": {"metis": blocks**3}}, 28),
              *squeezed,
              ("a plate, 30:1", named("thin", folder, blocks, settings.elements), 30)]
    for case, config, most in cases:
        row = bench.ours("cuts", case, config)
        bench.study.target(f"{case}: iterations to a bound of {ACCURATE:g}", f"at most {most}",
                           row["stop_reason"] if row["failed"] else f"{row['iterations']}, {_size(row)}",
                           not row["failed"] and row["iterations"] <= most)


def million(bench: Bench) -> None:
    """A million dofs, easy and with moduli at random."""
    each, folder = bench.settings.million, bench.study.folder
    row = bench.ours("million", f"{each[0]}³ subdomains", _plain(*each))
    bench.study.target(f"{row.get('dofs', 0):,} dofs", "20 s, 3 GB", _size(row),
                       not row["failed"] and row["seconds"] <= 20 and row["memory_mb"] <= 3000)
    row = bench.ours("million", f"random, {each[0]}³ subdomains", named("random", folder, *each))
    bench.study.target("moduli at random: iterations", "at most 22", f"{row.get('iterations', 0)}, {_size(row)}",
                       not row["failed"] and row["iterations"] <= 22)


def small(bench: Bench) -> None:
    """The beam of the first example with everything that is written and drawn."""
    config = {**beam(32), "output": {"fields": True, "figures": True}}
    row = bench.ours("beam", "32 slices", config)
    bench.study.target("the beam, whole command with figures", "1.2 s", _size(row), not row["failed"] and row["seconds"] <= 1.2)


def _plain(count: int, elements: int) -> dict[str, Any]:
    return {**cube(count, elements), "name": f"cubes-{count}-{elements}", "output": {"fields": False, "figures": False}}


def _size(row: Mapping[str, Any]) -> str:
    if row["failed"]:
        return row["stop_reason"]
    return f"{row['seconds']:.1f} s (CPU {row['cpu_seconds']:.1f}), {row['memory_mb']:,} MB, bound {row['bound']:.1e}"


def told(row: Mapping[str, Any]) -> str:
    """A row as a line."""
    what = f"{row['part']}, {row['case']}, {row['method']}: {row['stop_reason']}"
    if "seconds" not in row:
        return what
    count = f"{row['iterations']} iterations, " if row["iterations"] else ""
    return f"{what}, {count}{row['seconds']:.1f} s, CPU {row['cpu_seconds']:.1f} s, {row['memory_mb']:,} MB"


def picture(rows: Sequence[Mapping[str, Any]]):
    """Seconds of everybody on every cube; seconds over the number of subdomains."""
    figure, ((left, right),) = panels(1, 2, (11.0, 4.0), width_ratios=(3, 2))
    against = [row for row in rows if row["part"] == "rivals" and not row["failed"]]
    cases, methods = (list(dict.fromkeys(row[key] for row in against)) for key in ("case", "method"))
    for place, method in enumerate(methods):
        those = [row for row in against if row["method"] == method]
        left.bar([cases.index(row["case"]) + (place - len(methods) / 2 + 0.5) * 0.85 / len(methods) for row in those],
                 [row["seconds"] for row in those], 0.8 / len(methods), color=_COLOURS.get(method, GREY), label=method)
    left.set_xticks(range(len(cases)), cases)
    left.set_title("whole pipelines to 1e-6, wall seconds", fontsize=10, color=GREY)
    for kind, colour, label in (("subdomains", BLUE, "the same cube"), ("of 4³ bricks", ORANGE, "4³ bricks each")):
        those = [row for row in rows if row["part"] == "many" and not row["failed"] and row["case"].endswith(kind)]
        right.loglog([row["subdomains"] for row in those], [row["seconds"] for row in those], "o-", color=colour, label=label)
    right.set_title("wall seconds over subdomains", fontsize=10, color=GREY)
    return figure
