"""Dask cluster: a scheduler and worker processes on this machine, all bound to 127.0.0.1."""

import csv
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

Client = pytest.importorskip("distributed", reason="the packages of the extra `cluster` are not installed").Client
from psutil import Process, wait_procs  # noqa: E402

from whisker_sim.paths import whisker_program  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
TRACES = 16
SPATIAL_TRACES = 6
LONGEST_S = 120.0
"""Longer than any command of these tests on a slow machine."""


class Cluster:
    """A Dask scheduler and its workers, each a process."""

    def __init__(self, folder: Path, processes: ExitStack) -> None:
        self._folder, self._processes = folder, processes
        address = folder / "scheduler.json"
        self.scheduler = self._start("dask_scheduler", "--scheduler-file", address)
        wait_for(lambda: address_in(address) is not None, self.scheduler)
        self.address = address_in(address)

    def add_workers(self, count: int, sources: Path = ROOT / "sim") -> list[subprocess.Popen]:
        """Starts workers with one thread each, which import these sources, and waits until they are connected."""
        options = ["--nthreads", "1", "--no-nanny", "--local-directory", self._folder]
        workers = [self._start("dask_worker", self.address, *options, sources=sources) for _ in range(count)]
        with Client(self.address, set_as_default=False) as client:
            client.wait_for_workers(count, LONGEST_S)
        return workers

    def _start(self, module: str, *options: str | Path, sources: Path = ROOT / "sim") -> subprocess.Popen:
        command = [sys.executable, "-m", f"distributed.cli.{module}", *map(str, options), "--host", "127.0.0.1"]
        # The shortest time after which Dask lets a scheduler consider a worker dead.
        environment = environment_with(sources) | {"DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "1s"}
        with (self._folder / "log").open("ab") as log:
            process = subprocess.Popen(
                [*command, "--port" if module == "dask_scheduler" else "--worker-port", "0", "--dashboard-address", "127.0.0.1:0"],
                cwd=self._folder,
                env=environment,
                stdout=log,
                stderr=log,
            )
        self._processes.callback(end, process)
        return process


def end(process: subprocess.Popen) -> None:
    """Ends a process, even if it is stopped."""
    process.kill()
    process.wait()


def environment_with(sources: Path) -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(sources)}


def address_in(path: Path) -> str | None:
    """Address in a file of the scheduler. `None` before it is written to its end."""
    try:
        return json.loads(path.read_text())["address"]
    except (FileNotFoundError, ValueError):
        return None


def wait_for(condition: Callable[[], object], process: subprocess.Popen) -> None:
    """Waits for `condition`; fails after `LONGEST_S` or if `process` ends before."""
    deadline_s = time.monotonic() + LONGEST_S
    while not condition():
        assert process.poll() is None, "the process ended too early"
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


@pytest.fixture
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A cluster without workers."""
    with ExitStack() as processes:
        yield Cluster(tmp_path_factory.mktemp("cluster"), processes)


def generator(*arguments: str | Path) -> subprocess.Popen:
    """The generator, started in the root of the repository."""
    command = [sys.executable, "-m", "whisker_sim", *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, cwd=ROOT, env=environment_with(ROOT / "sim"), text=True, **pipes)


def stderr_lines(process: subprocess.Popen, code: int = 0) -> list[str]:
    """Lines on stderr of a process that must end with this exit code, without estimates of the time left."""
    _, error = process.communicate(timeout=LONGEST_S)
    assert process.returncode == code, error
    return [line for line in error.splitlines() if not line.endswith(" left")]


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else b"" for path in folder.rglob("*")}


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A suite of many short traces."""
    folder = tmp_path_factory.mktemp("suite")
    scene = json.loads((ROOT / "scenes/pin_curved.json").read_text()) | {"name": "short", "duration_s": 1.3}
    (folder / "scene.json").write_text(json.dumps(scene))
    path = folder / "suite.json"
    suite = {"format": 1, "name": "suite", "scenes": [{"scene": "scene.json", "seeds": list(range(TRACES))}]}
    path.write_text(json.dumps(suite))
    return path


@pytest.fixture(scope="module")
def spatial_suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A suite in space of short traces on a mesh, whose file is relative to the scene."""
    folder = tmp_path_factory.mktemp("spatial")
    (folder / "meshes").mkdir()
    shutil.copy(ROOT / "scenes/space/meshes/icosahedron.obj", folder / "meshes")
    scene = json.loads((ROOT / "scenes/space/mesh_straight.json").read_text())
    motion = {"kind": "smooth", "contact_arc_m": 0.0487, "depth_m": 0.003, "translation_m": 3e-4, "rotation_rad": 3e-3}
    scene |= {"name": "short", "motion": motion, "duration_s": 2.5, "simulation": "fast"}
    (folder / "scene.json").write_text(json.dumps(scene))
    suite = {"format": 1, "name": "suite", "scenes": [{"scene": "scene.json", "seeds": list(range(SPATIAL_TRACES))}]}
    (folder / "suite.json").write_text(json.dumps(suite))
    return folder / "suite.json"


@pytest.fixture(scope="module")
def local(suite: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Traces of the suite by one machine."""
    folder = tmp_path_factory.mktemp("local")
    stderr_lines(generator("simulate", suite, "--out", folder))
    return folder


def test_verif_traces_equal_those_of_one_machine_with_a_killed_and_a_slow_worker(
    cluster: Cluster, suite: Path, local: Path, tmp_path: Path
) -> None:
    """The slow worker is stopped until its tasks are given to another, and continues when those are finished."""
    killed, slow, _ = cluster.add_workers(3)
    out = tmp_path / "cluster"
    client = generator("cluster", "simulate", "--scheduler", cluster.address, suite, "--out", out)
    wait_for(lambda: len(list(out.glob("*.json"))) >= TRACES // 8, client)
    killed.kill()
    slow.send_signal(signal.SIGSTOP)
    lines = stderr_lines(client)
    # The worker is informed that its task is cancelled, and ends.
    slow.send_signal(signal.SIGCONT)
    slow.wait(LONGEST_S)
    assert sorted(line.split(":")[0] for line in lines) == [f"short_{seed:02d}" for seed in range(TRACES)]
    assert contents(out) == contents(local)
    client = generator("cluster", "simulate", "--scheduler", cluster.address, suite, "--out", out)
    assert {line.split(": ")[1] for line in stderr_lines(client)} == {"up to date"}


def test_verif_traces_in_space_equal_those_of_one_machine_with_a_killed_worker_and_client(
    cluster: Cluster, spatial_suite: Path, tmp_path: Path
) -> None:
    """Paths are relative to the client's working directory; the second client resumes where the first was killed."""
    suite = os.path.relpath(spatial_suite, ROOT)
    stderr_lines(generator("simulate", suite, "--out", tmp_path / "local"))
    killed, _ = cluster.add_workers(2)
    out = tmp_path / "cluster"
    command = ["cluster", "simulate", "--scheduler", cluster.address, suite, "--out", out]
    client = generator(*command)
    wait_for(lambda: len(list(out.glob("*.json"))) >= 2, client)
    end(client)
    kept = len(list(out.glob("*.json")))
    assert kept < SPATIAL_TRACES
    client = generator(*command)
    wait_for(lambda: len(list(out.glob("*.json"))) > kept, client)
    killed.kill()
    lines = stderr_lines(client)
    assert sorted(line.split(":")[0] for line in lines) == [f"short_{seed:02d}" for seed in range(SPATIAL_TRACES)]
    assert sum(line.endswith("up to date") for line in lines) == kept
    assert contents(out) == contents(tmp_path / "local")


@pytest.fixture(scope="module")
def evaluation() -> list[str]:
    """Arguments of an evaluation of many trials, on traces that the end-to-end run has simulated and fitted."""
    if not (ROOT / "datasets/smoke/calibrations/straight.json").is_file():
        pytest.skip("datasets/smoke is missing: run cargo xtask test")
    return ["scenes/suites/smoke.json", "--estimators", "ekf,ukf", "--noise", "0.01,0.03", "--seeds", "20"]


def whisker(*arguments: str | Path) -> None:
    """Runs the command on this machine; it must succeed."""
    subprocess.run([whisker_program(), *arguments], cwd=ROOT, check=True, capture_output=True)


@pytest.fixture(scope="module")
def evaluated(evaluation: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of the evaluation by one machine."""
    folder = tmp_path_factory.mktemp("evaluated")
    whisker("evaluate", *evaluation, "--results", folder)
    return folder


def results(folder: Path) -> dict[str, bytes]:
    """Content of the folder of results without the times of a step."""
    files = contents(folder)
    rows = list(csv.DictReader(io.StringIO(files["smoke/summary.csv"].decode())))
    return files | {"smoke/summary.csv": repr([row | {"step_ns": None} for row in rows]).encode()}


def test_verif_results_equal_those_of_one_machine_with_a_killed_and_a_slow_worker(
    cluster: Cluster, evaluation: list[str], evaluated: Path, tmp_path: Path
) -> None:
    killed, slow, _ = cluster.add_workers(3)
    out = tmp_path / "cluster"
    command = ["cluster", "evaluate", "--scheduler", cluster.address, "--shares", "12", *evaluation, "--results", out]
    client = generator(*command)
    wait_for(lambda: len(list(out.glob(".smoke.*.part/shards/*"))) >= 4, client)
    slow.send_signal(signal.SIGSTOP)
    orphans = Process(killed.pid).children()
    killed.kill()
    assert len(list(out.glob(".smoke.*.part/shards/*"))) < 12
    lines = stderr_lines(client)
    assert wait_procs(orphans, LONGEST_S)[1] == []
    slow.send_signal(signal.SIGCONT)
    slow.wait(LONGEST_S)
    assert sorted(lines) == sorted(f"share {number}/12: done" for number in range(1, 13))
    assert results(out) == results(evaluated)


def test_verif_results_of_shares_equal_those_of_one_machine(evaluation: list[str], evaluated: Path, tmp_path: Path) -> None:
    """Shares of simultaneous processes, one of which is missing."""
    command = [whisker_program(), "evaluate", *evaluation, "--results", tmp_path / "shares"]
    jobs = [subprocess.Popen([*command, "--share", f"{number}/4"], cwd=ROOT, stdout=subprocess.PIPE) for number in (4, 1, 3)]
    assert [job.communicate(timeout=LONGEST_S)[0] for job in jobs] == [
        b"share 4/4 done\n",
        b"share 1/4 done\n",
        b"share 3/4 done\n",
    ]
    whisker(*command[1:])
    assert results(tmp_path / "shares") == results(evaluated)


def test_robust_an_error_of_a_share_is_one_line(cluster: Cluster, tmp_path: Path) -> None:
    cluster.add_workers(1)
    command = ["cluster", "evaluate", "--scheduler", cluster.address]
    (line,) = stderr_lines(generator(*command, tmp_path / "none.json"), 1)
    assert line.startswith(f"error: {tmp_path}/none.json: ")
    (line,) = stderr_lines(generator(*command, "scenes/suites/smoke.json", "--sedes", "5"), 2)
    assert line == "error: unexpected argument '--sedes' found"
    (line,) = stderr_lines(generator(*command, "--whisker", tmp_path / "none", "scenes/suites/smoke.json"), 2)
    assert line.startswith("error: --whisker")


def test_verif_shares_add_up_to_the_traces_of_one_machine(suite: Path, local: Path, tmp_path: Path) -> None:
    """Traces of a job array, in any order."""
    for share in ("2/2", "1/2"):
        lines = stderr_lines(generator("simulate", suite, "--out", tmp_path / "shares", "--share", share))
        assert len(lines) == TRACES // 2
    assert contents(tmp_path / "shares") == contents(local)
    (*_, line) = stderr_lines(generator("simulate", suite, "--share", "4/3"), 2)
    assert "expected K/N with K from 1 to N, such as 3/16, found '4/3'" in line


def test_robust_a_worker_of_another_version_is_refused(cluster: Cluster, suite: Path, tmp_path: Path) -> None:
    sources = tmp_path / "sim"
    shutil.copytree(ROOT / "sim/whisker_sim", sources / "whisker_sim")
    with (sources / "whisker_sim/model.py").open("a") as file:
        file.write("# Another model.\n")
    (worker,) = cluster.add_workers(1, sources)
    command = ["cluster", "simulate", "--scheduler", cluster.address, suite, "--out", tmp_path / "out"]
    (line,) = stderr_lines(generator(*command), 1)
    assert line.startswith("error: worker tcp://127.0.0.1:")
    assert line.count("whisker_sim 0.1.0 (commit") == 2
    end(worker)
    cluster.add_workers(1, tmp_path / "nothing")
    (line,) = stderr_lines(generator(*command), 1)
    assert "the PYTHONPATH that the client has: ModuleNotFoundError: No module named 'whisker_sim'" in line
    assert contents(tmp_path / "out") == {}


def test_robust_no_sidecar_remains_beside_files_of_another_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Regardless of how many files of a recording were moved before an interruption."""
    from whisker_sim import cluster

    names = ["passage.json", "passage.joints.csv", "passage_left_1.csv", "passage_left_1.json"]
    move = Path.replace
    for most in range(len(names)):
        part, folder = tmp_path / f"part_{most}", tmp_path / f"folder_{most}"
        for place, text in ((part, "new"), (folder, "old")):
            place.mkdir()
            for name in names:
                (place / name).write_text(text)
        moved = []

        def replace(path: Path, target: Path, most: int = most, moved: list[Path] = moved) -> None:
            if len(moved) == most:
                raise KeyboardInterrupt
            moved.append(path)
            move(path, target)

        monkeypatch.setattr(Path, "replace", replace)
        with pytest.raises(KeyboardInterrupt):
            cluster._move_files(part, folder, "passage.json")
        monkeypatch.undo()
        assert not [path.name for path in folder.glob("*.json") if path.read_text() == "old"]
        assert not (folder / "passage.json").exists()


def test_robust_without_a_scheduler(cluster: Cluster, suite: Path, tmp_path: Path) -> None:
    """A missing scheduler and one that is killed during the job give one line; finished files are kept."""
    out = tmp_path / "out"
    (line,) = stderr_lines(generator("cluster", "simulate", "--scheduler", "tcp://127.0.0.1:1", suite, "--out", out), 1)
    assert line.startswith("error: --scheduler tcp://127.0.0.1:1: expected the address of a Dask scheduler, found none there")
    cluster.add_workers(1)
    client = generator("cluster", "simulate", "--scheduler", cluster.address, suite, "--out", out)
    wait_for(lambda: list(out.glob("*.json")), client)
    cluster.scheduler.kill()
    *finished, line = stderr_lines(client, 1)
    assert line == "error: the scheduler is gone; finished files are kept"
    assert {f"{made.split(':')[0]}.json" for made in finished} == {path.name for path in out.glob("*.json")}
