"""Hashes of inputs, code and outputs of a build.

Uses the standard library only, so that an up-to-date build costs nothing.
"""

import hashlib
import json
import platform
from collections.abc import Iterable, Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import stepblocks
from stepblocks.files.atomic import replace_text, resolve_inside
from stepblocks.files.text import Document, measure_file_size

MANIFEST = "manifest.json"  # in the output folder
RECORD = "record.json"  # in the folder of each stimulus

_MOST_BYTES = 500_000_000  # of a manifest

# libraries whose version can change a byte that is written
_SHAPING = (
    "cadquery",
    "cadquery-ocp",
    "jinja2",
    "manifold3d",
    "matplotlib",
    "numpy",
    "plotly",
    "pyvista",
    "shapely",
    "tifffile",
    "trimesh",
    "vtk",
)

# what other commands leave beside a build: title, and where; {} stands for set and stimulus
_BESIDE = {
    "the page to feel": "feel.html",
    "evidence": "evidence/evidence.html",
    "the closed loop": "loop/report.html",
    "the study": "study/report/report.html",
}
_OF_A_PART = {
    "drawing": "{}/*.drawing.pdf",
    "drawing, SVG": "{}/*.drawing.svg",
    "drawing, DXF": "{}/*.drawing.dxf",
    "inspection sheet": "{}/*.inspection-sheet.html",
    "sheet to fill in": "{}/*.inspection-sheet.csv",
    "inspection plan": "{}/*.plan.qif",
    "setup sheet": "{}/*.setup.html",
    "stock": "{}/*.stock.step",
    "routes": "{}/*.routes.csv",
    "gauge blocks, STEP": "{}/*.gauge.step",
    "inspection": "inspect/*{id}*.inspection.html",
    "scene": "scenes/{}/*/README.md",
    "": "{}/{id}.*",  # whatever else was written for it, by the end of its name
}


def hash_bytes(content: bytes) -> str:
    """Hash bytes."""
    return hashlib.sha256(content).hexdigest()


def hash_file(path: Path) -> str:
    """Hash a file; the empty text stands for one that cannot be read."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return ""


def compute_code_fingerprint() -> str:
    """Hash this package and the versions of the libraries that shape its output."""
    root = Path(stepblocks.__file__).parent
    total = hashlib.sha256()
    for path in sorted(root.rglob("*")):
        if path.suffix in {".py", ".html", ".css", ".j2", ".toml"}:
            total.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    for name, known in _list_libraries().items():
        total.update(f"{name}=={known}\n".encode() if known else f"{name} missing\n".encode())
    return total.hexdigest()


def _list_libraries() -> dict[str, str]:
    found = dict.fromkeys(_SHAPING, "")
    for name in _SHAPING:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def describe_environment() -> dict[str, object]:
    """Describe Python, platform, C library and libraries of this process.

    The C library matters: its sine has last bits of its own.
    """
    system = " ".join(filter(None, (platform.system(), platform.machine(), *platform.libc_ver())))
    return {"python": platform.python_version(), "platform": system, "libraries": _list_libraries()}


def write_sealed(path: Path, content: Mapping[str, object]) -> None:
    """Write JSON with a hash of itself; a file that was altered later is not used."""
    replace_text(
        path,
        json.dumps({**content, "seal": _compute_seal(content)}, indent=1, allow_nan=False) + "\n",
    )


def _compute_seal(content: Mapping[str, object]) -> str:
    return hash_bytes(json.dumps(content, sort_keys=True).encode())


def load_json(path: Path) -> Document:
    """Read a JSON object that this program wrote; empty for anything else."""
    try:
        content = (
            json.loads(path.read_text(encoding="utf-8"))
            if measure_file_size(path) < _MOST_BYTES
            else {}
        )
    except (OSError, ValueError, RecursionError):
        return {}
    seal = content.pop("seal", None) if isinstance(content, dict) else None
    return content if seal == _compute_seal(content) else {}


def list_outputs(record: Mapping[str, object]) -> dict[str, str]:
    """Return the hashes of the files that a manifest or a record lists."""
    outputs = record.get("outputs")
    return outputs if isinstance(outputs, dict) else {}


def load_record(folder: Path) -> Document:
    """Read the record of a stimulus; empty where it was not made or is not whole."""
    record = load_json(folder / RECORD)
    return record if list_outputs(record) else {}


def find_unchanged(folder: Path, name: str, digest: str) -> Path | None:
    """Return the file of a name if it lies in the folder and is as it was written."""
    path = resolve_inside(folder, name)
    return path if path is not None and hash_file(path) == digest else None


def are_intact(folder: Path, outputs: Mapping[str, str]) -> bool:
    """Tell whether there are files listed, all in the folder and as they were written."""
    return bool(outputs) and all(
        find_unchanged(folder, name, known) for name, known in outputs.items()
    )


def find_linked_files(output: Path, outputs: Iterable[str]) -> dict[str, list[list[str]]]:
    """Find files that other commands left beside the outputs of a build.

    Those of the whole folder stand under the empty name, those of a part under ``set/id``.
    """
    own = set(outputs)
    parts = [name.removesuffix(f"/{RECORD}") for name in own if name.endswith(f"/{RECORD}")]
    found = {
        "": [
            *([title, name] for title, name in _BESIDE.items() if (output / name).is_file()),
            *(
                [f"drawing of the series {path.name}", path.relative_to(output).as_posix()]
                for path in sorted(output.glob("*/*.series*"))
            ),
        ]
    }
    for part in sorted(parts):
        for title, pattern in _OF_A_PART.items():
            for path in sorted(output.glob(pattern.format(part, id=Path(part).name))):
                name = path.relative_to(output).as_posix()
                more = {"scene": f": {path.parent.name}", "": path.name.partition(".")[2]}
                if name not in own:
                    own.add(name)
                    found.setdefault(part, []).append([f"{title}{more.get(title, '')}", name])
    return found
