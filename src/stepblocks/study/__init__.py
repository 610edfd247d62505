"""The experiments on people, from the design to the report."""

from pandas import DataFrame as Table

from stepblocks.contact import Array
from stepblocks.errors import StudyError

__all__ = ["RATINGS", "Array", "Table", "require"]

RATINGS = (1, 7)  # lowest and highest rating


def require(holds: object, rule: str) -> None:
    """Refuse what breaks a rule; the rule says what was got instead."""
    if not holds:
        raise StudyError(rule)
