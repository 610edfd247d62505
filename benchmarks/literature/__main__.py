"""Write the comparison with the literature: ``python -m literature out/evidence``."""

import sys
from pathlib import Path

from literature.compare import hold_against_evidence


def main(folder: Path) -> None:
    """Compare, write page and tables, and print every verdict."""
    found = hold_against_evidence(folder)
    print(found.table.drop(columns=["said"]).to_string(index=False))
    print(found.finding())
    print(f"open {folder / 'evidence.html'}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/evidence"))
