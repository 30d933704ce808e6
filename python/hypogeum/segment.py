"""A sender's shared memory, mapped once more and read-only, in a way that lives as long as any array made of it.

iceoryx2 unmaps a sender's memory when that sender is gone; an array that somebody has kept would then end the process.
"""

import mmap
import os

import numpy as np

# Linux's advice to map all pages at once; older kernels refuse it, which costs time only.
MADV_POPULATE_READ = 22


class SegmentGone(Exception):
    """The memory has no name any more: its sender has died and was cleaned up after."""


class Segment:
    """The mapping of one sender."""

    def __init__(self, address, sender):
        """Maps the segment of `sender`, in which this address of the process lies."""
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
                raise SegmentGone(f"{path} is another file by now")
            self._memory = mmap.mmap(file, status.st_size, access=mmap.ACCESS_READ)
        finally:
            os.close(file)
        self._start, self._offset = start, offset
        try:
            self._memory.madvise(MADV_POPULATE_READ)
        except (OSError, ValueError):
            pass

    def bytes_at(self, address, n_bytes):
        """`[n_bytes] u8` from an address on. Every call gives an array of its own, the base of all views of it."""
        return np.frombuffer(self._memory, np.uint8, n_bytes, address - self._start + self._offset)


def mapping_of(address):
    """The line of this process's memory map in which an address lies."""
    with open("/proc/self/maps") as maps:
        for line in maps:
            span, _, offset, device, inode, *path = line.split(maxsplit=5)
            start, end = (int(number, 16) for number in span.split("-"))
            if start <= address < end:
                major, minor = (int(number, 16) for number in device.split(":"))
                return start, end, int(offset, 16), (major, minor), int(inode), "".join(path).strip()
    raise SegmentGone(f"{address:#x} is not mapped")
