"""As-built records: what is written reads back, folders are searched, and one stimulus has one
record."""

import numpy as np
import pytest

from stepblocks.errors import MetrologyError, PipelineError
from stepblocks.records.as_built import (
    AsBuilt,
    AsBuiltValue,
    collect_measured_edges,
    read_as_built,
    read_one_record_per_stimulus,
    read_records_by_serial,
    write_as_built,
)
from stepblocks.scans.scan import ScannedProfile

HEIGHT = AsBuiltValue(50.2e-6, 20e-9, "conforms")
RADIUS = AsBuiltValue(14e-6, 0.3e-6, "does not conform")


def record(stimulus="step-050", **values):
    surface = values.pop("surface", None)
    return AsBuilt(
        stimulus, "scan.csv", "0" * 64, "two planes", values or {"step_height": HEIGHT}, surface
    )


def test_a_record_reads_back_as_it_was_written_with_its_surface_to_a_picometre(tmp_path):
    x = np.arange(-50, 50) * 1e-6
    z = np.where(x < 0.0, 0.0, 50.2e-6) + np.random.default_rng(1).normal(0.0, 20e-9, 100)
    z[7] = np.nan
    written = record(step_height=HEIGHT, edge_radius=RADIUS, surface=ScannedProfile(x, z))
    paths = write_as_built(tmp_path / "step-050.as-built.toml", written)
    assert [path.name for path in paths] == [
        "step-050.as-built.toml",
        "step-050.as-built.profile.csv",
    ]
    back = read_as_built(str(paths[0]))
    assert back == written  # the surface is compared below
    np.testing.assert_allclose(back.surface.position, x, atol=0.5e-12)
    np.testing.assert_allclose(back.surface.height, z, atol=0.5e-12)


def test_without_a_surface_there_is_no_second_file(tmp_path):
    assert write_as_built(tmp_path / "a.as-built.toml", record()) == [tmp_path / "a.as-built.toml"]
    assert read_as_built(tmp_path / "a.as-built.toml").surface is None


@pytest.mark.parametrize(
    ("keys", "height"),
    [
        (("step_height", "groove_depth"), "step_height"),
        (("edge_radius", "ridge_height"), "ridge_height"),
        (("groove_depth",), "groove_depth"),
        (("edge_radius", "ball_radius"), None),
    ],
)
def test_the_height_of_a_step_is_that_of_the_edge_or_of_the_feature_beside_it(keys, height):
    values = {key: AsBuiltValue(1e-6 * len(key), 1e-9, "conforms") for key in keys}
    assert record(**values).height == (None if height is None else values[height])


def test_folders_and_files_may_be_mixed_and_records_are_found_by_their_stimulus(tmp_path):
    (tmp_path / "folder").mkdir()
    for name in ("step-050", "step-060"):
        write_as_built(tmp_path / "folder" / f"{name}.as-built.toml", record(name))
    write_as_built(tmp_path / "any-name.toml", record("step-070"))
    found = read_one_record_per_stimulus([tmp_path / "folder", tmp_path / "any-name.toml"])
    assert sorted(found) == ["step-050", "step-060", "step-070"]
    with pytest.raises(PipelineError, match="name each stimulus once, got step-070 twice"):
        read_one_record_per_stimulus([tmp_path / "any-name.toml", tmp_path / "any-name.toml"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(PipelineError, match="at least one record"):
        read_one_record_per_stimulus([tmp_path / "empty"])


def test_folders_in_a_folder_are_those_of_serial_numbers(tmp_path):
    for serial in ("SN-1", "SN-2"):
        (tmp_path / serial).mkdir()
        write_as_built(tmp_path / serial / "step-050.as-built.toml", record("step-050"))
    groups = read_records_by_serial([tmp_path])
    assert {serial: list(of_block) for serial, of_block in groups.items()} == {
        "SN-1": ["step-050"],
        "SN-2": ["step-050"],
    }
    with pytest.raises(PipelineError, match="give the folder of one serial number"):
        read_one_record_per_stimulus([tmp_path])


def test_a_record_without_a_height_says_nothing_of_an_edge():
    edges = collect_measured_edges(
        {"tip-125": record("tip-125", ball_radius=RADIUS), "step-050": record()}
    )
    assert edges == {"step-050": {"height_m": 50.2e-6, "height_std_m": 20e-9}}


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (
            lambda text: text.replace('scan = "scan.csv"', "scan = 5"),
            "scan: input should be a valid string, got 5",
        ),
        (
            lambda text: text.replace('std = "20 nm"', 'std = "-20 nm"'),
            "values.step_height.std: input should be greater than or equal to 0",
        ),
        (lambda text: text + " " * 1_000_001, "must be at most 1000000 bytes, got"),
        (
            lambda text: text.replace("schema = 1", 'schema = 1\nprofile = "a.csv"'),
            "with profile_sha256",
        ),
        (
            lambda text: text.replace(
                "schema = 1", f'schema = 1\nprofile = "{"a" * 5000}"\nprofile_sha256 = "b"'
            ),
            "must lie beside the record",
        ),
    ],
)
def test_a_record_that_was_changed_by_hand_is_refused_with_its_place(change, rule, tmp_path):
    path = tmp_path / "a.as-built.toml"
    write_as_built(path, record())
    path.write_text(change(path.read_text()))
    with pytest.raises(MetrologyError, match=rule) as caught:
        read_as_built(path)
    assert "a.as-built.toml" in str(caught.value)


def test_records_survive_odd_names_and_refuse_what_they_do_not_know(tmp_path):
    path = tmp_path / "a.toml"
    record = AsBuilt(
        "step-010",
        'my "scan"\\1\n.csv',
        "0" * 64,
        "µm",
        {"step_height": AsBuiltValue(1.00000001e-5, 2e-9, "conforms")},
    )
    write_as_built(path, record)
    back = read_as_built(path)
    assert back.scan == record.scan
    assert back.values["step_height"].value == pytest.approx(1.00000001e-5, rel=1e-9)
    for text, rule in {
        "schema = 2": "schema: input should be 1",
        "not toml": "TOML",
        path.read_text().replace('"10.0000001 um"', '"10"'): "must be a length",
        path.read_text().replace("std = ", "spread = "): "values.step_height.std is missing",
        'schema = 1\nstimulus = "a"\nscan = "b"\nscan_sha256 = ""\nconvention = '
        '""\n': "values is missing",
    }.items():
        path.write_text(text)
        with pytest.raises(MetrologyError, match=rule):
            read_as_built(path)


def test_an_inspected_block_speaks_in_the_closed_loop_with_its_own_height_and_edge(tmp_path):
    values = {
        "groove_depth": AsBuiltValue(50.4e-6, 20e-9, "conforms"),
        "edge_radius": AsBuiltValue(14e-6, 0.3e-6, "does-not-conform"),
    }
    write_as_built(
        tmp_path / "step-050.as-built.toml",
        AsBuilt("step-050", "scan.x3p", "0" * 64, "type A1", values),
    )
    edges = collect_measured_edges(read_one_record_per_stimulus([tmp_path]))
    assert edges["step-050"] == pytest.approx(
        {
            "height_m": 50.4e-6,
            "height_std_m": 20e-9,
            "edge_radius_m": 14e-6,
            "edge_radius_std_m": 0.3e-6,
        }
    )
