"""Promise: a sweep goes to an object store as it goes to a folder, with the same bytes."""

import pytest

import stepblocks
from stepblocks.cli import main
from stepblocks.errors import PipelineError
from stepblocks.files.store import FolderStore, ObjectStore, open_store

pytest.importorskip("fsspec")

PLAN = """
[sweep]
kind = "random"
rows = 40
rows_per_partition = 10
[parameters]
height = { from = "12 um", to = "80 um" }
friction = 0.15
"""


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "sweep.toml"
    path.write_text(PLAN, encoding="utf-8")
    return path


def read_files(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.mark.long
def test_an_object_store_gets_the_bytes_of_a_folder_and_its_table_is_read(plan, tmp_path):
    alone = stepblocks.run_sweep(plan, tmp_path / "alone")
    address = (tmp_path / "bucket" / "sweep").as_uri()
    stored = stepblocks.run_sweep(plan, address, jobs=2)
    assert (stored.folder, stored.computed, stored.found) == (address, 4, 0)
    kept = read_files(tmp_path / "bucket" / "sweep")
    expected = read_files(alone.folder)
    assert {name: content for name, content in expected.items() if name in kept} == kept
    assert len(kept) == 5  # four partitions and the plan
    assert stored.read().equals(alone.read())
    assert "height_um" in stored._repr_html_()


def test_what_is_missing_or_damaged_in_an_object_store_is_computed_again(plan, tmp_path):
    folder = tmp_path / "bucket" / "sweep"
    stepblocks.run_sweep(plan, folder.as_uri())
    whole = read_files(folder)
    (folder / "part-00000001.parquet").unlink()
    (folder / "part-00000002.parquet").write_bytes(b"no partition")
    again = stepblocks.run_sweep(plan, folder.as_uri())
    assert (again.computed, again.found) == (2, 2)
    assert read_files(folder) == whole


def test_a_partition_that_is_gone_is_named(plan, tmp_path):
    folder = tmp_path / "bucket"
    stored = stepblocks.run_sweep(plan, folder.as_uri())
    (folder / "part-00000003.parquet").unlink()
    with pytest.raises(PipelineError, match=r"partition is gone: .*part-00000003.parquet"):
        stored.read()


def test_an_object_store_with_another_sweep_is_refused(plan, tmp_path):
    address = (tmp_path / "bucket").as_uri()
    stepblocks.run_sweep(plan, address)
    plan.write_text(PLAN.replace("0.15", "0.16"), encoding="utf-8")
    with pytest.raises(PipelineError, match="holds the result of another sweep"):
        stepblocks.run_sweep(plan, address)


def test_an_address_of_an_unknown_kind_is_one_line_and_exit_2(plan, capsys):
    assert main(["sweep", str(plan), "-o", "nowhere://bucket/sweep"]) == 2
    message = capsys.readouterr().err
    assert "of a kind that fsspec knows" in message
    assert "[nowhere://bucket/sweep]" in message


def test_a_store_without_its_package_says_which_is_missing(monkeypatch):
    import fsspec.core

    def refuse(address):
        raise ImportError("Install s3fs to access S3")

    monkeypatch.setattr(fsspec.core, "url_to_fs", refuse)
    with pytest.raises(PipelineError, match="a package that is not installed: Install s3fs"):
        ObjectStore("s3://bucket/sweep").read("part")


def test_a_bucket_that_is_not_there_is_named_and_not_made(plan, tmp_path, monkeypatch):
    from fsspec.implementations.local import LocalFileSystem

    monkeypatch.setattr(LocalFileSystem, "root_marker", "")  # as of stores with buckets
    with pytest.raises(PipelineError, match="store has no such place"):
        stepblocks.run_sweep(plan, (tmp_path / "bucket").as_uri())
    assert not (tmp_path / "bucket").exists()


def test_the_command_line_writes_to_an_address(plan, tmp_path, capsys):
    address = (tmp_path / "bucket").as_uri()
    assert main(["sweep", str(plan), "-o", address]) == 0
    assert f"4 computed, 0 found [{address}]" in capsys.readouterr().out


def test_a_path_is_a_folder_and_an_address_an_object_store(tmp_path):
    assert open_store(tmp_path) == FolderStore(tmp_path)
    assert open_store("s3://bucket/sweep/") == ObjectStore("s3://bucket/sweep")
