"""The tables of a results folder in one workbook (.xlsx), or each as a .parquet file, by pandas where it is installed."""

from __future__ import annotations

import os
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from orchestrator.errors import wrong
from orchestrator.optional import check_there
from orchestrator.results.summary.summary import NAME as SUMMARY, numbers_of, read_summary

if TYPE_CHECKING:
    from pandas import DataFrame

WRITERS = {".xlsx": "openpyxl", ".parquet": "pyarrow"}  # ending → what pandas writes it with
ROWS = 1_048_575  # of a sheet, below its head


def export(directory: str | os.PathLike[str], target: str | os.PathLike[str]) -> list[Path]:
    """Writes all tables of a results folder, of a sweep or of a comparison, and the numbers of its summary.

    target : a workbook ``.xlsx``, with a sheet for each table; or ``NAME.parquet``, which becomes ``NAME-interfaces.parquet`` …
    Returns the files written; those that were there are replaced
    Raises InputError: another ending, pandas or its writer is not there, no tables, a table too long for a sheet, no room
    """
    folder, path = Path(directory), Path(target)
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise wrong((), f"{path}", f"a name that ends with {' or '.join(WRITERS)}", "write results.xlsx, say")
    for package in ("pandas", writer):
        check_there(package)
    import pandas

    tables = _tables(folder)
    if not tables:
        raise wrong((), f"no tables in {folder}", "a folder that run, sweep or compare has written", "name such a folder")
    book = path.suffix.lower() == ".xlsx"
    if book and (long := [name for name, table in tables.items() if len(table) > ROWS]):
        raise wrong((), f"{long[0]}.csv has more than {ROWS:,} lines", "tables that fit in a sheet", "write .parquet files")
    files = {name: path if book else path.with_name(f"{path.stem}-{name}{path.suffix}") for name in tables}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with pandas.ExcelWriter(path, engine=writer) if book else nullcontext() as sheets:
            for name, table in tables.items():
                if book:
                    table.to_excel(sheets, sheet_name=name[:31], index=False)
                else:
                    table.to_parquet(files[name], engine=writer, index=False)
        return list(dict.fromkeys(files.values()))
    except OSError as error:
        raise wrong((), f"{path} cannot be written: {error.strerror or error}", "a folder that can be written to",
                    "choose another place") from error


def _tables(folder: Path) -> dict[str, DataFrame]:
    """Name → table: those of the folder, and of the numbers of a summary."""
    import pandas

    found = {}
    if (folder / SUMMARY).is_file():
        found["summary"] = pandas.DataFrame(list(numbers_of(read_summary(folder)).items()), columns=["name", "value"])
    for path in sorted(folder.glob("*.csv")):
        try:
            found[path.stem] = pandas.read_csv(path)
        except (OSError, ValueError) as error:
            raise wrong((), f"{path} cannot be read: {error}", "a table of a results folder", "run the configuration again") from error
    return found
