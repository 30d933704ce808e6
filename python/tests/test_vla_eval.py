"""Policies in vla-eval's model servers. Those of the package itself are tested where it is installed."""

import numpy as np
import pytest

pytest.importorskip("websockets")
pytest.importorskip("msgpack")

from messages import attached, observation
from policy_servers import VlaEvalServer, direct, model_server, served, vla_eval_policy

from hypogeum.host import PolicyLost
from hypogeum.servers.answers import ServerError
from hypogeum.servers.policy import ServerPolicy
from hypogeum.vla_eval import VlaEval, default_mapping


def attach(port, settings=None):
    """Return a policy that is connected and attached to a run."""
    url = f"ws://127.0.0.1:{port}"
    found = ServerPolicy(VlaEval(url), url, settings or {}, default_mapping, 5)
    found.connect()
    found.on_attach(attached())
    return found


def test_each_slot_has_a_connection_and_episodes():
    with served(server := VlaEvalServer(vla_eval_policy)) as port:
        found = attach(port)
        sent = [observation(n_envs=2, records=[{"query": query}] * 2) for query in (0, 1, 0)]
        for message in sent:
            assert [(ours == theirs).all() for ours, theirs in zip(found(message), direct(message))] == [True, True]
    kinds = ["hello"] * 2 + 2 * (["episode_start", "observation"] + ["observation"] + ["episode_end"])
    assert sorted(server.kinds) == sorted(kinds + 2 * ["episode_start", "observation"])


@pytest.mark.parametrize(
    "answer, words",
    [
        ({"type": "error", "payload": {"error": "observation_failed: KeyError"}}, "answered an error: {'error': 'obs"),
        ({"type": "hello"}, "sent a message of type 'hello', expected 'action'"),
        ({"type": "action", "payload": {"actions": np.zeros(7)}, "seq": 0}, "answered message 0, expected"),
        ({"type": "action", "payload": [1.0]}, "sent a message of type 'action'"),
        ({"action": np.zeros(7)}, "answered a map with 'action', expected `actions`"),
        ({"actions": np.zeros(6)}, "answered actions [1, 6] float64, expected [rows, 7]"),
    ],
)
def test_answer_that_is_none_is_one_sentence(answer, words):
    with served(VlaEvalServer(lambda request: answer)) as port, pytest.raises(ServerError) as error:
        attach(port)(observation(n_envs=2))
    assert words in str(error.value) and "\n" not in str(error.value)


def test_episode_does_not_go_on_elsewhere():
    with served(VlaEvalServer(vla_eval_policy)) as port, pytest.raises(ServerError, match="episode in slot 1, which beg"):
        attach(port)(observation(n_envs=2, records=[{}, {"query": 4}]))


def test_other_version_is_refused():
    with served(VlaEvalServer(vla_eval_policy, version=2)) as port:
        with pytest.raises(PolicyLost, match="speaks version 2 of vla-eval's protocol, expected 1"):
            attach(port)


def test_single_rows_are_told(caplog):
    with served(VlaEvalServer(lambda request: {"actions": np.zeros(7)})) as port:
        assert np.shape(attach(port)(observation())) == (2, 1, 7)
    assert "answers a single row to each query; --execute 1" in caplog.text


class TestServerOfThePackage:
    """Model servers of the package vla-eval."""

    @pytest.fixture(autouse=True)
    def package(self):
        pytest.importorskip("vla_eval")

    @pytest.mark.parametrize("options", [{}, {"max_batch_size": 4}])
    def test_answers_are_those_of_its_policy(self, options):
        with model_server(**options) as server:
            found, sent = attach(server.port), observation(n_envs=3)
            assert all((ours == theirs).all() for ours, theirs in zip(found(sent), direct(sent)))

    def test_chunk_is_buffered_per_slot(self):
        with model_server(chunk_size=10) as server:
            found = attach(server.port)
            first = observation(n_envs=2)
            rows = [found(first)] + [found(observation(n_envs=2, records=[{"query": 1}] * 2)) for _ in range(9)]
            assert (np.concatenate(rows, axis=1) == np.stack(direct(first))).all()

    def test_failure_is_one_sentence(self):
        with model_server() as server:
            found = attach(server.port, {"mapping": {"image": "hand"}})
            with pytest.raises(ServerError, match="answered an error: .*observation_failed: KeyError"):
                found(observation(n_envs=1))
