"""The command line. Rooms are imported inside the commands, so that checking a file stays quick."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from orchestrator.errors import BAD_INPUT, CONVERGED, NOT_CONVERGED, visible, wrong
from orchestrator.ending import guarded, whole
from orchestrator.registry import CODES

if TYPE_CHECKING:
    from orchestrator.config.model import Config

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, epilog=(
    "A first run: orchestrator init my.yaml, orchestrator check my.yaml, orchestrator run "
    "my.yaml. Of a command's options: COMMAND --help."))
# what commands are listed under
BEGIN, SOLVE = "To begin", "To solve"
RESULTS, REST = "Results", "Installation, codes of your own, studies"


def _version(asked: bool) -> None:
    if asked:
        from orchestrator import __version__

        print(f"orchestrator {__version__}")
        raise typer.Exit


@app.callback()
def every_command(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True,
                                          help="print the version and end")] = False) -> None:
    """Multiscale domain decomposition around an untouched finite element code."""


def command(panel: str) -> Callable[[Callable[..., int | None]], Callable[..., int | None]]:
    """A command, listed under ``panel``, that ends with the exit code it returns, 0 for None, or as
    its error says.

    What solves nothing and is about files, the first of several ranks does alone.
    """
    def entered(does: Callable[..., int | None]) -> Callable[..., int | None]:
        @app.command(rich_help_panel=panel)
        @wraps(does)
        def ended(**options: object) -> None:
            from orchestrator.parallel.team import launched

            if panel not in (BEGIN, RESULTS) or not launched()[0]:
                guarded(lambda: does(**options) or CONVERGED)

        return does

    return entered


def flag(name: str, meaning: str) -> object:
    """The type of an option that is there or not."""
    return Annotated[bool, typer.Option(name, help=meaning)]


def folder(meaning: str) -> object:
    """The type of --output."""
    return Annotated[Optional[Path], typer.Option("--output", help=meaning)]


ConfigFile = Annotated[Path, typer.Argument(metavar="CONFIG", help="the YAML file")]
Overrides = Annotated[Optional[list[str]], typer.Option(
    "--set", metavar="KEY=VALUE",
    help="change an entry, such as method.tolerance.error=1e-8 (repeatable)")]
RunPrograms = flag("--run-programs",
                   "run the programs, interpreters and forms that CONFIG names, as run does")


@command(BEGIN)
def init(files: Annotated[list[Path], typer.Argument(metavar="[CONFIG] FILE...", help=(
             "the YAML file to write, none: called as the first of the others; then mesh, STEP "
             "and BREP files, none: a beam"))],
         h: Annotated[Optional[float],
                      typer.Option(
                          help="element size for STEP and BREP files; none: by thickness and "
                               "curvature")] = None
         ) -> int | None:
    """Write a commented configuration to begin with: names, pairs and bolts of the files filled
    in.
    """
    from orchestrator.begin import begin

    named = files[0].suffix.lower() in (".yaml", ".yml")
    print(
        visible(
            "\n".join(
                begin(files[0] if named else Path(f"{files[0].stem}.yaml".removeprefix("gmsh:")),
                      files[named:], h))))


@command(BEGIN)
def check(config: ConfigFile, overrides: Overrides = None,
          syntax_only: flag("--syntax-only", "stop before meshing") = False,
          run_programs: RunPrograms = False) -> int | None:
    """Show everything wrong with a configuration and its mesh; solve nothing."""
    from orchestrator.config.load import asked_of

    def lines(config: Config) -> list[str]:
        if syntax_only:
            return ["OK"]
        from orchestrator.inspect import checked

        return checked(config, run_programs)

    print(visible("\n".join(asked_of(config, overrides or [], lines, edited=True))))


@command(BEGIN)
def inspect(
    source: Annotated[Path,
                      typer.Argument(metavar="CONFIG|FILE",
                                     help="a YAML file, or a mesh, STEP or BREP file")],
            overrides: Overrides = None,
    h: Annotated[Optional[float], typer.Option(help="element size for STEP and BREP files")] = None,
            run_programs: RunPrograms = False) -> int | None:
    """List volumes, surfaces, and the pairs of parts that lie on each other, with area, distance
    and sides.
    """
    from orchestrator.config.load import asked_of
    from orchestrator.inspect import inspected, listed

    if source.suffix.lower() not in (".yaml", ".yml"):
        lines = inspected(source, h)
    else:
        lines = asked_of(source, overrides or [], lambda config: listed(config, run_programs))
    print(visible("\n".join(lines)))


@command(SOLVE)
def run(config: ConfigFile, overrides: Overrides = None,
        output: folder("results folder, instead of the one in CONFIG") = None,
        resume: flag("--resume", "go on from the checkpoint in the results folder") = False,
        reference: flag("--reference", "also solve undecomposed; report the true error") = False,
        quiet: flag("--quiet", "print nothing but errors") = False,
        verbose: flag("--verbose", "print all of the summary, not only what most look for") = False,
        start_from: Annotated[Optional[Path], typer.Option(
            metavar="DIR", help="begin with the state that the run of another results folder has "
            "ended with: same mesh, other loads, friction, gaps or tolerance")] = None,
        ) -> int | None:
    """Solve a problem and write its results."""
    from orchestrator.launch import launch

    return launch(config, overrides or [], verbose, output=output, resume=resume,
                  reference=reference, quiet=quiet, start_from=start_from)


@command(SOLVE)
def sweep(config: ConfigFile,
          vary: Annotated[Optional[list[str]], typer.Option(
              metavar="KEY=VALUE,VALUE",
              help="what to vary, such as bolts.0.force=5e3,1e4; bolts.*.force varies all together "
                   "(repeatable: every combination)")] = None,
          zipped: flag("--zip", "several --vary: first values together, then second ones") = False,
          overrides: Overrides = None,
          output: folder("its folder, instead of results/NAME_sweep") = None,
          resume: flag("--resume", "run no variant again that the folder has") = False,
          figures: flag("--figures", "draw every variant, not only the table") = False,
          quiet: flag("--quiet", "print nothing but errors") = False) -> int | None:
    """Run a configuration with different values: a table, a picture, and a results folder for
    each.
    """
    from orchestrator.launch import join
    from orchestrator.sweeps.variants import variants_of

    if join().size > 1:
        raise wrong((), "a sweep on several ranks",
                    "one process: a sweep runs its variants one after the other",
                    "start it without mpiexec; or each variant by itself, mpiexec orchestrator "
                    "run … --set …")
    variants = variants_of(vary or [], zipped)
    from orchestrator.sweeps.sweep import Sweep

    return Sweep(config, overrides or [], variants,
                 output or Path("results") / f"{config.stem}_sweep", figures, quiet).run(resume)


@command(RESULTS)
def report(
    directory: Annotated[Path,
                         typer.Argument(metavar="DIR", help="a results folder")]) -> int | None:
    """Draw the figures and a readable report from a results folder."""
    from orchestrator.results.report.report import report as write

    write(directory)


@command(RESULTS)
def compare(one: Annotated[Path, typer.Argument(metavar="A", help="a results folder")],
            other: Annotated[Path, typer.Argument(metavar="B", help="another one")]) -> int | None:
    """Show two results side by side; exit code 0 where they are equal to within the errors they
    tell, else 1.
    """
    from orchestrator.results.compare import compare as compared

    found = compared(one, other)
    print(visible("\n".join([f"A {one}, B {other}", "", *found.lines()])))
    return NOT_CONVERGED if found.different else CONVERGED


@command(REST)
def doctor() -> int | None:
    """Tell whether all that runs need is installed (else exit code 2), and which other codes and
    packages are there.
    """
    from orchestrator.blackbox.start import doctor as codes
    from orchestrator.method.sparse import cholmod
    from orchestrator.optional import absent, command as brings, WANTED
    from orchestrator.parallel import petsc

    library, solver = cholmod.library(), petsc.library()
    lines = [
        *codes(), *(f"without {name}: {use}; {brings(name)}"
                    for name, (_, use) in WANTED.items() if absent(name)),
        "without CHOLMOD: SuperLU factorises, slower in large scenes; Debian: libcholmod3, conda: "
        "suitesparse" if library is None else f"CHOLMOD: {library._name}",
        f"without PETSc, which spreads macro problems of many ranks: {solver}"
        if isinstance(solver, str) else
        f"PETSc {'.'.join(map(str, solver.Sys.getVersion()))} with MUMPS: {solver.__file__}"]
    if not absent("numba"):
        lines.append(compiled_once())
    print("\n".join(lines))
    return BAD_INPUT if any(line.startswith("missing") for line in lines) else CONVERGED


def compiled_once() -> str:
    """Compile all loops of contact, so that nobody's first run has to, if that has not been done
    for this package, Python and compiler; return a line that tells where they are.
    """
    from orchestrator.compiled import kept_in
    from orchestrator.config.load import load_config
    from orchestrator.solving import solve

    done = kept_in() / "done"
    if not done.exists():
        # the smallest scene that calls every loop, which its first few iterations compile
        solve(load_config(Path(__file__).with_name("loops.yaml")).config)
        with suppress(OSError):
            done.touch()
    return f"loops of contact: compiled, and kept in {done.parent}"


@command(REST)
def conformance(
    code: Annotated[str,
                    typer.Argument(metavar="CODE",
                                   help=f"{', '.join(CODES)}, or your own: solver.py")],
                transport: Annotated[Optional[str],
                                     typer.Option(
                                         help="pipe or file; default: all the code has")] = None,
                timeout: Annotated[float,
                                   typer.Option(
                                       help="seconds one answer may take")] = 60.0) -> int | None:
    """Run a code against the black box protocol: is it fit to take part?"""
    from orchestrator.blackbox.trial.trial import try_out

    return try_out(code, transport, timeout)


@command(REST)
def schema(
    keys: flag("--keys", "every key with its meaning, as Markdown, instead") = False) -> int | None:
    """Print the JSON schema of configurations, for editors that complete and check as one types."""
    if keys:
        from orchestrator.config.reference import reference as write
    else:
        from orchestrator.config.reference import schema as write

    print(write(), end="")


@command(REST)
def study(
    name: Annotated[Optional[str], typer.Argument(metavar="NAME", help="none: list them")] = None,
          overrides: Annotated[Optional[list[str]], typer.Option(
              "--set", metavar="KEY=VALUE",
              help="change a setting of the study, if it has any (repeatable)")] = None,
          output: folder("its folder, instead of results/studies/NAME") = None,
          resume: flag("--resume", "repeat no run that the folder has") = False) -> int | None:
    """Run a study of the paper or a benchmark: a matrix of configurations, a table and a figure."""
    _find_benchmarks()
    from benchmarks.registry import STUDIES, run_study

    if name in STUDIES:
        run_study(name, output, overrides or [], resume)
        return None
    listing = "\n".join(f"  {key:{max(map(len, STUDIES))}} {line}" for key, line in STUDIES.items())
    if name is None:
        print(f"Studies:\n{listing}")
        return None
    from orchestrator.config.explain import nearest

    raise wrong((), f"study '{name}'", "one of\n" + listing,
                nearest(name, list(STUDIES), otherwise="take one of these"))


def _find_benchmarks() -> None:
    """Let the folder ``benchmarks`` beside this package be imported; InputError where there is
    none, as in a wheel.
    """
    clone = Path(__file__).resolve().parents[1]
    if not (clone / "benchmarks" / "registry.py").is_file():
        raise wrong((), "a study in an installation without the folder benchmarks",
                    "a clone of the project: studies are in its repository, wheels do not have "
                    "them",
                    "run it in a clone, after `make setup`")
    sys.path.insert(0, str(clone))


def main() -> None:
    """Run the command line."""
    whole(app)
