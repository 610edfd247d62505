"""Which energies a person compares: those of the drag where it differs from the formula."""

from stepblocks.contact.counterface import Step
from stepblocks.contact.operating_point import OperatingPoint, Tool
from stepblocks.predict.perception import choose_compared_energies
from stepblocks.predict.predictions import predict_single_drag

POINT, EDGE = OperatingPoint(131e-6, 0.8, 0.17, Tool(8.7e3, 0.23)), 9e-6


def test_where_drag_and_formula_differ_for_one_block_the_drag_speaks_for_all():
    # from 20 to 33 um both agree; at 70 um the drag rings twice as much as the formula keeps
    for top, by in ((33e-6, "formula"), (70e-6, "drag")):
        made = [predict_single_drag(Step(height, EDGE), POINT) for height in (20e-6, top)]
        energies, said = choose_compared_energies(made)
        assert said == by
        one = made[0]
        kept = one.release.vibration_energy if by == "formula" else one.in_time.energy
        assert energies[0] == kept
