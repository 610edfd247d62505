"""The public face: every promised name is there, and importing the package costs nothing."""

import subprocess
import sys

import stepblocks


def test_every_public_name_is_described_and_there():
    for name in stepblocks.__all__:
        assert getattr(stepblocks, name) is not None
        assert f"`{name}`" in stepblocks.__doc__


def test_importing_the_package_loads_nothing_else():
    code = "import sys, stepblocks; print(sorted({'numpy', 'pydantic', 'pint', 'OCP'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
