"""A run from the command line: this process is all of it, or one of several ranks that it joins."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from orchestrator import folders
from orchestrator.errors import BAD_INPUT, InputError, wrong
from orchestrator.optional import command
from orchestrator.parallel.team import ALONE, Elsewhere, launched, share_memory, Team
from orchestrator.processes import check_addresses


def launch(config: Path, overrides: list[str], verbose: bool, **options: object) -> int | None:
    """Run a configuration: its exit code; None where another rank tells of an error.

    overrides, verbose : as of ``load_config`` and ``run.Means``; options : as of ``run.run``
    """
    check_addresses()
    team = join()
    try:
        with team.together():
            if team.rank:
                from orchestrator.run import follow

                return follow(team)
            return _lead(team, config, overrides, verbose, **options)
    except BaseException as error:
        if team.lost():
            folders.sweep()  # what the lost ones left
        if not team.speaks():
            return None
        raise team.cause(error)


def _lead(team: Team, config: Path, overrides: list[str], verbose: bool, **options: object) -> int:
    """Run on rank 0; errors of the configuration say where in the file they are."""
    from orchestrator.config.load import load_config, located  # other ranks read none
    from orchestrator.results.figures.artist import artist_for

    loaded = load_config(config, overrides, edited=True)
    # before the run's imports: it has as much to import
    with artist_for(loaded.config.output.figures) as artist:
        from orchestrator.run import Means, Ranks, run
        if loaded.config.refines:
            from orchestrator.accuracy.loop import run

        try:
            code = run(loaded, means=Means(Ranks(team), artist, verbose=verbose), **options)
            if not team.parted:
                team.share(None)  # there is nothing more to solve
            return code
        except (InputError, Elsewhere) as error:
            cause = team.cause(error)
            raise located(cause, loaded) if isinstance(cause, InputError) else error


def join() -> Team:
    """Return the team that this process belongs to.

    Raises InputError: started by mpiexec, but mpi4py is missing or belongs to another MPI
    """
    rank, size = launched()
    if size == 1:
        return ALONE
    share_memory()
    try:
        team = import_module("orchestrator.parallel.mpi").MpiRanks()
    except (ImportError, RuntimeError) as error:
        found = f"mpi4py cannot be imported: {error}"
        cure = f"{command('mpi4py')} brings mpi4py and an MPI with its mpiexec"
    else:
        if team.size == size:
            return team
        found = f"{size} processes started by mpiexec, of which each sees {team.size}"
        cure = "take the mpiexec of the MPI that mpi4py uses: .venv/bin/mpiexec after set-up"
    if rank:
        raise SystemExit(BAD_INPUT)  # rank 0 says why
    raise wrong((), found, "mpi4py and mpiexec of one MPI", cure)
