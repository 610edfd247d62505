"""Promise: the published JSON Schemas are those of the files that the program writes.

The judge is jsonschema, which is not ours.
"""

import json
import runpy
from pathlib import Path

import jsonschema
import pytest

import stepblocks
from oracles.published_schemas import SCHEMAS, check_file

ROOT = Path(__file__).resolve().parents[1]
WRITER = runpy.run_path(str(ROOT / "docs" / "json_schemas.py"))


@pytest.mark.parametrize("name", WRITER["PUBLISHED"])
def test_a_published_schema_is_what_the_types_say(name):
    # mended by: python docs/json_schemas.py
    text = (SCHEMAS / f"{name}.schema.json").read_text(encoding="utf-8")
    assert text == WRITER["format_schema"](WRITER["PUBLISHED"][name])
    jsonschema.Draft202012Validator.check_schema(json.loads(text))


def test_every_schema_is_published_by_the_command():
    assert {path.name for path in SCHEMAS.iterdir()} == {
        f"{name}.schema.json" for name in WRITER["PUBLISHED"]
    }


def test_a_build_writes_what_its_schemas_say(shipped_output):
    check_file("manifest", shipped_output / "manifest.json")
    for record in sorted(shipped_output.glob("*/*/record.json"))[:5]:
        check_file("stimulus-record", record)


def test_a_study_writes_what_its_schema_says(tmp_path):
    stepblocks.design_study([20e-6, 40e-6], tmp_path / "study", participants=2, seed=1)
    check_file("study-plan", tmp_path / "study" / "plan.json")


def test_a_schema_refuses_what_the_program_does_not_write(tmp_path):
    stepblocks.design_study([20e-6, 40e-6], tmp_path / "study", participants=2, seed=1)
    path = tmp_path / "study" / "plan.json"
    plan = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(plan | {"schema": 2}), encoding="utf-8")
    with pytest.raises(jsonschema.ValidationError):
        check_file("study-plan", path)
