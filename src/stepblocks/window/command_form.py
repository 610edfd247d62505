"""A form for a command: its questions, the command that follows from the answers, and its job."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from nicegui import ui

from stepblocks.errors import PipelineError, StepblocksError
from stepblocks.window import texts
from stepblocks.window.command_line import (
    ShownCommand,
    format_function_call,
    protect_leading_hyphen,
)
from stepblocks.window.folder import Folder
from stepblocks.window.frame import show_heading, show_mistake
from stepblocks.window.job_view import Runnable
from stepblocks.window.jobs import Job, JobList


def split_at_commas(text: str) -> list[str]:
    """Return the entries of a list with commas."""
    return list(map(str.strip, text.split(",")))


@dataclass(frozen=True)
class Question:
    """What a form asks for one option of a command.

    Attributes
    ----------
    name : str
        Of the answer.
    label : str
        What the form says.
    option : str
        The option, such as ``--seed``; empty for an argument: a file or folder by its name.
    keyword : str
        The same of the function; empty for an argument of it.
    default : str
        What the field says at first.
    choices : sequence of str
        What can be chosen; anything can be typed where there are none.
    read : callable
        Turns the answer into what the function takes; raises ValueError.
    is_required : bool
        Whether the command stands only when it is answered.
    is_of_function : bool
        Whether the function takes it, too.
    is_name : bool
        Whether it names a file or folder, which must lie in that of the window.
    """

    name: str
    label: str
    option: str = ""
    keyword: str = ""
    default: str = ""
    choices: Sequence[str] = ()
    read: Callable[[str], object] = str
    is_required: bool = False
    is_of_function: bool = True
    is_name: bool = False

    def make_command_words(self, answer: str) -> list[str]:
        """Return the words of the command for an answer."""
        if not self.option:
            return [protect_leading_hyphen(answer)]
        return [f"{self.option}={answer}"]


@dataclass(frozen=True)
class FormCommand:
    """A command that a form is for.

    Attributes
    ----------
    title : str
    words : tuple of str
        Name of the command.
    function : str
        The public function that does the same.
    questions : tuple of Question
        In the order of its arguments; those with an option behind those without.
    name_result_page, make_served_address : callable
        Return the page that it writes in the folder, and the address that it serves while it
        runs, for the answers.
    """

    title: str
    words: tuple[str, ...]
    function: str
    questions: tuple[Question, ...]
    name_result_page: Callable[[Mapping[str, str]], str] = lambda _: ""
    make_served_address: Callable[[Mapping[str, str]], str] = lambda _: ""

    def make_command(self, answers: Mapping[str, str]) -> ShownCommand:
        """Make the command for the answers of all questions; empty ones are left out.

        Raises
        ------
        PipelineError
            If a question must be answered and is not.
        """
        words = list(self.words)
        for question in self.questions:
            answer = answers[question.name].strip()
            if answer:
                words += question.make_command_words(answer)
            elif question.is_required:
                raise PipelineError(texts.MUST_BE_SAID.format(label=question.label))
        return ShownCommand(
            self.title,
            tuple(words),
            self.format_python(answers),
            self.name_result_page(answers),
            self.make_served_address(answers),
        )

    def format_python(self, answers: Mapping[str, str]) -> str:
        """Write the call of the function; nothing where an answer is none that it takes."""
        if not self.function:
            return ""
        arguments = []
        options = {}
        for question in self.questions:
            answer = answers[question.name].strip()
            if not answer or not question.is_of_function:
                continue
            try:
                value = question.read(answer)
            except ValueError:
                return ""
            if question.keyword:
                options[question.keyword] = value
            else:
                arguments.append(value)
        return format_function_call(self.function, *arguments, **options)


class CommandForm:
    """The fields of a command on a page, and below them the command and its job.

    Parameters
    ----------
    command : FormCommand
    folder : Folder
    jobs : JobList
    at_end : callable, optional
        Called with the job when it has ended.
    on_answers : callable, optional
        Called when an answer has changed.
    """

    def __init__(
        self,
        command: FormCommand,
        folder: Folder,
        jobs: JobList,
        on_job_end: Callable[[Job], object] | None = None,
        on_changed_answers: Callable[[], object] = lambda: None,
    ) -> None:
        self._command = command
        self._folder = folder
        self._jobs = jobs
        self._at_end = on_job_end
        self._on_answers = on_changed_answers
        self._is_filling = False
        self._fields: dict[str, ui.input | ui.select] = {}

    def build(self, answers: Mapping[str, str] | None = None) -> None:
        """Make the fields; `answers` replace what they say at first."""
        show_heading(self._command.title, 2)
        with ui.element("div").classes("fields"):
            for question in self._command.questions:
                first = (answers or {}).get(question.name, question.default)
                self._fields[question.name] = self._add_field(question, first)
        self._place = ui.column().classes("w-full")
        self._show_command()

    def _add_field(self, question: Question, first: str) -> ui.input | ui.select:
        """Add the field of a question."""
        field: ui.input | ui.select
        if question.choices:
            value = first if first in question.choices else None
            options = list(question.choices)
            field = ui.select(options, label=question.label, value=value, clearable=True)
        else:
            field = ui.input(question.label, value=first).props("debounce=200")
        field.on_value_change(self._show_changed_command)
        return field.classes("w-full").mark(question.name)

    def read_answers(self) -> dict[str, str]:
        """Return what the fields say, by the names of the questions."""
        return {name: str(field.value or "") for name, field in self._fields.items()}

    def fill_in_answers(self, answers: Mapping[str, str]) -> None:
        """Replace the answers of some fields, by the names of their questions."""
        self._is_filling = True
        for name, answer in answers.items():
            self._fields[name].set_value(answer)
        self._is_filling = False
        self._show_changed_command()

    def _show_changed_command(self) -> None:
        """Show the command for changed answers, and tell that they have changed."""
        if self._is_filling:
            return
        self._show_command()
        self._on_answers()

    def _show_command(self) -> None:
        """Show the command for what the fields say now, or what must be said yet."""
        self._place.clear()
        with self._place:
            try:
                answers = self.read_answers()
                for question in self._command.questions:
                    answer = answers[question.name].strip()
                    if question.is_name and answer:
                        self._folder.resolve(answer)
                command = self._command.make_command(answers)
            except StepblocksError as error:
                show_mistake(error)
                return
            Runnable(command, self._folder, self._jobs, self._at_end, has_title=False)
