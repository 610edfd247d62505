"""Write the bill of materials of an installation as CycloneDX 1.5.

python benchmarks/bill_of_materials.py FILE.cdx.json

Run it with the Python into which the wheel was installed: it lists that installation, each package
with version, licence and what it needs. The same installation gives the same bytes.
"""

from __future__ import annotations

import json
import os
import re
import sys
import uuid
from datetime import UTC, datetime
from importlib.metadata import Distribution, distributions
from pathlib import Path
from typing import Any

from licences import licence

SPECIFICATION = "1.5"
PRODUCT = "stepblocks"
TOOLS = {"pip"}  # comes with the environment, not with the product


def normalised(name: str) -> str:
    """Write the name of a package as the index does."""
    return re.sub(r"[-_.]+", "-", name).lower()


def reference(one: Distribution) -> str:
    """Write the package URL of a distribution."""
    return f"pkg:pypi/{normalised(one.metadata['Name'])}@{one.version}"


def component(one: Distribution) -> dict[str, Any]:
    """Describe one package."""
    return {
        "type": "library",
        "bom-ref": reference(one),
        "name": one.metadata["Name"],
        "version": one.version,
        "purl": reference(one),
        "licenses": [{"license": {"name": licence(one)}}],
    }


def needed(one: Distribution, known: dict[str, Distribution]) -> list[str]:
    """List what a package needs and is installed; extras are left out."""
    names = [
        re.split(r"[\s;<>=!~\[(]", text, maxsplit=1)[0]
        for text in one.requires or []
        if "extra ==" not in text
    ]
    return sorted({reference(known[normalised(n)]) for n in names if normalised(n) in known})


def bill(installed: list[Distribution]) -> dict[str, Any]:
    """Make the bill of the distributions of an environment."""
    known = {
        normalised(one.metadata["Name"]): one
        for one in installed
        if one.metadata["Name"] and normalised(one.metadata["Name"]) not in TOOLS
    }
    product = known.pop(PRODUCT)
    others = [known[name] for name in sorted(known)]
    known[PRODUCT] = product
    body = {
        "components": [component(one) for one in others],
        "dependencies": [
            {"ref": reference(one), "dependsOn": needed(one, known)} for one in [product, *others]
        ],
    }
    moment = datetime.fromtimestamp(int(os.environ.get("SOURCE_DATE_EPOCH", "0")), UTC)
    number = uuid.uuid5(uuid.NAMESPACE_URL, reference(product) + json.dumps(body, sort_keys=True))
    return {
        "bomFormat": "CycloneDX",
        "specVersion": SPECIFICATION,
        "serialNumber": f"urn:uuid:{number}",
        "version": 1,
        "metadata": {
            "timestamp": moment.isoformat().replace("+00:00", "Z"),
            "component": {**component(product), "type": "application"},
        },
        **body,
    }


def main() -> int:
    """Write the bill."""
    if len(sys.argv) != 2:
        print("usage: bill_of_materials.py FILE.cdx.json", file=sys.stderr)
        return 2
    text = json.dumps(bill(list(distributions())), indent=1, ensure_ascii=False) + "\n"
    Path(sys.argv[1]).write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
