"""What is handed on works outside the checkout: wheel and sdist hold every file, and begin from an
empty folder.
"""

import importlib
import json
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
    sdist = build_one("sdist", source, folder)
    with tarfile.open(sdist) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    return build_one("wheel", next((folder / "unpacked").iterdir()), folder), sdist


def build_one(kind, source, folder):
    pytest.importorskip("setuptools", minversion="77")
    code = f"import sys, setuptools.build_meta as b; print(b.build_{kind}(sys.argv[1]))"
    done = subprocess.run(
        [sys.executable, "-c", code, str(folder)],
        cwd=source,
        env={**os.environ, "SOURCE_DATE_EPOCH": "1700000000"},
        capture_output=True,
        text=True,
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


@pytest.mark.long
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


@pytest.mark.long
def test_the_wheel_is_the_same_bytes_when_it_is_built_again_elsewhere(built, tmp_path):
    wheel, sdist = built
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path / "elsewhere", filter="data")
    again = build_one("wheel", next((tmp_path / "elsewhere").iterdir()), tmp_path)
    assert again.read_bytes() == wheel.read_bytes()


def test_the_version_is_the_same_wherever_it_stands():
    version = re.search(r'^version = "(.*)"$', (ROOT / "pyproject.toml").read_text(), re.M)[1]
    assert f'__version__ = "{version}"' in (HOUSE / "__init__.py").read_text()
    assert f"version: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"## {version} (" in (ROOT / "CHANGELOG.md").read_text()


@pytest.mark.long
def test_the_bill_of_materials_names_every_package_and_resolves_every_reference(tmp_path):
    script = ROOT / "benchmarks" / "bill_of_materials.py"
    for name in ("a.cdx.json", "b.cdx.json"):
        subprocess.run([sys.executable, script, tmp_path / name], check=True)
    text = (tmp_path / "a.cdx.json").read_text()
    assert text == (tmp_path / "b.cdx.json").read_text()
    bill = json.loads(text)
    # Origin: CycloneDX 1.5, the required keys of a bill and the form of a serial number
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.5")
    assert re.fullmatch(r"urn:uuid:[0-9a-f-]{36}", bill["serialNumber"])
    product = bill["metadata"]["component"]
    assert product["name"] == "stepblocks"
    known = {one["bom-ref"] for one in [product, *bill["components"]]}
    assert len(known) == len(bill["components"]) + 1
    assert {"cadquery", "numpy", "scipy"} <= {one["name"] for one in bill["components"]}
    for one in bill["dependencies"]:
        assert {one["ref"], *one["dependsOn"]} <= known
    assert all(one["licenses"][0]["license"]["name"] for one in bill["components"])


@pytest.mark.long
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
    ):
        done = run(*words)
        assert done.returncode == 0, done.stderr
    assert "<canvas" in (here / "out" / "feel.html").read_text()


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


@pytest.fixture
def is_refused(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    return importlib.import_module("licences").is_refused


@pytest.mark.parametrize(
    "said",
    [
        "GPL-3.0-or-later",
        "AGPL-3.0-or-later",
        "GNU General Public License v3 or later (GPLv3+)",
        "GNU Affero General Public License v3 or later (AGPLv3+)",
        "GPL-2.0-only AND MPL-2.0",
        "GPL-2.0-only OR AGPL-3.0-only",
        "(GPL-2.0-only OR MIT) AND AGPL-3.0-only",
        "MIT License, GNU General Public License v3 (GPLv3)",
        "MIT; a library: GPL-2.0-only",
        "GPL-2.0-only WITH Classpath-exception-2.0",
        "MIT or GPL",  # in small letters no operator: a person must look
        "SSPL-1.0",
        "not stated",
        "UNKNOWN",
    ],
)
def test_a_licence_that_binds_who_uses_us_is_refused(said, is_refused):
    """Names and operators as SPDX and the classifiers of packages have them."""
    assert is_refused(said)


@pytest.mark.parametrize(
    "said",
    [
        "GPL-2.0-or-later OR MIT",
        "(GPL-2.0-only OR MIT) AND BSD-3-Clause",
        "LGPL-3.0-or-later",
        "GNU Lesser General Public License v3 or later (LGPLv3+)",
        "GNU Library or Lesser General Public License (LGPL)",
        "GNU Library General Public License v2",
        "Mozilla Public License 2.0 (MPL 2.0)",
        "MPL-2.0 AND (Apache-2.0 OR MIT)",
        "BSD License; libgfortran: GPL-3.0-or-later WITH GCC-exception-3.1",  # it is listed
    ],
)
def test_a_licence_that_leaves_who_uses_us_free_is_passed(said, is_refused):
    assert not is_refused(said)


def test_constraints_name_one_version_each_and_no_address():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    assert all(
        re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.+]+", line)
        for line in lines
        if line and line[0] != "#"
    )
