"""Heights for a study: the designs that theory names, and the intervals that simulation gives."""

import itertools
import math

import numpy as np
import pytest
from scipy.optimize import minimize, minimize_scalar
from scipy.special import ndtr, xlog1py, xlogy
from scipy.stats import norm

import stepblocks
from stepblocks.errors import StepblocksError
from stepblocks.study.design.adaptive import Prior
from stepblocks.study.design.information import (
    CurveShape,
    compute_curve_sensitivity,
    compute_line_sensitivity,
    compute_log_spread,
)
from stepblocks.study.design.placement import Target
from stepblocks.study.design.simulate import Observer
from stepblocks.study.design.simulated_intervals import Comparing
from stepblocks.study.design.trial_exchange import Criterion, exchange_trials

STANDARD = 50e-6
WEBER = 0.2
CERTAIN = {"weber": WEBER, "weber_factor": 1, "equal_factor": 1}
FINE = stepblocks.MakingRoute(least="20 um", most="120 um", step="0.1 um")
COARSE = stepblocks.MakingRoute(least="20 um", most="120 um", step="2 um")


def place(target, **options):
    return stepblocks.place_heights(
        options.pop("source", COARSE), target, **{"standard": STANDARD, "prior": CERTAIN} | options
    )


@pytest.mark.parametrize(
    ("curve", "distance", "share"),
    [
        # White (1973), Biometrika 60, 345-348; Minkin (1987), JASA 82, 1098-1103
        ("logistic", 1.5434, 0.176),
        ("normal", 1.1381, 0.128),
    ],
)
def test_threshold_and_jnd_are_known_best_at_the_two_points_of_white_and_minkin(
    curve, distance, share
):
    design = place("both", source=FINE, curve=curve, lapse=0.0, trials=400)
    heights = np.array(design.optimal.heights)
    spread = math.exp(compute_log_spread(WEBER, CurveShape(curve)))
    places = np.log(heights / STANDARD) / spread
    # the third height, which the analysis needs, lies beside one of the two
    assert np.abs(places) == pytest.approx(distance, abs=0.03)
    rise, _ = CurveShape(curve).compute_rise_and_slope(places)
    assert np.minimum(rise, 1.0 - rise) == pytest.approx(share, abs=0.004)
    below = sum(np.array(design.optimal.trials)[places < 0.0])
    assert below == pytest.approx(200, abs=4)


def find_interval(placement, quantity):
    return next(interval for interval in placement.intervals if interval.quantity == quantity)


def find_places(design, curve):
    """Return distances from the threshold in spreads, and shares of trials."""
    spread = math.exp(compute_log_spread(WEBER, CurveShape(curve)))
    places = np.log(np.array(design.optimal.heights) / STANDARD) / spread
    return places, np.array(design.optimal.trials) / sum(design.optimal.trials)


def inform(places, curve):
    """Return what a trial tells of middle and ln(spread), by hand: (p'/sqrt(pq)) (1, d)."""
    if curve == "normal":
        p, density = norm.cdf(places), norm.pdf(places)
    else:
        p = 1.0 / (1.0 + np.exp(-places))
        density = p * (1.0 - p)
    root = density / np.sqrt(p * (1.0 - p))
    return np.column_stack([root, root * places])


@pytest.mark.parametrize("curve", ["logistic", "normal"])
@pytest.mark.parametrize("target", ["both", "jnd"])
def test_no_height_tells_more_than_those_of_the_design(curve, target):
    # general equivalence theorem: Kiefer and Wolfowitz (1960), Canad. J. Math. 12, 363-366 for D;
    # Silvey (1980), Optimal Design, section 3.5 for c
    places, shares = find_places(
        place(target, source=FINE, curve=curve, lapse=0.0, trials=10_000), curve
    )
    slopes = inform(places, curve)
    inverse = np.linalg.inv(slopes.T @ (shares[:, np.newaxis] * slopes))
    everywhere = inform(np.linspace(-3.0, 3.0, 601), curve)
    if target == "both":
        variance = np.sum(everywhere @ inverse * everywhere, axis=1)
        bound = 2.0
    else:
        variance = (everywhere @ inverse[1]) ** 2
        bound = inverse[1, 1]
    assert variance.max() == pytest.approx(bound, rel=2e-3)


@pytest.mark.parametrize(
    ("curve", "distance", "share"),
    [
        # d tanh(d/2) = 2: Ford, Torsney and Wu (1992), J. R. Statist. Soc. B 54, 569-583
        ("logistic", 2.3994, 0.0832),
        # the maximum of d**2 phi**2 / (Phi (1 - Phi)), of the same paper
        ("normal", 1.5750, 0.0576),
    ],
)
def test_a_jnd_alone_is_known_best_farther_out(curve, distance, share):
    places, shares = find_places(
        place("jnd", source=FINE, curve=curve, lapse=0.0, trials=400), curve
    )
    assert np.abs(places) == pytest.approx(distance, abs=0.03)
    assert shares[places < 0.0].sum() == pytest.approx(0.5, abs=0.01)
    rise, _ = CurveShape(curve).compute_rise_and_slope(places)
    assert np.minimum(rise, 1.0 - rise) == pytest.approx(share, abs=0.004)


def test_without_the_error_of_the_spread_all_trials_would_lie_at_the_threshold():
    # Elfving's theorem: the c-optimal design of a logistic median is one point, with a variance of
    # 4 spread**2 / n; its information is singular, its generalised inverse gives that of the median
    heights = STANDARD * np.exp(np.linspace(-0.6, 0.6, 41))
    prior = Prior(weber=WEBER, weber_factor=1.0, equal_factor=1.0)
    sensitivity = compute_curve_sensitivity(heights, STANDARD, prior, 0.0, CurveShape.LOGISTIC)
    asymptotic = Criterion(sensitivity, (0,))
    found = exchange_trials(asymptotic, np.full(41, 4.0), 1, 1)
    assert set(np.flatnonzero(found)) <= {19, 20, 21}
    spread = math.exp(compute_log_spread(WEBER, CurveShape.LOGISTIC))
    least = 4.0 * spread**2 / 164
    assert least <= math.exp(asymptotic.compute_value(found)) < 1.01 * least
    single = np.zeros(41)
    single[20] = 164.0
    assert math.exp(asymptotic.compute_value(single)) == pytest.approx(least, rel=1e-6)
    slopes = inform(np.zeros(1), "logistic") / [[spread, 1.0]]
    inverse = np.linalg.pinv(164 * slopes.T @ slopes)
    assert inverse[0, 0] == pytest.approx(least, rel=1e-9)


@pytest.mark.repeats
@pytest.mark.parametrize("trials", [100, 1000, 10_000])
def test_the_points_of_a_threshold_close_in_with_the_fourth_root_of_the_trials(trials):
    # 4 cosh(d/2)**2 / n (1 + 3 * 4 cosh(d/2)**2 / (n d**2)) is least at d; near it d**4 = 48 / n
    def compute_variance(d):
        spread_variance = 4.0 * math.cosh(d / 2.0) ** 2 / (trials * d**2)
        return math.cosh(d / 2.0) ** 2 * (1.0 + 3.0 * spread_variance)

    expected = minimize_scalar(compute_variance, bounds=(0.01, 3.0), method="bounded").x
    assert expected == pytest.approx((48.0 / trials) ** 0.25, rel=0.06)
    design = place("threshold", source=FINE, curve="logistic", lapse=0.0, trials=trials)
    places, shares = find_places(design, "logistic")
    assert shares @ np.abs(places) == pytest.approx(expected, rel=0.1)
    bounds = find_interval(design.optimal, "threshold").bounds
    spread = math.exp(compute_log_spread(WEBER, CurveShape.LOGISTIC))
    error = math.log(bounds.high / bounds.low) / 3.919928 / spread
    assert error**2 == pytest.approx(4.0 * compute_variance(expected) / trials, rel=5e-3)


@pytest.mark.parametrize("target", ["threshold", "jnd", "both"])
def test_no_shift_of_trials_tells_more_with_lapses_and_a_vague_expectation(target):
    heights = np.arange(20, 121, 2) * 1e-6
    prior = Prior(weber=WEBER, weber_factor=1.5, equal_factor=1.1)
    goal = Target(target)
    sensitivity = compute_curve_sensitivity(heights, STANDARD, prior, 0.02, CurveShape.NORMAL)
    criterion = Criterion(sensitivity, goal.parameter_indices, goal.spread_index)
    start = np.zeros(len(heights))
    start[::10] = 1000.0
    found = exchange_trials(criterion, start, 1, 3)
    least = criterion.compute_value(found)
    total = found.sum()
    for height in range(len(heights)):
        shifted = 0.999 * found
        shifted[height] += 0.001 * total
        # the slope in the direction of every height is not negative (equivalence theorem)
        assert (criterion.compute_value(shifted) - least) / 0.001 > -2e-3


def test_an_exponent_is_known_best_at_the_ends_of_the_range():
    heights = [20e-6, 30e-6, 50e-6, 80e-6]
    design = stepblocks.place_heights(heights, "exponent", trials=40, noise=0.2, equal_number=4)
    shares = dict(zip(design.optimal.heights, design.optimal.trials, strict=True))
    assert shares[20e-6] + shares[80e-6] == 39
    # standard error of the slope of a straight line, with Student's t of n - 2
    logs = np.repeat(np.log(design.optimal.heights), design.optimal.trials)
    error = 0.2 / math.sqrt(np.sum((logs - logs.mean()) ** 2))
    interval = find_interval(design.optimal, "exponent")
    assert interval.width == pytest.approx(2.0 * 2.024394 * error, rel=1e-6)
    assert find_interval(design.optimal, "exponent").width < design.equal.intervals[0].width
    assert 0.3 < design.efficiency < 0.9


@pytest.mark.repeats
@pytest.mark.parametrize("places", [(0,), (1,), (0, 1)])
@pytest.mark.parametrize("lapse", [0.0, 0.03])
def test_no_other_share_of_trials_tells_more(places, lapse):
    heights = np.array([30e-6, 38e-6, 45e-6, 55e-6, 66e-6, 90e-6])
    prior = Prior(weber_factor=1.5, equal_factor=1.1)
    criterion = Criterion(
        compute_curve_sensitivity(heights, STANDARD, prior, lapse, CurveShape.NORMAL), places
    )
    values = []
    for counts in itertools.product(range(11), repeat=len(heights)):
        if sum(counts) == 10 and np.count_nonzero(counts) >= 3:
            values.append(criterion.compute_value(4.0 * np.array(counts)))
    start = np.array([2.0, 2.0, 2.0, 2.0, 1.0, 1.0])
    found = criterion.compute_value(4.0 * exchange_trials(criterion, start, 4, 3))
    assert found == pytest.approx(min(values), abs=1e-6)


def test_heights_of_equal_trials_are_the_best_that_can_be_chosen():
    heights = (np.arange(20, 100, 5) * 1e-6).tolist()
    design = place("jnd", source=heights, same_trials=True, number=4, trials=80)
    assert set(design.optimal.trials) == {20}
    sensitivity = compute_curve_sensitivity(
        np.array(heights),
        STANDARD,
        Prior(weber_factor=1.0, equal_factor=1.0),
        0.02,
        CurveShape.NORMAL,
    )
    criterion = Criterion(sensitivity, (1,))

    def compute_value(chosen):
        return criterion.compute_value(20.0 * np.isin(heights, chosen))

    best = min(itertools.combinations(heights, 4), key=compute_value)
    assert compute_value(design.optimal.heights) == pytest.approx(compute_value(best), abs=1e-6)


def test_the_determinant_follows_every_added_trial():
    heights = np.array([20e-6, 40e-6, 60e-6])
    criterion = Criterion(compute_line_sensitivity(heights, 0.3), (1,))
    trials = np.array([3.0, 2.0, 5.0])
    for place_of, value in enumerate(criterion.compute_values_with_additions(trials, 4.0)):
        more = trials.copy()
        more[place_of] += 4.0
        assert value == pytest.approx(criterion.compute_value(more), abs=1e-8)


@pytest.mark.repeats
@pytest.mark.parametrize(
    ("target", "width", "fewer"),
    [("threshold", "4 um", 4e-6), ("jnd", 0.05, 0.05), ("threshold", "40 um", 40e-6)],
)
def test_a_width_is_reached_by_the_trials_of_the_design_and_by_no_fewer(target, width, fewer):
    design = place(target, width=width)
    trials = sum(design.optimal.trials)
    assert find_interval(design.optimal, target).width <= fewer
    assert trials <= design.equal.needed
    if trials > 6:
        assert find_interval(place(target, trials=trials - 4).optimal, target).width > fewer
    again = place(target, trials=trials)
    assert again.optimal.trials == design.optimal.trials


def test_a_vague_expectation_spreads_the_heights():
    sure = place(
        "threshold",
    )
    vague = place("threshold", prior={"equal_factor": 1.5, "weber_factor": 1})
    assert np.ptp(vague.optimal.heights) > 2.0 * np.ptp(sure.optimal.heights)


def simulate_errors(placement, lapse, runs, seed):
    """Return fitted ln(threshold) and ln(spread) of simulated participants, by own likelihood."""
    logs = np.log(np.array(placement.heights) / STANDARD)
    totals = np.array(placement.trials)
    log_spread = compute_log_spread(WEBER, CurveShape.NORMAL)
    truth = lapse + (1.0 - 2.0 * lapse) * ndtr(logs / math.exp(log_spread))
    generator = np.random.default_rng(seed)
    fits = []
    for hits in generator.binomial(totals, truth, (runs, len(totals))):

        def miss(point, hits=hits):
            middle, spread, rate = point
            p = rate + (1.0 - 2.0 * rate) * ndtr((logs - middle) / math.exp(spread))
            p = np.clip(p, 1e-12, 1.0 - 1e-12)
            return -np.sum(xlogy(hits, p) + xlog1py(totals - hits, -p))

        bounds = [(-1.0, 1.0), (-5.0, 1.0), (0.0, 0.1)]
        fits.append(minimize(miss, [0.0, log_spread, 0.02], bounds=bounds).x[:2])
    return np.array(fits)


def check_scatter(placement, fits):
    """Check that fits scatter as the expected intervals say, within sampling error."""
    interval = find_interval(placement, "threshold").bounds
    errors = [math.log(interval.high / interval.low) / 3.91993]
    ratios = find_interval(placement, "jnd").bounds.transform(lambda ratio: math.log1p(ratio))
    errors.append(math.log(ratios.high / ratios.low) / 3.91993)
    sampling = 1.0 / math.sqrt(2.0 * len(fits))
    assert fits.std(axis=0, ddof=1) / errors == pytest.approx([1.0, 1.0], abs=4.0 * sampling)


@pytest.mark.repeats
@pytest.mark.parametrize("target", ["jnd", "threshold"])
def test_simulated_participants_scatter_as_the_interval_says(target):
    design = place(target, trials=400, number=5, lapse=0.03)
    check_scatter(design.optimal, simulate_errors(design.optimal, 0.03, 100, 1))


@pytest.mark.long
def test_a_certain_threshold_is_known_better_than_from_equal_heights_by_simulation():
    design = place("threshold", trials=60)
    (found, _), (equal, _) = [
        simulate_errors(placement, 0.02, 200, 1).std(axis=0)
        for placement in (design.optimal, design.equal)
    ]
    assert found < 0.8 * equal


def compare_with_simulation(target, seed, runs):
    """Return simulated and expected widths of the interval of a target, by design."""
    heights = (np.arange(20, 101, 5) * 1e-6).tolist()
    names = [f"step-{height * 1e6:03.0f}" for height in heights]
    observer = Observer(weber=1.0, lapse=0.04)
    options = {"experiment": "constant", "standard": "step-050", "seed": seed, "runs": runs}
    options |= {"observer": observer, "measure": target}
    (jnd,) = stepblocks.study_power(heights, **options | {"measure": "jnd"})["jnd_ratio"]
    expected = {"weber": jnd, "weber_factor": 1, "equal_factor": 1}
    design = place(target, source=heights, prior=expected, trials=600, lapse=0.02)
    unit = "um" if target == "threshold" else "ratio"
    widths = {}
    for label, placement in (("optimal", design.optimal), ("equal", design.equal)):
        numbers = dict(zip(placement.heights, placement.trials, strict=True))
        trials = {name: numbers[h] for name, h in zip(names, heights, strict=True) if h in numbers}
        (row,) = stepblocks.study_power(heights, trials=trials, **options).to_dict("records")
        assert row["fitted_ratio"] > 0.97
        simulated = row[f"simulated_high_95_{unit}"] - row[f"simulated_low_95_{unit}"]
        expected = row[f"expected_high_95_{unit}"] - row[f"expected_low_95_{unit}"]
        widths[label] = simulated, expected
    return widths


@pytest.mark.long
def test_power_finds_by_simulation_the_interval_of_a_threshold_that_a_design_expects():
    widths = compare_with_simulation("threshold", 1, 80)
    for simulated, expected in widths.values():
        assert simulated == pytest.approx(expected, rel=0.25)
    assert widths["optimal"][0] < 0.9 * widths["equal"][0]


@pytest.mark.long
@pytest.mark.parametrize("seed", [2, 3])
def test_power_finds_by_simulation_the_interval_of_a_jnd_from_few_heights_and_many(seed):
    widths = compare_with_simulation("jnd", seed, 300)
    for simulated, expected in widths.values():
        assert simulated == pytest.approx(expected, rel=0.15)


def compare_by_power_law(placement, exponent, lapse):
    """Plan the comparisons of a placement for a participant whose energies are a power law."""
    heights = np.array(placement.heights)
    weber = (1.0 + WEBER) ** exponent - 1.0
    return Comparing(
        heights=heights,
        energies=heights**exponent,
        trials=np.array(placement.trials, dtype=np.float64),
        standard_energy=STANDARD**exponent,
        observer=Observer(weber=weber, lapse=2.0 * lapse),
    )


@pytest.mark.parametrize("target", ["threshold", "jnd"])
def test_power_expects_what_a_design_does_where_energy_is_a_power_of_the_height(target):
    """The curve over ln(height) is then that over ln(energy), so that both ask the same."""
    design = place(target, trials=600, lapse=0.02)
    row = compare_by_power_law(design.optimal, 1.7, 0.02).make_interval_comparison_row(
        target, 10, 1
    )
    bounds = find_interval(design.optimal, target).bounds
    unit, scale = ("um", 1e6) if target == "threshold" else ("ratio", 1.0)
    assert row[f"{target}_{unit}"] == pytest.approx(scale * bounds.value, rel=1e-4)
    assert row[f"expected_low_95_{unit}"] == pytest.approx(scale * bounds.low, rel=1e-3)
    assert row[f"expected_high_95_{unit}"] == pytest.approx(scale * bounds.high, rel=1e-3)


@pytest.mark.long
def test_a_jnd_from_three_heights_scatters_as_its_design_expects():
    """Fitted as `analyse_study` fits, of participants whose curve is the expected one."""
    design = place("jnd", trials=600, lapse=0.02)
    fits = compare_by_power_law(design.optimal, 1.7, 0.02).simulate_fits(150, 4)
    check_scatter(design.optimal, fits)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"standard": "step-1"}, "standard must be one of the blocks "),
        ({"trials": {"a": 3}}, "trials must be of the blocks step-020, "),
        ({"trials": {"step-020": 3}}, "trials must be of 3 blocks or more, got 1"),
        ({"trials": {"step-020": 1.5}}, "trials must be whole numbers above 0, got 1.5 [step-020]"),
        ({"experiment": "estimates"}, "threshold or jnd must be of the experiment constant"),
        ({"measure": "bias", "trials": {"a": 3}}, "trials must be given with the measure"),
        ({"runs": 2}, "runs must lie between 10 and 100000, got 2"),
    ],
)
def test_power_refuses_what_gives_no_threshold(wrong, message):
    options = {"experiment": "constant", "standard": "step-050", "measure": "jnd", "seed": 1}
    with pytest.raises(StepblocksError) as caught:
        stepblocks.study_power([20e-6, 40e-6, 50e-6, 70e-6], **options | wrong)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(
    ("target", "wrong", "message"),
    [
        ("slope", {}, "target must be one of threshold, jnd, both, exponent, got 'slope'"),
        ("jnd", {"standard": None}, "standard must be given for comparisons"),
        ("jnd", {"standard": "50 N"}, "standard "),
        ("jnd", {"lapse": 0.2}, "lapse must be 0 to 0.1, got 0.2"),
        ("jnd", {"lapse": math.nan}, "lapse must be 0 to 0.1, got nan"),
        ("jnd", {"curve": "cubic"}, "curve must be one of normal, logistic, got 'cubic'"),
        ("jnd", {"prior": {"precision": 1}}, "prior must name equal, equal_factor, weber, "),
        ("jnd", {"trials": 61}, "trials must be a multiple of 2, got 61"),
        ("jnd", {"trials": 4}, "trials must be a whole number from 6 to 10000, got 4"),
        (
            "jnd",
            {"same_trials": True, "number": 7, "trials": 60},
            "trials must be a multiple of 14, got 60",
        ),
        ("jnd", {"number": 2}, "number must be a whole number from 3 to 51, got 2"),
        ("both", {"width": 0.1}, "width must be that of a threshold or of a JND"),
        ("jnd", {"width": -1.0}, "width must be positive and finite, got -1.0"),
        ("jnd", {"width": 1e-9}, "width must be reached by 10000 trials"),
        ("jnd", {"width": 0.01}, "width must be reached by 10000 trials, got 0.01"),
        ("jnd", {"width": 0.1, "trials": 60}, "trials or width must be given, got both"),
        ("exponent", {}, "standard and prior apply to comparisons"),
        ("jnd", {"source": [1e-5, 2e-5]}, "there must be 3 to 2000 different heights"),
        ("jnd", {"source": stepblocks.MakingRoute()}, "a route must state the least and the most"),
        (
            "jnd",
            {"source": stepblocks.MakingRoute(least="1 um", most="9 mm", step="1 nm")},
            "a route must make at most 2000 heights, got 8999001",
        ),
    ],
)
def test_what_cannot_be_is_refused_by_name_and_rule(target, wrong, message):
    with pytest.raises(StepblocksError) as caught:
        place(target, **wrong)
    assert str(caught.value).startswith(message)


def test_a_standard_may_be_named_as_in_the_file():
    declared = stepblocks.StimulusSet.declare(
        "mine",
        step_block=[{"id": f"b{size}", "height": f"{size} um"} for size in (30, 40, 50, 60, 80)],
    )
    design = stepblocks.place_heights(declared, "jnd", standard="b50", trials=40)
    again = stepblocks.place_heights(declared, "jnd", standard="50 um", trials=40)
    assert design == again
