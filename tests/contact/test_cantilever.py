"""The composite rod against closed forms of beam theory, with every dimension away from 1."""

import cmath
import math

import numpy as np
import pytest

from stepblocks.contact.rod import (
    Hold,
    Rod,
    Sleeve,
    compute_bush_stiffness,
    compute_rod_ring,
    solve_rod_for_tool,
)
from stepblocks.errors import ContactError

EI, LINE, L = 1.7, 0.083, 0.077
ROD = Rod(EI, LINE, L, 0.0, 0.05)
# first root of 1 + cos x cosh x, Blevins, Formulas for Natural Frequency, table 8-1
FIRST = 1.8751040687119611


def mode(x):
    """Closed shape of the first mode, 1 at the tip (Blevins, table 8-1)."""
    b, s = FIRST * x / L, 0.7340955137589128
    return 0.5 * (np.cosh(b) - np.cos(b) - s * (np.sinh(b) - np.sin(b)))


def closed_frequency(bending, line):
    return FIRST**2 / math.tau * math.sqrt(bending / (line * L**4))


def test_a_bare_rod_rings_and_gives_as_the_closed_forms_say():
    ring = compute_rod_ring(ROD)
    assert ring.frequency == pytest.approx(closed_frequency(EI, LINE), rel=1e-7)
    assert ring.stiffness == pytest.approx(3.0 * EI / L**3, rel=1e-8)
    assert ring.loss_factor == pytest.approx(0.05, rel=1e-12)


def test_a_sheath_over_the_whole_length_makes_a_uniform_composite_rod():
    ring = compute_rod_ring(ROD, Sleeve(0.0, L, 0.6, 0.031, 0.21))
    assert ring.frequency == pytest.approx(closed_frequency(EI + 0.6, LINE + 0.031), rel=1e-7)
    assert ring.stiffness == pytest.approx(3.0 * (EI + 0.6) / L**3, rel=1e-8)
    assert ring.loss_factor == pytest.approx((0.05 * EI + 0.21 * 0.6) / (EI + 0.6), rel=1e-9)


@pytest.mark.parametrize("at", [0.2, 0.5, 0.9])
def test_a_small_mass_lowers_the_frequency_as_rayleigh_says(at):
    # df/f = -m phi(x)^2 / (2 M), and the modal mass of a uniform cantilever is a quarter of its own
    mass, short = 1e-4 * LINE * L, 5e-3 * L
    shift = (
        compute_rod_ring(ROD, Sleeve(at * L - 0.5 * short, short, 0.0, mass / short, 0.0)).frequency
        / compute_rod_ring(ROD).frequency
        - 1.0
    )
    assert shift == pytest.approx(-0.5 * mass * mode(at * L) ** 2 / (0.25 * LINE * L), rel=2e-3)


def test_a_short_stiff_sheath_stiffens_as_castigliano_says():
    a, b, more = 0.013, 0.041, 0.9

    def compliance(start, end, bending):  # integral of (L - x)^2 / E I
        return ((L - start) ** 3 - (L - end) ** 3) / (3.0 * bending)

    total = compliance(0.0, a, EI) + compliance(a, b, EI + more) + compliance(b, L, EI)
    assert compute_rod_ring(ROD, Sleeve(a, b - a, more, 0.02, 0.1)).stiffness == pytest.approx(
        1.0 / total, rel=1e-8
    )


def test_the_tip_mass_solves_for_the_frequency_and_an_impossible_one_is_refused():
    rod = solve_rod_for_tool(9.81e3, 300.0, 14.2e-3, 3.1e-3, 200e9, 7900.0)
    ring = compute_rod_ring(rod)
    assert ring.frequency == pytest.approx(300.0, rel=1e-6)
    assert ring.stiffness == pytest.approx(9.81e3, rel=1e-8)
    assert ring.decay_time == pytest.approx(14.2e-3, rel=1e-6)
    # without its own mass a rod is a spring: M = k / w^2
    light = solve_rod_for_tool(9.81e3, 300.0, 14.2e-3, 3.1e-3, 200e9, 1e-3)
    assert light.end_mass == pytest.approx(9.81e3 / (math.tau * 300.0) ** 2, rel=1e-5)
    with pytest.raises(
        ContactError, match=r"must not exceed that of the bare shank .*, got 300 Hz"
    ):
        solve_rod_for_tool(9.81e3, 300.0, 14.2e-3, 5e-3, 200e9, 7900.0)


def test_loss_by_strain_energy_agrees_with_the_complex_frequency():
    # a uniform composite has the complex frequency in closed form: w ~ sqrt(E I (1 + i eta)); they
    # differ by eta^2
    for eta in (0.01, 0.2):
        exact = 2.0 * cmath.sqrt(1.0 + 1j * eta).imag / cmath.sqrt(1.0 + 1j * eta).real
        ring = compute_rod_ring(Rod(EI, LINE, L, 0.0, eta))
        assert ring.loss_factor == pytest.approx(exact, rel=0.3 * eta**2)
        assert ring.log_decrement == pytest.approx(
            1.0 / (ring.decay_time * ring.frequency), rel=1e-12
        )


def test_a_bush_follows_its_thin_limits():
    # thin and incompressible: the squeezed film, 12 pi G / e^3; thin and compressible: pi (M + G) /
    # e
    shear, e = 1.0e6, 1e-3
    firm = compute_bush_stiffness(4e-3, 4e-3 * (1.0 + e), 3.0 * shear, 0.5)
    assert firm == pytest.approx(12.0 * math.pi * shear / e**3, rel=5e-3)
    nu = 0.3
    loose = compute_bush_stiffness(4e-3, 4e-3 * (1.0 + e), 2.0 * (1.0 + nu) * shear, nu)
    oedometric = 2.0 * shear * (1.0 - nu) / (1.0 - 2.0 * nu)
    assert loose == pytest.approx(math.pi * (oedometric + shear) / e, rel=5e-3)


def test_a_long_soft_hold_gives_as_a_beam_on_an_elastic_bedding():
    # Hetenyi, Beams on Elastic Foundation, 1946: end force P and moment P L on a semi-infinite beam
    bedding = 8.0e8
    b = (bedding / (4.0 * EI)) ** 0.25
    sinks, turns = 2.0 * b / bedding * (1.0 + b * L), 2.0 * b**2 / bedding * (1.0 + 2.0 * b * L)
    compliance = L**3 / (3.0 * EI) + sinks + turns * L
    ring = compute_rod_ring(ROD, Hold(9.0 / b, bedding, 0.3))
    assert ring.stiffness == pytest.approx(1.0 / compliance, rel=1e-4)
    assert ring.frequency < compute_rod_ring(ROD).frequency
    assert 0.05 < ring.loss_factor < 0.3
    rigid = compute_rod_ring(ROD, Hold(0.02, 1e14, 0.3))
    assert rigid.frequency == pytest.approx(closed_frequency(EI, LINE), rel=2e-2)


def test_a_sheath_beyond_the_free_length_is_refused():
    with pytest.raises(ContactError, match="must lie on the free length of the shank, 0 to 77 mm"):
        compute_rod_ring(ROD, Sleeve(0.05, 0.04, 0.1, 0.01, 0.1))


def test_mean_energy_is_that_of_an_exponential():
    ring = compute_rod_ring(ROD)
    time = np.linspace(0.0, 16e-3, 20001)
    mean = np.trapezoid(np.exp(-2.0 * time / ring.decay_time), time) / 16e-3
    assert ring.compute_mean_energy(16e-3) == pytest.approx(mean, rel=1e-7)
