"""The page of a study: its design, its sheets, a run in this browser, and its analysis."""

from collections.abc import Mapping

from nicegui import ui

from stepblocks.window import texts
from stepblocks.window.command_form import CommandForm, FormCommand, Question, split_at_commas
from stepblocks.window.folder import Folder, Kind
from stepblocks.window.frame import show_heading
from stepblocks.window.job_view import show_embedded_page
from stepblocks.window.jobs import Job, JobList

_EXPERIMENTS = ("estimates", "virtual", "constant", "magnitude", "2afc", "adaptive")
_FIRST_FOLDER = "study"
_FIRST_PORT = "8230"


def make_design_command(stimuli: list[str]) -> FormCommand:
    """Make the command that designs a study with a stimulus file of the folder."""
    folder = Question(
        "folder",
        texts.STUDY_FOLDER,
        "--output",
        default=_FIRST_FOLDER,
        is_required=True,
        is_name=True,
    )
    experiment = Question(
        "experiment",
        texts.EXPERIMENT,
        "--experiment",
        "experiment",
        default="estimates",
        choices=_EXPERIMENTS,
    )
    participants = Question(
        "participants", texts.PARTICIPANTS, "--participants", "participants", "10", read=int
    )
    probes = Question(
        "probes", texts.PROBES, "--probes", "probes", "bare,hard,soft", read=split_at_commas
    )
    repetitions = Question(
        "repetitions", texts.REPETITIONS, "--repetitions", "repetitions", "3", read=int
    )
    questions = (
        _make_stimuli_question(stimuli),
        folder,
        _make_seed_question(),
        experiment,
        participants,
        probes,
        repetitions,
        Question("standard", texts.STANDARD, "--standard", "standard"),
    )
    return FormCommand(
        texts.DESIGN,
        ("study", "design"),
        "design_study",
        questions,
        lambda answers: f"{answers['folder']}/preregistration.md",
    )


def make_sheets_command(studies: list[str]) -> FormCommand:
    """Make the command that writes blinded run sheets."""
    return FormCommand(
        texts.SHEETS,
        ("study", "sheet"),
        "write_sheets",
        (_make_study_question(studies),),
        lambda answers: f"{answers['study']}/run-sheets.html",
    )


def make_run_command(studies: list[str], stimuli: list[str]) -> FormCommand:
    """Make the command that leads a participant through the trials, at an address of its own."""
    participant = Question(
        "participant",
        texts.PARTICIPANT,
        "--participant",
        "participant",
        default="1",
        is_required=True,
    )
    port = Question(
        "port",
        texts.PORT,
        "--port",
        default=_FIRST_PORT,
        is_required=True,
        is_of_function=False,  # in Python nobody needs a page to ask and to answer
    )
    questions = (
        _make_study_question(studies),
        Question("file", texts.STUDY_FILE, keyword="source", choices=stimuli),
        participant,
        Question("practice", texts.PRACTICE, "--practice", "practice", read=int),
        port,
    )
    return FormCommand(
        texts.RUN_STUDY,
        ("study", "run", "--no-open"),
        "open_run",
        questions,
        make_served_address=lambda answers: f"http://127.0.0.1:{answers['port']}/",
    )


def make_simulation_command(studies: list[str], stimuli: list[str]) -> FormCommand:
    """Make the command that lets simulated participants answer."""
    questions = (
        _make_study_question(studies),
        _make_stimuli_question(stimuli),
        Question("answers", texts.ANSWERS_TO_WRITE, "--output", is_required=True, is_name=True),
        _make_seed_question(),
    )
    return FormCommand(texts.SIMULATE_STUDY, ("study", "simulate"), "simulate_study", questions)


def make_analysis_command(studies: list[str]) -> FormCommand:
    """Make the command that analyses the answers of a study."""

    def name_page(answers: Mapping[str, str]) -> str:
        report = answers["report"] or f"{answers['study']}/report"
        return f"{report}/report.html"

    questions = (
        _make_study_question(studies),
        Question(
            "answers", texts.ANSWERS, read=lambda text: [text], is_required=True, is_name=True
        ),
        Question("report", texts.REPORT_FOLDER, "--output", "output", is_name=True),
        Question("reference", texts.REFERENCE, "--reference", "reference"),
    )
    return FormCommand(texts.ANALYSE, ("study", "analyse"), "analyse_study", questions, name_page)


def _make_stimuli_question(stimuli: list[str]) -> Question:
    """Ask for the stimulus file."""
    return Question("file", texts.STUDY_FILE, choices=stimuli, is_required=True)


def _make_seed_question() -> Question:
    """Ask for the seed of all random choices."""
    return Question("seed", texts.SEED, "--seed", "seed", "1", read=int, is_required=True)


def _make_study_question(studies: list[str]) -> Question:
    """Ask for the folder of the study."""
    return Question("study", texts.STUDY, choices=studies, is_required=True)


class StudyPage:
    """The page on which a study is designed, run and analysed."""

    def __init__(self, folder: Folder, jobs: JobList) -> None:
        self._folder = folder
        self._jobs = jobs

    def build(self) -> None:
        """Make the page."""
        show_heading(texts.STUDY_PAGE)
        ui.label(texts.STUDY_HELP)
        design = ui.column().classes("w-full")
        place = ui.column().classes("w-full")

        def show_steps(_: Job | None = None) -> None:
            place.clear()
            with place:
                self._show_steps()

        form = CommandForm(
            make_design_command(self._folder.list_felt_files()),
            self._folder,
            self._jobs,
            show_steps,
        )
        with design:
            form.build(self._answer_with_first_entries())
        show_steps()

    def _show_steps(self) -> None:
        """Show what can be done with the studies of the folder."""
        studies = self._list_names(Kind.STUDY)
        if not studies:
            ui.label(texts.NO_STUDY)
            return
        stimuli = self._folder.list_felt_files()
        first = self._answer_with_first_entries()
        answers = f"{first['study']}/answers.csv"
        for command in (
            make_sheets_command(studies),
            make_run_command(studies, stimuli),
            make_simulation_command(studies, stimuli),
        ):
            form = CommandForm(command, self._folder, self._jobs)
            form.build(first | {"answers": answers})
        form = CommandForm(
            make_analysis_command(studies), self._folder, self._jobs, self._show_report
        )
        form.build(first | {"answers": answers})

    def _show_report(self, job: Job) -> None:
        """Show the report of an analysis."""
        show_embedded_page(
            self._folder, job.command.page, texts.REPORT_OF.format(title=texts.ANALYSE)
        )

    def _list_names(self, kind: Kind) -> list[str]:
        """List the names of the entries of a kind."""
        return self._folder.list_names(kind)

    def _answer_with_first_entries(self) -> dict[str, str]:
        """Answer the questions of a file and a study where the folder has just one of them."""
        answers = {}
        for name, found in (
            ("file", self._folder.list_felt_files()),
            ("study", self._list_names(Kind.STUDY)),
        ):
            if found:
                answers[name] = found[0]
        return answers
