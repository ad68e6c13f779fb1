"""Prints the table that `semcal experiment` has kept in a folder, to write it into its place of a page.

    semcal experiment pairs --jobs 2
    python tests/benchmarks/kept_table.py semcal_experiments/pairs "semcal experiment pairs --jobs 2" \\
        --into docs/rivals.md#pairs

COMMAND is the one that measured the results.
"""

from pathlib import Path

from benchmark import KeptTable, script
from laboratory.page_tables import read_measured

from semcal_cli.experiments.experiment_run import TABLE
from semcal_cli.files.input_files import read_text


def main(folder: Path, command: str) -> KeptTable:
    return KeptTable(read_text(folder / TABLE), read_measured(folder), command)


if __name__ == "__main__":
    script(main)
