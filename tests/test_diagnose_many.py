"""Owns the tests of `ltp.diagnose_many`: on processes, threads and Dask, with failures, kills and changed inputs."""

from __future__ import annotations

import json
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ltp
from ltp.cli import main
from ltp.results import Store

OPTIONS = {"candidates": ["coulomb_friction", "quadratic_drag"]}
WORDS = {"tau": "40*sin(3*t)"}


def drive(force: float, seed: int = 0) -> ltp.Recording:
    """Two seconds of a drive with dry friction of `force` N, its position known to 2 um."""
    machine = ltp.zoo.drive().attach("coulomb_friction", "drive", force=force)
    run = ltp.simulate(machine, WORDS, t_end=2.0, dt=0.01)
    noise = 2e-6 * np.random.default_rng(seed).standard_normal(len(run.t))
    return ltp.Recording(run.t, {"tau": run.inputs[:, 0]}, {"q": run.outputs[:, 0] + noise}, name=f"drive{seed}")


def job(name: str, force: float = 8.0, seed: int = 0) -> ltp.Job:
    return ltp.Job(name, ltp.zoo.drive(), drive(force, seed), options=OPTIONS)


def plain(result: ltp.JobResult) -> dict[str, Any]:
    """The diagnosis without the time that it took."""
    assert result.diagnosis is not None, result.error
    tree: dict[str, Any] = json.loads(result.diagnosis.to_json())
    del tree["seconds"]
    return tree


@pytest.fixture(scope="module")
def here() -> dict[str, ltp.JobResult]:
    """Two jobs done without an executor."""
    return ltp.diagnose_many([job("one"), job("two", 14.0, 1)])


@pytest.fixture
def pool() -> Iterator[Executor]:
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as executor:
        yield executor


def test_nouns_are_copied_to_the_bit(here: dict[str, ltp.JobResult]) -> None:
    model = ltp.zoo.hopper()
    assert pickle.loads(pickle.dumps(model)).to_toml() == model.to_toml()
    t = 0.01 * np.arange(200) + 0.002 * np.sin(np.arange(200))
    with pytest.warns(UserWarning, match="jitters"):
        whole = ltp.Recording(t, {"tau": np.cos(t)}, {"q": np.sin(t)})
    for recording in (whole, whole.slice(0.3, 1.5)):
        copy = pickle.loads(pickle.dumps(recording))
        assert (copy.dt, copy.warnings, copy.name) == (recording.dt, recording.warnings, recording.name)
        for name in ("t", "inputs", "outputs"):
            assert np.array_equal(getattr(copy, name), getattr(recording, name), equal_nan=True)
    diagnosis = here["one"].diagnosis
    assert diagnosis is not None
    told = pickle.loads(pickle.dumps(diagnosis))
    assert told == diagnosis
    assert told.to_json() == diagnosis.to_json()
    assert told.model.to_toml() == diagnosis.model.to_toml()
    assert np.array_equal(told.traces["records"][0]["after"], diagnosis.traces["records"][0]["after"])


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_model_takes_its_own_effects_along(tmp_path: Path) -> None:
    path = tmp_path / "one_way_drag.toml"
    path.write_text(
        'sentence = "a drag in one direction"\non = "port"\nlaw = "-drag*abs(velocity)"\nreference = "none"\n'
        '[parameters]\ndrag = { unit = "force/velocity", scale = "force/velocity" }\n'
    )
    model = ltp.zoo.drive().with_effects([path]).attach("one_way_drag", "drive", drag=3.0)
    copy = pickle.loads(pickle.dumps(model.with_parameters(b=230.0)))
    assert copy.to_toml() == model.with_parameters(b=230.0).to_toml()
    options = {"candidates": ["coulomb_friction", "one_way_drag"]}
    diagnosis = ltp.diagnose(ltp.zoo.drive().with_effects([path]), drive(8.0), **options)  # type: ignore[arg-type]
    assert pickle.loads(pickle.dumps(diagnosis)).model.to_toml() == diagnosis.model.to_toml()


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_told_diagnosis_reports(here: dict[str, ltp.JobResult], tmp_path: Path) -> None:
    diagnosis = here["one"].diagnosis
    assert diagnosis is not None
    copy = pickle.loads(pickle.dumps(diagnosis)).report(tmp_path / "copy.html")
    assert copy.read_text() == diagnosis.report(tmp_path / "own.html").read_text()
    bare = ltp.Diagnosis.from_json(diagnosis.to_json())
    assert bare.report(tmp_path / "bare.html").stat().st_size > 1000
    with pytest.raises(ltp.InputError, match="not the JSON of a diagnosis"):
        ltp.Diagnosis.from_json("{}")


def test_processes_give_the_same_bits(here: dict[str, ltp.JobResult], pool: Executor) -> None:
    told: list[tuple[str, float]] = []
    jobs = {"one": job("x"), "two": job("y", 14.0, 1)}
    found = ltp.diagnose_many(jobs, pool, progress=lambda *news: told.append(news))
    assert list(found) == ["one", "two"]
    assert [plain(found[name]) for name in found] == [plain(here[name]) for name in found]
    assert [share for _, share in told] == [0.5, 1.0]
    assert told[-1][0].startswith("2 of 2 done; ")
    for name, force in (("one", 8.0), ("two", 14.0)):
        diagnosis = found[name].diagnosis
        assert diagnosis is not None
        assert diagnosis.effects[0].name == "coulomb_friction"
        assert diagnosis.effects[0].parameters["force"].value == pytest.approx(force, rel=0.02)


def test_paths_are_read_where_the_job_runs(tmp_path: Path, pool: Executor) -> None:
    record = drive(8.0)
    rows = np.column_stack([record.t, record.inputs, 1e3 * record.outputs])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="t,tau,position [mm]", comments="", fmt="%.17g")
    ltp.zoo.drive().save(tmp_path / "drive.toml")
    options = {**OPTIONS, "columns": {"q": "position [mm]"}}
    train = f"{tmp_path / 'run.csv'}@0:1.5"
    found = ltp.diagnose_many([ltp.Job("part", tmp_path / "drive.toml", train, options=options)], pool)
    diagnosis = found["part"].diagnosis
    assert diagnosis is not None, found["part"].error
    assert diagnosis.traces["records"][-1]["t"][-1] == pytest.approx(1.5)
    assert diagnosis.effects[0].parameters["force"].value == pytest.approx(8.0, rel=0.02)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_failures_are_results_and_stop_nothing(tmp_path: Path) -> None:
    lost = ltp.Job("lost", ltp.zoo.drive(), tmp_path / "none.csv")
    wrong = ltp.Job("wrong", ltp.zoo.cart_pendulum(), drive(8.0), options=OPTIONS)
    with ThreadPoolExecutor(2) as threads:
        found = ltp.diagnose_many([lost, job("good"), wrong], threads, results=tmp_path)
    assert [one.error is None for one in found.values()] == [False, True, False]
    assert found["lost"].error is not None
    assert found["lost"].error.kind == "InputError"
    assert "none.csv" in found["lost"].sentence
    assert found["wrong"].error is not None
    assert found["good"].diagnosis is not None
    again = ltp.diagnose_many([lost, job("good"), wrong], results=tmp_path)
    assert [one.resumed for one in again.values()] == [False, True, False]


class Broken(Executor):
    """An executor whose worker dies with its second job, as one that ran out of memory."""

    def __init__(self) -> None:
        self.count = 0

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        self.count += 1
        if self.count > 2:
            raise RuntimeError("cannot schedule new futures after shutdown")
        future: Future[Any] = Future()
        if self.count == 2:
            future.set_exception(EOFError("the worker died"))
        else:
            future.set_result(fn(*args, **kwargs))
        return future


def test_a_dead_worker_loses_no_job() -> None:
    found = ltp.diagnose_many([job("one"), job("two"), job("three")], Broken())
    assert found["one"].diagnosis is not None
    assert [found[name].error.kind for name in ("two", "three")] == ["EOFError", "RuntimeError"]  # type: ignore[union-attr]


def test_only_what_changed_is_done_again(tmp_path: Path) -> None:
    results = tmp_path / "deep" / "results"
    first = ltp.diagnose_many([job("one"), job("two")], results=results)
    again = ltp.diagnose_many([job("one"), job("two", 14.0), job("three")], results=results)
    assert [one.resumed for one in again.values()] == [True, False, False]
    assert plain(again["one"]) == plain(first["one"])
    assert again["one"].seconds == first["one"].seconds
    assert again["one"].diagnosis is not None
    assert again["one"].diagnosis.report(tmp_path / "r.html").stat().st_size > 1000
    (results / "one.npz").write_bytes(b"half a fi")
    (results / "three.json").write_text('{"format": 1, "jo')
    third = ltp.diagnose_many([job("one"), job("two", 14.0), job("three")], results=results)
    assert [one.resumed for one in third.values()] == [False, True, False]
    assert not list(results.glob(".*"))


def test_a_fingerprint_is_of_contents(tmp_path: Path) -> None:
    path = ltp.zoo.drive().save(tmp_path / "drive.toml")
    base = ltp.Job("a", path, drive(8.0), options=OPTIONS)
    same = [
        ltp.Job("b", path, [drive(8.0)], options=OPTIONS),
        ltp.Job("a", path, drive(8.0), options={**OPTIONS, "threads": 2}),
    ]
    others = [
        ltp.Job("a", ltp.zoo.drive().with_parameters(b=230.0), drive(8.0), options=OPTIONS),
        ltp.Job("a", path, drive(8.1), options=OPTIONS),
        ltp.Job("a", path, drive(8.0), drive(8.0), options=OPTIONS),
        ltp.Job("a", path, drive(8.0), options={**OPTIONS, "seed": 1}),
    ]
    assert {one.fingerprint() for one in same} == {base.fingerprint()}
    assert len({one.fingerprint() for one in [base, *others]}) == 5


def test_names_become_files_that_differ(tmp_path: Path) -> None:
    store = Store(tmp_path)
    names = ["run1", "Run1", "RUN1", "a/b", "a_b", "..", ".hidden", "lange Straße", "x" * 300]
    paths = [store.path(name) for name in names]
    assert len({str(path).lower() for path in paths}) == len(names)
    assert all(path.parent == tmp_path and len(path.name) < 130 for path in paths)
    assert store.path("run1").name == "run1.json"


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_ctrl_c_in_progress_ends_threads_cleanly(tmp_path: Path) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    jobs = [job(f"job{i}", 8.0 + i) for i in range(6)]
    with ThreadPoolExecutor(1) as threads, pytest.raises(KeyboardInterrupt):
        ltp.diagnose_many(jobs, threads, results=tmp_path, progress=interrupt)
    assert 1 <= len(list(tmp_path.glob("*.json"))) < 6
    assert sum(one.resumed for one in ltp.diagnose_many(jobs, results=tmp_path).values()) >= 1


def machines(folder: Path, count: int) -> None:
    """A folder as `ltp diagnose-many` wants it."""
    folder.mkdir()
    ltp.zoo.drive().save(folder / "model.toml")
    for i in range(count):
        record = drive(6.0 + i, i)
        (folder / f"m{i}").mkdir()
        rows = np.column_stack([record.t, record.inputs, record.outputs])
        np.savetxt(folder / f"m{i}" / "train.csv", rows, delimiter=",", header="t,tau,q", comments="", fmt="%.17g")


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals are sent as POSIX does")
@pytest.mark.parametrize("how", ["interrupt", "kill"])
def test_a_killed_run_goes_on_where_it_was(tmp_path: Path, how: str) -> None:
    machines(tmp_path / "machines", 6)
    results = tmp_path / "results"
    words = ["diagnose-many", "machines", "--results", "results", "--workers", "2"]
    words += ["--candidates", "coulomb_friction,quadratic_drag"]
    process = subprocess.Popen(
        [sys.executable, "-m", "ltp", *words], cwd=tmp_path, start_new_session=True, stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 120
    while not list(results.glob("*.json")):
        assert time.monotonic() < deadline
        assert process.poll() is None, process.stderr and process.stderr.read()
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGINT if how == "interrupt" else signal.SIGKILL)
    process.communicate(timeout=60)
    assert process.returncode == (130 if how == "interrupt" else -signal.SIGKILL)
    finished = {path.stem for path in results.glob("*.json")}
    assert len(finished) < 6
    run = subprocess.run(
        [sys.executable, "-m", "ltp", *words, "--json"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    tree = json.loads(run.stdout)
    assert [one["job"] for one in tree] == [f"m{i}" for i in range(6)]
    assert {one["job"] for one in tree if one["resumed"]} == finished
    assert all(one["diagnosis"]["effects"][0]["name"] == "coulomb_friction" for one in tree)
    assert not list(results.glob("*.part"))


def test_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    machines(tmp_path / "machines", 1)
    (tmp_path / "machines" / "broken").mkdir()
    (tmp_path / "machines" / "broken" / "train.csv").write_text("t,q\n0,1\n1,2\n")
    words = ["diagnose-many", "machines", "--results", "out", "--candidates", "coulomb_friction"]
    assert main(words) == 1
    out = capsys.readouterr().out
    assert "coulomb_friction at drive" in out
    assert "broken: InputError" in out
    assert main(words) == 1
    assert "as before" in capsys.readouterr().out
    assert main(["diagnose-many", "nowhere", "--results", "out"]) == 2
    assert main(["diagnose-many", "out", "--results", "out"]) == 2
    assert main([*words, "--workers", "0"]) == 2


def test_bad_jobs_are_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(ltp.InputError, match=r"unknown option 'sed'.*seed"):
        ltp.Job("a", "zoo:drive", "run.csv", options={"sed": 1})
    with pytest.raises(ltp.InputError, match="no name"):
        ltp.Job("", "zoo:drive", "run.csv")
    with pytest.raises(ltp.InputError, match="no training recording"):
        ltp.Job("a", "zoo:drive", [])
    with pytest.raises(ltp.InputError, match="given twice"):
        ltp.diagnose_many([job("a"), job("a")])
    with pytest.raises(ltp.InputError, match="jobs hold a str"):
        ltp.diagnose_many(["a"])  # type: ignore[list-item]
    (tmp_path / "file").write_text("")
    with pytest.raises(ltp.InputError, match="results folder"):
        ltp.diagnose_many([], results=tmp_path / "file")
    assert ltp.diagnose_many([]) == {}


def test_dask(here: dict[str, ltp.JobResult], tmp_path: Path) -> None:
    """The executor of a cluster: two workers in processes of their own."""
    distributed = pytest.importorskip("distributed", reason="Dask is not installed: pip install 'ltp-dynamics[dask]'")
    lost = ltp.Job("lost", ltp.zoo.drive(), tmp_path / "none.csv")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, local_directory=str(tmp_path)
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        jobs = [job("one"), lost, job("two", 14.0, 1)]
        found = ltp.diagnose_many(jobs, client.get_executor(), results=tmp_path / "results")
    assert [plain(found[name]) for name in ("one", "two")] == [plain(here[name]) for name in ("one", "two")]
    assert found["lost"].error is not None
    assert all(one.resumed for one in ltp.diagnose_many([jobs[0], jobs[2]], results=tmp_path / "results").values())
