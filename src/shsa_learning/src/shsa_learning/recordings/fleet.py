"""Reads the rosbags of a fleet side by side: by a process each, or by the workers of dask."""
import os
import signal
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from functools import partial
from typing import Any, Callable, Dict, Iterable, Iterator, List, Sequence, Tuple, Union

from shsa_core.errors import ModelError, ShsaError
from shsa_core.model.som import Som
from shsa_learning.recordings.bags import Step, read_bag
from shsa_learning.recordings.recording import Recording

MOST_OF_ALL, FEWEST = 1_000_000, 2_000
"""Rows of a source that are kept of all bags together, and of each at least."""
ANSWER_S = 10.0
"""So long a scheduler is given to answer."""

Refused = Tuple[str, str]
Answer = Tuple[str, Union[Recording, Refused]]
"""A bag, and what is in it, or where and what is wrong: it may come from another process."""


def read_bags(
    paths: Sequence[str], som: Som, step: Step, dask: str, most: int
) -> Tuple[Recording, ...]:
    """Read bags; the arguments are those of `data.read`. Raises ShsaError for the first refused."""
    most = min(most, max(FEWEST, MOST_OF_ALL // max(1, len(paths))))
    if len(paths) < 2 and not dask:
        return tuple(read_bag(path, som, step, most) for path in paths)
    read = partial(_read, som, most)
    found: Dict[str, Recording] = {}
    refused: Dict[str, Refused] = {}
    for path, answer in _by_dask(read, paths, dask) if dask else _by_processes(read, paths):
        if isinstance(answer, Recording):
            found[path] = answer
        else:
            refused[path] = answer
        step(os.path.getsize(path))
    for path in paths:
        if path in refused:
            raise ModelError(*refused[path])
    return tuple(found[path] for path in paths)


def _read(som: Som, most: int, path: str) -> Answer:
    try:
        return path, read_bag(path, som, most=most)
    except ModelError as error:
        return path, (error.where, error.what)
    except ShsaError as error:
        return path, (path, str(error))


def _by_processes(read: Callable[[str], Answer], paths: Sequence[str]) -> Iterator[Answer]:
    deaf = signal.signal, (signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who waits for them
    with ProcessPoolExecutor(os.cpu_count(), None, *deaf) as processes:
        futures: List["Future[Answer]"] = [processes.submit(read, path) for path in paths]
        try:
            for future in as_completed(futures):
                yield future.result()
        finally:
            for future in futures:
                future.cancel()


def _by_dask(read: Callable[[str], Answer], paths: Sequence[str], address: str) -> Iterator[Answer]:
    try:
        import distributed
    except ImportError:
        raise ModelError("--dask", "needs python3-distributed, which is not installed") from None
    try:
        client = distributed.Client(address, timeout=ANSWER_S)
    except (OSError, ValueError) as error:
        raise ModelError("--dask", f"no scheduler answers at {address}: {error}") from error
    with client:
        futures: Iterable[Any] = client.map(read, paths, pure=False)
        for _, answer in distributed.as_completed(futures, with_results=True):
            yield answer
