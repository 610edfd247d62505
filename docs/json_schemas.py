"""Write the JSON Schemas of the program's files from the types that write them.

Run: python docs/json_schemas.py
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from stepblocks.build.manifest import Manifest, StimulusRecord
from stepblocks.loop.record import LoopRecord
from stepblocks.records.inspection import InspectionRecord
from stepblocks.records.model import ModelFile
from stepblocks.study.design.plan import Plan

FOLDER = Path(__file__).resolve().parent / "reference" / "schemas"
DIALECT = "https://json-schema.org/draft/2020-12/schema"


@dataclass(frozen=True)
class Published:
    """A file whose schema is published.

    Attributes
    ----------
    title : str
        Its name, as it lies in a folder.
    written_by : str
        The command that writes it.
    kind : type
        What it is written from.
    numbered : bool
        Whether its first key is ``schema``, the number of its version, beside the fields.
    nullable : bool
        Whether numbers that JSON cannot hold are written as null.
    optional : mapping of str to sequence of str
        Keys that are left out where there is nothing to say, by the name of their object.
    open_objects : sequence of str
        Objects that are written in a form of their own, with keys that depend on what they say.
    named_tuples : sequence of str
        Tuples that are written as objects with the names of their items.
    """

    title: str
    written_by: str
    kind: type
    numbered: bool = True
    nullable: bool = False
    optional: Mapping[str, Iterable[str]] = field(default_factory=dict)
    open_objects: Iterable[str] = ()
    named_tuples: Iterable[str] = ()


PUBLISHED = {
    "loop-result": Published(
        "result.json",
        "stepblocks loop",
        LoopRecord,
        nullable=True,
        optional={"ScansRecord": ("mean_edge_radius_m", "left_out")},
        open_objects=("NextExperiment",),
        named_tuples=("ExcludedTrial",),
    ),
    "loop-model": Published(
        "model.json",
        "stepblocks loop",
        ModelFile,
        numbered=False,
        nullable=True,
        optional={"ProbePart": ("friction", "contact")},
    ),
    "inspection": Published(
        "inspection.json", "stepblocks inspect", InspectionRecord, numbered=False
    ),
    "manifest": Published("manifest.json", "stepblocks build", Manifest),
    "stimulus-record": Published(
        "record.json", "stepblocks build", StimulusRecord, open_objects=("RecordedVerdict",)
    ),
    "study-plan": Published("plan.json", "stepblocks study design", Plan, open_objects=("Prior",)),
}


def write_schema(published: Published) -> dict[str, Any]:
    """Return the schema of a file."""
    schema = TypeAdapter(published.kind).json_schema(mode="serialization", by_alias=True)
    objects = {published.kind.__name__: schema, **schema.get("$defs", {})}
    for name in published.open_objects:
        objects[name].clear()
        objects[name]["type"] = "object"
    for name in published.named_tuples:
        name_items(objects[name])
    for name, keys in published.optional.items():
        needed = objects[name].get("required", [])
        objects[name]["required"] = [key for key in needed if key not in keys]
    if published.numbered:
        number = {"const": 1, "title": "Version of the format"}
        schema["properties"] = {"schema": number, **schema["properties"]}
        schema["required"] = ["schema", *schema.get("required", [])]
    if published.nullable:
        allow_null_numbers(schema)
    written = f"Written by `{published.written_by}`."
    description = f"{schema.pop('description', '')}".strip()
    return {
        "$schema": DIALECT,
        "title": published.title,
        "description": f"{written} {description}".strip(),
        **{key: value for key, value in schema.items() if key != "title"},
    }


def name_items(definition: dict[str, Any]) -> None:
    """Turn the schema of a tuple with names into that of the object that is written for it."""
    properties = {}
    for item in definition.pop("prefixItems"):
        properties[item["title"].lower().replace(" ", "_")] = item
    del definition["minItems"], definition["maxItems"]
    definition["type"] = "object"
    definition["properties"] = properties
    definition["required"] = list(properties)


def allow_null_numbers(schema: Any) -> None:
    """Let every number of a schema be null: so are numbers written that JSON cannot hold."""
    if isinstance(schema, list):
        for item in schema:
            allow_null_numbers(item)
        return
    if not isinstance(schema, dict):
        return
    if schema.get("type") == "number":
        schema["type"] = ["number", "null"]
    for item in schema.values():
        allow_null_numbers(item)


def format_schema(published: Published) -> str:
    """Return the text of a schema's file."""
    return json.dumps(write_schema(published), indent=1, ensure_ascii=False) + "\n"


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    for name, published in PUBLISHED.items():
        path = FOLDER / f"{name}.schema.json"
        path.write_text(format_schema(published), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
