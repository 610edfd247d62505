"""Define an effect as a user would: the file that ``--laws`` is given by ``fuzz_commands.py``."""

import numpy as np

from stepblocks import Law, Parameter

FILM = Law(
    "film_valley",
    "mu (1 + s ln(v / 6 mm/s)^2)",
    (Parameter("rise", "1", 0.0, -0.3, 3.0, 0.03),),
    lambda state, _, v: state.changed(
        friction=state.friction * (1.0 + v["rise"] * np.log(state.speed / 6e-3) ** 2)
    ),
    slot="friction",
    covariate="speed_mm_s",
)
