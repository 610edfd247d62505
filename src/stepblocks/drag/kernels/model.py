"""What the integrator takes and returns, by name; numba reads a named tuple as a structure."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact import Array

# columns of the rows of a trace
COLUMNS = (
    "time_s",
    "fx_n",
    "fy_n",
    "x_m",
    "y_m",
    "vx_m_s",
    "vy_m_s",
    "handle_m",
    "normal_n",
    "friction_n",
)


class Ledger(NamedTuple):
    """Energies [J]: what is put in, the changes of what is stored, and what is lost."""

    handle_work: float  # of the handle or of the pulling force
    kinetic: float
    spring: float
    lift: float
    contact: float
    bristle: float
    friction_loss: float
    damping_loss: float
    impact_loss: float
    tissue_loss: float


LEDGER = Ledger._fields


class Path(NamedTuple):
    """The path of the tip's lowest point: cubics between knots, two branches at each kink."""

    knots: Array  # shape (n,) [m]
    cubics: Array  # coefficients in powers of the distance from the left knot, shape (n - 1, 4)
    kinks: NDArray[np.int64]  # knots at which two contacts share the load, shape (m,)
    branches: Array  # coefficients of the left and the right branch, shape (m, 2, 4)


class Spring(NamedTuple):
    """The tool along the drag, which the handle carries by its first mode."""

    tool_stiffness: float  # of all modes together [N/m]
    stiffness: float  # of the first mode [N/m]
    mass: float  # of the first mode [kg]
    damping: float  # of the first mode [N s/m]
    hardening: float  # k3 of ``F = k x + k3 x^3`` [N/m^3]


class NormalContact(NamedTuple):
    """The contact along its normal, ``F = K d^p`` with a loss after Hunt and Crossley."""

    stiffness: float  # K [N/m^p]
    power: float  # p [1]
    loss: float  # share of the force that is lost per speed of approach [s/m]


class Carrier(NamedTuple):
    """What presses the tip down: a weight, on the tip itself or on a carrier with a spring."""

    load: float  # [N]
    is_sprung: bool
    stiffness: float  # between tip and carrier [N/m]
    damping: float  # of the tip along z [N s/m]
    mass: float  # [kg]


class Handle(NamedTuple):
    """What moves the tool: a handle of constant speed, or one that a force pulls."""

    is_driven: bool
    speed: float  # [m/s]
    pull: float  # [N]
    mass: float  # [kg]
    damping: float  # of its guide [N s/m]


class Friction(NamedTuple):
    """Friction of tip and surface on bristles."""

    sliding: float  # coefficient [1]
    static: float  # coefficient at rest [1]
    stribeck_speed: float  # over which the one falls to the other [m/s]
    viscous: float  # rise of the coefficient per speed [s/m]
    varies: bool  # whether the coefficient depends on the speed
    stiffness: float  # of the bristles [N/m]
    give: float  # inverse of that stiffness [m/N]
    damping: float  # of the bristles [N s/m]
    bends: bool  # whether the bristles bend towards the limit (Dahl, LuGre)


class Wall(NamedTuple):
    """A soft wall along which the tool rubs."""

    is_there: bool
    stiffness: float  # [N/m]
    damping: float  # [N s/m]
    friction: float  # force at which the tool slides along it [N]


class Model(NamedTuple):
    """All that acts on the tip; numbers alone."""

    window: float  # distance from a kink within which both of its sides are touched [m]
    spring: Spring
    contact: NormalContact
    carrier: Carrier
    handle: Handle
    friction: Friction
    wall: Wall
    sliding_pull: float  # force on the tool in steady sliding on level ground [N]


class Start(NamedTuple):
    """Where the drag begins."""

    x: float  # of the tip [m]
    y: float  # of the tip [m]
    stretch: float  # of the spring in steady sliding [m]


class Pace(NamedTuple):
    """How the drag is stepped and recorded."""

    time_step: float  # [s]
    steps: int  # at most
    steps_per_row: int


class Places(NamedTuple):
    """The places that may catch the tip, in the order of the drag; arrays of shape (n,)."""

    start: Array  # where the approach begins [m]
    last: Array  # where the slope begins to fall again [m]
    behind: Array  # where the tip has passed the place [m]
    locks: NDArray[np.bool_]  # whether no pull lifts a rigid tip over it
    rises: Array  # rise of the pull by which a place holds the tip [N]


class Stop(NamedTuple):
    """What ends the drag before its last step, and what takes the tip back to a place."""

    left: float  # end of the path [m]
    right: float  # other end of the path [m]
    pull: float  # past which the tip counts as locked [N]
    ring_time: float  # recorded after the last release [s]
    fall_back: float  # distance behind a place from which the tip must climb it again [m]


class Passage(NamedTuple):
    """What the pull tells of a place that the tip has passed; the columns of a passage."""

    place: float  # its number
    greatest: float  # pull [N]; minus infinity where it never rose
    greatest_time: float  # [s]
    greatest_x: float  # [m]
    least: float  # pull on the approach [N]
    least_time: float  # [s]
    passed_time: float  # [s]


class Outcome(NamedTuple):
    """What the integrator has found."""

    rows: Array  # shape (n, 10); with overtones the force of each mode follows
    peak_force: float  # greatest pull [N]
    peak_time: float  # [s]
    ledger: Ledger  # of the whole drag
    passages: Array  # shape (m, 17); `Passage`, and the ledger then
