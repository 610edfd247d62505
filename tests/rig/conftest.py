"""Lengths of micrometres and energies of microjoules: pytest's default absolute tolerance of 1e-12
would be met by anything.
"""

import pytest

# the scalar comparison, to which those of arrays and lists come down
APPROX = type(pytest.approx(1.0))


@pytest.fixture(autouse=True)
def _no_absolute_tolerance_unless_it_is_stated(monkeypatch):
    monkeypatch.setattr(APPROX, "DEFAULT_ABSOLUTE_TOLERANCE", 0.0)
