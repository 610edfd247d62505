"""Who feels it: the experiments on people, from the design to the report."""

from stepblocks.errors import StudyError


def require(holds: object, rule: str) -> None:
    """Refuse what breaks a rule; the rule says what was got instead."""
    if not holds:
        raise StudyError(rule)
