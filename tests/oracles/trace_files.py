"""Containers of traces as other programs write them: the HDF5 file of a session turned into TDMS,
MATLAB's format or one CSV per trial, with every digit of the numbers.
"""

from pathlib import Path

import h5py
import numpy as np
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat


def turned(session: Path, kind: str) -> Path:
    """Turn the traces of a session of one HDF5 file into another format, in place, and its
    declaration with it.
    """
    if kind == "hdf5":
        return session
    with h5py.File(session / "traces.h5") as file:
        trials = {
            name: {channel: data[()] for channel, data in group.items()}
            for name, group in file.items()
        }
    (session / "traces.h5").unlink()
    declared = session / "session.toml"
    if kind == "csv":
        (session / "traces").mkdir()
        for name, one in trials.items():
            table = np.column_stack([*one.values()]).astype(np.float64)
            np.savetxt(
                session / "traces" / f"{int(name)}.csv",
                table,
                fmt="%.17g",
                delimiter=",",
                header=",".join(one),
                comments="",
            )
        text = declared.read_text()
        declared.write_text(text.replace('"traces.h5"', '"traces/{trial}.csv"'))
        return session
    if kind == "mat":
        savemat(
            session / "traces.mat",
            {f"trial_{n}": one for n, one in trials.items()},
            do_compression=True,
        )
    else:
        with TdmsWriter(str(session / "traces.tdms")) as file:
            for name, one in trials.items():
                file.write_segment(
                    [ChannelObject(name, channel, values) for channel, values in one.items()]
                )
    if declared.exists():
        declared.write_text(declared.read_text().replace("traces.h5", f"traces.{kind}"))
    return session
