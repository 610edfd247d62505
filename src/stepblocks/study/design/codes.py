"""Blinding codes: what the experimenter reads and writes in place of a block's engraved identity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stepblocks.errors import StudyError

_ALPHABET = "ABCDEFHKLMNPRTUVWXY"  # no I, O, Q, S, Z, G, J: a hand writes them like others; 19 is prime
MAX_CODES = len(_ALPHABET) ** 2  # Most blocks that one study can tell apart


def is_code(text: str) -> bool:
    """Tell whether a text can be a blinding code.

    Examples
    --------
    >>> code = blinding_codes(["step-010"], np.random.default_rng(1))["step-010"]
    >>> is_code(code), is_code(code[:2] + "?")
    (True, False)
    """
    if len(text) != 3 or any(letter not in _ALPHABET for letter in text):
        return False
    first, second, check = (_ALPHABET.index(letter) for letter in text)
    return (2 * first + 3 * second + check) % len(_ALPHABET) == 0


def blinding_codes(identities: Sequence[str], generator: np.random.Generator) -> dict[str, str]:
    """Give every block a code that says nothing about it."""
    if len(identities) > MAX_CODES:
        raise StudyError(f"a study must have at most {MAX_CODES} blocks, got {len(identities)}")
    size = len(_ALPHABET)
    codes = {}
    for identity, number in zip(identities, generator.permutation(MAX_CODES), strict=False):
        first, second = divmod(int(number), size)
        codes[identity] = _ALPHABET[first] + _ALPHABET[second] + _ALPHABET[-(2 * first + 3 * second) % size]
    return codes
