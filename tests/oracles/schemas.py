"""Published schemas, where they are installed: their licences let nobody but their publishers hand
them on with a program.

`STEPBLOCKS_SCHEMAS` names a folder (beside the repository: ``schemas``) with QIF 3.0 in ``qif3``
(QIFApplications, QIFLibrary, Check, samples; qifstandards.org) and the DCC with D-SI in ``dcc``
(v3.3.0; ptb.de/dcc).
"""

import os
from pathlib import Path

import pytest
from lxml import etree

ROOT = Path(os.environ.get("STEPBLOCKS_SCHEMAS") or Path(__file__).parents[3] / "schemas")
QIF, CHECKS, DCC = (
    "qif3/QIFApplications/QIFDocument.xsd",
    "qif3/Check/Check.xsl",
    "dcc/v3.3.0/dcc.xsd",
)


def installed(name):
    path = ROOT / name
    if not path.exists():
        pytest.skip(f"needs {name} under STEPBLOCKS_SCHEMAS")
    return path


def faults(name, document):
    """What a schema says against a document."""
    schema = etree.XMLSchema(etree.parse(installed(name)))
    schema.validate(etree.parse(document))
    return [str(error) for error in schema.error_log]


def findings(document):
    """What the checks that are published with QIF say against a document."""
    report = etree.XSLT(etree.parse(installed(CHECKS)))(etree.parse(document))
    return [
        etree.tostring(one)
        for one in report.getroot().iter()
        if len(one) == 0 and (one.text or one.attrib)
    ]
