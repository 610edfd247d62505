"""One root for every error a user can cause, one subclass per stage.

The message of each is a single line that says name, rule, value and place, for example
``edge_radius must not exceed height (10 um), got 12.5 um [stimuli/x.toml, block step-010]``.
"""


class RuleError(Exception):
    """A broken rule; the message says which."""


class StepblocksError(RuleError):
    """A mistake that the user can correct; a command prints it in one line and exits with 2.

    Attributes
    ----------
    exit_code : int
        Code with which a command ends, always 2.
    """

    exit_code = 2


class QuantityError(StepblocksError, ValueError):
    """A quantity that cannot be read.

    It is also a ValueError, so that pydantic reports it with the place of the field.
    """


class StimulusError(StepblocksError):
    """A stimulus file that asks for something malformed or impossible."""


class SolidError(StepblocksError):
    """A shape that the CAD kernel could not make or that came out invalid."""


class MachiningError(StepblocksError):
    """A file for the workshop that could not be written."""


class HapticsError(StepblocksError):
    """A file for the simulator that could not be written."""


class MetrologyError(StepblocksError):
    """An artefact or a scan that cannot be read or evaluated."""


class ContactError(StepblocksError):
    """A prediction asked for outside the domain of its equation."""


class BenchError(StepblocksError):
    """A measured session that cannot be read."""


class StudyError(StepblocksError):
    """A design or a table of judgements that cannot be analysed."""


class PipelineError(StepblocksError):
    """A run that cannot start or go on: output folder, selection, options."""


class UsageError(StepblocksError, TypeError, ValueError):
    """A declared part, or a value of another public class, was made with fields it cannot have.

    It is also a TypeError, as Python raises for a wrong keyword, and a ValueError, as pydantic
    raises for a wrong value.
    """


class ReadingWarning(UserWarning):
    """What a reader had to find out about a file: its encoding, its separators, what is missing.

    A command prints it as a note; a script may turn it into an error with `warnings`.

    Parameters
    ----------
    note : str
        What was found out.
    place : object
        The file.
    """

    def __init__(self, note: str, place: object = "") -> None:
        super().__init__(note, place)
        self.note = note
        self.place = place

    def __str__(self) -> str:
        """Return the note with its file."""
        return f"{self.note} [{self.place}]"
