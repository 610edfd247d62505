"""Write the comparison with the literature: ``python -m literature out/evidence``."""

import sys
from pathlib import Path

from literature.compare import hold_against_evidence


def main(folder: Path) -> None:
    """Compare, write page and tables, and print every verdict."""
    found = hold_against_evidence(folder)
    print(found.table.drop(columns=["said"]).to_string(index=False))
    resolutions = found.resolutions.drop(columns=["setting", "energies"])
    rows = [list(resolutions.columns), *resolutions.to_numpy().tolist()]
    print("\nExplanations fitted to the band of 10 to 20 µJ\n")
    print("\n".join(f"| {' | '.join(row)} |" for row in rows))
    spread = found.explanations[0].spread
    print(f"\n{found.finding()} That equation spreads them by a factor of {spread:.0f}.")
    print(f"open {folder / 'evidence.html'}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/evidence"))
