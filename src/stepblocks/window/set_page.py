"""The page of a set by what is felt: targets in, blocks out, both on one axis."""

from collections.abc import Mapping
from pathlib import PurePosixPath
from urllib.parse import quote

from nicegui import ui

from stepblocks.files.text import is_file
from stepblocks.window import texts
from stepblocks.window.command_form import CommandForm, FormCommand, Question, split_list
from stepblocks.window.command_line import write_call, write_object
from stepblocks.window.folder import Folder, Kind
from stepblocks.window.frame import show_heading
from stepblocks.window.jobs import Job, JobList

_FIRST_FILE = "even.toml"
_FIRST_PICTURE = "out/even.png"
_FIRST_KIND = "step_block"


class _SetDesignCommand(FormCommand):
    """Its function returns the set; what was designed is written and drawn by two more lines."""

    def write_python(self, answers: Mapping[str, str]) -> str:
        """Write the lines that design, write and draw; nothing where an answer is no number."""
        said = {name: text.strip() for name, text in answers.items() if text.strip()}
        options: dict[str, object] = {}
        for name in ("lowest", "highest", "apart", "base"):
            if name in said:
                options[name] = said[name]
        conditions: dict[str, object] = {}
        try:
            if "number" in said:
                options["number"] = int(said["number"])
            if "friction" in said:
                conditions["frictions"] = [float(said["friction"])]
        except ValueError:
            return ""
        if "load" in said:
            conditions["normal_loads"] = [said["load"]]
        if conditions:
            options["prediction"] = conditions
        if "kind" in said or "step" in said:
            kind = said.get("kind", _FIRST_KIND)
            options["route"] = write_object("MakingRoute", kind, step=said.get("step"))
        arguments: list[object] = [PurePosixPath(said["file"]).stem]
        if "targets" in said:
            arguments.append(split_list(said["targets"]))
        call = write_call("design_set", *arguments, **options)
        lines = [call.replace("\n\n", "\n\ndesign = ", 1)]
        lines.append(f"design.stimuli.to_toml({said['file']!r})")
        if "plot" in said:
            lines.append(f"design.draw({said['plot']!r})")
        return "\n".join(lines)


def make_set_design(stimuli: list[str]) -> FormCommand:
    """Make the command that designs a set."""
    questions = (
        Question("file", texts.SET_FILE, default=_FIRST_FILE, is_required=True),
        _TargetsQuestion("targets", texts.TARGETS),
        Question("lowest", texts.LOWEST, "--lowest", default="2 uJ"),
        Question("highest", texts.HIGHEST, "--highest"),
        Question("number", texts.NUMBER, "--number", default="8"),
        Question("apart", texts.APART, "--apart", default="1 JND"),
        Question("kind", texts.SET_KIND, "--kind", choices=(_FIRST_KIND, "margin_block")),
        Question("base", texts.SET_BASE, "--base", choices=stimuli),
        Question("load", texts.SET_LOAD, "--load"),
        Question("friction", texts.SET_FRICTION, "--friction"),
        Question("step", texts.SET_STEP, "--step"),
        Question("plot", texts.SET_PLOT, "--plot", default=_FIRST_PICTURE),
    )
    return _SetDesignCommand(texts.DESIGN_SET, ("design-set",), "design_set", questions)


class _TargetsQuestion(Question):
    """Targets are an option each."""

    def make_words(self, answer: str) -> list[str]:
        """Return the words of the command for targets with commas between them."""
        words = []
        for target in answer.split(","):
            words.append(f"--targets={target.strip()}")
        return words


class SetPage:
    """The page on which a set of blocks is designed by what is felt."""

    def __init__(self, folder: Folder, jobs: JobList) -> None:
        self._folder = folder
        self._jobs = jobs

    def build(self) -> None:
        """Make the page."""
        show_heading(texts.SET_PAGE)
        ui.label(texts.SET_HELP)
        entries = self._folder.list_entries()
        stimuli = [entry.name for entry in entries if entry.kind is Kind.STIMULI]
        form = CommandForm(make_set_design(stimuli), self._folder, self._jobs, self._show_set)
        form.build()

    def _show_set(self, job: Job) -> None:
        """Show the picture of a set that was designed, and where it can be changed."""
        file = job.command.words[1]
        if not is_file(self._folder.resolve(file)):
            return
        ui.link(texts.DECLARE_SET, f"/declare?file={quote(PurePosixPath(file).as_posix())}")
        for word in job.command.words:
            picture = word.removeprefix("--plot=")
            if picture != word and is_file(self._folder.resolve(picture)):
                image = ui.image(self._folder.make_link(picture)).classes("max-w-[900px]")
                image.props(f'alt="{texts.SET_PICTURE}"')
