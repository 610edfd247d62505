"""The plan of a sweep: a table whose rows follow from their numbers alone."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

from stepblocks.contact.operating_point import PAPER
from stepblocks.files.claim import hash_plan

# dimensions of a counterface, and the parameters of a sweep that stand for them
SURFACES: dict[str, dict[str, str]] = {
    "step": {"height": "height", "edge_radius": "edge_radius"},
    "margin": {
        "gap": "marginal_gap",
        "rise": "horizontal_discrepancy",
        "opening": "vertical_discrepancy",
    },
}
# ways of a drag over a margin; a plan holds their places
DIRECTIONS = ("tooth-to-crown", "crown-to-tooth")
SQUARE = math.inf  # stands for "as the gap": the end of the crown is square

# of the columns of the result: a folder with those of another edition is another sweep's
_COLUMNS_EDITION = 2

# each parameter's dimension, and its value where a sweep does not name it (None: it must)
Parameters = dict[str, tuple[str, float | None]]
_SETTING: Parameters = {
    "tip_radius": ("length", PAPER.ball_radius),
    "normal_load": ("force", PAPER.normal_load),
    "friction": ("ratio", None),
    "stiffness": ("stiffness", PAPER.tool.stiffness),
    "conversion": ("ratio", PAPER.tool.conversion),
    "speed": ("speed", PAPER.speed),
    "frequency": ("frequency", PAPER.tool.frequency),
    "damping_ratio": ("ratio", PAPER.tool.damping_ratio),
}
PARAMETERS: dict[str, Parameters] = {
    "step": {"height": ("length", None), "edge_radius": ("length", 0.0), **_SETTING},
    "margin": {
        "marginal_gap": ("length", None),
        "vertical_discrepancy": ("length", SQUARE),
        "horizontal_discrepancy": ("length", 0.0),
        **_SETTING,
        "direction": ("direction", 0.0),
    },
}


@dataclass(frozen=True)
class SweepStimulus:
    """One stimulus of a set that a sweep goes over.

    Attributes
    ----------
    id : str
        Its identity.
    values : dict of str to float
        Its dimensions [m], by the names of the sweep's parameters.
    spreads : dict of str to float
        Their standard uncertainties [m]; empty where no tolerances are drawn.
    face : dict of str to float
        Fields of its counterface that no parameter stands for: floor of a gap, sides of a scan.
    tissue : list of float
        Stiffness [N/m], damping at 1 Hz [N s/m] and friction [1] of what gives way beside the tip;
        the damping falls with the frequency of the ring.
    """

    id: str
    values: dict[str, float]
    spreads: dict[str, float]
    face: dict[str, float]
    tissue: list[float]


@dataclass(frozen=True)
class SweepPlan:
    """A sweep, resolved."""

    kind: str  # ``"grid"`` or ``"random"``
    mode: str  # ``"static"`` (equations 1 and 2) or ``"drag"`` (in time as well)
    surface: str  # ``"step"`` or ``"margin"``
    points: int  # of the design
    draws: int  # within the tolerances of each point
    seed: int  # every row draws from its own stream, seeded by this and the row's number
    rows_per_partition: int  # of one file of the result
    values: dict[str, list[float]]  # by name: values of a grid, or choices of a random design [SI]
    ranges: dict[str, list[float]]  # by name: low and high of a random design [SI]
    spreads: dict[str, float]  # by name: standard uncertainty of a draw [SI]
    shares: dict[str, float]  # by name: standard uncertainty of a draw as a share of the value [1]
    stimuli: list[SweepStimulus]  # of a set that the sweep goes over; empty without a set
    limits: dict[str, float]  # tangential forces beyond which a tip does not slip, by name [N]
    laws: dict[str, Mapping[str, object]]  # as declared, by kind

    @property
    def row_count(self) -> int:
        """Number of rows of the result."""
        return self.points * self.draws

    @property
    def partition_count(self) -> int:
        """Number of files of the result."""
        return math.ceil(self.row_count / self.rows_per_partition)

    @property
    def digest(self) -> str:
        """Hash of all that the rows and their files depend on, the program's version included."""
        from stepblocks import __version__

        record = {**asdict(self), "stepblocks": __version__, "columns": _COLUMNS_EDITION}
        return hash_plan(record)
