"""A name in a file is followed only inside its folder; drafts of dead runs go; a build takes
whatever names a user gives it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from stepblocks.build import page as pages, run as building
from stepblocks.build.check import check_output
from stepblocks.build.linked import find_linked_files
from stepblocks.build.manifest import (
    MANIFEST,
    RECORD,
    are_outputs_intact,
    find_unaltered_file,
    hash_bytes,
    hash_file,
    load_manifest,
    load_sealed_json,
    load_stimulus_record,
    write_sealed_json,
)
from stepblocks.build.run import BuildReport, build_sets
from stepblocks.cli import main
from stepblocks.compute import fingerprint
from stepblocks.errors import PipelineError
from stepblocks.files.atomic import lock_folder, make_draft_folder, resolve_inside

ROOT = Path(__file__).resolve().parents[2]
SHEATHS = ROOT / "stimuli" / "sheaths.toml"
OUTWARD = ["", ".", "..", "../x", "a/../../x", "/etc/hostname", "a/..", "x\0y"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    output = tmp_path_factory.mktemp("made") / "out"
    build_sets(SHEATHS, output, only="sheath-hard", jobs=1)
    build_sets(SHEATHS, output, jobs=1)
    return output


@pytest.fixture
def copy(made, tmp_path):
    import shutil

    shutil.copytree(made, tmp_path / "out")
    return tmp_path / "out"


@pytest.mark.parametrize("name", OUTWARD)
def test_a_name_that_leads_out_of_its_folder_is_not_ours(name, tmp_path):
    assert resolve_inside(tmp_path, name) is None


def test_plain_names_are_ours_and_links_on_the_way_are_not(tmp_path):
    folder, outside = tmp_path / "out", tmp_path / "outside"
    (folder / "set").mkdir(parents=True)
    outside.mkdir()
    assert resolve_inside(folder, "set/id/a.stl") == folder / "set" / "id" / "a.stl"
    assert resolve_inside(folder, "a.stl") == folder / "a.stl"
    (folder / "link").symlink_to(outside)
    (folder / "set" / "file").symlink_to(folder / "set")
    assert resolve_inside(folder, "link/a.stl") is None
    assert resolve_inside(folder, "set/file") is None
    # the folder itself may be one: that is the user's own choice
    (tmp_path / "here").symlink_to(folder)
    assert resolve_inside(tmp_path / "here", "set/a.stl") == tmp_path / "here" / "set" / "a.stl"


@pytest.mark.parametrize("name", [name for name in OUTWARD if "\0" not in name])
def test_what_lies_outside_is_neither_read_nor_believed(name, tmp_path):
    (tmp_path / "x").write_text("secret")
    folder = tmp_path / "folder"
    (folder / "a").mkdir(parents=True)
    assert find_unaltered_file(folder, name, hash_file(folder / name)) is None
    assert not are_outputs_intact(folder, {name: hash_file(folder / name)})


def test_a_list_of_files_is_intact_when_all_are_there_as_written(tmp_path):
    (tmp_path / "a.txt").write_text("a")
    assert are_outputs_intact(tmp_path, {"a.txt": hash_bytes(b"a")})
    assert not are_outputs_intact(tmp_path, {"a.txt": hash_bytes(b"b")})
    assert not are_outputs_intact(tmp_path, {"a.txt": hash_bytes(b"a"), "b.txt": hash_bytes(b"b")})
    assert not are_outputs_intact(tmp_path, {})  # nothing listed is nothing known


@pytest.mark.parametrize("content", ["", "{", "[1]", '{"outputs": [1]}', '{"outputs": "x"}'])
def test_a_record_that_is_none_lists_no_files(content, tmp_path):
    (tmp_path / RECORD).write_text(content)
    assert load_stimulus_record(tmp_path) is None
    assert load_manifest(tmp_path) is None


def test_the_fingerprint_hangs_on_code_and_libraries(monkeypatch):
    before = fingerprint.compute_code_fingerprint()
    assert fingerprint.compute_code_fingerprint() == before
    monkeypatch.setattr(fingerprint, "version", lambda name: "0.0")
    assert fingerprint.compute_code_fingerprint() != before


@pytest.mark.parametrize("place", ["absolute", "parent"])
def test_a_manifest_that_names_a_file_outside_does_not_delete_it(place, copy, tmp_path):
    victim = tmp_path / "precious" / "notes.txt"
    victim.parent.mkdir()
    victim.write_text("mine")
    name = str(victim) if place == "absolute" else "../precious/notes.txt"
    content = load_sealed_json(copy / "manifest.json")
    content["outputs"][name] = hash_file(victim)
    content["code"] = "an older one"
    write_sealed_json(copy / "manifest.json", content)
    build_sets(SHEATHS, copy, jobs=1)
    assert victim.read_text() == "mine"
    assert name not in load_manifest(copy).outputs


@pytest.mark.parametrize("place", ["absolute", "parent"])
def test_a_record_that_names_a_file_outside_does_not_delete_it(place, copy, tmp_path):
    victim = tmp_path / "out" / "mine.txt"
    victim.write_text("mine")
    path = copy / "sheaths" / "sheath-soft" / RECORD
    content = load_sealed_json(path)
    content["outputs"][str(victim) if place == "absolute" else "../../mine.txt"] = hash_file(victim)
    write_sealed_json(path, content)
    report = build_sets(SHEATHS, copy, jobs=1)
    # its record is not believed, so it is made again
    assert report.built == ["sheaths/sheath-soft"]
    assert victim.read_text() == "mine"


@pytest.mark.parametrize("lost", ["stimuli", "failures", "outputs", "seal"])
def test_a_manifest_that_was_altered_by_hand_is_made_again(lost, copy):
    path = copy / "manifest.json"
    whole = path.read_text()
    content = json.loads(whole)
    del content[lost]
    path.write_text(json.dumps(content))
    assert load_manifest(copy) is None
    assert build_sets(SHEATHS, copy, jobs=1).current == 2
    assert path.read_text() == whole


def test_the_manifest_says_with_what_it_was_made(copy):
    made = load_manifest(copy).made_with
    assert made.python == ".".join(map(str, sys.version_info[:3]))
    assert made.platform.startswith("Linux ")
    assert made.libraries["numpy"] == np.__version__


def test_a_second_run_into_the_same_folder_is_refused_and_writes_nothing(tmp_path, capsys):
    output = tmp_path / "out"
    output.mkdir()
    with lock_folder(output):
        assert main(["build", str(SHEATHS), "-o", str(output)]) == 2
    assert "another run is writing into this folder" in capsys.readouterr().err
    assert list(output.iterdir()) == []
    with lock_folder(output):  # the lock is gone with its holder
        pass


def test_a_page_that_somebody_removes_meanwhile_is_said_and_is_in_no_manifest(
    copy, monkeypatch, capsys
):
    # two users in one folder: a manifest listed the page with an empty hash
    before = (copy / MANIFEST).read_bytes()
    made_page = pages.write_page

    def write_and_lose(*arguments):
        written = made_page(*arguments)
        (copy / "index.html").unlink()
        return written

    monkeypatch.setattr(pages, "write_page", write_and_lose)
    (copy / "index.html").write_text("changed")  # so that the build is not up to date
    assert main(["build", str(SHEATHS), "-o", str(copy), "--jobs", "1"]) == 2
    said = capsys.readouterr().err
    assert "No such file or directory" in said
    assert str(copy / "index.html") in said
    assert len(said.splitlines()) == 1
    assert (copy / MANIFEST).read_bytes() == before


def test_check_looks_at_tables_and_specifications_too(copy):
    folder = copy / "sheaths" / "sheath-soft"
    table, asked = copy / "sheaths" / "predictions.csv", folder / "specification.json"
    rows = [line.split(",") for line in table.read_text().splitlines()]
    at = rows[0].index("peak_force_n")
    rows[3][at] = str(1.001 * float(rows[3][at]))
    table.write_text("\n".join(map(",".join, rows)) + "\n")
    asked.write_text(asked.read_text().replace("1410", "1411").replace("0.0005", "0.0006"))
    failed = {
        name
        for name, verdicts in check_output(SHEATHS, copy)
        if not all(one.passed for one in verdicts)
    }
    assert failed == {
        f"sheaths/{name}" for name in ("predictions.csv", "sheath-soft/specification.json")
    }


def test_check_predicts_a_table_again_and_does_not_ask_the_manifest_alone(copy):
    table, manifest = copy / "sheaths" / "predictions.csv", copy / MANIFEST
    rows = [line.split(",") for line in table.read_text().splitlines()]
    at = rows[0].index("vibration_energy_uj")
    rows[2][at] = str(1.001 * float(rows[2][at]))
    table.write_text("\n".join(map(",".join, rows)) + "\n")
    content = load_sealed_json(manifest)
    content["outputs"]["sheaths/predictions.csv"] = hash_file(table)
    write_sealed_json(manifest, content)  # as if a program that errs had written both
    verdicts = dict(check_output(SHEATHS, copy))["sheaths/predictions.csv"]
    assert [one.deviation for one in verdicts if not one.passed] == [1.0]


@pytest.mark.parametrize(("units", "wrong"), [(1, 0.0), (2, 1.0)])
def test_check_forgives_a_table_the_last_digit_that_a_last_bit_turns(copy, units, wrong):
    # figures have six digits; two processors may round 1.2345649999 and 1.2345650001 apart
    table = copy / "sheaths" / "predictions.csv"
    rows = [line.split(",") for line in table.read_text().splitlines()]
    at = rows[0].index("vibration_energy_uj")
    digits = len(rows[2][at].partition(".")[2])
    assert len(rows[2][at].replace(".", "").lstrip("0")) == 6
    rows[2][at] = f"{float(rows[2][at]) + units * 10.0**-digits:.{digits}f}"
    table.write_text("\n".join(map(",".join, rows)) + "\n")
    verdicts = dict(check_output(SHEATHS, copy))["sheaths/predictions.csv"]
    assert sum(one.deviation for one in verdicts) == wrong


@pytest.mark.parametrize("lost", ["verdicts", "kind"])
def test_a_record_that_has_lost_a_part_counts_as_not_built(lost, copy):
    path = copy / "sheaths" / "sheath-soft" / RECORD
    content = json.loads(path.read_text())
    del content[lost]
    path.write_text(json.dumps(content))
    assert load_stimulus_record(path.parent) is None
    # the other is left out of the page
    assert build_sets(SHEATHS, copy, only="sheath-hard", jobs=1).built == []
    assert "sheath-soft.step" not in (copy / "index.html").read_text()
    assert build_sets(SHEATHS, copy, jobs=1).built == ["sheaths/sheath-soft"]


@pytest.mark.parametrize("linked", ["sheaths", "sheaths/sheath-soft", "assets"])
def test_a_folder_that_is_a_link_is_not_written_through(linked, tmp_path, capsys):
    elsewhere, output = tmp_path / "elsewhere", tmp_path / "out"
    elsewhere.mkdir()
    (output / linked).parent.mkdir(parents=True)
    (output / linked).symlink_to(elsewhere)
    with pytest.raises(PipelineError, match="no link on the way"):
        build_sets(SHEATHS, output, jobs=1)
    assert list(elsewhere.iterdir()) == []
    assert main(["build", str(SHEATHS), "-o", str(output)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_the_output_folder_itself_may_be_a_link(made, tmp_path):
    (tmp_path / "here").symlink_to(made)
    assert build_sets(SHEATHS, tmp_path / "here", jobs=1).built == []


def test_two_runs_in_two_containers_never_share_a_draft(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "getpid", lambda: 1)  # as the first process of either container
    with (
        make_draft_folder(tmp_path / "set-id") as first,
        make_draft_folder(tmp_path / "set-id") as second,
    ):
        assert first != second
        (first / "a").write_text("a")
        assert list(second.iterdir()) == []
    assert list(tmp_path.iterdir()) == []


def test_a_script_without_a_main_guard_builds_in_several_processes(tmp_path):
    script = tmp_path / "plain.py"
    script.write_text(
        f"import stepblocks\nprint(stepblocks.build_sets({str(SHEATHS)!r}, 'out', jobs=2).built)\n"
    )
    done = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("sheaths/sheath-") == 2
    assert done.stdout.count("\n") == 1  # the script ran once
    assert done.stderr == ""


def test_files_default_to_the_folder_of_stimuli_and_paths_may_be_texts(made, tmp_path, monkeypatch):
    (tmp_path / "stimuli").mkdir()
    (tmp_path / "stimuli" / "sheaths.toml").write_text(SHEATHS.read_text())
    monkeypatch.chdir(tmp_path)
    for files in (None, "stimuli", ["stimuli/sheaths.toml"], Path("stimuli")):
        assert build_sets(files, str(made), jobs=1).current == 2


def test_a_set_is_predicted_once_a_build(copy, monkeypatch):
    from stepblocks.predict import predictions

    calls = []
    counted = predictions.predict_by_formula
    monkeypatch.setattr(
        predictions,
        "predict_by_formula",
        lambda stimuli: (calls.append(stimuli.name), counted(stimuli))[1],
    )
    (copy / "index.html").unlink()
    build_sets(SHEATHS, copy, jobs=1)
    assert calls == ["sheaths"]
    assert (copy / "index.html").is_file()


def test_check_output_measures_every_file_again_and_says_which_is_off(copy):
    found = dict(check_output(str(SHEATHS), str(copy)))
    assert all(verdict.passed for verdicts in found.values() for verdict in verdicts)
    assert "sheaths/sheath-soft/sheath-soft.step" in found
    (copy / "sheaths" / "sheath-soft" / "sheath-soft.stl").unlink()
    lost = dict(check_output(SHEATHS, copy, only="sheath-soft"))
    assert [name for name, verdicts in lost.items() if not all(one.passed for one in verdicts)] == [
        "sheaths/sheath-soft/sheath-soft.stl"
    ]
    with pytest.raises(PipelineError, match="--only must match"):
        list(check_output(SHEATHS, copy, only="nothing"))


@pytest.mark.parametrize("made", [True, False])
def test_a_set_that_was_never_built_is_not_called_out_of_tolerance(tmp_path, made):
    folder = tmp_path / "out"
    if made:
        folder.mkdir()
    with pytest.raises(PipelineError, match="not built: sheaths; run stepblocks build first"):
        check_output(SHEATHS, folder)


def test_a_notebook_sees_what_a_build_did_with_nothing_left_unescaped():
    report = BuildReport("out<1>", ["a/b"], 3, ["a/b/FAIL <x> & y"])
    shown = report._repr_html_()
    assert "1 built, 3 up to date, 1 checks failed" in shown
    assert "out&lt;1&gt;/index.html" in shown
    assert "<li>a/b/FAIL &lt;x&gt; &amp; y</li>" in shown


def test_a_folder_that_cannot_be_written_is_refused_before_anything_is_made(tmp_path, monkeypatch):
    monkeypatch.setattr(building.os, "access", lambda path, mode: False)
    with pytest.raises(PipelineError, match="must be writable"):
        build_sets(SHEATHS, tmp_path / "out", jobs=1)
    assert list(tmp_path.glob("out/*")) == []


def test_every_form_of_the_drawing_of_a_series_is_linked_from_the_page(tmp_path):
    (tmp_path / "own").mkdir()
    for form in ("dxf", "pdf", "svg"):
        (tmp_path / "own" / f"own.series.{form}").write_text("a drawing")
    linked = {name for _, name in find_linked_files(tmp_path, [])[""]}
    assert linked == {f"own/own.series.{form}" for form in ("dxf", "pdf", "svg")}


def test_a_folder_whose_stimulus_goes_while_it_is_built_gets_no_manifest(copy, monkeypatch):
    # such a build ended with code 0, and its manifest named fewer stimuli than were built
    whole = (copy / MANIFEST).read_bytes()
    (copy / MANIFEST).unlink()
    (copy / "sheaths" / "sheath-hard" / RECORD).unlink()
    monkeypatch.setattr(
        building, "_find_outdated_stimuli", lambda *_: []
    )  # it stood there a moment ago
    with pytest.raises(PipelineError, match="no other program may remove files while they are"):
        build_sets(SHEATHS, copy, jobs=1)
    assert not (copy / MANIFEST).exists()
    monkeypatch.undo()
    build_sets(SHEATHS, copy, jobs=1)
    assert (copy / MANIFEST).read_bytes() == whole
