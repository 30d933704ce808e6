"""WebSocket connections of a policy, which answer pings while the simulator is busy.

They live in an event loop in a thread of its own. Every wait has a deadline, in seconds of `time.monotonic`.
"""

import asyncio
import logging
import threading
import time
from concurrent import futures

from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidURI, WebSocketException
from websockets.protocol import State

from .answers import ConnectionLost, ServerError

# Largest message of a server in bytes. A chunk of 127 rows of 16 f64 has 16 KiB.
MAX_BYTES = 1 << 24
RETRY_INTERVAL_S = 0.5
# Time by which a thread may be late.
GRACE_S = 1.0

# Python 3.10 has three classes of this name.
LATE = (TimeoutError, asyncio.TimeoutError, futures.TimeoutError)

log = logging.getLogger("hypogeum")


class Sockets:
    """Connections by key.

    Args:
        url: Address, `ws://` or `wss://`.
        greet: Coroutine function that receives a new connection, and returns what the server says of itself.
    """

    def __init__(self, url, greet):
        self.url, self.greet = url, greet
        self.connections = {}
        self.metadata = None
        self.loop = asyncio.new_event_loop()
        threading.Thread(target=self.loop.run_forever, name="connections", daemon=True).start()

    def open(self, keys, deadline):
        """Connect the keys that are not connected, in as many attempts as fit, and return the server's metadata.

        Connections that the server has closed meanwhile are replaced.

        Raises:
            ConnectionLost: The server cannot be reached until the deadline.
        """
        closed = [key for key, connection in self.connections.items() if connection.state is not State.OPEN]
        if closed:
            log.warning("the server has closed %d of %d connections", len(closed), len(self.connections))
            self.drop(closed)
        missing = sorted(set(keys) - self.connections.keys())
        if missing:
            self._run(self._open(missing, deadline), missing, deadline)
        return self.metadata

    def talk(self, conversations, deadline):
        """Run a coroutine function per key with its connection, all at the same time, and return their results by key.

        Raises:
            ServerError: One of them failed. All their connections are closed, since answers could still arrive there.
        """
        coroutines = [talk(self.connections[key]) for key, talk in conversations.items()]
        return dict(zip(conversations, self._run(gather(coroutines), conversations, deadline)))

    def drop(self, keys):
        """Close the connections of some keys, and return the futures of that."""
        connections = [self.connections.pop(key) for key in keys if key in self.connections]
        return [asyncio.run_coroutine_threadsafe(connection.close(), self.loop) for connection in connections]

    def close(self):
        """Close all connections."""
        futures.wait(self.drop(list(self.connections)), GRACE_S)

    def _run(self, coroutine, keys, deadline):
        left = max(deadline - time.monotonic(), 0)
        future = asyncio.run_coroutine_threadsafe(asyncio.wait_for(coroutine, left), self.loop)
        try:
            error = future.exception(left + GRACE_S)
        except LATE as late:
            error = late
        finally:
            future.cancel()
        if error is None:
            return future.result()
        self.drop(keys)
        # New errors: the loop's live as long as its tasks, and would retain the observation of this call.
        if isinstance(error, ServerError):
            raise type(error)(str(error))
        if isinstance(error, (OSError, WebSocketException, *LATE)):
            raise ConnectionLost(reason_of(error, left))
        raise error

    async def _open(self, keys, deadline):
        await gather([self._connect(key, deadline, idx == 0) for idx, key in enumerate(keys)])

    async def _connect(self, key, deadline, is_first):
        """Connect a key; the first of several reports failed attempts."""
        options = dict(compression=None, max_size=MAX_BYTES, ping_interval=None, open_timeout=None, close_timeout=1)
        is_told = not is_first
        while True:
            connection = None
            try:
                connection = await connect(self.url, **options)
                self.metadata = await self.greet(connection)
                self.connections[key] = connection
                if is_told and is_first:
                    log.info("the server is there again")
                return
            except InvalidURI:
                raise
            except (OSError, WebSocketException) as error:
                if deadline - time.monotonic() < RETRY_INTERVAL_S:
                    raise
                if not is_told:
                    left = deadline - time.monotonic()
                    log.warning("the server %s; trying again for %.0f s", reason_of(error, left), left)
                is_told = True
            finally:
                if connection is not None and self.connections.get(key) is not connection:
                    await connection.close()
            await asyncio.sleep(RETRY_INTERVAL_S)


async def gather(coroutines):
    """Return the results of coroutines that run at the same time. If one fails, the others are cancelled."""
    tasks = [asyncio.ensure_future(coroutine) for coroutine in coroutines]
    try:
        return await asyncio.gather(*tasks)
    except BaseException:
        for task in tasks:
            task.cancel()
        raise


def reason_of(error, waited_s):
    """Return the predicate of a sentence about the server."""
    if isinstance(error, LATE):
        return f"sent nothing within {waited_s:.0f} s"
    if isinstance(error, ConnectionClosed):
        return f"closed the connection ({error})"
    return f"cannot be reached ({error})"
