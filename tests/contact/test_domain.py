"""Every value outside the formulas is refused in one wording, alone or in an array."""

import math

import numpy as np
import pytest

from stepblocks.contact.domain import (
    require_finite,
    require_not_negative,
    require_positive,
    unwrap_scalar,
)
from stepblocks.errors import ContactError


@pytest.mark.parametrize(
    "value", [1e-300, 3, 2.5, np.float64(4.0), np.array([1.0, 2.0]), np.array([[1e300]])]
)
def test_what_is_positive_and_finite_passes_every_rule(value):
    for rule in (require_positive, require_not_negative, require_finite):
        rule("load", value)


@pytest.mark.parametrize(
    ("rule", "value", "message"),
    [
        (require_positive, 0.0, "load must be positive and finite, got 0 N"),
        (require_positive, math.inf, "load must be positive and finite, got inf N"),
        (
            require_positive,
            np.array([1.0, -2.0, -3.0]),
            "load must be positive and finite, got -2 N",
        ),
        (require_not_negative, -1e-9, "load must be finite and not negative, got -1e-09 N"),
        (
            require_not_negative,
            np.array([[0.0], [math.nan]]),
            "load must be finite and not negative, got nan N",
        ),
        (require_finite, -math.inf, "load must be finite, got -inf N"),
    ],
)
def test_the_first_wrong_value_is_named_with_its_rule_and_unit(rule, value, message):
    with pytest.raises(ContactError) as error:
        rule("load", value, "N")
    assert str(error.value) == message
    rule_without_unit = message.removesuffix(" N")
    with pytest.raises(ContactError) as error:
        rule("load", value)
    assert str(error.value) == rule_without_unit


def test_zero_is_not_positive_but_not_negative_either():
    require_not_negative("friction", 0.0)
    require_not_negative("friction", np.zeros(3))
    with pytest.raises(ContactError):
        require_positive("friction", np.zeros(3))


def test_a_number_comes_out_as_a_number_and_an_array_as_itself():
    assert type(unwrap_scalar(np.array(2.0))) is float
    many = np.array([1.0, 2.0])
    assert unwrap_scalar(many) is many
