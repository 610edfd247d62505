"""The experiments on people, from the design to the report."""

from pandas import DataFrame as Table

from stepblocks.contact import Array
from stepblocks.errors import StudyError

__all__ = ["RATINGS", "Array", "Table", "require"]

RATINGS = (1, 7)  # lowest and highest rating
require = StudyError.require
