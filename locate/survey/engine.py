"""Where the flights of a survey are worked on: in this process, or by the workers of Dask."""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol, TypeVar, runtime_checkable

from geometry.errors import BadInputError
from geometry.processes import count_cores

LOCAL = "local"
CONNECT_S = 20.0
"""Longest wait for a scheduler to answer."""
DEADLY = "its workers died, each time on the same task: too little memory?"
log = logging.getLogger("locate")

Item = TypeVar("Item")
Result = TypeVar("Result")
Submit = Callable[..., Any]


@runtime_checkable
class DividedJob(Protocol):
    """A job that can be done in parts, each of which keeps its results in files.

    Calling the job does what remains after its parts, and returns the result.
    """

    def list_parts(self, item: Any) -> Sequence[Sequence[str]]:
        """Names of the parts: group after group, those of one group at the same time."""
        ...

    def do_part(self, item: Any, name: str) -> str | None:
        """Does one part; returns why it cannot be done, or None."""
        ...

    def failed_result(self, item: Any, why: str) -> Any:
        """The result of an item that cannot be done."""
        ...


def map_flights(
    job: Callable[[Item], Result], items: Sequence[Item], scheduler: str | None = None
) -> Iterator[tuple[Item, Result]]:
    """Applies a job to every item and yields (item, result) as each is done, in any order.

    A `DividedJob` becomes one task for each part. A worker that dies costs the task it was at:
    another does it again. Where the scheduler dies, the same call goes on from the parts done.

    Args:
        job: A function that can be pickled, as must its items and results be. It keeps its own
            work in files, so that doing it again costs little.
        items: One for each flight.
        scheduler: None to work here, ``"local"`` for as many processes as there are cores, or the
            address of a running Dask scheduler, whose workers see the same files.

    Raises:
        BadInputError: The scheduler cannot be reached, or was lost.
    """
    workers = min(count_cores(), len(items)) if scheduler == LOCAL else 1
    if scheduler is None or (scheduler == LOCAL and (workers < 2 or not _has_dask())):
        for item in items:
            yield item, job(item)
        return
    with _open_client(scheduler, workers) as client:
        yield from _gather_results(client, job, items)


def _submit_parts(submit: Submit, job: Callable[[Item], Result], item: Item) -> Any:
    """Submits the parts of a job, each after those it needs; returns the future of the end."""
    before: list[Any] = []
    if isinstance(job, DividedJob):
        for group in job.list_parts(item):
            before = [submit(_do_part, job, item, name, before) for name in group]
    return submit(_finish_job, job, item, before)


def _do_part(job: DividedJob, item: Any, name: str, before: Sequence[str | None]) -> str | None:
    return _first_reason(before) or job.do_part(item, name)


def _finish_job(job: Callable[[Any], Any], item: Any, before: Sequence[str | None]) -> Any:
    why = _first_reason(before)
    return (
        job(item)
        if why is None or not isinstance(job, DividedJob)
        else job.failed_result(item, why)
    )


def _result_of_deadly(job: Callable[[Item], Result], item: Item, error: Exception) -> Result:
    """The result of an item that ends the workers at it.

    Raises:
        BadInputError: The job has no result for such items.
    """
    if not isinstance(job, DividedJob):
        raise BadInputError(f"{item}: {DEADLY}") from error
    result: Result = job.failed_result(item, DEADLY)
    return result


def _first_reason(reasons: Sequence[str | None]) -> str | None:
    return next((why for why in reasons if why is not None), None)


def _has_dask() -> bool:
    try:
        import distributed  # noqa: F401
    except ImportError:
        log.info("one process: install plume-locate[cluster] to use all cores")
        return False
    return True


@contextmanager
def _open_client(scheduler: str, workers: int) -> Iterator[Any]:
    """A client of a running scheduler, or of a cluster that lives as long as the block."""
    if not _has_dask():
        raise BadInputError(f"{scheduler}: needs Dask; pip install 'plume-locate[cluster]'")
    from distributed import Client, LocalCluster

    if scheduler == LOCAL:
        with (
            LocalCluster(  # type: ignore[no-untyped-call]
                n_workers=workers, threads_per_worker=1, dashboard_address=None
            ) as cluster,
            Client(cluster) as client,  # type: ignore[no-untyped-call]
        ):
            yield client
        return
    try:
        client = Client(scheduler, timeout=CONNECT_S)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise BadInputError(f"{scheduler}: no Dask scheduler answers there ({error})") from error
    with client:
        yield client


def _gather_results(
    client: Any, job: Callable[[Item], Result], items: Sequence[Item]
) -> Iterator[tuple[Item, Result]]:
    """The results as they come.

    Dask blames every task that a dead worker had before it, so those it gives up are tried again
    at the end, one item at a time: what then still kills its workers is to blame.
    """
    from distributed import CancelledError, KilledWorker, as_completed
    from distributed.comm.core import CommClosedError

    def submit(function: Callable[..., Any], *given: Any) -> Any:
        return client.submit(function, *given, pure=False)

    futures = {_submit_parts(submit, job, item): item for item in items}
    suspects = []
    try:
        for future in as_completed(list(futures)):  # type: ignore[no-untyped-call]
            item = futures.pop(future)
            try:
                result = future.result()
            except KilledWorker:
                suspects.append(item)
                continue
            yield item, result
        for item in suspects:
            try:
                result = _submit_parts(submit, job, item).result()
            except KilledWorker as error:
                result = _result_of_deadly(job, item, error)
            yield item, result
    except (CancelledError, CommClosedError) as error:
        raise BadInputError(
            f"the Dask scheduler was lost ({type(error).__name__}); "
            "the same command goes on from the parts that are done"
        ) from error
