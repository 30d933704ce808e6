"""Serve the policy of an openpi server: `python -m hypogeum.openpi ws://HOST:PORT NAME --mapping FILE`.

The server sends its metadata first, then answers each request with a map whose `actions` are `[rows, dim]`, or with
text if it fails. Requests and answers are msgpack with arrays.
"""

import json

from .mapping import MappingError
from .requirements import explained
from .servers.answers import actions_of, receive
from .servers.command import make_parser, serve_server

INSTALL = "pip install './python[openpi]'"
# A request like that of openpi's own example for LIBERO. The keys are those of a training configuration.
EXAMPLE = {
    "mapping": {
        "observation/image": "external1_camera",
        "observation/wrist_image": "hand_camera",
        "observation/state": ["tcp_pose", "qpos[7:8]"],
        "prompt": "instruction",
    }
}


class OpenPi:
    """Connections to an openpi server.

    The server computes one answer at a time, so that several connections keep it busy: while it computes, the next
    requests wait where it reads them. A slot always uses the same connection.

    Args:
        url: Address, `ws://` or `wss://`.
        n_connections: Number of connections at most.
    """

    def __init__(self, url, n_connections):
        from .servers.packing import Packing
        from .servers.sockets import Sockets

        self.packing = Packing(str.encode)
        self.sockets = Sockets(url, self.greet)
        self.n_connections = n_connections

    async def greet(self, connection):
        """Return the server's metadata, its first message."""
        return self.packing.unpack(await receive(connection))

    def prepare(self, requests):
        """Do nothing: this protocol needs to know nothing beforehand."""

    def close(self):
        """Close all connections."""
        self.sockets.close()

    def encode(self, requests, envs):
        """Return one message per request."""
        return [self.packing.pack(request) for request in requests]

    def open(self, slots, deadline):
        """Connect what the slots need, and return the server's metadata."""
        return self.sockets.open({slot % self.n_connections for slot in slots}, deadline)

    def ask(self, slots, messages, deadline):
        """Return the actions for each message."""
        keys = [slot % self.n_connections for slot in slots]
        of = {key: [message for message, its in zip(messages, keys) if its == key] for key in keys}
        answers = self.sockets.talk({key: talk(its) for key, its in of.items()}, deadline)
        left = {key: iter(its) for key, its in answers.items()}
        return [actions_of(self.packing.unpack(next(left[key]))) for key in keys]


def talk(messages):
    """Return a coroutine function that sends messages on a connection and returns their answers."""

    async def exchange(connection):
        answers = []
        for message in messages:
            await connection.send(message)
            answers.append(await receive(connection))
        return answers

    return exchange


def no_mapping(_morphology=None):
    """Raise `MappingError`, because the keys of a checkpoint cannot be guessed."""
    raise MappingError(
        "openpi's servers expect the keys that their checkpoint was trained with; name them with --mapping FILE, such "
        f"as {json.dumps(EXAMPLE)}"
    )


def main(argv=None):
    parser = make_parser("openpi", __doc__, ("ws", "wss"))
    parser.add_argument("--connections", type=int, default=8, metavar="N", help="connections (default: %(default)s)")
    args = parser.parse_args(argv)
    if args.connections < 1:
        parser.error(f"--connections is {args.connections}, expected at least 1")

    def make_server(_parts, settings):
        return OpenPi(args.url, args.connections) if settings.get("mapping") else no_mapping()

    with explained(INSTALL):
        serve_server(args, make_server, no_mapping)


if __name__ == "__main__":
    main()
