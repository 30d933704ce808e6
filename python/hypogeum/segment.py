"""Second, read-only mapping of a sender's shared memory, which stays valid while any array refers to it.

iceoryx2 unmaps a sender's memory when the sender detaches. Reading an array that the policy has retained would then
crash the process.
"""

import mmap
import os

import numpy as np

# madvise(2) advice to map all pages at once. Linux before 5.14 rejects it, which only costs time.
MADV_POPULATE_READ = 22


class SegmentGone(Exception):
    """The segment's file no longer exists: its sender has exited and has been cleaned up."""


class Segment:
    """Mapping of one sender's data segment."""

    def __init__(self, address, sender):
        """Map the segment of `sender` that contains `address`, an address in this process."""
        self.sender = sender
        start, _, offset, device, inode, path = mapping_of(address)
        try:
            file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        except OSError as error:
            raise SegmentGone(f"{path}: {error.strerror}") from error
        try:
            status = os.fstat(file)
            found = (os.major(status.st_dev), os.minor(status.st_dev), status.st_ino)
            if found != (*device, inode):
                raise SegmentGone(f"{path} has been replaced by another file")
            self._memory = mmap.mmap(file, status.st_size, access=mmap.ACCESS_READ)
        finally:
            os.close(file)
        self._start, self._offset = start, offset
        try:
            self._memory.madvise(MADV_POPULATE_READ)
        except (OSError, ValueError):
            pass

    def bytes_at(self, address, n_bytes):
        """Return the bytes at `address` as `[n_bytes] u8`.

        Every call returns a new array, which is the base of all views derived from it.
        """
        return np.frombuffer(self._memory, np.uint8, n_bytes, address - self._start + self._offset)


def mapping_of(address):
    """Return the entry of `/proc/self/maps` that contains `address`: start, end, offset, device, inode, path."""
    with open("/proc/self/maps") as maps:
        for line in maps:
            span, _, offset, device, inode, *path = line.split(maxsplit=5)
            start, end = (int(number, 16) for number in span.split("-"))
            if start <= address < end:
                major, minor = (int(number, 16) for number in device.split(":"))
                return start, end, int(offset, 16), (major, minor), int(inode), "".join(path).strip()
    raise SegmentGone(f"{address:#x} is not mapped")
