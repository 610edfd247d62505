"""What a design plans beside its trials: plan.json."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from stepblocks.errors import StudyError
from stepblocks.study.design.adaptive import Prior, complete_prior

FILE_NAME = "plan.json"
_SCHEMA = 1


@dataclass(frozen=True)
class Plan:
    """What is decided before the first participant comes.

    Attributes
    ----------
    primary : str
        Primary outcome; empty for the first of the experiment.
    reference : str
        Condition that the others are compared with; empty for none.
    prior : Prior or None
        Of an adaptive design.
    """

    primary: str = ""
    reference: str = ""
    prior: Prior | None = None

    def to_json(self) -> str:
        """Write the plan as the text of its file."""
        prior = {}
        if self.prior is not None:
            prior = asdict(self.prior)
        document = {
            "schema": _SCHEMA,
            "primary": self.primary,
            "reference": self.reference,
            "prior": prior,
        }
        return json.dumps(document, indent=1) + "\n"


def read_plan(folder: Path) -> Plan:
    """Read the plan of a study; a folder without one, of an earlier version, plans nothing.

    A prior that is not stated, or not completely, is completed.

    Raises
    ------
    StudyError
        If the file is not as `design_study` writes it.
    """
    path = folder / FILE_NAME
    try:
        if not path.exists():
            return Plan(prior=complete_prior({}))
        document = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(document, dict):
            raise TypeError("a JSON object is expected")
        prior = complete_prior(document.get("prior", {}))
        return Plan(str(document["primary"]), str(document["reference"]), prior)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise StudyError(
            f"plan.json must be as 'study design' wrote it: {error!r:.60} [{path}]"
        ) from error


def read_prior(folder: Path) -> Prior:
    """Read the prior of an adaptive design."""
    prior = read_plan(folder).prior
    assert prior is not None  # it is completed where it is read
    return prior
