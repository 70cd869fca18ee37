"""Tasks on a Dask cluster: one of this machine, one that runs already, or one that a job queue starts.

Tasks are submitted in a bounded window, so that neither this process nor Dask's scheduler holds more than a few
per worker of a run of many thousands. When this process ends, however it ends, Dask forgets what it had submitted and
the workers stop.
"""

from __future__ import annotations

import asyncio
import logging
import os
import secrets
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing import resource_tracker
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Self

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.runtime.imports import needing
from avs3d_bench.scheduling.jobqueue import Jobs, start_cluster
from avs3d_bench.scheduling.ledger import Ledger, Next
from avs3d_bench.scheduling.on_worker import TOPIC, AttemptError, TaskSettings, attempt, busy
from avs3d_bench.scheduling.tasks import Attempt, Event, Failure, Listener, Policy, Success, Task

#: Of what Dask logs, this and worse is shown.
_LEVEL = logging.INFO if os.environ.get("AVS3D_DEBUG") else logging.CRITICAL
#: Submitted tasks per slot of the cluster, and the least of them: a worker that is done has the next one at hand. Not
#: where fewer tasks are left than workers may still come: what Dask has given to a worker stays there.
_WINDOW, _LEAST = 2, 16
#: How many other workers a task may choose from when it is tried again.
_ELSEWHERE = 32
#: Between two looks at how many workers there are, seconds.
_REFRESH = 3.0
#: Between two questions to a job queue about its jobs, seconds.
_ASK = 10.0
#: Approximate limit of events per second from all workers together.
_EVENTS = 100.0
#: Time limit for workers to stop tasks that are no longer wanted (s).
_STOP = 10.0
#: Time limits for a scheduler's answer: the first, and the later ones (s).
_CONNECT, _ANSWER = 20.0, 10.0


class DaskScheduler:
    """A Dask cluster, started or joined on entering the context.

    Args:
        workers: worker processes of a cluster that is started here.
        address: of the scheduler of a cluster that runs.
        jobqueue, jobqueue_options: see `jobqueue.start_cluster`.
        gpus: each task takes one GPU: the resource ``GPU`` of Dask's workers.
    """

    def __init__(
        self,
        workers: int,
        *,
        address: str | None = None,
        jobqueue: str | None = None,
        jobqueue_options: Path | None = None,
        gpus: bool = False,
    ) -> None:
        self.slots = workers
        self._workers = workers
        self._address = address
        self._jobqueue = jobqueue
        self._jobqueue_options = jobqueue_options
        self._gpus = gpus
        self._stack = ExitStack()
        self._where = address or "the local Dask cluster"
        self._jobs: Jobs | None = None

    def __enter__(self) -> Self:
        with needing("--scheduler dask", "pip install 'avs3d-bench[cluster]'"):
            import dask
            import distributed
        _mute_dask()
        with ExitStack() as stack:
            # A task that is tried again elsewhere must not be drawn back to where it failed.
            stack.enter_context(dask.config.set({"distributed.scheduler.work-stealing": False}))
            if self._address is None:
                with _without_interrupts():
                    cluster = self._start(distributed)
                    stack.callback(_close, cluster)
                target: Any = cluster
            else:
                target = self._address
                _expect_scheduler(target)
            try:
                client: Any = distributed.Client
                self._client = client(target, timeout=_CONNECT, set_as_default=False)
            except OSError as error:
                raise Avs3dError(f"{self._where}: its scheduler does not answer ({_line(error)})") from None
            stack.callback(_close, self._client)
            self._stack = stack.pop_all()
        self.dashboard = str(self._client.dashboard_link or "")
        return self

    def _start(self, distributed: Any) -> Any:
        if self._jobqueue is not None:
            assert self._jobqueue_options is not None
            self._where = f"the cluster of --jobqueue {self._jobqueue}"
            cluster = start_cluster(self._jobqueue, self._jobqueue_options, self._workers)
            self._jobs = Jobs(self._jobqueue, cluster)
            return cluster
        # Threads of one process, where each takes a device; else processes. Memory is used in the supervised processes,
        # which Dask does not watch.
        shape = (
            {"n_workers": 1, "threads_per_worker": self._workers, "resources": {"GPU": self._workers}}
            if self._gpus
            else {"n_workers": self._workers, "threads_per_worker": 1}
        )
        return distributed.LocalCluster(
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            memory_limit=0,
            silence_logs=_LEVEL,
            preload=["avs3d_bench.scheduling.on_worker"],
            **shape,
        )

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def run(self, tasks: Sequence[Task], policy: Policy, listen: Listener) -> Generator[Success | Failure, None, None]:
        """See `tasks.Scheduler`.

        Raises:
            UsageError: if tasks need GPUs and no worker offers any.
            Avs3dError: if the scheduler of the cluster is lost, or all its jobs have ended.
        """
        # Of a cluster that runs, all are there; one that is started here has its workers come one by one.
        wanted = self._workers if self._address is None else 0
        run = _DaskRun(
            self._client, tasks, policy, listen, gpus=self._gpus, where=self._where, wanted=wanted, jobs=self._jobs
        )
        if self.dashboard:
            listen(Event("note", "", f"Dask's dashboard: {self.dashboard}"))
        try:
            yield from run.results()
        finally:
            run.stop()


class _DaskRun:
    """One call of `DaskScheduler.run`."""

    def __init__(
        self,
        client: Any,
        tasks: Sequence[Task],
        policy: Policy,
        listen: Listener,
        *,
        gpus: bool,
        where: str,
        wanted: int,
        jobs: Jobs | None,
    ) -> None:
        self._client = client
        self._listen = listen
        self._where = where
        self._wanted = wanted
        self._jobs = jobs
        self._asked = time.monotonic()
        self._resources = {"GPU": 1} if gpus else None
        self._name = secrets.token_hex(6)
        self._policy = policy
        self._ledger = Ledger(tasks, retries=policy.retries, ahead=1)
        self._open: dict[Any, Next] = {}
        self._bound: dict[Any, list[str]] = {}
        self._submitted = 0
        self._news: SimpleQueue[Any] = SimpleQueue()
        self._threads: dict[str, int] = {}
        self._looked = 0.0
        self._waiting = self._silent = False
        client.subscribe_topic(TOPIC, self._news.put)
        client.subscribe_topic("all", self._news.put)

    def results(self) -> Generator[Success | Failure, None, None]:
        while not self._ledger.finished:
            self._look()
            self._submit()
            news = [self._wait()]
            with suppress(Empty):
                while True:
                    news.append(self._news.get_nowait())
            ended = []
            for item in news:
                if isinstance(item, tuple):
                    self._tell(item[1])
                elif item is not None and item in self._open:
                    ended.append(item)
            yield from self._collect(ended)

    def _wait(self) -> Any:
        try:
            return self._news.get(timeout=0.5)
        except Empty:
            return None

    def _look(self) -> None:
        """Update the list of workers, at intervals."""
        if time.monotonic() - self._looked < (_REFRESH if self._threads else 0.5):
            return
        self._looked = time.monotonic()
        if self._client.status not in ("running", "newly-created", "connecting"):
            raise self._lost()
        try:
            self._threads = dict(_bounded(self._client, self._client.nthreads, _ANSWER))
            self._silent = False
        except TimeoutError:
            if not self._silent:
                self._listen(Event("note", "", f"{self._where}: its scheduler does not answer; waiting for it"))
            self._silent = True
        except OSError:  # the client tries to connect again, or gives up: its status tells
            pass
        else:
            if self._resources and self._threads:
                workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
                if not any(worker.get("resources", {}).get("GPU") for worker in workers):
                    raise UsageError(
                        f"{self._where}: no worker offers a GPU; start them with --resources 'GPU=1' (docs/cluster.md)"
                    )
        self._unbind()
        slots = sum(self._threads.values())
        self._ledger.ahead = max(1, _WINDOW * slots)
        if not slots and not self._waiting:
            self._listen(Event("note", "", f"{self._where} has no workers yet; waiting for the first"))
        self._waiting = not slots
        self._look_at_jobs(slots)

    def _look_at_jobs(self, slots: int) -> None:
        """Have jobs that the queue has ended replaced, now and then.

        Raises:
            Avs3dError: if there is nothing left to wait for.
        """
        if self._jobs is None:
            return
        self._jobs.see()
        if time.monotonic() - self._asked < _ASK:
            return
        self._asked = time.monotonic()
        replaced, hopeless = self._jobs.mend()
        if replaced:
            plural = "job has" if replaced == 1 else "jobs have"
            self._listen(Event("note", "", f"{replaced} {plural} ended before the work; submitted again"))
        if hopeless and not slots:
            raise Avs3dError(
                f"{self._where}: its jobs have ended, and no worker is left; their logs (log_directory) say why; "
                "run the same command again to go on"
            )

    def _submit(self) -> None:
        slots = sum(self._threads.values())
        window = slots
        if slots and self._ledger.left > max(_LEAST, _WINDOW * max(slots, self._wanted)):
            window = max(_LEAST, _WINDOW * slots)
        terms = TaskSettings(self._name, self._policy.environment, max(1.0, slots / _EVENTS))
        while len(self._open) < window and (item := self._ledger.take()):
            task = item.task
            elsewhere = self._elsewhere(item)
            self._submitted += 1
            future = self._client.submit(
                attempt,
                task,
                terms,
                key=(f"{task.call.__name__}-{self._name}", task.name, self._submitted),
                pure=False,
                workers=elsewhere,
                resources=self._resources,
            )
            self._open[future] = item
            if elsewhere:
                self._bound[future] = elsewhere
            future.add_done_callback(self._news.put)

    def _elsewhere(self, item: Next) -> list[str] | None:
        """A few workers besides the one that the task failed on, if there are any; None: wherever it may be."""
        if not item.failed:
            return None
        failed = item.failed[-1].worker.partition(" ")[0]
        others = [address for address in self._threads if address != failed]
        first = self._submitted % max(1, len(others))
        return (others[first:] + others[:first])[:_ELSEWHERE] or None

    def _unbind(self) -> None:
        """Submit again what is bound to workers of which none is left."""
        for future, workers in list(self._bound.items()):
            if future not in self._open:
                del self._bound[future]
            elif not any(address in self._threads for address in workers):
                del self._bound[future]
                self._ledger.give_back(self._open.pop(future))
                future.cancel()

    def _collect(self, ended: list[Any]) -> Generator[Success | Failure, None, None]:
        """Take what has ended off the cluster, all at once."""
        values = self._values([future for future in ended if future.status == "finished"])
        for future in ended:
            item = self._open.pop(future)
            if future in values:
                self._ledger.done(item.task)
                yield Success(item.task, values[future])
            elif future.status in ("lost", "pending"):
                # The worker was lost before its result was fetched: Dask runs it again.
                self._open[future] = item
                future.add_done_callback(self._news.put)
                continue
            elif future.status == "error":
                failed = self._attempt_of(future.exception())
                given_up = list(self._ledger.failed(item, failed))
                if not given_up:
                    self._listen(Event("retry", item.task.name, failed.message))
                yield from given_up
            else:
                raise self._lost()
            future.release()

    def _values(self, done: list[Any]) -> dict[Any, Any]:
        """Values of finished tasks, without those whose worker was lost meanwhile and that failed again."""
        try:
            return dict(zip(done, self._client.gather(done), strict=True)) if done else {}
        except Exception:
            if len(done) == 1:
                return {}
        return {future: value for each in done for future, value in self._values([each]).items()}

    def _tell(self, content: dict[str, Any]) -> None:
        if content.get("run") == self._name:
            self._listen(Event(content["kind"], content["name"], content["text"]))
        elif content.get("action") == "remove-worker" and not content.get("expected"):
            self._listen(Event("worker", "", f"{content.get('worker')} is lost; its tasks run elsewhere"))

    def _attempt_of(self, error: BaseException) -> Attempt:
        """A failed attempt with the error that a Dask task ended with.

        Raises:
            Avs3dError: if the scheduler cannot read any task of this project.
        """
        if isinstance(error, AttemptError):
            return error.attempt
        last = getattr(error, "last_worker", None)
        if last is not None:  # KilledWorker
            message = "the workers it ran on were lost, one after another; is avs3d-bench installed there?"
            return Attempt(str(getattr(last, "address", last)), "crash", message)
        if "deserialization of the task graph" in str(error):
            raise Avs3dError(
                f"{self._where}: its scheduler cannot read the tasks; install the same avs3d-bench[cluster] on the "
                "scheduler's machine as here, and start it again"
            )
        return Attempt("", "unfit", f"the cluster could not start it: {type(error).__name__}: {_line(error)}")

    def _lost(self) -> Avs3dError:
        return Avs3dError(f"{self._where}: its scheduler is gone; run the same command again to go on")

    def stop(self) -> None:
        """Have the cluster forget what is still open, and wait until its workers have ended it."""
        with suppress(Exception):
            self._client.unsubscribe_topic(TOPIC)
            self._client.unsubscribe_topic("all")
        if not self._open or self._client.status != "running":
            return
        deadline = time.monotonic() + _STOP
        client, name = self._client, self._name
        with suppress(Exception):  # the cluster may be going down as well, or some worker never answers
            _bounded(client, lambda: client.cancel(list(self._open), force=True), _STOP)
            self._open.clear()
            while (left := deadline - time.monotonic()) > 0:
                # A worker without this package says so, and has nothing of ours to end.
                if not any(_bounded(client, lambda: client.run(busy, name, on_error="ignore"), left).values()):
                    break
                time.sleep(0.2)


def _expect_scheduler(address: str) -> None:
    """Ask for the identity of a scheduler: Dask's client waits for ever if it accepts a connection but never answers.

    Raises:
        Avs3dError: if it is no Dask scheduler.
    """
    import distributed

    security: Any = distributed.Security
    rpc: Any = distributed.core.rpc

    async def ask() -> Any:
        server = rpc(address, timeout=_CONNECT, connection_args=security().get_connection_args("client"))
        try:
            return await server.identity()
        finally:
            await server.close_rpc()

    async def ask_in_time() -> Any:
        return await asyncio.wait_for(ask(), _CONNECT)

    try:
        kind = asyncio.run(ask_in_time())["type"]
    except Exception as error:  # no connection, no address, no certificate, another protocol
        raise Avs3dError(
            f"--scheduler-address {address}: no Dask scheduler answers there ({_line(error)}); "
            "expected what `dask scheduler` prints, such as tcp://HOST:8786"
        ) from None
    if kind != "Scheduler":
        raise Avs3dError(
            f"--scheduler-address {address}: this is a Dask {kind.lower()}, expected the scheduler; "
            "give the address that `dask scheduler` prints"
        )


def _bounded(client: Any, call: Callable[[], Any], seconds: float) -> Any:
    """``call()``, a method of a client, for at most so many seconds.

    Raises:
        TimeoutError: if it takes longer.
    """

    async def ask() -> Any:
        return await call()

    return client.sync(ask, callback_timeout=seconds)


def _line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Delay Ctrl-C until the end; the processes that are started meanwhile never receive it.

    It reaches every process of a terminal, but only the first one decides what it means. A blocked signal stays blocked
    in the threads and processes that are started meanwhile. (Dask's workers that take the place of lost ones are made
    deaf by `on_worker.dask_setup`.)
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    resource_tracker.ensure_running()  # starting it would unblock
    heard: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: heard.append(number))
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        signal.signal(signal.SIGINT, before)
        if heard:
            raise KeyboardInterrupt


def _mute_dask() -> None:
    """Hide Dask's log of lost connections with tracebacks: this module reports them in one line."""
    for name in ["asyncio", "tornado", *logging.root.manager.loggerDict]:
        if name.partition(".")[0] in ("distributed", "asyncio", "tornado"):
            logging.getLogger(name).setLevel(_LEVEL)


def _close(what: Any) -> None:
    with suppress(Exception):  # what cannot be reached any more has ended
        what.close(timeout=_ANSWER)
