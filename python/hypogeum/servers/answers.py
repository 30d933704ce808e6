"""Answers of policy servers, and what is wrong with them, in one sentence each. Imports no package of a protocol."""

from ..chunk import AnswerError


class ServerError(AnswerError):
    """An answer of a server that is none."""


class ConnectionLost(ServerError):
    """A connection that ended, or on which no answer came in time."""


async def receive(connection):
    """Return the next message on a WebSocket connection, or raise `ServerError` if it is text."""
    message = await connection.recv()
    if isinstance(message, str):
        # The last line of a traceback says what happened.
        lines = [line.strip() for line in message.splitlines() if line.strip()]
        raise ServerError(f"answered text instead of actions: {lines[-1][:300] if lines else 'an empty message'}")
    return message


def actions_of(reply):
    """Return the value of `actions` in a reply, or raise `ServerError`."""
    if not isinstance(reply, dict):
        raise ServerError(f"answered {type(reply).__name__}, expected a map with `actions`")
    if reply.get("actions") is None:
        raise ServerError(f"answered a map with {', '.join(map(repr, reply)) or 'no keys'}, expected `actions`")
    return reply["actions"]
