"""The writer's lock: the operating system holds it on the map, and frees it at death."""

from __future__ import annotations

import errno
import sys

__all__ = ["try_lock"]

if sys.platform == "win32":  # pragma: no cover
    import msvcrt
    import os

    def try_lock(descriptor: int) -> bool:
        """Lock the open file for one writer; false if another process holds the lock."""
        # A byte far behind the end, because locked bytes cannot be read by others here
        position = os.lseek(descriptor, 0, os.SEEK_CUR)
        try:
            os.lseek(descriptor, 2**62, os.SEEK_SET)
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        finally:
            os.lseek(descriptor, position, os.SEEK_SET)
        return True

else:
    import fcntl

    def try_lock(descriptor: int) -> bool:
        """Lock the open file for one writer; false if another process holds the lock."""
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno in (errno.EWOULDBLOCK, errno.EACCES, errno.EAGAIN):
                return False
            raise
        return True
