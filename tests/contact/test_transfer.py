"""From the tip to the clamp and the finger: closed forms of the cantilever, and the same rod by
another library's elements.
"""

import itertools
import math

import numpy as np
import pytest
from scipy.linalg import eigh

from stepblocks.contact.rod import (
    STYLUS_HAND,
    Hand,
    Hold,
    Rod,
    Sleeve,
    compute_clamp_force,
    compute_energy_share_in_hand,
    compute_modes,
    compute_rod_ring,
    integrate_squared_clamp_force,
)

UNIFORM = Rod(0.71, 0.053, 0.113, 0.0, 0.03)
TIPPED = Rod(2.5, 0.099, 0.0916, 0.57e-3, 0.07)
SLEEVE, HOLD = Sleeve(0.011, 0.037, 0.31, 0.029, 0.11), Hold(0.041, 2.3e6, 0.17)
EVERY = 1e9  # Hz: all modes of the mesh


def wave_numbers(count):
    """Roots of cos x cosh x = -1, by hand known as 1.8751, 4.6941, 7.8548, ..."""
    from scipy.optimize import brentq

    return [
        brentq(lambda x: math.cos(x) + 1.0 / math.cosh(x), (n - 0.7) * math.pi, (n - 0.3) * math.pi)
        for n in range(1, count + 1)
    ]


def test_a_blow_on_the_tip_of_a_cantilever_reaches_its_clamp_as_the_series_of_its_modes():
    # Origin: Euler-Bernoulli: w = x^2 sqrt(EI / m L^4); mass normalised phi(L) = 2 / sqrt(m L),
    # momentum 2 s sqrt(m L) / x with s = (sinh x - sin x) / (cosh x + cos x): force on the clamp J
    # sum (+-) 4 s / x w exp(-w eta t / 2) sin w t
    roots = wave_numbers(4)
    unit = math.sqrt(UNIFORM.bending_stiffness / (UNIFORM.line_mass * UNIFORM.length**4))
    time = np.linspace(0.0, 20e-3, 3001)
    expected = np.zeros_like(time)
    for n, x in enumerate(roots):
        s = (math.sinh(x) - math.sin(x)) / (math.cosh(x) + math.cos(x))
        w = unit * x * x
        expected += (
            (-1) ** n
            * 4.0
            * s
            / x
            * w
            * np.exp(-0.5 * w * UNIFORM.loss_factor * time)
            * np.sin(w * time)
        )
    modes = compute_modes(UNIFORM, highest=1.01 * unit * roots[3] ** 2 / math.tau)
    assert [one.frequency for one in modes] == pytest.approx(
        [unit * x * x / math.tau for x in roots], rel=1e-4
    )
    assert [one.reaction for one in modes] == pytest.approx(
        [1.5660, -0.8679, 0.5089, -0.3638], abs=2e-4
    )
    found = compute_clamp_force(modes, time, is_blow=True)
    assert np.abs(found - expected).max() < 2e-3 * np.abs(expected).max()


@pytest.mark.parametrize(("sleeves", "hold"), [((), None), ((SLEEVE,), None), ((), HOLD)])
def test_the_modes_are_those_of_another_library_s_elements(sleeves, hold):
    # Origin: scikit-fem's Hermite elements with its own quadrature, 160 on the free length
    skfem = pytest.importorskip("skfem")
    start = -hold.length if hold else 0.0
    ends = sorted(
        {start, 0.0, TIPPED.length, *(e for s in sleeves for e in (s.start, s.start + s.length))}
    )
    points = np.unique(np.concatenate([np.linspace(a, b, 61) for a, b in itertools.pairwise(ends)]))
    basis = skfem.Basis(skfem.MeshLine(points), skfem.ElementLineHermite(), intorder=8)

    def within(x, a, b):
        return (x > a) & (x < b)

    @skfem.BilinearForm
    def stiffness(u, v, w):
        bending = TIPPED.bending_stiffness + sum(
            s.bending_stiffness * within(w.x[0], s.start, s.start + s.length) for s in sleeves
        )
        bedding = hold.line_stiffness * (w.x[0] < 0.0) if hold else 0.0
        return bending * u.hess[0, 0] * v.hess[0, 0] + bedding * u * v

    @skfem.BilinearForm
    def inertia(u, v, w):
        line = TIPPED.line_mass + sum(
            s.line_mass * within(w.x[0], s.start, s.start + s.length) for s in sleeves
        )
        return line * u * v

    k, m = stiffness.assemble(basis).toarray(), inertia.assemble(basis).toarray()
    at_tip = basis.nodal_dofs[0, np.argmax(basis.mesh.p[0])]
    m[at_tip, at_tip] += TIPPED.end_mass
    clamped = [] if hold else list(basis.nodal_dofs[:, np.argmin(basis.mesh.p[0])])
    free = np.setdiff1d(np.arange(len(k)), clamped)
    values, shapes = eigh(k[np.ix_(free, free)], m[np.ix_(free, free)])
    moved = np.zeros(len(k))
    moved[basis.nodal_dofs[0]] = 1.0
    modes = compute_modes(TIPPED, (*sleeves, hold)[0], highest=12e3)[:4]
    for one, value, shape in zip(modes, values, shapes.T, strict=False):
        assert one.frequency == pytest.approx(math.sqrt(value) / math.tau, rel=1e-5)
        full = np.zeros(len(k))
        full[free] = shape
        assert one.reaction == pytest.approx(float(moved @ m @ full * full[at_tip]), rel=1e-3)


@pytest.mark.parametrize("worn", [None, SLEEVE, HOLD])
def test_all_modes_together_hold_the_pull_that_is_let_go(worn):
    modes = compute_modes(TIPPED, worn, EVERY)
    assert sum(one.reaction for one in modes) == pytest.approx(1.0, rel=1e-6)
    assert modes[0].frequency == pytest.approx(compute_rod_ring(TIPPED, worn).frequency, rel=1e-6)
    assert modes[0].loss_factor == pytest.approx(
        compute_rod_ring(TIPPED, worn).loss_factor, rel=1e-6
    )


def test_what_a_sensor_sees_of_one_mode_is_its_closed_form():
    # integral of (a exp(-s t) cos w t)^2
    (one,) = compute_modes(TIPPED, highest=1000.0)
    w, t = math.tau * one.frequency, 16e-3
    s = 0.5 * w * one.loss_factor

    def part(u):
        e = math.exp(-2 * s * u)
        return -e / (4 * s) + e * (w * math.sin(2 * w * u) - s * math.cos(2 * w * u)) / (
            4 * (s * s + w * w)
        )

    assert integrate_squared_clamp_force([one], t) == pytest.approx(
        one.reaction**2 * (part(t) - part(0.0)), rel=1e-4
    )


def test_a_heavy_handle_leaves_the_finger_what_its_own_inertia_lets_through():
    # Origin: one mode on a mass so heavy that it does not move the mode: v = R / (i w m), P = b
    # |v|^2 / 2
    rod, heavy = Rod(2.5, 0.099, 0.0916, 0.57e-3, 0.07), Hand(50.0, 575.0, 1.3, 0.21, 176.0, 11.3)
    modes = compute_modes(rod)
    w, eta = math.tau * modes[0].frequency, modes[0].loss_factor
    total = heavy.handle_mass + rod.line_mass * rod.length + rod.end_mass
    blown = 0.5 * heavy.grasp_damping * (modes[0].reaction / (w * total)) ** 2
    spent = blown * -math.expm1(-w * eta * 16e-3) / (w * eta)
    stiffness = compute_rod_ring(rod).stiffness
    assert compute_energy_share_in_hand(rod, stiffness, modes, heavy) == pytest.approx(
        spent * 2.0 * stiffness, rel=0.02
    )
    assert compute_energy_share_in_hand(
        rod, stiffness, modes, STYLUS_HAND
    ) > 1000.0 * compute_energy_share_in_hand(rod, stiffness, modes, heavy)


def test_the_finger_takes_no_more_than_is_stored_and_nothing_without_a_damper():
    modes, stiffness = compute_modes(TIPPED), compute_rod_ring(TIPPED).stiffness
    assert 0.0 < compute_energy_share_in_hand(TIPPED, stiffness, modes) < 1.0
    dry = Hand(20e-3, 575.0, 1e-12, 0.21, 176.0, 11.3)
    assert compute_energy_share_in_hand(TIPPED, stiffness, modes, dry) < 1e-9
