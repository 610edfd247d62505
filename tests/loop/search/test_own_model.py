"""A model of one's own: the example of the guide runs as printed, and says what physics says."""

import re
from pathlib import Path

import pytest

GUIDE = Path(__file__).parents[3] / "docs" / "how-to" / "explain-a-model-of-your-own.md"


def test_the_pendulum_of_the_guide_lacks_its_amplitude():
    (code,) = re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(code, str(GUIDE), "exec"), names)
    found = names["found"]
    assert [(f.effect.id, str(f.verdict)) for f in found.findings] == [
        ("finite_amplitude", "effect")
    ]
    # origin: T = 2 pi sqrt(L / g) (1 + a^2 / 16 + 11 a^4 / 3072 + ...); up to 1 rad the next term
    # adds 11 / 192 of the first at most
    c, std = (one["finite_amplitude.c"] for one in (found.extended.values, found.extended.std))
    assert 1.0 / 16.0 - 3.0 * std < c < (1.0 + 11.0 / 192.0) / 16.0 + 3.0 * std
    assert found.extended.values["gravity"] == pytest.approx(9.81, rel=2e-3)
