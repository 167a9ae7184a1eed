"""Owns `ltp.diagnose_many`: many diagnoses on any executor, none of them lost."""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

from ltp._ltp import ConvergenceError, InputError
from ltp.diagnose import Diagnosis, diagnose
from ltp.jobs import Job
from ltp.results import Store

Progress: TypeAlias = "Callable[[str, float], None]"

_LISTEN = 0.2  # s between two looks at the keyboard: on Windows a wait without end would not hear Ctrl-C


@dataclass(frozen=True)
class JobError:
    """Why a job has no diagnosis: the `kind` of the exception, such as "InputError", and what it says."""

    kind: str
    message: str


@dataclass(frozen=True)
class JobResult:
    """What became of one job: a `diagnosis`, or an `error`; one of them is None.

    seconds: how long it took where it ran, files included. resumed: it was read from the results folder, not made now.
    """

    name: str
    diagnosis: Diagnosis | None
    error: JobError | None
    seconds: float
    resumed: bool = False

    @property
    def sentence(self) -> str:
        """The diagnosis in a sentence, or what went wrong."""
        if self.diagnosis is not None:
            return self.diagnosis.sentence
        return f"{self.error.kind}: {self.error.message}" if self.error else ""


def diagnose_many(
    jobs: Mapping[str, Job] | Iterable[Job],
    executor: Executor | None = None,
    *,
    results: str | Path | None = None,
    progress: Progress | None = None,
) -> dict[str, JobResult]:
    """Make many diagnoses; returns what became of each job, by its name, in the order of `jobs`.

    jobs: a sequence of `Job`, or a mapping of names to jobs (the key is the name then).
    executor: any `concurrent.futures` executor: a `ProcessPoolExecutor`, a `ThreadPoolExecutor`, or that of a Dask
        cluster, `dask.distributed.Client(...).get_executor()`. It stays open. Without one the jobs run here, one after
        the other. A job on an executor uses one thread unless its options say otherwise, here all cores.
    results: a folder, made if need be. Each diagnosis is written there as soon as it is there, whole or not at all; the
        same call after a kill takes from it what is done and makes the rest. A job whose documents, samples or options
        changed, and one that failed, is done again.
    progress: called with a message and the finished fraction in [0, 1] after each job.

    A job that fails is a result with its `error`, and so is one whose worker died; nothing stops the others. Ctrl-C
    cancels what has not begun and raises `KeyboardInterrupt`; what was finished is in `results`. Raises `InputError`
    for names that are given twice, and for a results folder that cannot be written.
    """
    listed = _named(jobs)
    store = None if results is None else Store(results)
    found: dict[str, JobResult] = {}
    marks: dict[str, str] = {}

    def done(result: JobResult) -> None:
        found[result.name] = result
        if store is not None and not result.resumed:
            _keep(store, result, marks.get(result.name))
        if progress is not None:
            failed = sum(one.error is not None for one in found.values())
            words = f"{len(found)} of {len(listed)} done" + (f", {failed} failed" if failed else "")
            progress(f"{words}; {result.name}: {result.sentence}", len(found) / len(listed))

    waiting: list[Job] = []
    for job in listed:
        if store is None:
            waiting.append(job)
            continue
        try:
            marks[job.name] = job.fingerprint()
            kept = store.load(job.name, marks[job.name])
        except Exception as error:
            done(_failed(job.name, error, 0.0))
            continue
        if kept is None:
            waiting.append(job)
        else:
            done(JobResult(job.name, kept[0], None, kept[1], resumed=True))
    if executor is None:
        for job in waiting:
            done(_run(job, 0, None))
    else:
        _run_on(executor, waiting, done)
    return {job.name: found[job.name] for job in listed}


def _run_on(executor: Executor, jobs: list[Job], done: Callable[[JobResult], None]) -> None:
    # Threads share our memory, so that a job in one can be told to stop; a process hears Ctrl-C itself.
    stop = threading.Event() if isinstance(executor, ThreadPoolExecutor) else None
    running: dict[Future[JobResult], Job] = {}
    try:
        for job in jobs:
            try:
                running[executor.submit(_run, job, 1, stop)] = job
            except Exception as error:  # the pool is broken or closed
                done(_failed(job.name, error, 0.0))
        while running:
            finished, _ = wait(running, timeout=_LISTEN, return_when=FIRST_COMPLETED)
            for future in finished:
                done(_outcome(running.pop(future), future))
    except BaseException:  # Ctrl-C, or an exception of `progress`
        if stop is not None:
            stop.set()
        for future in running:
            future.cancel()
        raise


def _outcome(job: Job, future: Future[JobResult]) -> JobResult:
    try:
        return future.result()
    except KeyboardInterrupt:  # a worker heard Ctrl-C, and this process may not have
        raise
    except BaseException as error:  # a worker that died, a job or a result that could not travel
        return _failed(job.name, error, 0.0)


def _run(job: Job, threads: int, stop: threading.Event | None) -> JobResult:
    """One job, where it runs: read, diagnose, and turn every exception into a result."""
    began = time.perf_counter()

    def listening(*_: object) -> None:
        if stop is not None and stop.is_set():
            raise _Stopped("another job was interrupted")

    try:
        with warnings.catch_warnings():
            if threading.current_thread() is threading.main_thread():
                warnings.simplefilter("ignore")  # they are kept in the diagnosis; filters are shared between threads
            model, train, test = job.read()
            options = {"threads": threads, **job.diagnosis_options()}
            diagnosis = diagnose(model, train, test, progress=listening, **options)
    except Exception as error:
        return _failed(job.name, error, time.perf_counter() - began)
    return JobResult(job.name, diagnosis, None, time.perf_counter() - began)


class _Stopped(Exception):
    """Raised inside a job of a thread that is to end."""


def _failed(name: str, error: BaseException, seconds: float) -> JobResult:
    message = str(error) or "no message"
    if not isinstance(error, (InputError, ConvergenceError, _Stopped)):
        message += "; run again: what is finished is taken from the results folder, if there is one"
    return JobResult(name, None, JobError(type(error).__name__, message), seconds)


def _keep(store: Store, result: JobResult, mark: str | None) -> None:
    if result.diagnosis is not None and mark is not None:
        store.save(result.name, mark, result.diagnosis, result.seconds)
    elif result.error is not None:
        store.save_error(result.name, result.error.kind, result.error.message)


def _named(jobs: Mapping[str, Job] | Iterable[Job]) -> list[Job]:
    if isinstance(jobs, Mapping):
        return [replace(job, name=name) for name, job in jobs.items()]
    listed = list(jobs)
    for job in listed:
        if not isinstance(job, Job):
            raise InputError(f"diagnose_many: jobs hold a {type(job).__name__}, expected ltp.Job(name, model, train)")
    names = [job.name for job in listed]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(
            f"diagnose_many: {len(twice)} names are given twice, such as {twice[0]!r}; each result needs its own"
        )
    return listed
