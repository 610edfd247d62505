"""Files that say more than they hold.

A few kilobytes that would fill a machine cost one trial, and one line.
"""

import resource
import struct
import zlib

import h5py
import pytest

from stepblocks.bench.faults import TraceError
from stepblocks.bench.measure import measure_session_to_file
from stepblocks.bench.session import open_session
from stepblocks.bench.traces import Traces

KINDS = [("t", "f8"), ("x", "f8"), ("y", "f8")]
CHANNELS = 'channels = { time = "time_s", tangential = "fx_n", normal = "fy_n" }'


def empty_compound(path):
    """A compound of 400 million rows that nobody wrote: 9.6 GB from a file of a few kilobytes."""
    with h5py.File(path, "w") as file:
        file.create_dataset("1", (400_000_000,), KINDS, chunks=(2**16,), compression="gzip")


def squeezed(prefix, zeros):
    """zlib stream of a prefix and many zeros (RFC 1950).

    One block of zeros, compressed once and repeated.
    """
    size = 2**24
    deflate = zlib.compressobj(9, zlib.DEFLATED, -15)
    head = deflate.compress(prefix) + deflate.flush(zlib.Z_FULL_FLUSH)
    block = deflate.compress(bytes(size)) + deflate.flush(zlib.Z_FULL_FLUSH)
    low, high = (whole := zlib.adler32(prefix)) & 0xFFFF, whole >> 16
    sum_of = (high + zeros // size * size * low) % 65521 << 16 | low
    return (
        b"\x78\x9c" + head + block * (zeros // size) + deflate.flush() + struct.pack(">I", sum_of)
    )


def zeros_of_matlab(path):
    """A version 5 file with one variable of 3 GiB of zeros, in 3 MB (MAT-File Format.

    Table 1-1).
    """
    rows, zeros = 3 * 2**27, 3 * 2**30
    flags = struct.pack("<IIII", 6, 8, 6, 0)
    shape = struct.pack("<IIii", 5, 8, rows // 3, 3)
    name = struct.pack("<II8s", 1, 7, b"trial_1")
    body = flags + shape + name + struct.pack("<II", 9, zeros)
    stream = squeezed(struct.pack("<II", 14, len(body) + zeros) + body, zeros)
    path.write_bytes(
        b"MATLAB 5.0 MAT-file".ljust(124)
        + b"\x00\x01IM"
        + struct.pack("<II", 15, len(stream))
        + stream
    )


FILES = {
    "compound.h5": (
        empty_compound,
        'group = "{trial}"\nchannels = { time = "t", tangential = "x", normal = "y" }',
    ),
    "zeros.mat": (zeros_of_matlab, "channels = { time = 0, tangential = 1, normal = 2 }"),
}


@pytest.mark.parametrize("name", FILES)
def test_a_small_file_that_unpacks_to_gigabytes_costs_its_trial_and_no_memory(name, session):
    write, channels = FILES[name]
    text = (session / "session.toml").read_text()
    assert CHANNELS in text
    (session / "session.toml").write_text(
        text.replace("traces/{trial:04d}.csv", name).replace(CHANNELS, channels)
    )
    write(session / name)
    assert (session / name).stat().st_size < 4_000_000
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with (
        Traces(open_session(session)) as traces,
        pytest.raises(TraceError, match="needs more than 2 GiB") as caught,
    ):
        traces.read("1")
    assert "\n" not in str(caught.value)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300 * 1024  # [KiB]


def test_a_session_without_a_column_of_blocks_is_measured(session, tmp_path):
    lines = (session / "trials.csv").read_text().splitlines()
    assert lines[0].split(",")[1] == "block"
    left = [
        ",".join(cell for number, cell in enumerate(line.split(",")) if number != 1)
        for line in lines
    ]
    (session / "trials.csv").write_text("\n".join(left) + "\n")
    summary = measure_session_to_file(session, tmp_path / "features.csv", jobs=1)
    assert summary.total - summary.excluded == 6
