"""Drift of a scan line by line is no form of a part, and no form is proven under it."""

import numpy as np
import pytest

from oracles.softgauge import correlated_map
from stepblocks.inspect.budget import Bound, Instrument
from stepblocks.inspect.conformity import Outcome
from stepblocks.inspect.evaluation import EvaluationOptions
from stepblocks.inspect.run import inspect_scan
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.scans.scan import HeightMap

UM = 1e-6
PART = StepBlock(id="step-050", height={"nominal": "50 um", "tolerance": "1 um"})
KNOWN = Instrument(1e-4, 0.0, 1e-4)
OPTICAL = EvaluationOptions(stylus_radius=0.0, stylus_cone=0.0)
STEP = 5 * UM


def inspect_map(seed=0, drift=0.0, bow_upper=0.0, walk=0.0):
    """Inspect a map of a block; `drift` is along y on both faces, `bow_upper` on one [m]."""
    random = np.random.default_rng(seed)
    x = (np.arange(240) - 120) * STEP
    t = np.linspace(-1.0, 1.0, 80)
    z = np.tile(np.where(x > 0.0, 50 * UM, 0.0), (80, 1))
    z += correlated_map(z.shape, STEP, 5e-9, 20e-9, 10 * UM, random)
    z += drift * t[:, np.newaxis] ** 2
    z += walk * np.cumsum(random.normal(size=80))[:, np.newaxis] / np.sqrt(80.0)
    z += np.where(x > 0.0, bow_upper * t[:, np.newaxis] ** 2, 0.0)
    return inspect_scan(HeightMap(z, STEP, STEP), PART, instrument=KNOWN, options=OPTICAL)


def find_failures(result):
    failed = [entry for entry in result.judged if entry.decision.verdict is not Outcome.CONFORMS]
    return {entry.characteristic.key for entry in failed}


@pytest.mark.repeats
@pytest.mark.parametrize("seed", range(3))
def test_what_both_faces_share_line_by_line_fails_no_part(seed):
    result = inspect_map(seed, drift=2.5 * UM)
    assert not find_failures(result) & {"flatness_lower", "flatness_upper", "parallelism"}
    for key in ("flatness_lower", "flatness_upper"):
        measured = result.evaluation.values[key]
        assert measured.bound is Bound.AT_LEAST
        assert measured.value < 0.2 * UM
    (note,) = (note for note in result.evaluation.notes if "share a form" in note)
    assert "turned by 90 deg" in note


def test_a_form_of_one_face_alone_fails_it_still():
    assert "flatness_upper" in find_failures(inspect_map(bow_upper=2.5 * UM))


@pytest.mark.long
def test_without_drift_nothing_is_said_of_it():
    result = inspect_map()
    assert result.evaluation.values["flatness_upper"].bound is Bound.NONE
    assert not any("share a form" in note for note in result.evaluation.notes)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(2))
def test_an_instrument_that_wanders_from_line_to_line_fails_no_part(seed):
    result = inspect_map(seed, walk=3.0 * UM)
    assert not find_failures(result) & {"flatness_lower", "flatness_upper", "parallelism"}
    assert result.evaluation.values["flatness_upper"].value < 0.05 * UM
