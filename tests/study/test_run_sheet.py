"""Printed run sheets: every trial once, nothing that unblinds, the same bytes twice, and room to write."""

import pytest

from stepblocks.study.design import Item, design_constant_stimuli, design_crossover
from stepblocks.study.experiments import EXPERIMENTS
from stepblocks.study.page import draw_sheet_pages, render_sheets_pdf
from stepblocks.study.sheet import blind_rows

BLOCKS = [Item(f"step-{h:03}", f"STEP-{h:03}", h * 1e-6) for h in (25, 50, 75)]
DESIGNS = {
    "estimates": lambda: design_crossover("estimates", 2, BLOCKS, 5, 1, ("bare", "hard", "soft")),
    "virtual": lambda: EXPERIMENTS["virtual"].design(2, BLOCKS, 2, 1),
    "constant": lambda: design_constant_stimuli(2, BLOCKS, 20, 1, "step-050"),
}


def sheets(experiment):
    rows = DESIGNS[experiment]().trials
    return {
        who: blind_rows([row for row in rows if row["participant"] == who]) for who in ("1", "2")
    }


@pytest.mark.parametrize("experiment", sorted(DESIGNS))
def test_every_trial_stands_once_on_the_pages_of_its_participant_and_nothing_unblinds_it(
    experiment,
):
    given = sheets(experiment)
    printed = {"1": [], "2": []}
    for page in draw_sheet_pages("A study", given):
        texts = [text.get_text() for text in page.axes[0].texts]
        printed[texts[0][-1]] += texts
    for who, rows in given.items():
        for row in rows:
            for name, text in row.items():
                if name != "participant" and text:
                    shown = sum(other[name] == text for other in rows)
                    if name == "trial":
                        assert printed[who].count(text) == shown == 1
                    else:
                        assert printed[who].count(text) >= shown
        assert not any("step-" in text.lower() for text in printed[who])


def test_the_pdf_has_a_page_per_38_trials_of_each_participant_and_no_time_stamp():
    given = sheets("constant")
    content = render_sheets_pdf("constant", given)
    assert content.startswith(b"%PDF")
    assert content.count(b"/Type /Page ") == 2 * 3  # 80 trials each
    assert b"/CreationDate" not in content
    assert render_sheets_pdf("constant", given) == content


def test_no_text_leaves_its_cell_or_the_page():
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    for experiment in DESIGNS:
        page = next(iter(draw_sheet_pages(EXPERIMENTS[experiment].sheet_title, sheets(experiment))))
        renderer = FigureCanvasAgg(page).get_renderer()
        axes = page.axes[0]
        boxes = [
            (t, t.get_window_extent(renderer).transformed(axes.transData.inverted()))
            for t in axes.texts
        ]
        for text, box in boxes:
            assert 10.0 < box.x0 < box.x1 < 200.0, text.get_text()
            assert 8.0 < box.y0 < box.y1 < 290.0, text.get_text()
        for index, (one, a) in enumerate(boxes):
            for other, b in boxes[index + 1 :]:
                assert a.x1 < b.x0 or b.x1 < a.x0 or a.y1 < b.y0 or b.y1 < a.y0, (
                    one.get_text(),
                    other.get_text(),
                )
