"""The experiments on people, from the design to the report."""

from typing import TYPE_CHECKING

from stepblocks.contact import Array
from stepblocks.errors import StudyError

__all__ = ["Array", "Table", "require"]

if TYPE_CHECKING:
    from pandas import DataFrame as Table
else:
    Table = object  # pandas is imported where a table is made


def require(holds: object, rule: str) -> None:
    """Refuse what breaks a rule; the rule says what was got instead."""
    if not holds:
        raise StudyError(rule)
