"""Traces in every layout: what independent libraries write is read back to the bit.

And damage costs one trial.
"""

import h5py
import numpy as np
import pandas as pd
import pytest
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from oracles.traces import Course
from stepblocks.bench.faults import TraceError
from stepblocks.bench.session import open_session
from stepblocks.bench.signal import Trace
from stepblocks.bench.traces import READERS, Traces
from stepblocks.bench.traces.mat import list_mat_variables
from stepblocks.errors import BenchError
from stepblocks.rehearse.trace_files import TRACE_FILES, open_trace_writer

TIME = Course().clock()
COLUMNS = {"t": TIME, "x": Course().force(TIME), "y": 0.8 + 0.1 * TIME}
NAMED = 'time = "t", tangential = "x", normal = "y"'
INDEXED = "time = 0, tangential = 1, normal = 2"


def session(folder, traces, channels=NAMED, extra=""):
    (folder / "session.toml").write_text(
        'schema = 1\n[probe]\nspring_constant = "9810 N/m"\n[acquisition]\nsample_rate = "10 '
        'kHz"\n'
        f'traces = "{traces}"\nchannels = {{ {channels} }}\n{extra}\n'
    )
    (folder / "trials.csv").write_text("trial\n1\n2\n")
    return open_session(folder)


def read(folder, traces, trial="2", channels=NAMED, extra=""):
    with Traces(session(folder, traces, channels, extra)) as source:
        return source.read(trial)


def same(trace):
    for name, ours in zip(("time", "tangential", "normal"), COLUMNS.values(), strict=True):
        np.testing.assert_array_equal(getattr(trace, name), ours)


# Each writes the trial 2 with a library that is not ours.
def csv_file(folder):
    pd.DataFrame(COLUMNS).to_csv(folder / "run-2.csv", index=False)
    return "run-{trial}.csv", NAMED, ""


def csv_without_names(folder):
    lines = "made on a Monday\n" + pd.DataFrame(COLUMNS).to_csv(
        index=False, header=False, sep=" ", float_format="%.17g"
    )
    (folder / "run-2.dat").write_text(lines)
    return "run-{trial}.dat", INDEXED, 'format = "csv"\ndelimiter = " "\nskip_lines = 1'


def hdf5_groups(folder):
    with h5py.File(folder / "all.h5", "w") as file:
        for name, values in COLUMNS.items():
            file[f"trial_0002/{name}"] = values
    return "all.h5", NAMED, ""


def hdf5_file_per_trial(folder):
    with h5py.File(folder / "0002.hdf5", "w") as file:
        for name, values in COLUMNS.items():
            file[name] = values
    return "{trial:04d}.hdf5", NAMED, ""


def hdf5_matrix_lying(folder):
    with h5py.File(folder / "all.h5", "w") as file:
        file["2"] = np.stack(list(COLUMNS.values()))
    return "all.h5", INDEXED, 'group = "{trial}"'


def mat_struct(folder):
    savemat(folder / "all.mat", {"trial_2": COLUMNS, "notes": "dry"}, do_compression=True)
    return "all.mat", NAMED, ""


def mat_matrix_uncompressed(folder):
    savemat(
        folder / "all.mat", {"other": np.eye(3), "trial2": np.column_stack(list(COLUMNS.values()))}
    )
    return "all.mat", INDEXED, ""


def mat_file_per_trial(folder):
    savemat(folder / "run2.mat", COLUMNS)
    return "run{trial}.mat", NAMED, ""


def mat_of_version_7_3(folder):
    with h5py.File(folder / "all.mat", "w", userblock_size=512) as file:
        for name, values in COLUMNS.items():
            file[f"trial_2/{name}"] = values[None, :]
    return "all.mat", NAMED, ""


def tdms_groups(folder):
    with TdmsWriter(str(folder / "all.tdms")) as file:
        file.write_segment(
            [ChannelObject("trial 2", name, values) for name, values in COLUMNS.items()]
        )
    return "all.tdms", NAMED, ""


def tdms_file_per_trial(folder):
    # a file of its own may call its one group anything
    with TdmsWriter(str(folder / "2.tdms")) as file:
        file.write_segment(
            [ChannelObject("Untitled", name, values) for name, values in COLUMNS.items()]
        )
    return "{trial}.tdms", INDEXED, ""


WRITERS = (
    csv_file,
    csv_without_names,
    hdf5_groups,
    hdf5_file_per_trial,
    hdf5_matrix_lying,
    mat_struct,
    mat_matrix_uncompressed,
    mat_file_per_trial,
    mat_of_version_7_3,
    tdms_groups,
    tdms_file_per_trial,
)


@pytest.mark.parametrize("write", WRITERS)
def test_every_layout_is_read_back_to_the_bit(write, tmp_path):
    traces, channels, extra = write(tmp_path)
    same(read(tmp_path, traces, channels=channels, extra=extra))


@pytest.mark.parametrize("write", WRITERS)
def test_a_trial_that_is_not_there_costs_that_trial_alone(write, tmp_path):
    traces, channels, extra = write(tmp_path)
    with Traces(session(tmp_path, traces, channels, extra)) as source:
        with pytest.raises(TraceError, match="missing"):
            source.read("1")
        same(source.read("2"))


@pytest.mark.parametrize("write", WRITERS)
def test_an_unknown_channel_is_named(write, tmp_path):
    traces, channels, extra = write(tmp_path)
    wrong = channels.replace('"y"', '"pull"').replace("normal = 2", "normal = 9")
    with pytest.raises(TraceError, match=r"pull|9"):
        read(tmp_path, traces, channels=wrong, extra=extra)


def test_every_format_has_a_layout_here():
    # WAV has no columns by name: test_rows_and_wav has its layouts
    assert {write.__name__.split("_")[0] for write in WRITERS} == set(READERS) - {"wav"}


@pytest.mark.parametrize("kind", TRACE_FILES)
def test_what_we_write_is_what_we_read(kind, tmp_path):
    trace = Trace(*(values.astype(np.float32).astype(float) for values in COLUMNS.values()))
    with open_trace_writer(tmp_path, kind) as write:
        for trial in (1, 2):
            write(trial, Trace(trace.time, trial * trace.tangential, trace.normal))
    names = 'time = "time_s", tangential = "fx_n", normal = "fy_n"'
    found = read(tmp_path, TRACE_FILES[kind], channels=names)
    np.testing.assert_allclose(found.tangential, 2.0 * trace.tangential, rtol=1e-5)
    np.testing.assert_allclose(found.time, trace.time, atol=1e-6)


@pytest.mark.parametrize("suffix", ["h5", "mat", "tdms"])
@pytest.mark.parametrize("content", [b"", b"nonsense" * 100])
def test_a_container_that_is_none_is_one_clear_error(suffix, content, tmp_path):
    (tmp_path / f"all.{suffix}").write_bytes(content)
    if suffix == "tdms" and not content:
        pytest.skip("an empty file is a TDMS file without groups")
    with pytest.raises(BenchError, match="traces cannot be read"):
        read(tmp_path, f"all.{suffix}")


def test_a_version_5_file_that_is_cut_off_is_said_to_be_and_where(tmp_path):
    mat_struct(tmp_path)
    path = tmp_path / "all.mat"
    whole = path.read_bytes()
    assert set(list_mat_variables(path).extents) == {"trial_2", "notes"}
    path.write_bytes(whole[:-10])
    with pytest.raises(TraceError, match=r"all\.mat is damaged or truncated at byte"):
        list_mat_variables(path)


def test_bytes_that_turned_within_a_variable_cost_that_trial(tmp_path):
    traces, channels, extra = mat_struct(tmp_path)
    path = tmp_path / "all.mat"
    place, length = list_mat_variables(path).extents["trial_2"]
    data = bytearray(path.read_bytes())
    data[place + length // 2 : place + length // 2 + 40] = bytes(40)
    path.write_bytes(bytes(data))
    with pytest.raises(TraceError, match="unreadable: variable 'trial_2'"):
        read(tmp_path, traces, channels=channels, extra=extra)


def test_channels_of_different_length_are_truncated(tmp_path):
    with h5py.File(tmp_path / "all.h5", "w") as file:
        file["2/x"], file["2/y"] = np.zeros(100), np.zeros(90)
    with pytest.raises(
        TraceError, match=r"different lengths \(tangential 100, normal 90 samples\)"
    ):
        read(tmp_path, "all.h5", channels='tangential = "x", normal = "y"')


def test_of_a_record_the_declared_part_is_used_whenever_its_clock_begins(tmp_path):
    # samples every 0.1 ms from 5 s on: from 20 ms after the first up to 45 ms
    late = pd.DataFrame(COLUMNS).assign(t=TIME + 5.0)
    late.to_csv(tmp_path / "run-2.csv", index=False, float_format="%.17g")
    found = read(tmp_path, "run-{trial}.csv", extra='trim = ["20 ms", "45 ms"]')
    kept = (TIME >= 20e-3 - 1e-9) & (TIME < 45e-3 - 1e-9)
    assert 0 < kept.sum() < len(TIME)
    assert len(found.time) == pytest.approx(kept.sum(), abs=1)
    assert found.time[0] == pytest.approx(5.02, abs=1.1e-4)
    first = int(np.argmin(np.abs(TIME + 5.0 - found.time[0])))
    np.testing.assert_array_equal(found.tangential, COLUMNS["x"][first : first + len(found.time)])
    np.testing.assert_array_equal(found.normal, COLUMNS["y"][first : first + len(found.time)])


def test_a_part_that_ends_before_it_begins_is_refused(tmp_path):
    with pytest.raises(BenchError, match=r"trim` must be two times, the first before the second"):
        session(tmp_path, "run-{trial}.csv", extra='trim = ["2 s", "0.1 s"]')


def test_a_trial_cannot_name_a_file_elsewhere(tmp_path):
    csv_file(tmp_path)
    with Traces(session(tmp_path, "run-{trial}.csv")) as source:
        for trial in ("../2", "a/b", "..\\2"):
            with pytest.raises(TraceError, match="no part of a file name"):
                source.read(trial)


def test_text_among_numbers_and_tables_are_no_samples(tmp_path):
    with h5py.File(tmp_path / "all.h5", "w") as file:
        file["2/t"], file["2/y"] = TIME, np.zeros((5, 5))
        file["2/x"] = np.array([b"a", b"b"])
    with pytest.raises(TraceError, match="holds no numbers"):
        read(tmp_path, "all.h5")
    with pytest.raises(TraceError, match=r"is a table of shape \(5, 5\)"):
        read(tmp_path, "all.h5", channels='tangential = "y", normal = "t"')


@pytest.mark.parametrize("way", ["external link", "external group", "external storage", "virtual"])
def test_nothing_outside_the_session_is_read_through_an_hdf5_file(tmp_path, way):
    from stepblocks.bench.traces.hdf5 import Hdf5Reader
    from stepblocks.bench.traces.reader import TrialPlace

    with h5py.File(tmp_path / "secret.h5", "w") as secret:
        secret["group/fx"] = np.arange(8.0)
    (tmp_path / "raw.bin").write_bytes(np.arange(8.0).tobytes())
    path = tmp_path / "traces.h5"
    with h5py.File(path, "w") as file:
        if way == "external group":
            file["0001"] = h5py.ExternalLink("secret.h5", "/group")
        else:
            group = file.create_group("0001")
            if way == "external link":
                group["fx"] = h5py.ExternalLink("secret.h5", "/group/fx")
            elif way == "external storage":
                raw = [(str(tmp_path / "raw.bin"), 0, h5py.h5f.UNLIMITED)]
                group.create_dataset("fx", (8,), "f8", external=raw)
            else:
                layout = h5py.VirtualLayout((8,), "f8")
                layout[:] = h5py.VirtualSource(str(tmp_path / "secret.h5"), "group/fx", (8,))
                group.create_virtual_dataset("fx", layout)
    place = TrialPlace("1", ("0001",), has_own_file=False, is_whole_file=False)
    reader = Hdf5Reader()
    with (
        reader.open(path) as file,
        pytest.raises(TraceError, match="lies in another file, which is not read"),
    ):
        reader.read_column(reader.find_group(file, place), "fx")
