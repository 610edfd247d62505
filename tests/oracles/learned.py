"""A model as learned from a session, put together by hand: constants, effects, and as much doubt
as a test wants.
"""

import math

import numpy as np

from stepblocks.contact.operating_point import Limits, Tool
from stepblocks.records.model import LearnedFit, LearnedModel
from stepblocks.rig.effects.grammar.covariates import CovariateRange
from stepblocks.rig.effects.named import list_named_laws

__all__ = ["CONSTANTS", "make_learned_model"]

CONSTANTS = {
    "friction": 0.17,
    "ln_conversion": math.log(0.23),
    "stiffness_ratio": 1.05,
    "ln_ring_frequency": math.log(290.0),
    "ln_decay_time": math.log(0.021),
}
_RANGES = (
    CovariateRange("height_um", 10.0, 80.0, False, (), 8),
    CovariateRange("load_n", 0.3, 1.1, False, (), 4),
    CovariateRange("speed_mm_s", 2.0, 20.0, True, (), 4),
    CovariateRange("run_order", 1.0, 120.0, False, (), 120),
    CovariateRange("operator", labels=("A", "B"), distinct=2),
)


def make_learned_model(
    effects=None, std=0.0, scatter=0.0, blocks=("step-020", "step-050")
) -> LearnedModel:
    """Constants as above, blocks of their nominal height; `effects` maps a law's name to values of
    its parameters.
    """
    laws = tuple(law for law in list_named_laws(blocks) if law.id in (effects or {}))
    heights = {f"height_error[{block}]": 0.0 for block in blocks}
    nominal = CONSTANTS | heights
    extended = nominal | {
        f"{law.id}.{name}": v for law in laws for name, v in effects[law.id].items()
    }

    def fit(values, laws=()):
        # heights are known to a nanometre, the rest as the test says
        sizes = np.array([1e-9 * (std > 0.0) if "height" in name else std for name in values])
        return LearnedFit(values, tuple("1" for _ in values), np.diag(sizes**2), laws)

    return LearnedModel(
        verdict="effect" if laws else "none",
        tool=Tool(stiffness=9500.0, frequency=300.0, decay_time=0.02, limits=Limits()),
        tip_radius_um=120.0,
        height_std=1e-6,
        scanned={blocks[0]: (20.3e-6, 15e-9)},
        blocks=tuple(blocks),
        ranges=_RANGES,
        quantity_std=np.zeros(3),
        channel_std=np.full(7, scatter),
        nominal=fit(nominal),
        extended=fit(extended, laws),
    )
