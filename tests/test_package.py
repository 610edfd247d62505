"""What is handed on works outside the checkout: wheel and sdist hold every file, and begin from an
empty folder.
"""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
HOUSE = ROOT / "src" / "stepblocks"


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Sdist of a copy of the sources, made by the build backend that pyproject names, and the wheel
    that is made from it.
    """
    folder = tmp_path_factory.mktemp("package")
    source = folder / "source"
    shutil.copytree(
        HOUSE, source / "src" / "stepblocks", ignore=shutil.ignore_patterns("__pycache__", "*.nb?")
    )
    shutil.copytree(ROOT / "stimuli", source / "stimuli")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source / name)
    sdist = made("sdist", source, folder)
    with tarfile.open(sdist) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    return made("wheel", next((folder / "unpacked").iterdir()), folder), sdist


def made(kind, source, folder):
    pytest.importorskip("setuptools", minversion="77")
    code = f"import sys, setuptools.build_meta as b; print(b.build_{kind}(sys.argv[1]))"
    done = subprocess.run(
        [sys.executable, "-c", code, str(folder)], cwd=source, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return folder / done.stdout.split()[-1]


def ours():
    files = (
        path for path in HOUSE.rglob("*") if path.is_file() and "__pycache__" not in path.parts
    )
    return {
        path.relative_to(HOUSE).as_posix() for path in files if path.suffix not in {".nbi", ".nbc"}
    }


def test_the_wheel_and_the_sdist_hold_every_file_of_the_package_and_the_shipped_sets(built):
    wheel, sdist = built
    with zipfile.ZipFile(wheel) as archive:
        every = archive.namelist()
    assert ours() - {name.removeprefix("stepblocks/") for name in every} == set()
    carried = {Path(name).name for name in every if "share/stepblocks/stimuli/" in name}
    assert carried == {path.name for path in (ROOT / "stimuli").glob("*.toml")}
    with tarfile.open(sdist) as archive:
        names = {
            name.split("/src/stepblocks/")[1]
            for name in archive.getnames()
            if "/src/stepblocks/" in name
        }
    assert ours() - names == set()


def test_the_wheel_begins_from_an_empty_folder_without_the_checkout(built, tmp_path):
    wheel, _ = built
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    here = tmp_path / "empty"
    here.mkdir()
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}

    def run(*words):
        command = [sys.executable, "-m", "stepblocks", *words]
        return subprocess.run(command, cwd=here, env=environment, capture_output=True, text=True)

    where = [sys.executable, "-c", "import stepblocks; print(stepblocks.__file__)"]
    found = subprocess.run(
        where, cwd=here, env=environment, capture_output=True, text=True, check=True
    ).stdout
    assert found.startswith(str(tmp_path))
    for words in (
        ("new", "block", "mine.toml"),
        ("predict", "mine.toml", "-o", "predictions.csv"),
        ("feel", "mine.toml", "--no-open"),
        ("export", "--list-devices"),
        ("evidence", "-o", "evidence"),
    ):
        done = run(*words)
        assert done.returncode == 0, done.stderr
    assert "<style>\n:root" in (here / "evidence" / "evidence.html").read_text()


def test_licences_are_listed_and_what_has_a_copyleft_is_named_in_the_docs():
    done = subprocess.run(
        [sys.executable, ROOT / "benchmarks" / "licences.py"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    weak = {
        line.split(" | ")[0].strip("| ")
        for line in done.stdout.splitlines()
        if line.endswith("| weak |")
    }
    page = (ROOT / "docs" / "reference" / "stability.md").read_text()
    assert {"npTDMS", "igor2"} <= weak
    assert [name for name in weak if name not in page] == []


def test_constraints_name_one_version_each_and_no_address():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    assert all(
        re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.+]+", line)
        for line in lines
        if line and line[0] != "#"
    )
