"""One rule of what is missing: a fill value stands far off its column, or is named."""

import numpy as np
import pytest

from stepblocks.files.missing import is_missing_word, replace_fill_values_by_nan


@pytest.mark.parametrize(
    "fill", [-9999.0, -32768.0, 32767.0, 1e30, 1.70141e38, 3.4028234663852886e38]
)
def test_a_fill_value_far_off_its_column_is_missing(fill):
    found = replace_fill_values_by_nan(np.array([1.0, fill, 3.0, fill]))
    assert np.isnan(found.values).tolist() == [False, True, False, True]
    assert found.count == 2


def test_a_number_among_others_of_its_size_is_a_number():
    values = np.array([32765.0, 32766.0, 32767.0])
    assert replace_fill_values_by_nan(values).values is values


def test_a_declared_value_counts_alone():
    found = replace_fill_values_by_nan(np.array([0.0, 5.0, -9999.0]), (0.0,))
    assert np.isnan(found.values).tolist() == [True, False, False]
    assert replace_fill_values_by_nan(np.array([1.0, -9999.0]), ()).count == 0


@pytest.mark.parametrize(
    "word", ["", "NA", "n/a", "<NA>", "NaN", "#N/A", "None", "NULL", "-", '"NA"']
)
def test_words_for_a_missing_number(word):
    assert is_missing_word(word)


@pytest.mark.parametrize("word", ["0", "OVERLOAD", "Nancy"])
def test_words_that_are_none(word):
    assert not is_missing_word(word)
