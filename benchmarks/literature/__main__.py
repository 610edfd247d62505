"""Write the comparison with the literature: ``python -m literature out/evidence``."""

import sys
from pathlib import Path

import pandas as pd

from literature.compare import hold_against_evidence


def format_markdown(table: pd.DataFrame) -> str:
    """Write a table as Markdown, in which an empty cell keeps its place."""
    lines = [list(table.columns), ["---"] * table.shape[1], *table.to_numpy().tolist()]
    return "\n".join(f"| {' | '.join(map(str, cells))} |" for cells in lines)


def main(folder: Path) -> None:
    """Compare, write page and tables, and print every verdict."""
    found = hold_against_evidence(folder)
    print("Published figures beside the model\n")
    print(format_markdown(found.table.drop(columns=["said"])))
    print("\nExplanations fitted to the band of 10 to 20 µJ\n")
    print(format_markdown(found.resolutions.drop(columns=["setting", "energies"])))
    spread = found.explanations[0].spread
    print(f"\n{found.finding()} That equation spreads them by a factor of {spread:.0f}.")
    print(f"open {folder / 'evidence.html'}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/evidence"))
