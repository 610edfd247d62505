"""Run the tutorials as notebooks, each in an empty folder, and keep them in out/tutorials.

python benchmarks/notebooks.py [NAME ...]
"""

import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import jupytext
import nbformat
from nbclient import NotebookClient
from traitlets.config import Config

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    output = ROOT / "out" / "tutorials"
    shutil.copytree(ROOT / "docs" / "images", output / "images", dirs_exist_ok=True)
    for source in sorted((ROOT / "docs" / "tutorials").glob("*.md")):
        if sys.argv[1:] and source.stem not in sys.argv[1:]:
            continue
        notebook = jupytext.read(source)
        for cell in notebook.cells:
            cell.source = cell.source.replace("](../images/", "](images/")
        with TemporaryDirectory() as folder:
            # the kernel is spoken to through files of ours, not through ports that anybody on the
            # machine reads
            private = Config({"KernelManager": {"transport": "ipc", "ip": f"{folder}/kernel"}})
            place = {"metadata": {"path": folder}}
            NotebookClient(notebook, timeout=600, resources=place, config=private).execute()
        nbformat.write(notebook, output / f"{source.stem}.ipynb")
        cells = sum(cell.cell_type == "code" for cell in notebook.cells)
        print(f"{source.stem}: {cells} cells ran [{output / source.stem}.ipynb]", flush=True)


if __name__ == "__main__":
    main()
