"""Checksums of messages, by which each side notices that something else has written to the other's memory."""

import zlib

from .observation import FrameError


class DamagedError(FrameError):
    """An observation that was overwritten in shared memory after it was sent."""


def checksum(header, pages):
    """Return the CRC-32 of a header, with 0 in place of its checksum, and of its pages."""
    copy = type(header).from_buffer_copy(header)
    copy.checksum = 0
    return zlib.crc32(pages, zlib.crc32(bytes(copy)))


def check_checksum(header, pages):
    """Raise `DamagedError` if a message has a checksum that its bytes do not match."""
    if not header.has_checksum:
        return
    expected = checksum(header, pages)
    if header.checksum != expected:
        raise DamagedError(f"the checksum of the message is {header.checksum:#010x}, but its bytes give {expected:#010x}")
