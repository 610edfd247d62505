"""Arrays of a row per trial, and WAV files, as laboratories keep them."""

import h5py
import numpy as np
import pytest
from scipy.io import savemat, wavfile

from stepblocks.bench.session import open_session
from stepblocks.bench.traces import Traces
from stepblocks.errors import BenchError

DECLARED = """schema = 1
[probe]
spring_constant = "9.81 N/mm"
[acquisition]
sample_rate = "10 kHz"
{acquisition}
[acquisition.channels]
tangential = {{ column = "{tangential}", {scale} }}
normal = {{ column = "{normal}", {scale} }}
"""


def write_declaration(folder, acquisition, tangential="Fx", normal="Fy", scale='unit = "mN"'):
    folder.mkdir()
    text = DECLARED.format(
        acquisition=acquisition, tangential=tangential, normal=normal, scale=scale
    )
    (folder / "session.toml").write_text(text)
    # trials out of order: a row is found by its place in the table, not by its number
    (folder / "trials.csv").write_text("trial\n7\n3\n12\n")
    return folder


def read_trace(folder, trial):
    with Traces(open_session(folder)) as traces:
        return traces.read(trial)


def make_arrays(samples=40):
    forces = np.arange(3.0 * samples).reshape(3, samples)
    return forces, 1e3 + forces


def write_hdf5(path, arrays):
    with h5py.File(path, "w") as file:
        for name, array in arrays.items():
            file[name] = array


@pytest.mark.parametrize(
    ("name", "write"), [("all.h5", write_hdf5), ("all.mat", lambda path, a: savemat(path, a))]
)
def test_each_row_of_an_array_is_a_trial_in_the_order_of_the_table(tmp_path, name, write):
    session = write_declaration(tmp_path / "s", f'traces = "{name}"\nrows = "trials"')
    tangential, normal = make_arrays()
    write(session / name, {"Fx": tangential, "Fy": normal})
    trace = read_trace(session, "3")
    np.testing.assert_allclose(trace.tangential, 1e-3 * tangential[1])
    np.testing.assert_allclose(trace.normal, 1e-3 * normal[1])


def test_columns_may_be_trials_and_what_fills_up_short_rows_is_cut_off(tmp_path):
    session = write_declaration(tmp_path / "s", 'traces = "all.h5"\nrows = "trials"')
    tangential, normal = make_arrays()
    tangential[2, 30:] = np.nan
    normal[2, 30:] = np.nan
    write_hdf5(session / "all.h5", {"Fx": tangential.T, "Fy": normal.T})
    np.testing.assert_allclose(read_trace(session, "12").tangential, 1e-3 * tangential[2, :30])


def test_an_array_without_a_row_for_each_trial_is_refused(tmp_path):
    session = write_declaration(tmp_path / "s", 'traces = "all.h5"\nrows = "trials"')
    write_hdf5(session / "all.h5", {"Fx": np.zeros((5, 40)), "Fy": np.zeros((5, 40))})
    with pytest.raises(Exception, match=r"'Fx' is 5 x 40: .* it has 3 rows"):
        read_trace(session, "3")


@pytest.mark.parametrize(
    ("name", "write"), [("all.h5", write_hdf5), ("all.mat", lambda path, a: savemat(path, a))]
)
def test_a_file_without_groups_of_trials_says_what_it_holds(tmp_path, name, write):
    session = write_declaration(tmp_path / "s", f'traces = "{name}"')
    write(session / name, {"Fx": np.zeros((3, 40)), "Fy": np.zeros((3, 40))})
    with pytest.raises(Exception, match=r"holds Fx \(3 x 40\), Fy \(3 x 40\).*rows = \"trials\""):
        read_trace(session, "3")


@pytest.mark.parametrize("kind", [np.int16, np.int32, np.float32])
def test_a_wav_file_is_a_share_of_its_declared_full_scale(tmp_path, kind):
    session = write_declaration(
        tmp_path / "s",
        'traces = "m{trial}.wav"\nfull_scale = "10 V"',
        tangential="0",
        normal="1",
        scale='factor = "5 N/V"',
    )
    shares = np.column_stack([np.linspace(-0.5, 0.5, 64), np.full(64, 0.25)])
    stored = shares.astype(kind)
    if kind is not np.float32:
        stored = np.round(shares * -float(np.iinfo(kind).min)).astype(kind)
    wavfile.write(session / "m7.wav", 10_000, stored)
    trace = read_trace(session, "7")
    # origin: half of full scale of 10 V at 5 N/V is 25 N; 16 bits have steps of 50 N / 32768
    np.testing.assert_allclose(trace.tangential, 50.0 * shares[:, 0], atol=1e-3)
    np.testing.assert_allclose(trace.normal, 12.5, atol=1e-3)
    assert trace.time[1] == pytest.approx(1e-4)


def test_a_wav_file_whose_rate_is_another_is_refused(tmp_path):
    session = write_declaration(
        tmp_path / "s", 'traces = "m{trial}.wav"\nfull_scale = 2', "0", "1", 'unit = "N"'
    )
    wavfile.write(session / "m7.wav", 8_000, np.zeros((64, 2), dtype=np.int16))
    with pytest.raises(Exception, match=r"8000 Hz\), `acquisition.sample_rate` is 10000 Hz"):
        read_trace(session, "7")


@pytest.mark.parametrize(
    ("acquisition", "rule"),
    [
        ('traces = "m{trial}.wav"', "full_scale` must say what full scale"),
        ('traces = "m{trial}.wav"\nfull_scale = "loud"', "must be a number or a voltage"),
        ('traces = "all.h5"\nfull_scale = 2', "full_scale` is for WAV files alone"),
        ('traces = "m{trial}.h5"\nrows = "trials"', "rows` is for one file of all trials"),
        ('traces = "all.tdms"\nrows = "trials"', "rows` is for HDF5 and MATLAB"),
    ],
)
def test_a_declaration_that_cannot_be_meant_is_refused(tmp_path, acquisition, rule):
    with pytest.raises(BenchError, match=rule):
        open_session(write_declaration(tmp_path / "s", acquisition))
