"""Serve the policy of a vla-eval model server: `python -m hypogeum.vla_eval ws://HOST:PORT NAME`.

Each slot of the simulator has a connection of its own, on which EPISODE_START begins an episode and each OBSERVATION is
answered by an ACTION. Messages are msgpack with arrays.
"""

import itertools
import time
import weakref

from .requirements import explained
from .robot import CAMERAS, STATE_PARTS
from .servers.answers import ServerError, actions_of, receive
from .servers.command import make_parser, serve_server

INSTALL = "pip install './python[vla-eval]'"
PROTOCOL_VERSION = 1


class VlaEval:
    """Connections to a vla-eval model server.

    Args:
        url: Address, `ws://` or `wss://`.
    """

    def __init__(self, url):
        from .servers.packing import Packing
        from .servers.sockets import Sockets

        self.packing = Packing(str)
        self.sockets = Sockets(url, self.greet)
        self.sequence = itertools.count()
        self.in_episode = weakref.WeakSet()

    async def greet(self, connection):
        """Exchange HELLO messages and return what the server says of itself."""
        payload = {"harness_version": "hypogeum", "protocol_version": PROTOCOL_VERSION, "benchmark": "hypogeum"}
        await connection.send(self.message("hello", payload)[1])
        found = await self.receive(connection, "hello")
        version = found.get("protocol_version")
        if version != PROTOCOL_VERSION:
            raise ServerError(f"speaks version {version!r} of vla-eval's protocol, expected {PROTOCOL_VERSION}")
        return found

    def prepare(self, requests):
        """Do nothing: this protocol needs to know nothing beforehand."""

    def close(self):
        """Close all connections."""
        self.sockets.close()

    def encode(self, requests, envs):
        """Return the messages per request, each with its sequence number: one that starts the episode, if it is new."""
        return [
            (
                self.message("episode_start", task_of(env)) if env.query == 0 else None,
                self.message("observation", request),
            )
            for request, env in zip(requests, envs)
        ]

    def open(self, slots, deadline):
        """Connect the slots and return what the server says of itself."""
        return self.sockets.open(slots, deadline)

    def ask(self, slots, messages, deadline):
        """Return the actions for each message."""
        talks = {slot: self.talk(slot, *its) for slot, its in zip(slots, messages)}
        answers = self.sockets.talk(talks, deadline)
        return [actions_of(answers[slot]) for slot in slots]

    def talk(self, slot, start, observation):
        """Return a coroutine function that sends an observation on a connection and returns its answer."""

        async def exchange(connection):
            if start is not None:
                if connection in self.in_episode:
                    await connection.send(self.message("episode_end", {})[1])
                self.in_episode.add(connection)
                await connection.send(start[1])
            elif connection not in self.in_episode:
                raise ServerError(f"does not know the episode in slot {slot}, which began on an earlier connection")
            await connection.send(observation[1])
            return await self.receive(connection, "action", observation[0])

        return exchange

    def message(self, kind, payload):
        """Return a sequence number and the message with it."""
        sequence = next(self.sequence)
        return sequence, self.packing.pack(dict(type=kind, payload=payload, seq=sequence, timestamp=time.time()))

    async def receive(self, connection, kind, sequence=None):
        """Return the payload of the next message, or raise `ServerError` if it is not of this kind."""
        found = self.packing.unpack(await receive(connection))
        found = found if isinstance(found, dict) else {}
        payload = found.get("payload")
        if found.get("type") == "error":
            raise ServerError(f"answered an error: {str(payload)[:300]}")
        if found.get("type") != kind or not isinstance(payload, dict):
            raise ServerError(f"sent a message of type {found.get('type')!r}, expected {kind!r} of vla-eval's protocol")
        if sequence not in (None, found.get("seq")):
            raise ServerError(f"answered message {found.get('seq')}, expected {sequence}")
        return payload


def task_of(env):
    """Return what the server learns of an episode at its start."""
    return {"task": {"name": env.instruction, "policy_seed": env.policy_seed}}


def default_mapping(morphology):
    """Return the keys that vla-eval recommends, with everything that a robot has."""
    return {
        "images": {camera: camera for camera in CAMERAS[morphology]},
        "state": [part for part, _ in STATE_PARTS[morphology]],
        "task_description": "instruction",
    }


def main(argv=None):
    args = make_parser("vla_eval", __doc__, ("ws", "wss")).parse_args(argv)
    with explained(INSTALL):
        serve_server(args, lambda _parts, _settings: VlaEval(args.url), default_mapping)


if __name__ == "__main__":
    main()
