"""The published JSON Schemas, by which jsonschema judges what the program writes."""

import json
from pathlib import Path

import jsonschema

SCHEMAS = Path(__file__).resolve().parents[2] / "docs" / "reference" / "schemas"


def check_file(name: str, path: Path) -> None:
    """Judge a file by the schema of a name; what is wrong is raised."""
    schema = json.loads((SCHEMAS / f"{name}.schema.json").read_text(encoding="utf-8"))
    jsonschema.validate(json.loads(path.read_text(encoding="utf-8")), schema)
