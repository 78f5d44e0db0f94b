"""Subdomains of any shape: METIS parts of an irregular mesh, and the solids of an assembly."""

from __future__ import annotations

from pathlib import Path

from benchmarks.studies.stages import COLUMNS, picture
from benchmarks.kit.study import Case, Study
from benchmarks.problems.bracket import bracket
from benchmarks.problems.cases import assembly as assembly_problem
from benchmarks.problems.cases import defaults, with_method

METIS_STAGES = 25


def metis(study: Study) -> None:
    """64 parts of a bracket with a hole."""
    study.columns = COLUMNS
    problem = bracket(Path(study.folder.path))
    study.solve(Case(with_method(problem, defaults()), {"case": "64 METIS parts"}))
    found = study.rows[-1]["stages_to_true_error"]
    study.target("METIS, 64 parts of an irregular mesh: true error ≤ 1e-6", f"at most {METIS_STAGES} stages", found,
                 found is not None and found <= METIS_STAGES)
    study.figure(picture(study, "A bracket in 64 METIS parts, defaults"))


def assembly(study: Study) -> None:
    """18 bonded solids; the plate is clamped at its base and the rod pulled."""
    study.columns = COLUMNS
    study.solve(Case(with_method(assembly_problem(), defaults()), {"case": "18 solids, bonded"}))
    row = study.rows[-1]
    study.target("as1-tu-203.stp, 18 solids bonded", "true error ≤ 1e-6; time and stages reported",
                 f"{row['true_error']:.1e} after {row['iterations']} stages, {row['seconds']} s with meshing",
                 row["true_error"] <= 1e-6)
    study.figure(picture(study, "The assembly as1-tu-203 in its 18 solids, defaults"))
