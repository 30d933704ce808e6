"""Policy servers that the tests start in threads, with a policy whose chunk is a function of what it is sent.

The messages are written with msgpack alone, so that no code of the package is on both ends.
"""

import asyncio
import threading
from contextlib import contextmanager

import msgpack
import numpy as np
from websockets.asyncio.server import serve

N_ROWS = 10


def chunk(image, state, text, dim=7):
    """Return small actions, `[N_ROWS, dim] f32`, that depend on every pixel, every number and the text."""
    weights = np.arange(1, image.size + 1, dtype=np.uint32).reshape(image.shape)
    seed = int((image * weights).sum(dtype=np.uint64)) + int.from_bytes(state.tobytes(), "little") + len(text)
    return np.random.default_rng(seed).uniform(-0.3, 0.3, (N_ROWS, dim)).astype(np.float32)


def direct(observation):
    """The same policy as a policy function."""
    envs = [(env.cameras["external1_camera"], env.state[:8], env.instruction) for env in observation]
    return [chunk(np.ascontiguousarray(image), state, text, observation.action_dim) for image, state, text in envs]


def pack(message):
    """Return a message in openpi's format."""

    def encode(array):
        fields = {b"__ndarray__": True, b"data": array.tobytes(), b"dtype": array.dtype.str, b"shape": array.shape}
        return fields

    return msgpack.packb(message, default=encode)


def unpack(data):
    def decode(fields):
        if b"__ndarray__" in fields:
            return np.ndarray(fields[b"shape"], np.dtype(fields[b"dtype"]), fields[b"data"])
        return fields

    return msgpack.unpackb(data, object_hook=decode)


class OpenPiServer:
    """A server of openpi's protocol that counts its requests.

    Args:
        metadata: What it says first; None for a server that says nothing.
        behaviour: Function from the number of the request, the connection and the request to the answer: a map, text,
            bytes, or None for none.
    """

    def __init__(self, behaviour, metadata={"robot": "panda"}):
        self.behaviour, self.metadata = behaviour, metadata
        self.n_requests, self.n_connections, self.requests = 0, 0, []

    async def handle(self, connection):
        self.n_connections += 1
        if self.metadata is not None:
            await connection.send(pack(self.metadata))
        async for data in connection:
            self.n_requests += 1
            request = unpack(data)
            self.requests.append(request)
            answer = self.behaviour(self.n_requests, request)
            if answer == "close":
                await connection.close(1011)
            elif isinstance(answer, dict):
                await connection.send(pack(answer))
            elif answer is not None:
                await connection.send(answer)


def openpi_policy(_number, request):
    """The policy behind openpi's protocol."""
    actions = chunk(request["observation/image"], request["observation/state"], request["prompt"])
    return {"actions": actions.astype(np.float64), "server_timing": {"infer_ms": 1.0}}


@contextmanager
def served(server, port=0):
    """Serve `server.handle` in a thread and return the port."""
    ready, loop, ports = threading.Event(), asyncio.new_event_loop(), []
    stop = asyncio.Event()

    async def main():
        async with serve(server.handle, "127.0.0.1", port, compression=None, max_size=None) as listener:
            ports.append(listener.sockets[0].getsockname()[1])
            ready.set()
            await stop.wait()

    thread = threading.Thread(target=lambda: loop.run_until_complete(main()), daemon=True)
    thread.start()
    assert ready.wait(10)
    try:
        yield ports[0]
    finally:
        loop.call_soon_threadsafe(stop.set)
        thread.join(10)


class VlaEvalServer:
    """A server of vla-eval's protocol.

    Args:
        behaviour: Function from an observation to the payload of the ACTION, or to a whole message with a `type`.
    """

    def __init__(self, behaviour, version=1):
        self.behaviour, self.version = behaviour, version
        self.kinds = []

    async def handle(self, connection):
        async for data in connection:
            found = msgpack.unpackb(data, object_hook=decode_strings)
            assert set(found) == {"type", "payload", "seq", "timestamp"}
            self.kinds.append(found["type"])
            answer = {"timestamp": 0.0, "seq": found["seq"], "payload": {"protocol_version": self.version}, "type": "hello"}
            if found["type"] == "observation":
                payload = self.behaviour(found["payload"])
                answer |= payload if "type" in payload else {"type": "action", "payload": payload}
            if found["type"] in ("hello", "observation"):
                await connection.send(msgpack.packb(answer, default=encode_strings))


def encode_strings(array):
    """Return an array in vla-eval's format."""
    return {"__ndarray__": True, "data": array.tobytes(), "dtype": array.dtype.str, "shape": list(array.shape)}


def decode_strings(fields):
    if "__ndarray__" in fields:
        return np.frombuffer(fields["data"], np.dtype(fields["dtype"])).reshape(fields["shape"])
    return fields


def vla_eval_policy(request):
    """The policy behind vla-eval's protocol, with its default keys."""
    image = request["images"]["external1_camera"]
    return {"actions": chunk(image, request["state"][:8], request["task_description"])}


def model_server(**options):
    """Return a model server of the package vla-eval with the same policy, which runs in a thread."""
    from vla_eval.api import serve_background
    from vla_eval.model_servers.predict import PredictModelServer

    class Policy(PredictModelServer):
        def predict(self, obs, ctx):
            return vla_eval_policy(obs)

        def predict_batch(self, obs_batch, ctx_batch):
            return [vla_eval_policy(obs) for obs in obs_batch]

    return serve_background(Policy(**options))
