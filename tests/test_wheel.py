"""What is installed from a wheel or a source archive is whole: code, templates, data and the shipped sets."""

import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    pytest.importorskip("setuptools", minversion="77")
    work = tmp_path_factory.mktemp("wheel")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, work)
    shutil.copytree(
        ROOT / "src" / "stepblocks", work / "src" / "stepblocks", ignore=shutil.ignore_patterns("__pycache__")
    )
    shutil.copytree(ROOT / "stimuli", work / "stimuli")
    code = "from setuptools import build_meta as b; b.build_wheel('dist'); b.build_sdist('dist')"
    done = subprocess.run([sys.executable, "-c", code], cwd=work, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return work / "dist"


def wanted():
    package = ROOT / "src" / "stepblocks"
    files = [path for path in package.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    return {path.relative_to(ROOT / "src").as_posix() for path in files}


def test_the_wheel_carries_every_file_of_the_package_and_the_shipped_sets(built):
    (wheel,) = built.glob("*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    assert wanted() <= names
    carried = {Path(name).name for name in names if "share/stepblocks/stimuli/" in name}
    assert carried == {path.name for path in (ROOT / "stimuli").glob("*.toml")}


def test_the_source_archive_carries_all_that_the_wheel_is_built_from(built):
    (archive,) = built.glob("*.tar.gz")
    with tarfile.open(archive) as source:
        names = {name.split("/", 1)[1] for name in source.getnames() if "/" in name}
    assert {f"src/{name}" for name in wanted()} <= names
    assert {f"stimuli/{path.name}" for path in (ROOT / "stimuli").glob("*.toml")} | {
        "LICENSE",
        "pyproject.toml",
    } <= names
