"""The height fields that this package writes can be inspected, and so can any TIFF of heights."""

import json

import numpy as np
import pytest
import tifffile

from stepblocks.artefacts.heightfield import sample_height_field, write_height_field
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Instrument
from stepblocks.inspect.evaluation import EvaluationOptions
from stepblocks.inspect.run import inspect_scan
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.scans.read import read_scan

PART = StepBlock(id="step-050", height="50 um")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    return write_height_field(tmp_path_factory.mktemp("field") / "step-050.heightfield", PART)


@pytest.mark.parametrize("ending", [".tiff", ".json"])
def test_a_height_field_reads_back_with_its_spacing(ending, written):
    (path,) = (path for path in written if path.suffix == ending)
    scan = read_scan(path)
    np.testing.assert_allclose(scan.height, sample_height_field(PART), atol=4e-12)  # float32
    assert (scan.dx, scan.dy) == (2e-6, 2e-6)
    with pytest.raises(MetrologyError, match="unit must not be given"):
        read_scan(path, "um")


@pytest.mark.long
def test_a_height_field_is_as_high_as_its_part(written):
    optical = EvaluationOptions(stylus_radius=0.0, stylus_cone=0.0)
    known = Instrument(1e-4, 0.0, 1e-4)
    result = inspect_scan(written[-1], PART, instrument=known, options=optical)
    assert result.evaluation.values["step_height"].value == pytest.approx(50e-6, abs=1e-9)


def test_a_tiff_of_others_needs_spacing_and_unit_and_one_channel(tmp_path):
    heights = np.arange(60, dtype=np.float32).reshape(6, 10)
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, heights)
    for unit in (None, "um", "x=um,y=um,z=um"):
        with pytest.raises(MetrologyError, match="states neither spacing nor unit"):
            read_scan(path, unit)
    scan = read_scan(path, "x=0.5um,y=2um,z=nm")
    assert (scan.dx, scan.dy) == (0.5e-6, 2e-6)
    np.testing.assert_allclose(scan.height, heights * 1e-9, rtol=1e-6)
    tifffile.imwrite(path, np.zeros((6, 10, 3), np.uint8), photometric="rgb")
    with pytest.raises(MetrologyError, match="one page of one channel"):
        read_scan(path, "x=0.5um,y=2um,z=nm")


def test_a_sidecar_without_its_numbers_or_with_others_is_refused(written, tmp_path):
    sidecar = json.loads(written[-1].read_text())
    (tmp_path / "a.json").write_text(json.dumps(sidecar))
    with pytest.raises(MetrologyError, match="must lie beside the sidecar"):
        read_scan(tmp_path / "a.json")
    name = next(name for name in sidecar["files"] if name.endswith(".tiff"))
    tifffile.imwrite(tmp_path / name, np.zeros((3, 4), np.float32))
    with pytest.raises(MetrologyError, match="points of its sidecar"):
        read_scan(tmp_path / "a.json")
