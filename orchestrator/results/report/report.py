"""A report a person can read, made from a results folder alone: report.md, report.html and the
figures.
"""

from __future__ import annotations

import io
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path

from ruamel.yaml import YAML

from orchestrator.config.method import Method
from orchestrator.optional import check_there, DRAWING
from orchestrator.results.figures.figures import figures_apart
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.report.document import (
    Marked, heading, page, picture, plain, section, table)
from orchestrator.results.report.tables import tables
from orchestrator.results.solution import Solution
from orchestrator.results.summary.lines import summary_rows
from orchestrator.results.summary.summary import View
from orchestrator.results.summary.verdict import verdict

# words of the summary → what to cite where they are there
CITED = {
    "": "P. Oumaziz, P. Gosselet, P.-A. Boucard, M. Abbas: A parallel non-invasive multiscale "
        "strategy for a mixed domain decomposition method with frictional contact. Int. J. Numer. "
        "Meth. Eng. 115 (2018) 893–912 (the method).",
    r'"status_counts": {': "P. Oumaziz, P. Gosselet, P.-A. Boucard, S. Guinard: A non-invasive "
                           "implementation of a mixed domain decomposition method for frictional "
                           "contact problems. Comput. Mech. 60 (2017) 797–812 (contact).",
    r'"acceleration": "Anderson': "D. G. Anderson: Iterative procedures for nonlinear integral "
                                  "equations. J. ACM 12 (1965) 547–560 (acceleration).",
    r'"error_kind": "': "W. Prager, J. L. Synge: Approximations in elasticity based on the concept "
                        "of function space. Quart. Appl. Math. 5 (1947) 241–269 (error bound).",
    r'"code": "freefem"': "F. Hecht: New development in FreeFem++. J. Numer. Math. 20 (2012) "
                          "251–265 (finite elements).",
    r'"code": "calculix"': "G. Dhondt: The Finite Element Method for Three-Dimensional "
                           "Thermomechanical Applications. Wiley, 2004 (finite elements: "
                           "CalculiX).",
    r'"code": "scikit-fem"': "T. Gustafsson, G. D. McBain: scikit-fem: A Python package for finite "
                             "element assembly. J. Open Source Softw. 5 (2020) 2369 (finite "
                             "elements).",
    r'"(step|polycrystal)": ["{]': "C. Geuzaine, J.-F. Remacle: Gmsh: a 3-D finite element mesh "
                                   "generator with built-in pre- and post-processing facilities. "
                                   "Int. J. Numer. Meth. Eng. 79 (2009) 1309–1331 (meshes).",
    r'"metis": \d': "G. Karypis, V. Kumar: A fast and high quality multilevel scheme for "
                    "partitioning irregular graphs. SIAM J. Sci. Comput. 20 (1998) 359–392 "
                    "(subdomains).",
}
# the structure first, the rest where the text has come to it
_PICTURES = [
    ("deformed.png", "Deformed structure, coloured by von Mises stress; lines: sharp edges and "
     "borders of the subdomains."),
    ("interfaces.png", "The interfaces that are not perfect: where they are open, stick or slip."),
    ("convergence.png", "Convergence over the iterations, with the tolerance."),
    ("time.png",
     "Where the time went: wall clock per stage, and the black box on its own clock.")]


def report(directory: str | os.PathLike[str]) -> Path:
    """Draw the figures anew and write report.md and report.html (one file, pictures inside): the
    verdict first, the structure's picture, the lines of the summary, the tables behind them.

    directory : a results folder
    Returns path of report.md
    Raises InputError: missing folder, or not one that a run has written; disk full or folder not
        writable; a package that draws is not installed
    """
    for package in DRAWING:
        check_there(package)
    solution, folder = Solution.read(directory), ResultsFolder(directory)
    summary = solution.summary
    there = {path.name for path in figures_apart(folder, summary, solution.history,
                                                 solution.fields)}
    first, *others = [picture(f"figures/{file}", text) if file in there else ""
                      for file, text in _PICTURES]
    told = verdict(View(summary)) if solution.converged else [
        f"The run has NOT converged ({solution.stop_reason}): these numbers are of its last state."]
    parts = [heading(str(summary.get("name") or "Run"), 1), *map(Marked.of, told), first,
             table(("", ""), [row for row in summary_rows(summary) if row[0] != "verdict"]),
             *(part for each in tables(solution) for part in each.markdown),
             *section("Figures", *others), *_configuration(summary), *cited(summary)]
    text = "\n\n".join(filter(None, parts)) + "\n"
    folder.write("report.html", page(text, folder.path, str(summary.get("name"))))
    return folder.write("report.md", text)


def cited(summary: Mapping[str, object]) -> list[str]:
    """Return what to cite for what a run has used."""
    used = json.dumps(summary)
    return [heading("To cite"), "\n".join(
        f"- {plain(source)}" for words, source in CITED.items() if re.search(words, used))]


def _configuration(summary: Mapping[str, object]) -> list[str]:
    """The configuration as YAML, and the versions that have computed it."""
    config, writer, stream = _without(summary.get("config") or {}), YAML(typ="safe", pure=True), \
        io.StringIO()
    usual = Method().model_dump(mode="json", exclude_none=True)
    config["method"] = _without(config.get("method") or {}, usual)
    writer.default_flow_style, writer.sort_base_mapping_type_on_output, writer.width = \
        None, False, 100
    writer.dump({key: value for key, value in config.items() if value not in ({}, [])}, stream)
    versions = ", ".join(" ".join(item) for item in (summary.get("versions") or {}).items())
    return [heading("The question"),
            plain("The configuration, less what is the default of method. Versions: "
                  f"{versions or 'unknown'}."),
            "\n".join("    " + line for line in stream.getvalue().splitlines())]


def _without(value: Mapping[str, object], usual: object = None) -> dict[str, object]:
    """Entries that say something: no null, and none that is as usual."""
    usual, result = usual if isinstance(usual, Mapping) else {}, {}
    for key, item in value.items():
        if isinstance(item, Mapping):
            item = _without(item, usual.get(key)) or None
        if item is not None and usual.get(key) != item:
            result[key] = item
    return result
