"""The drawing of a step wrung from two gauge blocks: section, view from above, edge and tables."""

from collections.abc import Iterable

from stepblocks.parts.body import Body
from stepblocks.parts.gauge_pair import (
    GRADES,
    RIM,
    SECTION_LENGTH,
    SECTION_WIDTH,
    WRINGING,
    GaugePair,
    find_gauge_pair,
    make_gauge_base,
)
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.on_paper import format_millimetres
from stepblocks.workshop.gauge_reach import Contribution, JudgedCharacteristic
from stepblocks.workshop.paper import (
    MILLIMETRES_PER_METRE,
    Alignment,
    Point,
    View,
    choose_standard_scale,
    format_scale,
    replace_decimal_points_by_commas,
)
from stepblocks.workshop.sheet import Note, Sheet

_SECTION_MIDDLE: Point = (105.0, 244.0)  # of the section A-A on the paper
_SECTION_SIZE = (142.0, 46.0)  # at most
_TOP_MIDDLE: Point = (105.0, 160.0)
_TOP_SIZE = (120.0, 80.0)
_EDGE: Point = (296.0, 226.0)  # foot of the step in detail D
_EDGE_HEIGHT = 30.0  # of the step there, at most
_NOTES: Point = (25.0, 104.0)
_PARTS_CORNER: Point = (232.0, 198.0)
_GRADES_CORNER: Point = (232.0, 168.0)
_REACH_CORNER: Point = (232.0, 133.0)
_EXACT = 1e-12  # rounding within which a deviation is its limit [m]
_PART_WIDTHS = (10.0, 102.0, 64.0)
_GRADE_WIDTHS = (22.0, 34.0, 38.0, 30.0, 30.0, 22.0)
_REACH_WIDTHS = (22.0, 64.0, 90.0)


def draw_gauge_assembly_views(
    sheet: Sheet, block: StepBlock, pair: GaugePair, judged: Iterable[JudgedCharacteristic]
) -> None:
    """Draw a step from two gauge blocks: how it is put together, what it is and what it misses.

    Parameters
    ----------
    sheet : Sheet
        With the characteristics of the block.
    block : StepBlock
        The block in one piece.
    pair : GaugePair
        Gauge blocks whose difference is its height.
    judged : iterable of JudgedCharacteristic
        What decides about each characteristic of the block.
    """
    base = make_gauge_base(block, pair)
    _draw_assembly_section(sheet, base, pair)
    _draw_assembly_from_above(sheet, base)
    _draw_step_detail(sheet, block)
    _draw_parts_table(sheet, base, pair)
    _draw_grades_table(sheet, block, pair)
    _draw_table_of_reached_characteristics(sheet, judged)
    sheet.write_notes(_NOTES, [Note(line) for line in _list_assembly_notes(pair)])


def _draw_assembly_section(sheet: Sheet, base: Body, pair: GaugePair) -> None:
    """Draw base and gauge blocks in section, clear of the holes."""
    tall = base.thickness.nominal + pair.upper
    scale = _choose_fitting_scale((base.length.nominal, tall), _SECTION_SIZE)
    middle_x, middle_y = _SECTION_MIDDLE
    base_top = middle_y + (0.5 * tall - pair.upper) * MILLIMETRES_PER_METRE * scale
    view = View((middle_x, base_top), scale)
    half = base.half_length
    thickness = base.thickness.nominal
    _draw_cut_box(sheet, view.map_to_paper(-half, -thickness), view.map_to_paper(half, 0.0), 0.0)
    _draw_cut_box(
        sheet, view.map_to_paper(-SECTION_WIDTH, 0.0), view.map_to_paper(0.0, pair.lower), 90.0
    )
    _draw_cut_box(
        sheet, view.map_to_paper(0.0, 0.0), view.map_to_paper(SECTION_WIDTH, pair.upper), 0.0
    )
    right, _ = view.map_to_paper(half, 0.0)
    _, low = view.map_to_paper(-half, -thickness)
    upper_x, upper_y = view.map_to_paper(0.7 * SECTION_WIDTH, 0.5 * pair.upper)
    sheet.draw_leader((upper_x, upper_y), (right + 6.0, upper_y + 9.0), "3, upper")
    lower_x, lower_y = view.map_to_paper(-0.7 * SECTION_WIDTH, 0.5 * pair.lower)
    sheet.draw_leader((lower_x, lower_y), (lower_x - 6.0, lower_y + 11.0), "2, lower")
    base_y = 0.5 * (base_top + low)
    sheet.draw_leader((right - 2.0, base_y), (right + 6.0, base_y), "1, base")
    edge_x, edge_y = view.map_to_paper(0.0, pair.upper)
    sheet.draw_leader((edge_x, edge_y), (edge_x + 6.0, edge_y + 14.0), "working edge, detail D")
    caption = f"A-A   {format_scale(scale)}, beside the holes"
    sheet.write_text((middle_x, low - 8.0), caption, alignment=Alignment.BOTTOM_CENTER)


def _draw_cut_box(
    sheet: Sheet, low_corner: Point, high_corner: Point, hatch_degrees: float
) -> None:
    """Draw a rectangle that is cut, with its hatch."""
    left, bottom = low_corner
    right, top = high_corner
    sheet.draw_hatch([low_corner, (right, bottom), high_corner, (left, top)], hatch_degrees)
    sheet.draw_rectangle(low_corner, high_corner)


def _draw_assembly_from_above(sheet: Sheet, base: Body) -> None:
    """Draw base and gauge blocks from above, with the place of the section."""
    scale = _choose_fitting_scale((base.length.nominal, base.width.nominal), _TOP_SIZE)
    view = View(_TOP_MIDDLE, scale)
    half_length = base.half_length
    half_width = base.half_width
    half_section = 0.5 * SECTION_LENGTH
    left, low = view.map_to_paper(-half_length, -half_width)
    right, high = view.map_to_paper(half_length, half_width)
    sheet.draw_rectangle((left, low), (right, high))
    near = view.map_to_paper(-SECTION_WIDTH, -half_section)
    far = view.map_to_paper(SECTION_WIDTH, half_section)
    sheet.draw_rectangle(near, view.map_to_paper(0.0, half_section))
    sheet.draw_rectangle(view.map_to_paper(0.0, -half_section), far)
    middle_x, middle_y = _TOP_MIDDLE
    sheet.draw_cutting_line((left - 8.0, middle_y - 6.0), (right + 8.0, middle_y - 6.0), "A")
    for number, share in (("2", -0.5), ("3", 0.5)):
        place = view.map_to_paper(share * SECTION_WIDTH, 0.3 * half_section)
        sheet.write_text(place, number, 3.5, Alignment.MIDDLE_CENTER)
    size = f"{SECTION_LENGTH * 1e3:g} x {SECTION_WIDTH * 1e3:g}"
    tip = view.map_to_paper(SECTION_WIDTH, 0.7 * half_section)
    sheet.draw_leader(tip, (right + 6.0, tip[1] + 3.0), f"2 x {size}, long sides")
    sheet.write_text((right + 10.0, tip[1] - 3.0), "together, in the middle")
    caption = f"top {format_scale(scale)}, rim of {RIM * 1e3:g} or more"
    sheet.write_text((middle_x, low - 7.0), caption, alignment=Alignment.BOTTOM_CENTER)


def _choose_fitting_scale(size: tuple[float, float], room_mm: tuple[float, float]) -> float:
    """Choose the largest scale at which a size [m] fits into a room on the paper [mm]."""
    length, height = size
    wide, tall = room_mm
    largest = min(wide / (length * MILLIMETRES_PER_METRE), tall / (height * MILLIMETRES_PER_METRE))
    return choose_standard_scale(largest)


def _draw_step_detail(sheet: Sheet, block: StepBlock) -> None:
    """Draw detail D: the step between both gauge blocks, heights enlarged."""
    x, lower = _EDGE
    height = block.height.nominal * MILLIMETRES_PER_METRE
    scale = choose_standard_scale(_EDGE_HEIGHT / height)
    top = lower + height * scale
    left = x - 44.0
    right = x + 50.0
    sheet.draw_polyline([(left, lower), (x, lower), (x, top), (right, top)])
    sheet.draw_line((x, lower), (x, lower - 9.0))
    sheet.draw_break_line(left, lower - 9.0, lower)
    sheet.draw_break_line(right, lower - 9.0, top)
    sheet.draw_dimension(
        "step_height", (x - 26.0, lower), (x, top), (x - 14.0, lower), scale, upright=True
    )
    sheet.draw_characteristic_leader(
        "edge_radius", (x, top), (x + 8.0, top + 9.0), "R {}, no chamfer"
    )
    for place, text in (((x - 22.0, lower - 5.0), "2"), ((x + 24.0, lower + 3.0), "3")):
        sheet.write_text(place, text, 3.5, Alignment.MIDDLE_CENTER)
    caption = f"D   heights {format_scale(scale)}, lengths not to scale"
    sheet.write_text((x, lower - 18.0), caption, alignment=Alignment.BOTTOM_CENTER)


def _draw_parts_table(sheet: Sheet, base: Body, pair: GaugePair) -> None:
    """Draw the table of the three parts with their sizes."""
    sizes = (base.length.nominal, base.width.nominal, base.thickness.nominal)
    base_size = replace_decimal_points_by_commas(" x ".join(f"{size * 1e3:.7g}" for size in sizes))
    rows = [("no.", "part", "size")]
    rows.append(("1", "base of the material below, its top lapped", base_size))
    section = f"{SECTION_LENGTH * 1e3:g} x {SECTION_WIDTH * 1e3:g}"
    for number, length in (("2", pair.lower), ("3", pair.upper)):
        size = f"{_format_gauge_length(length)} long, section {section}"
        rows.append((number, f"gauge block, ISO 3650, grade {pair.grade}", size))
    sheet.write_table(_PARTS_CORNER, rows, _PART_WIDTHS)


def _draw_grades_table(sheet: Sheet, block: StepBlock, pair: GaugePair) -> None:
    """Draw the table of what the step of each grade may be off by."""
    permitted = min(block.height.upper, -block.height.lower)
    rows = [
        ("grade", "length, each", "½ variation, each", "step at worst", "95 % within", "reaches")
    ]
    for grade, limits in GRADES.items():
        graded = find_gauge_pair(block.height.nominal, grade)
        if graded is None:
            continue
        name = grade
        if grade == pair.grade:
            name = f"{grade}, drawn"
        reaches = "yes"
        if graded.worst > permitted + _EXACT:
            reaches = "no"
        row = (
            name,
            _format_symmetric_deviation(limits.deviation),
            _format_symmetric_deviation(0.5 * limits.variation),
            _format_symmetric_deviation(graded.worst),
            _format_symmetric_deviation(graded.expected),
            reaches,
        )
        rows.append(row)
    sheet.write_table(_GRADES_CORNER, rows, _GRADE_WIDTHS)


def _format_symmetric_deviation(deviation: float) -> str:
    """Write a deviation to either side [m] in micrometres."""
    return f"±{_format_micrometres(deviation)}"


def _format_micrometres(length: float) -> str:
    """Write a small length [m] in micrometres."""
    return replace_decimal_points_by_commas(f"{length * 1e6:.2g} µm")


def _format_gauge_length(length: float) -> str:
    """Write the length of a gauge block [m] in millimetres, with the decimals of the set."""
    return replace_decimal_points_by_commas(format_millimetres(length, 4))


def _draw_table_of_reached_characteristics(
    sheet: Sheet, judged: Iterable[JudgedCharacteristic]
) -> None:
    """Draw the table of the characteristics that the assembly reaches or misses, with reasons."""
    numbers: dict[Contribution, list[int]] = {}
    for item in judged:
        numbers.setdefault(item.contribution, []).append(item.number)
    rows = [("reached", "no. on the inspection sheet", "by, or why not")]
    for contribution in Contribution:
        if contribution in numbers:
            listed = format_number_ranges(numbers[contribution])
            rows.append((contribution.reach.value, listed, contribution.value))
    sheet.write_table(_REACH_CORNER, rows, _REACH_WIDTHS)


def format_number_ranges(numbers: Iterable[int]) -> str:
    """Write ascending whole numbers, those that follow one another as a range: ``1-4, 7``."""
    ranges: list[list[int]] = []
    for number in numbers:
        if ranges and number == ranges[-1][1] + 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])
    texts = []
    for first, last in ranges:
        text = f"{first}"
        if last > first:
            text = f"{first}-{last}"
        texts.append(text)
    return ", ".join(texts)


def _list_assembly_notes(pair: GaugePair) -> list[str]:
    """List the notes on the resulting step, and on preparing, wringing and holding the parts."""
    lengths = f"{_format_gauge_length(pair.upper)} - {_format_gauge_length(pair.lower)}"
    height = _format_gauge_length(pair.upper - pair.lower)
    std = _format_micrometres(0.5 * pair.expected)
    expected = _format_symmetric_deviation(pair.expected)
    worst = _format_symmetric_deviation(pair.worst)
    film = _format_symmetric_deviation(WRINGING)
    return [
        f"Step: {lengths} = {height} mm; standard uncertainty {std}, 95 % within {expected},",
        f"at worst {worst}: lengths, half of their variations, {film} of film under each block.",
        "",
        "Base: top flat within 0,1 µm, Ra 0,02 µm, since thin gauge blocks take its form. Holes,",
        "edges and letters as on the part drawing, from the middle of the base.",
        "Part 3: no chamfer at the working edge (usual: 0,1 to 0,3). Order it so, or lap it off.",
        "",
        "1  Stone off burrs, clean all faces with solvent, look at them under an optical flat.",
        "2  Wipe a trace of oil on and off. Lay part 2 crosswise, press, slide and turn it until",
        "    it clings. Wring part 3 likewise, its long side against that of part 2.",
        "3  Hold the base alone: by its screws, or in a vice at its sides; no clamp on the blocks.",
        "4  Straight, parallel fringes on parts 2 and 3 show that they are wrung; else wring anew.",
        "    Let all cool to 20 °C, then measure as on the inspection sheet.",
        "5  After use slide the blocks apart, never pull; oil and store them.",
    ]
