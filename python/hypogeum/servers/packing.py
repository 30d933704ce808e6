"""Messages in msgpack with numpy arrays, as openpi and vla-eval write them.

An array is a map with the keys `__ndarray__`, `data`, `dtype` and `shape`, which are bytes in openpi's messages and
strings in those of vla-eval.
"""

import msgpack
import numpy as np

from .answers import ServerError

# Kinds of dtypes: bool, signed and unsigned integers, floats. Never objects.
KINDS = "biuf"


class Packing:
    """Format of messages.

    Args:
        key: `str`, or `str.encode` for keys of arrays that are bytes.
    """

    def __init__(self, key):
        self.marker, self.data, self.dtype, self.shape = map(key, ("__ndarray__", "data", "dtype", "shape"))
        self.scalar = key("__npgeneric__")

    def pack(self, message):
        """Return the bytes of a message, which may contain arrays."""
        return msgpack.packb(message, default=self._encode)

    def unpack(self, data):
        """Return the message in `data`.

        Raises:
            ServerError: It is no valid message.
        """
        try:
            return msgpack.unpackb(data, object_hook=self._decode)
        except (ValueError, TypeError, KeyError, msgpack.UnpackException) as error:
            raise ServerError(f"sent {len(data)} bytes that are no msgpack message with arrays: {error}") from error

    def _encode(self, array):
        if isinstance(array, np.ndarray):
            shape = list(array.shape)
            return {self.marker: True, self.data: array.tobytes(), self.dtype: array.dtype.str, self.shape: shape}
        raise TypeError(f"{type(array).__name__} cannot be sent")

    def _decode(self, fields):
        if self.marker in fields or self.scalar in fields:
            dtype = np.dtype(fields[self.dtype])
            if dtype.kind not in KINDS:
                raise ValueError(f"an array of type {dtype}")
            if self.scalar in fields:
                return dtype.type(fields[self.data])
            return np.frombuffer(fields[self.data], dtype).reshape(fields[self.shape])
        return fields

