"""Policies in LeRobot's own server for async inference.

Needs lerobot[async] and, for a run, HYPOGEUM set to the binary.
"""

import os
from concurrent import futures

import pytest

os.environ.setdefault("HF_HUB_OFFLINE", "1")
torch = pytest.importorskip("torch")
grpc = pytest.importorskip("grpc")
pytest.importorskip("lerobot.policies.act.modeling_act", exc_type=ImportError)

from messages import attached, observation  # noqa: E402

from hypogeum.host import PolicyLost  # noqa: E402
from hypogeum.lerobot import LeRobotPolicy  # noqa: E402
from hypogeum.lerobot_async import LeRobotAsync, check_mapping, default_mapping, main, read_config  # noqa: E402
from hypogeum.mapping import MappingError  # noqa: E402
from hypogeum.servers.answers import ServerError  # noqa: E402
from hypogeum.servers.policy import ServerPolicy  # noqa: E402

N_ROWS = 6


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    """Folder of an ACT with random weights that sees an external camera and joint positions."""
    from lerobot.configs.types import FeatureType, PolicyFeature
    from lerobot.policies.act.configuration_act import ACTConfig
    from lerobot.policies.act.modeling_act import ACTPolicy
    from lerobot.policies.factory import make_pre_post_processors

    torch.set_num_threads(1)
    torch.manual_seed(3)
    shapes = {"observation.images.external1": (3, 224, 224), "observation.state": (9,), "action": (7,)}
    kinds = (FeatureType.VISUAL, FeatureType.STATE, FeatureType.ACTION)
    features = {name: PolicyFeature(kind, shape) for (name, shape), kind in zip(shapes.items(), kinds)}
    actions = {"action": features.pop("action")}
    config = ACTConfig(
        input_features=features, output_features=actions, chunk_size=N_ROWS, n_action_steps=N_ROWS, dim_model=16,
        n_heads=2, dim_feedforward=32, n_encoder_layers=1, use_vae=False, pretrained_backbone_weights=None, device="cpu",
    )  # fmt: skip
    stats = {}
    for name, shape in shapes.items():
        shape = (3, 1, 1) if len(shape) == 3 else shape
        stats[name] = dict(mean=torch.full(shape, 0.1), std=torch.full(shape, 0.3))
    folder = tmp_path_factory.mktemp("checkpoints") / "act"
    ACTPolicy(config).save_pretrained(folder)
    for processor in make_pre_post_processors(config, dataset_stats=stats):
        processor.save_pretrained(folder)
    return folder


@pytest.fixture
def server(tmp_path, monkeypatch):
    """Address of a policy server of LeRobot in this process."""
    # It writes logs to the current folder when it is imported.
    monkeypatch.chdir(tmp_path)
    from lerobot.async_inference.configs import PolicyServerConfig
    from lerobot.async_inference.policy_server import PolicyServer
    from lerobot.transport import services_pb2_grpc

    listener = grpc.server(futures.ThreadPoolExecutor(max_workers=4))
    policy_server = PolicyServer(PolicyServerConfig(host="127.0.0.1", inference_latency=0.0))
    services_pb2_grpc.add_AsyncInferenceServicer_to_server(policy_server, listener)
    port = listener.add_insecure_port("127.0.0.1:0")
    listener.start()
    yield f"127.0.0.1:{port}"
    listener.stop(0).wait(10)


def attach(address, checkpoint, settings=None, connect_s=30):
    config = read_config(checkpoint)
    client = LeRobotAsync(address, str(checkpoint), config.get("type", "act"), "cpu")
    found = ServerPolicy(client, address, settings or {}, lambda robot: default_mapping(config, robot), connect_s)
    found.connect()
    found.on_attach(attached())
    return found


def test_answers_are_those_of_the_policy(checkpoint, server):
    found, direct = attach(server, checkpoint), LeRobotPolicy(checkpoint)
    for query in range(2):
        sent = observation(n_envs=3, records=[{"query": query}] * 3)
        for ours, theirs in zip(found(sent), direct(sent)):
            assert ours.shape == (N_ROWS, 7) and (ours == theirs).all()


def test_failure_of_the_policy_is_one_sentence(checkpoint, server):
    settings = {"mapping": {"observation.images.other": "hand", "observation.state": ["qpos"]}}
    with pytest.raises(ServerError, match="answered nothing, as LeRobot's server does when its policy fails"):
        attach(server, checkpoint, settings)(observation(n_envs=1))


def test_checkpoint_that_the_server_lacks_is_one_sentence(server, tmp_path):
    with pytest.raises(PolicyLost, match="failed \\(UNKNOWN: .*; start the server") as error:
        attach(server, tmp_path / "none")
    assert "\n" not in str(error.value)


def test_server_that_is_not_there_is_one_sentence(checkpoint):
    with pytest.raises(PolicyLost, match="127.0.0.1:1 cannot be reached"):
        attach("127.0.0.1:1", checkpoint, connect_s=0.5)


def test_mapping_has_the_features_of_the_checkpoint(checkpoint):
    found = default_mapping(read_config(checkpoint), "single")
    assert found == {"observation.images.external1": "external1", "observation.state": ["qpos"]}
    assert list(default_mapping({}, "bimanual")) == [
        *(f"observation.images.{name}" for name in ("external1", "external2", "panda1_hand", "panda2_hand")),
        "observation.state",
    ]
    with pytest.raises(MappingError, match="prompt: LeRobot's server takes observation.images.NAME"):
        check_mapping({"mapping": {"prompt": "instruction"}})


@pytest.mark.parametrize("kind", [None, "diffusion"])
def test_policy_with_a_memory_is_refused(kind, tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["grpc://localhost:1", "mine", "--checkpoint", str(tmp_path), *(["--type", kind] if kind else [])])
    assert "--type" in capsys.readouterr().err


@pytest.mark.skipif("HYPOGEUM" not in os.environ, reason="HYPOGEUM is not set to the binary")
def test_run_gives_the_rows_of_the_policy(checkpoint, server):
    from test_servers_run import finish, trial

    rows = []
    lines = (
        ["-m", "hypogeum.lerobot", "mine", checkpoint, "--threads", "1"],
        ["-m", "hypogeum.lerobot_async", f"grpc://{server}", "mine", "--checkpoint", checkpoint],
    )
    for line in lines:
        with trial("--execute", str(N_ROWS)) as run:
            host = run.host(*line)
            code, _, err = finish(run.process)
            assert code == 0, err + finish(host)[2]
            assert finish(host)[0] == 0
            rows.append(run.rows())
    assert rows[0] == rows[1] and len(rows[0]) == 10
