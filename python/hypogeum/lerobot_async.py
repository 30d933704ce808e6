"""Serve the policy of LeRobot's async inference: `python -m hypogeum.lerobot_async grpc://HOST:PORT NAME ...`.

Both sides unpickle what the other one sends, so that each can run any code on the other: only for hosts that trust each
other. The server loads a checkpoint, a folder on its machine or a name on the hub, and answers one observation at a
time.
"""

import itertools
import json
import pickle
import time
from pathlib import Path

from .layout import MAX_HORIZON
from .lerobot.kinds import CURRENT
from .mapping import IMAGES, STATE, MappingError, default_parts
from .requirements import explained
from .robot import CAMERAS, STATE_PARTS
from .servers.answers import ConnectionLost, ServerError
from .servers.command import make_parser, serve_server

INSTALL = "pip install './python[lerobot-async]'"
# Key of the instruction in LeRobot's observations.
TASK = "task"


class LeRobotAsync:
    """Connection to LeRobot's policy server.

    Args:
        address: `HOST:PORT`.
        checkpoint: Folder or name on the hub, for the server.
        kind: LeRobot's type of the policy.
        device: Torch device, for the server.
    """

    def __init__(self, address, checkpoint, kind, device):
        # LeRobot's server unpickles its own classes.
        from lerobot.async_inference import helpers
        from lerobot.transport import services_pb2, services_pb2_grpc

        self.helpers, self.messages, self.services = helpers, services_pb2, services_pb2_grpc
        self.address, self.checkpoint, self.kind, self.device = address, checkpoint, kind, device
        self.timesteps = itertools.count()
        self.features = None
        self.channel = self.stub = None

    def prepare(self, requests):
        """Note the features of a run's observations, with which the server loads the policy anew."""
        self.features = {name: feature_of(name, source) for name, source in requests.sources.items()}
        self.stub = None

    def encode(self, requests, envs):
        """Return one observation per request, each with its time step."""
        return [self.observation(request, env) for request, env in zip(requests, envs)]

    def observation(self, request, env):
        """Return a time step and the observation with it, pickled."""
        timestep, values = next(self.timesteps), {TASK: env.instruction}
        for name, value in request.items():
            if name.startswith(IMAGES):
                values[name.removeprefix(IMAGES)] = value
            else:
                values |= {entry: float(number) for entry, number in zip(names_of(name, len(value)), value)}
        # `must_go`: the server skips what resembles its last observation, even one of another episode.
        timed = self.helpers.TimedObservation(time.time(), timestep, observation=values, must_go=True)
        return timestep, pickle.dumps(timed)

    def open(self, slots, deadline):
        """Connect, and let the server load the policy once the features of a run are known."""
        import grpc
        from lerobot.transport.utils import grpc_channel_options

        if self.channel is None:
            self.channel = grpc.insecure_channel(self.address, grpc_channel_options())
            try:
                grpc.channel_ready_future(self.channel).result(timeout=left(deadline))
            except grpc.FutureTimeoutError:
                self.close()
                raise ConnectionLost("cannot be reached") from None
        if self.stub is None and self.features is not None:
            self.stub = self.services.AsyncInferenceStub(self.channel)
            config = self.helpers.RemotePolicyConfig(
                self.kind, self.checkpoint, self.features, MAX_HORIZON, self.device
            )
            self.call(self.stub.Ready, self.messages.Empty(), deadline)
            setup = self.messages.PolicySetup(data=pickle.dumps(config))
            self.call(self.stub.SendPolicyInstructions, setup, deadline)
        return None

    def ask(self, slots, messages, deadline):
        """Return the actions for each message."""
        return [self.actions(*message, deadline) for message in messages]

    def actions(self, timestep, data, deadline):
        """Return the actions for an observation."""
        from lerobot.transport.utils import send_bytes_in_chunks

        pieces = send_bytes_in_chunks(data, self.messages.Observation, silent=True)
        self.call(self.stub.SendObservations, pieces, deadline)
        reply = self.call(self.stub.GetActions, self.messages.Empty(), deadline)
        if not reply.data:
            raise ServerError("answered nothing, as LeRobot's server does when its policy fails; its log says why")
        actions = pickle.loads(reply.data)
        if not actions or actions[0].get_timestep() != timestep:
            raise ServerError("answered an observation of another client; it serves one at a time")
        return [action.get_action().float().numpy() for action in actions]

    def call(self, method, request, deadline):
        """Return the reply to a remote call, or raise `ConnectionLost`."""
        import grpc

        try:
            return method(request, timeout=left(deadline))
        except grpc.RpcError as error:
            self.close()
            raise ConnectionLost(f"failed ({error.code().name}: {str(error.details())[:300]})") from error

    def close(self):
        """Close the connection, so that the next observation opens another one."""
        if self.channel is not None:
            self.channel.close()
        self.channel = self.stub = None


def left(deadline):
    """Return the seconds until a deadline, as a timeout."""
    return max(deadline - time.monotonic(), 0.001)


def names_of(feature, width):
    """Return names for the entries of a vector, which LeRobot's robots name one by one."""
    return [f"{feature}.{idx}" for idx in range(width)]


def feature_of(name, source):
    """Return the description of a feature with a resolved source, as in LeRobot's datasets."""
    if name.startswith(IMAGES):
        # The server does not read the size of images.
        return {"dtype": "image", "shape": (), "names": ["height", "width", "channels"]}
    names = names_of(name, sum(part.stop - part.start for part in source))
    return {"dtype": "float32", "shape": (len(names),), "names": names}


def read_config(checkpoint):
    """Return the `config.json` of a checkpoint, or an empty dict if it is on another machine."""
    path = Path(checkpoint).expanduser() / "config.json"
    return json.loads(path.read_text()) if path.is_file() else {}


def default_mapping(config, morphology):
    """Return the mapping by the names and widths of a checkpoint's features, or else of those in our datasets."""
    features = config.get("input_features")
    if features is None:
        images = {IMAGES + camera.removesuffix("_camera"): camera for camera in CAMERAS[morphology]}
        return images | {STATE: [part for part, _ in STATE_PARTS[morphology]]}
    sources = {}
    for name, feature in features.items():
        is_state = feature["type"] == "STATE"
        sources[name] = default_parts(morphology, feature["shape"][0]) if is_state else name.removeprefix(IMAGES)
    return sources


def check_mapping(settings):
    """Raise `MappingError` for a request that LeRobot's server does not take."""
    for name, source in settings.get("mapping", {}).items():
        if isinstance(source, dict) or not (name.startswith(IMAGES) or name == STATE):
            raise MappingError(
                f"{name}: LeRobot's server takes {IMAGES}NAME and {STATE}; the instruction is always sent"
            )


def main(argv=None):
    parser = make_parser("lerobot_async", __doc__, ("grpc",))
    checkpoint = "what the server loads: a folder on its machine, or a name on the hub"
    parser.add_argument("--checkpoint", required=True, metavar="PATH", help=checkpoint)
    parser.add_argument("--type", metavar="TYPE", help="LeRobot's type of the policy, such as act")
    parser.add_argument("--device", default="cpu", help="torch device of the server (default: cpu)")
    args = parser.parse_args(argv)
    config = read_config(args.checkpoint)
    kind = args.type or config.get("type")
    if kind not in CURRENT:
        parser.error(
            f"the checkpoint's type is {kind!r}; set --type to one of {', '.join(sorted(CURRENT))}, whose chunks "
            "depend on the current observation alone"
        )

    def make_server(parts, settings):
        check_mapping(settings)
        return LeRobotAsync(f"{parts.hostname}:{parts.port}", args.checkpoint, kind, args.device)

    with explained(INSTALL):
        serve_server(args, make_server, lambda morphology: default_mapping(config, morphology))


if __name__ == "__main__":
    main()
