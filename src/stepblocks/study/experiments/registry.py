"""The kinds of experiment by their names; a new kind is one more file and one more line here."""

from stepblocks.errors import StudyError
from stepblocks.study.experiments.comparisons import ADAPTIVE, CONSTANT
from stepblocks.study.experiments.estimates import ESTIMATES
from stepblocks.study.experiments.kind import Experiment
from stepblocks.study.experiments.magnitudes import MAGNITUDE
from stepblocks.study.experiments.virtual import VIRTUAL

EXPERIMENTS: dict[str, Experiment] = {
    "estimates": ESTIMATES,
    "virtual": VIRTUAL,
    "constant": CONSTANT,
    "magnitude": MAGNITUDE,
    "adaptive": ADAPTIVE,
}
ALIASES = {"2afc": "constant"}


def refuse_unused_options(experiment: str, **options: object) -> None:
    """Reject options that were given and that a kind of experiment does not follow.

    An option that is false, zero or empty was not given.
    """
    for option, value in options.items():
        if not value or option in EXPERIMENTS[experiment].takes:
            continue
        following = [name for name, kind in EXPERIMENTS.items() if option in kind.takes]
        raise StudyError(f"{option} is an option of {', '.join(following)}, not of {experiment}")
