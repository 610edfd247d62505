"""Promise: a set declared in Python goes wherever the file of the same set goes."""

import numpy as np
import pandas as pd
import pytest

import stepblocks
from stepblocks import StimulusSet


@pytest.fixture(scope="module")
def declared():
    return StimulusSet.declare("mine", step_block=[{"id": "low", "height": "25 um"}])


@pytest.fixture(scope="module")
def built(declared, tmp_path_factory):
    folder = tmp_path_factory.mktemp("python")
    declared.to_toml(folder / "mine.toml")
    reports = {
        "set": stepblocks.build_sets(declared, folder / "set", jobs=1),
        "file": stepblocks.build_sets(folder / "mine.toml", folder / "file", jobs=1),
    }
    return folder, reports


@pytest.mark.long
def test_a_set_is_built_to_the_bytes_of_its_file(built):
    folder, reports = built
    assert all(one.built == ["mine/low"] and not one.failures for one in reports.values())
    trees = [
        {
            path.relative_to(folder / name): path.read_bytes()
            for path in (folder / name).rglob("*")
            if path.is_file()
        }
        for name in reports
    ]
    assert trees[0] == trees[1]


def test_a_set_is_up_to_date_as_its_file_is(declared, built):
    again = stepblocks.build_sets(declared, built[0] / "set")
    assert (again.built, again.current) == ([], 1)


def test_a_set_is_checked_as_its_file_is(declared, built):
    folder, _ = built
    by_set = list(stepblocks.check_output(declared, folder / "set"))
    assert by_set == list(stepblocks.check_output(folder / "mine.toml", folder / "set"))
    assert all(verdict.passed for _, verdicts in by_set for verdict in verdicts)
    thicker = StimulusSet.declare("mine", step_block=[{"id": "low", "height": "26 um"}])
    found = stepblocks.check_output(thicker, folder / "set")
    assert any(not verdict.passed for _, verdicts in found for verdict in verdicts)


def test_a_scan_is_judged_against_a_part_of_a_set(declared):
    x = np.linspace(-2e-3, 2e-3, 4001)
    scan = x, np.where(x < 0.0, 0.0, 25.2e-6)
    results = [
        stepblocks.inspect_scan(scan, one, stimuli=declared)
        for one in ("low", declared.step_block[0])
    ]
    for result in results:
        assert result.evaluation.values["step_height"].value == pytest.approx(25.2e-6, abs=20e-9)


def test_a_scan_is_judged_from_whatever_holds_it(tmp_path, declared):
    part = declared.step_block[0]
    x = np.linspace(-1e-3, 1e-3, 1001)
    z = np.where(x < 0.0, 0.0, 25.1e-6)
    z[100] = np.nan
    table = pd.DataFrame({"x_um": 1e6 * x, "z_um": 1e6 * z})
    table.to_csv(tmp_path / "scan.csv", index=False, na_rep="nan")
    held = [
        tmp_path / "scan.csv",
        table,
        (x, z),
        np.stack([x, z]),
        stepblocks.ScannedProfile(x, z),
    ]
    found = [stepblocks.inspect_scan(one, part).evaluation.values["step_height"] for one in held]
    for one in found:
        assert one.value == pytest.approx(25.1e-6, abs=1e-10)
        # arrays have no last digit, whose rounding is a share of the budget of a file
        assert one.std == pytest.approx(found[0].std, rel=0.01)
    assert found[1].std == found[0].std
    grid = pd.DataFrame(
        {"x_um": np.tile(1e6 * x, 3), "y_um": np.repeat([0.0, 5.0, 10.0], len(x)), "z_um": 0.0}
    )
    grid["z_um"] = np.where(grid["x_um"] < 0.0, 0.0, 25.1)
    mapped = stepblocks.inspect_scan(grid, part).evaluation.values["step_height"]
    assert mapped.value == pytest.approx(25.1e-6, abs=1e-10)
    with pytest.raises(stepblocks.StepblocksError, match="unit"):
        stepblocks.inspect_scan(pd.DataFrame({"x": x, "z": z}), part)


def test_a_part_of_a_set_is_dragged_over_by_its_name(declared):
    by_name = stepblocks.drag_over("low", stimuli=declared)
    face = declared.step_block[0].counterface()
    assert by_name.trace.peak_force == stepblocks.drag_over(face).trace.peak_force
    with pytest.raises(
        stepblocks.StepblocksError, match="declared in mine, got 'high'; declared are low"
    ):
        stepblocks.drag_over("high", stimuli=declared)


@pytest.mark.long
def test_a_set_is_drawn_and_exported_as_its_file_is(declared, built, tmp_path):
    source = built[0] / "mine.toml"
    for name, given in (("set", declared), ("file", source)):
        orders = stepblocks.order_parts(given, tmp_path / name)
        assert [one.name for one in orders] == ["mine/low", "mine/quotation"]
        stepblocks.export_scenes(given, "mujoco", tmp_path / name / "scene")
    names = [
        sorted(path.relative_to(tmp_path / one) for path in (tmp_path / one).rglob("*"))
        for one in ("set", "file")
    ]
    assert names[0] == names[1]


@pytest.mark.parametrize("function", [stepblocks.check_output, stepblocks.order_parts])
def test_what_is_no_set_is_refused_in_one_line(function, tmp_path):
    with pytest.raises(stepblocks.StepblocksError, match="a set must be a path or a StimulusSet"):
        function([3.0], tmp_path)


def test_of_many_entries_that_are_no_parts_the_first_is_named():
    # a mistake each would fill the memory: ten million ended the process in the validation
    with pytest.raises(stepblocks.StepblocksError, match=r"stimuli\.0: .* Part, got 1") as error:
        StimulusSet(name="mine", title="Mine", stimuli=[1, 2, 3])
    assert "stimuli.1" not in str(error.value)


def test_a_study_has_the_blocks_of_a_set_as_of_its_file(tmp_path):
    declared = StimulusSet.declare(
        "mine", step_block=[{"id": name, "height": f"{name[1:]} um"} for name in ("h20", "h40")]
    )
    declared.to_toml(tmp_path / "mine.toml")
    sources = {"set": declared, "file": tmp_path / "mine.toml"}
    designs = []
    for name, source in sources.items():
        stepblocks.design_study(source, tmp_path / name, seed=7, participants=2)
        stepblocks.write_sheets(tmp_path / name)
        stepblocks.simulate_study(tmp_path / name, source, tmp_path / name / "answers.csv", seed=7)
        designs.append({path.name: path.read_bytes() for path in (tmp_path / name).rglob("*.csv")})
    assert "answers.csv" in designs[0]
    assert designs[0] == designs[1]
    powers = [
        stepblocks.study_power(
            source,
            seed=7,
            damping={"bare": 1.0, "soft": 0.5},
            participants=(3,),
            analysis="f-test",
            runs=10,
        )
        for source in sources.values()
    ]
    assert powers[0].equals(powers[1])


@pytest.mark.parametrize("height", [50e-6, np.float64(50e-6), "50 um", "0.05 mm"])
def test_a_length_in_python_is_metres_or_states_its_unit(height):
    assert stepblocks.StepBlock(id="a", height=height).height.nominal == 50e-6
    assert stepblocks.Step(height).height == 50e-6
    declared = StimulusSet.declare("mine", step_block=[{"id": "a", "height": height}])
    assert declared.stimuli[0].height.nominal == 50e-6


@pytest.mark.parametrize("height", [50, True, float("nan"), -1e-6])
def test_a_number_that_is_no_height_is_refused_in_python(height):
    with pytest.raises(stepblocks.StepblocksError, match="height: must"):
        stepblocks.StepBlock(id="a", height=height)


def test_a_number_without_its_unit_is_refused_in_a_file(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('[[step_block]]\nid = "a"\nheight = 5e-5\n')
    with pytest.raises(stepblocks.StepblocksError, match="a number needs its unit"):
        stepblocks.load_set(path)


def test_a_set_in_python_has_the_tips_of_the_paper_as_a_file_has():
    block = stepblocks.StepBlock(id="a", height=50e-6)
    assert StimulusSet(name="m", title="M", stimuli=(block,)).prediction.tip_radii == (125e-6,)
