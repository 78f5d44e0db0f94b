"""A run from the command line: this process is all of it, or one of several ranks."""

from __future__ import annotations

from pathlib import Path

from orchestrator.errors import InputError
from orchestrator.parallel.team import Elsewhere, join, Team
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
            from orchestrator import folders

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
