"""All effects that may be asked for: the named laws, and every slot over every covariate."""

from __future__ import annotations

from collections.abc import Sequence

from stepblocks.contact.effects import (
    block_tilt,
    contact_creep,
    conversion_laws,
    edge_rounding,
    elastic_indentation,
    hardening_spring,
    load_errors,
    load_friction,
    real_release,
    running_in,
    sensor_laws,
    stribeck,
    tip_flat,
    tip_wear,
    viscous_drag,
)
from stepblocks.contact.effects.block_height import law_for
from stepblocks.contact.effects.law import Law
from stepblocks.contact.effects.smooth import SLOT_MOVES, CovariateRange, smooth_law, trend_law


def named_laws(blocks: Sequence[str] = ()) -> tuple[Law, ...]:
    """Return the laws with names; the height error of each of `blocks` among them."""
    return (
        edge_rounding.LAW,
        tip_wear.LAW,
        tip_wear.WORN,
        tip_flat.LAW,
        block_tilt.LAW,
        elastic_indentation.LAW,
        contact_creep.LAW,
        load_friction.LAW,
        *stribeck.LAWS,
        running_in.LAW,
        hardening_spring.LAW,
        *load_errors.LAWS,
        *viscous_drag.LAWS,
        *conversion_laws.LAWS,
        *real_release.LAWS,
        *sensor_laws.LAWS,
        *(law_for(block) for block in blocks),
    )


def smooth_laws(covariates: Sequence[CovariateRange]) -> tuple[Law, ...]:
    """Return every slot over every covariate, as a straight line and as a smooth."""
    laws: list[Law] = []
    for where in covariates:
        for move in SLOT_MOVES:
            if not where.labels and where.distinct > 2:
                laws.append(trend_law(move, where))
            laws.append(smooth_law(move, where))
    return tuple(laws)
