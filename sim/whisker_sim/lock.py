"""Exclusive access of one process to a folder of outputs."""

import errno
import fcntl
import os
import platform
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_UNAVAILABLE = {errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOLCK, errno.EOPNOTSUPP}
"""Errors of a file system without locks, or of a folder that may not be written: there is no exclusion."""
_LONGEST = 200
"""Longest description of a process, in bytes."""


@contextmanager
def exclusive(folder: Path, share: str = "") -> Iterator[None]:
    """Waits until no other process writes `folder`, or its share of that name, and excludes others until the end of the context.

    A lock of the operating system on the hidden file `.<name>.lock` beside the folder, as in the Rust crate `files`. The operating
    system releases it when the process ends, even by a kill.
    """
    target = folder.resolve()
    path = target.with_name(f".{target.name}{share and '.'}{share}.lock")
    file = _locked(path, folder)
    try:
        yield
    finally:
        if file is not None:
            # Removed while the lock is held.
            path.unlink(missing_ok=True)
            os.close(file)


def _locked(path: Path, folder: Path) -> int | None:
    """Descriptor of the locked file at `path`; `None` without exclusion."""
    waited = False
    while True:
        file = None
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
            if not waited and not _is_free(file):
                holder = os.read(file, _LONGEST).decode(errors="replace").strip() or "another process"
                print(f"{folder}: waiting for {holder}, which writes it", file=sys.stderr, flush=True)
                waited = True
            fcntl.flock(file, fcntl.LOCK_EX)
        except OSError as error:
            if file is not None:
                os.close(file)
            if error.errno in _UNAVAILABLE:
                return None
            raise
        # The previous holder removes the file: a lock on a removed file excludes nobody.
        if _is_at(file, path):
            os.ftruncate(file, 0)
            os.pwrite(file, f"process {os.getpid()} on {platform.node()}\n".encode(), 0)
            return file
        os.close(file)


def _is_at(file: int, path: Path) -> bool:
    """Whether the open file is still the one at `path`."""
    try:
        return os.path.samestat(os.fstat(file), path.stat())
    except FileNotFoundError:
        return False


def _is_free(file: int) -> bool:
    """Locks the file if no other process has locked it; returns whether it succeeded."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
