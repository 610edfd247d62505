"""Printed run sheets: every trial once, nothing that unblinds, the same bytes twice, and room to
write.
"""

import pytest

from oracles.designs import compared, crossed
from stepblocks.study.analysis.page import render_run_sheets
from stepblocks.study.design.blocks import Item
from stepblocks.study.design.sheet import make_blinded_row

BLOCKS = [Item(f"step-{h:03}", f"STEP-{h:03}", h * 1e-6) for h in (25, 50, 75)]
DESIGNS = {
    "estimates": lambda: crossed("estimates", 2, BLOCKS, 5, 1, ("bare", "hard", "soft")),
    "virtual": lambda: crossed("virtual", 2, BLOCKS, 2, 1),
    "constant": lambda: compared(2, BLOCKS, 20, 1, "step-050"),
}


def sheets(experiment):
    rows = DESIGNS[experiment]().trials
    return {
        who: [make_blinded_row(row) for row in rows if row["participant"] == who]
        for who in ("1", "2")
    }


@pytest.mark.parametrize("experiment", sorted(DESIGNS))
def test_every_trial_is_one_row_of_its_participant_and_nothing_unblinds_it(experiment):
    page = render_run_sheets("A study", sheets(experiment))
    for who, rows in sheets(experiment).items():
        part = page.split("<section>")[int(who)]
        assert f"participant {who}" in part
        assert part.count("<tr>") == 1 + len(rows)
        for row in rows:
            cells = "".join(
                f"<td{' class=' + chr(34) + 'code' + chr(34) if name.endswith('code') else ''}>"
                f"{text}</td>"
                for name, text in row.items()
                if name != "participant"
            )
            assert f"<tr>{cells}</tr>" in part
    assert "step-" not in page.lower().split("</style>")[1]
    assert render_run_sheets("A study", sheets(experiment)) == page
