"""Worker processes that die: an error of one line, also while items or tasks are left to be submitted."""

import os
from functools import partial

import pytest

from whisker_sim.errors import WhiskerSimError
from whisker_sim.jobs import FAILED, Job, process_executor
from whisker_sim.physics.command import run
from whisker_sim.physics.study import Study
from whisker_sim.progress import Progress


def _die(*_):
    """Work that kills its process, as the kernel does for lack of memory."""
    os._exit(FAILED)


def _assert_one_line(error):
    assert "a worker process died" in str(error.value)
    assert "\n" not in str(error.value)


def test_robust_a_worker_that_dies_while_items_are_left(tmp_path):
    job = Job("try", "item", str, lambda *_: False, _die)
    with Progress("try", "item", 6) as progress, pytest.raises(WhiskerSimError) as error:
        list(process_executor(2)(job, [(tmp_path, index) for index in range(6)], progress))
    _assert_one_line(error)


def test_robust_the_client_of_a_cluster_removes_its_own_folders_only(tmp_path):
    """Those of killed clients are its own, too: the folder of traces is locked."""
    cluster = pytest.importorskip("whisker_sim.cluster", reason="the packages of the extra `cluster` are not installed")
    theirs = tmp_path / "one" / ".parts" / "kept.csv"
    theirs.parent.mkdir(parents=True)
    theirs.touch()
    folders = [tmp_path / "one", tmp_path / "two"]
    (tmp_path / "one" / ".parts-k1ll3d00" / "tmp").mkdir(parents=True)
    cluster._remove_leftovers(folders)
    with cluster._part_folders(folders) as parts, cluster._part_folders(folders) as others:
        assert list(parts) == folders
        assert all(part.parent == folder and part.is_dir() for folder, part in parts.items())
        assert not set(parts.values()) & set(others.values())
        assert theirs.exists()
    assert theirs.exists()
    assert [path.name for folder in folders for path in folder.iterdir()] == [".parts"]


def test_robust_a_worker_that_dies_in_a_study(tmp_path):
    study = Study("dies", "tasks that kill their process", lambda _: [partial(_die)] * 200, list)
    with pytest.raises(WhiskerSimError) as error:
        run([study], tmp_path, 1)
    _assert_one_line(error)
