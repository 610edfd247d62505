"""What a design plans beside its trials: plan.json."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from stepblocks.errors import StudyError
from stepblocks.study.design.adaptive import Prior, parse_prior

FILE_NAME = "plan.json"
ORDER_OF_TRIALS = "order"  # the covariate that a plan may name
QUESTION = "How real did it feel?"
ANCHORS = ("not at all real", "completely real")
_SCHEMA = 1
_LONGEST_WORDS = 80  # letters of a question or an anchor


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
    covariate : str
        ``"order"`` where the order of trials is in the mixed models; empty for none.
    question : str
        That asks for a rating of realism.
    anchors : tuple of str
        What the lowest and the highest rating mean.
    """

    primary: str = ""
    reference: str = ""
    prior: Prior | None = None
    covariate: str = ""
    question: str = QUESTION
    anchors: tuple[str, ...] = ANCHORS

    def __post_init__(self) -> None:
        if self.covariate not in ("", ORDER_OF_TRIALS):
            raise StudyError(f"covariate must be {ORDER_OF_TRIALS!r}, got {self.covariate!r:.60}")
        _check_words("question", (self.question,), 1)
        _check_words("anchors", self.anchors, 2)

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
            "covariate": self.covariate,
            "question": self.question,
            "anchors": list(self.anchors),
        }
        return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _check_words(option_name: str, words: Sequence[str], word_count: int) -> None:
    """Reject words that a participant cannot read, or another number of them."""
    are_different = len(words) == word_count and len(set(words)) == word_count
    if are_different and all(map(_is_readable_text, words)):
        return
    texts = "text"
    if word_count > 1:
        texts = "texts"
    shown = ", ".join(map(repr, words))
    raise StudyError(
        f"{option_name} must be {word_count} different {texts} of at most {_LONGEST_WORDS} "
        f"letters, got {shown:.120}"
    )


def _is_readable_text(text: object) -> bool:
    """Return whether a participant can read a text, which is not too long."""
    if not isinstance(text, str) or len(text) > _LONGEST_WORDS:
        return False
    return bool(text.strip()) and text.isprintable()


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
            return Plan(prior=parse_prior({}))
        document = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(document, dict):
            raise TypeError("a JSON object is expected")
        prior = parse_prior(document.get("prior", {}))
        return Plan(
            str(document["primary"]),
            str(document["reference"]),
            prior,
            str(document.get("covariate", "")),
            str(document.get("question", QUESTION)),
            tuple(document.get("anchors", ANCHORS)),
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise StudyError(
            f"plan.json must be as 'study design' wrote it: {error!r:.60} [{path}]"
        ) from error


def read_prior(folder: Path) -> Prior:
    """Read the prior of an adaptive design."""
    prior = read_plan(folder).prior
    assert prior is not None  # it is completed where it is read
    return prior
