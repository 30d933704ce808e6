"""Policies in servers: requests, answers that are none, lost connections, command lines.

Needs websockets and msgpack.
"""

import json
import logging
import os
import socket
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip("websockets")
pytest.importorskip("msgpack")

from messages import attached, observation
from policy_servers import OpenPiServer, openpi_policy, served

from hypogeum.host import PolicyLost
from hypogeum.mapping import MappingError
from hypogeum.openpi import EXAMPLE, OpenPi, no_mapping
from hypogeum.servers import policy as policy_module
from hypogeum.servers.answers import ServerError
from hypogeum.servers.command import parse_url, without_credentials
from hypogeum.servers.policy import ServerPolicy
from hypogeum.servers.requests import Requests, read_mapping

MAPPING = {
    "observation/image": "external1",
    "observation/state": ["qpos[0:8]"],
    "prompt": "instruction",
    "extra": {"hand": "hand_camera", "seed": "policy_seed"},
}


def attach(port, settings=None, run=None, connect_s=5):
    """Return a policy that is connected and attached to a run."""
    url = f"ws://127.0.0.1:{port}"
    found = ServerPolicy(OpenPi(url, 2), url, settings or {"mapping": MAPPING}, no_mapping, connect_s)
    found.connect()
    found.on_attach(run or attached())
    return found


def test_request_has_the_mapped_values():
    with served(server := OpenPiServer(openpi_policy)) as port:
        sent = observation(n_envs=3)
        answers = attach(port)(sent)
    assert [np.shape(rows) for rows in answers] == [(10, 7)] * 3 and server.n_connections == 2
    request = min(server.requests, key=lambda request: request["observation/state"][0])
    assert (request["observation/image"] == sent[0].external[0]).all() and request["prompt"] == "lift"
    assert request["observation/state"].dtype == np.float32 and request["observation/state"].tolist() == list(range(8))
    assert (request["extra"]["hand"] == sent[0].hand[0]).all() and request["extra"]["seed"] == 0
    # Each env gets the answer to its own request.
    states = [request["observation/state"][0] for request in server.requests]
    for env, rows in zip(sent, answers):
        found = openpi_policy(0, server.requests[states.index(env.state[0])])["actions"]
        assert (rows == found.astype(np.float32)).all()


ROWS = np.zeros((10, 7))


@pytest.mark.parametrize(
    "answer, words",
    [
        ({"actions": np.zeros((10, 8))}, ["[10, 8] float64, expected [rows, 7]", "add --control-mode pd_joint_pos"]),
        ({"actions": np.zeros((10, 32))}, ["[10, 32]", "pd_ee_delta_pose of a single robot", "serve a policy for this"]),
        ({"actions": np.zeros((0, 7))}, ["[0, 7]"]),
        ({"actions": "none"}, ["[] <U4, expected [rows, 7]"]),
        ({"action": ROWS}, ["answered a map with 'action', expected `actions`"]),
        ("Traceback\n  File x\nKeyError: 'observation/image'\n", ["text instead of actions: KeyError: 'observation/im"]),
        (b"\xc1", ["sent 1 bytes that are no msgpack message"]),
        (b"", ["sent 0 bytes that are no msgpack message"]),
        ({"actions": {b"__ndarray__": True, b"data": b"123", b"dtype": "<f8", b"shape": [1]}}, ["no msgpack message"]),
        ({"actions": {b"__ndarray__": True, b"data": b"1", b"dtype": "|O", b"shape": [1]}}, ["no msgpack message"]),
        ({"actions": {b"__ndarray__": True}}, ["no msgpack message"]),
        ([1, 2], ["answered list, expected a map with `actions`"]),
        (bytes(1 << 25), ["closed the connection", "message too big"]),
        ("close", ["closed the connection", "1011", "a new connection is opened"]),
    ],
)
def test_answer_that_is_none_is_one_sentence(answer, words):
    from policy_servers import pack

    packed = pack(answer) if isinstance(answer, list) else answer
    with served(OpenPiServer(lambda number, request: packed if number == 1 else {"actions": ROWS})) as port:
        found = attach(port)
        with pytest.raises(ServerError) as error:
            found(observation(n_envs=1))
        text = str(error.value)
        assert text.startswith(f"ws://127.0.0.1:{port} ") and "\n" not in text
        assert all(word in text for word in words), text
        # The next observation is answered, on a new connection if need be.
        assert np.shape(found(observation(n_envs=1))) == (1, 10, 7)


def test_action_that_is_not_finite_is_told_once(caplog):
    with served(OpenPiServer(lambda number, request: {"actions": ROWS * np.nan})) as port:
        found = attach(port)
        assert np.isnan(found(observation(n_envs=1))).all() and np.isnan(found(observation(n_envs=1))).all()
    assert sum("not finite; their episodes end with an error" in line for line in caplog.messages) == 1


def shorten(monkeypatch, found, timeout_s, queued_s=policy_module.QUEUED_S):
    """Shorten the time for an answer, less the margin, for a test."""
    found.timeout_s = timeout_s
    monkeypatch.setattr(policy_module, "QUEUED_S", queued_s)
    monkeypatch.setattr(policy_module, "LEAST_S", timeout_s / 2)


def test_silent_server_is_given_up(monkeypatch):
    with served(OpenPiServer(lambda number, request: None)) as port:
        shorten(monkeypatch, found := attach(port), 0.3, queued_s=0)
        for _ in range(2):
            start = time.monotonic()
            with pytest.raises(ServerError, match=r"sent nothing within 0 s; a new connection"):
                found(observation(n_envs=3))
            assert time.monotonic() - start < 1
        with pytest.raises(PolicyLost, match="3 times in a row; look at the server's log"):
            found(observation(n_envs=3))


def test_queued_observation_shares_the_deadline(monkeypatch):
    with served(OpenPiServer(lambda number, request: None)) as port:
        shorten(monkeypatch, found := attach(port), 1)
        start = time.monotonic()
        for words in ("sent nothing within 1 s", "too late for this observation, which waited behind"):
            with pytest.raises(ServerError, match=words):
                found(observation(n_envs=1))
    assert time.monotonic() - start < 1.5


def test_restarted_server_is_found_again(caplog):
    caplog.set_level(logging.INFO)
    with served(OpenPiServer(openpi_policy)) as port:
        found = attach(port)
        assert len(found(observation(n_envs=2))) == 2
    with served(OpenPiServer(openpi_policy), port):
        assert len(found(observation(n_envs=2))) == 2
    assert caplog.text.count("connected to") == caplog.text.count("the server has closed 2 of 2 connections") == 1


def test_server_that_stays_away_is_given_up(monkeypatch, caplog):
    with served(OpenPiServer(openpi_policy)) as port:
        shorten(monkeypatch, found := attach(port), 1, queued_s=0)
        found(observation(n_envs=2))
    with pytest.raises(PolicyLost, match=r"cannot be reached \(.*refused|Connect call failed.*start the server"):
        found(observation(n_envs=2))
    assert "trying again for 1 s" in caplog.text


@pytest.mark.parametrize("metadata, words", [(None, "sent nothing within 1 s"), ("text", "answered text")])
def test_server_without_metadata_is_refused(metadata, words):
    class Mute(OpenPiServer):
        async def handle(self, connection):
            if metadata is not None:
                await connection.send(metadata)
            await connection.wait_closed()

    with served(Mute(None)) as port, pytest.raises(PolicyLost, match=words):
        attach(port, connect_s=1)


@pytest.mark.parametrize(
    "mapping, words",
    [
        ({"a": {"b": "front"}, "c": "hand"}, ["a.b: 'front': a single robot's state has no part", "a single robot has the cameras exter"]),
        ({"state": ["qpos[0:8]"], "prompt": "instruction"}, ["no value is a camera"]),
        ({"a": "hand", "state": ["qpos[0:10]"]}, ["state: ['qpos[0:10]']: 'qpos[0:10]' needs bounds"]),
        ({"a": "hand", "b": 3}, ["b: 3: expected a camera, a list of parts of the state"]),
        ({"a": "hand", "b": []}, ["b: []: expected"]),
        ({"a": "panda1_hand_camera"}, ["no part 'panda1_hand_camera'", "tcp_pose 7, and instruction, policy_seed, query"]),
    ],
)
def test_mapping_without_source_is_refused(mapping, words):
    with pytest.raises(MappingError) as error:
        Requests(mapping, "single")
    assert all(word in str(error.value) for word in words), error.value


def test_openpi_without_mapping_shows_one():
    with pytest.raises(MappingError, match="--mapping FILE") as error:
        no_mapping("single")
    shown = json.loads(str(error.value).split("such as ")[1])
    assert shown == EXAMPLE and len(Requests(shown["mapping"], "single").cameras) == 2


@pytest.mark.parametrize(
    "text, words",
    [
        ('{"mapping": {}, "size": 3}', "unknown keys ['size']"),
        ('{"mapping": "hand"}', "expected an object"),
        ('{"morphology": "triple"}', "`morphology` is 'triple', expected single or bimanual"),
        ('{"mapping": ', "not valid JSON"),
    ],
)
def test_invalid_mapping_file_is_one_sentence(tmp_path, text, words):
    (path := tmp_path / "mapping.json").write_text(text)
    with pytest.raises(MappingError) as error:
        read_mapping(path)
    assert words in str(error.value) and str(path) in str(error.value)


def test_run_that_does_not_fit_is_refused():
    from hypogeum.execution import RunRefused

    with served(OpenPiServer(openpi_policy)) as port:
        with pytest.raises(RunRefused, match="renders no images"):
            attach(port, run=attached(images=False))
        with pytest.raises(RunRefused, match="single and bimanual robots; set `morphology`"):
            attach(port, run=attached(morphologies=("single", "bimanual")))
        settings = {"mapping": {"a": "panda1_hand"}, "morphology": "bimanual"}
        with pytest.raises(RunRefused, match="for a bimanual robot"):
            attach(port, settings=settings)
        found = attach(port, settings={"mapping": MAPPING, "control_mode": "pd_joint_pos"})
        with pytest.raises(MappingError, match="add --control-mode pd_joint_pos to the run"):
            found(observation(n_envs=1))


@pytest.mark.parametrize("url", ["localhost:8000", "http://localhost:8000", "ws://:8000", "ws://u:secret@host:port"])
def test_address_that_is_none_is_refused(url):
    with pytest.raises(MappingError, match="expected ws://HOST:PORT or wss://HOST:PORT") as error:
        parse_url(url, ("ws", "wss"))
    assert "secret" not in str(error.value)
    assert without_credentials("wss://u:secret@host:8000/p?token=secret") == "wss://host:8000/p"


def command(module, *arguments, path=()):
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([*map(str, path), *sys.path])}
    line = [sys.executable, "-m", f"hypogeum.{module}", *arguments]
    return subprocess.run(line, capture_output=True, text=True, env=env, timeout=60, check=False)


@pytest.mark.parametrize("module", ["openpi", "vla_eval"])
def test_command_explains_what_is_missing(module, tmp_path):
    (tmp_path / "websockets.py").write_text("raise ModuleNotFoundError(\"No module named 'websockets'\")\n")
    (mapping := tmp_path / "mapping.json").write_text(json.dumps({"mapping": MAPPING}))
    done = command(module, "ws://localhost:1", "mine", "--mapping", str(mapping), path=[tmp_path])
    extra = module.replace("_", "-")
    expected = f"error: No module named 'websockets'; install what is missing: pip install './python[{extra}]'\n"
    assert (done.returncode, done.stderr) == (1, expected)
    done = command(module, "--help", path=[tmp_path])
    assert done.returncode == 0 and "--mapping FILE" in done.stdout


def test_command_says_why_it_cannot_serve(tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"ws://127.0.0.1:{free.getsockname()[1]}"
    (mapping := tmp_path / "mapping.json").write_text(json.dumps({"mapping": MAPPING}))
    done = command("openpi", url, "mine", "--mapping", str(mapping), "--connect", "0.2")
    assert done.returncode == 1 and done.stderr.startswith(f"error: {url} cannot be reached (")
    done = command("openpi", url, "mine")
    assert done.returncode == 1 and "name them with --mapping FILE, such as {" in done.stderr
    done = command("vla_eval", "localhost", "mine")
    assert (done.returncode, done.stderr.count("\n")) == (1, 1) and "'localhost' is no address" in done.stderr
    done = command("openpi", url, "mine", "--mapping", str(tmp_path / "none"))
    assert done.stderr == f"error: there is no mapping {tmp_path / 'none'}\n"
