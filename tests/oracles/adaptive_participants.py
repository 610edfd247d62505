"""Participants of an adaptive study who compare heights with a normal noise in their logarithm, and
never lapse.
"""

import math

import numpy as np

from stepblocks.study.adaptive import open_adaptive


def answer_all(folder, spread, seed):
    """Let everybody answer every trial; return the number of answers."""
    study, count = open_adaptive(folder), 0
    for participant in range(1, study.participants + 1):
        session, generator = study.session(participant), np.random.default_rng([seed, participant])
        while (pair := session.next_pair()) is not None:
            first, second = (
                math.log(study.blocks[code].height) for code in (pair.first, pair.second)
            )
            session.record(
                pair.trial, bool(second - first + spread * generator.standard_normal() > 0.0)
            )
        study.save(session)
        count += len(session.answers)
    return count
