"""Serving of LeRobot's policies. Needs lerobot[pi,smolvla,diffusion] and, for real runs, HYPOGEUM set to the binary."""

import gc
import json
import logging
import os
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import weakref
from pathlib import Path

import numpy as np
import pytest

# Nothing here needs a hub, and waiting for one takes a minute.
os.environ.setdefault("HF_HUB_OFFLINE", "1")
torch = pytest.importorskip("torch")
pytest.importorskip("sentencepiece")
pytest.importorskip("diffusers")
pytest.importorskip("lerobot.policies.pi05.modeling_pi05", exc_type=ImportError)

import lerobot_checkpoints as checkpoints  # noqa: E402
import make_pi05_reference as reference  # noqa: E402
from lerobot.policies.diffusion.modeling_diffusion import DiffusionPolicy  # noqa: E402
from lerobot.policies.factory import make_pre_post_processors  # noqa: E402
from messages import attached, message  # noqa: E402
from safetensors.torch import load_file, save_file  # noqa: E402

from hypogeum import Observation  # noqa: E402
from hypogeum.execution import RunRefused  # noqa: E402
from hypogeum.history import HistoryError  # noqa: E402
from hypogeum.layout import MORPHOLOGIES, PAGE_BYTES  # noqa: E402
from hypogeum.lerobot import LeRobotPolicy, sampling  # noqa: E402
from hypogeum.lerobot.live import copy_of  # noqa: E402
from hypogeum.mapping import MappingError  # noqa: E402

HYPOGEUM = os.environ.get("HYPOGEUM")
CASES = Path(__file__).parents[2] / "policy-host/tests/data/pi05"
KINDS = list(checkpoints.KINDS)
STATE = "observation.state"
LIMIT_S = 120


@pytest.fixture(scope="session")
def folders(tmp_path_factory):
    torch.set_num_threads(1)
    made = {}

    def folder(kind):
        if kind not in made:
            made[kind] = checkpoints.KINDS[kind](tmp_path_factory.mktemp("checkpoints") / kind)
        return made[kind]

    return folder


def observe(contents, queries=None, seeds=None, execute=4, steps=None):
    """Return an observation of one env per number in `contents`, on which images and states depend."""
    queries, seeds = queries or [0] * len(contents), seeds or contents
    records = [
        dict(slot=idx, query=query, execute=execute, policy_seed=seed, step=step)
        for idx, (query, seed, step) in enumerate(zip(queries, seeds, steps or queries))
    ]
    header, pages = message(n_envs=len(contents), records=records)
    for idx, content in enumerate(contents):
        random = np.random.default_rng(content)
        block = pages.reshape(len(contents), -1)[idx]
        block[PAGE_BYTES:] = random.integers(0, 256, len(block) - PAGE_BYTES, np.uint8)
        found = Observation(header, pages)
        found.states[idx] = random.uniform(-1, 1, MORPHOLOGIES["single"].state_dim)
    return Observation(header, pages)


@pytest.mark.parametrize("kind", KINDS)
def test_copy_of_a_live_policy_answers_alike(folders, kind):
    policy = LeRobotPolicy(folders(kind))
    policy.policy.config.pretrained_path = folders(kind)
    copy = copy_of(policy.policy, policy.preprocess, policy.postprocess)
    assert np.array_equal(copy(observe([5, 6])), policy(observe([5, 6])))


@pytest.mark.parametrize("kind", KINDS)
def test_chunk_depends_on_own_env_and_seed_only(folders, kind):
    policy, batched = LeRobotPolicy(folders(kind)), LeRobotPolicy(folders(kind), batch=True)
    found = np.stack(policy(observe([5, 6, 7])))
    assert found.shape == (3, policy.config.n_action_steps, 7) and found.dtype == np.float32
    assert np.isfinite(found).all() and found.std() > 0.01
    assert (np.stack(policy(observe([7, 9, 5])))[[2, 0]] == found[[0, 2]]).all()
    assert np.abs(np.stack(batched(observe([5, 6, 7]))) - found).max() < 1e-5
    reseeded = np.stack(policy(observe([5, 6, 7], seeds=[5, 1, 7])))
    assert (reseeded[[0, 2]] == found[[0, 2]]).all() and np.abs(reseeded[1] - found[1]).max() > 1e-3


@pytest.mark.parametrize("name", ["robot", "one_camera", "missing", "padded", "bf16"])
def test_pi05_equals_lerobots_recorded_chunks(name, tmp_path, monkeypatch):
    folder = CASES / name
    if not (folder / "config.json").exists():
        folder = shutil.copytree(CASES / "one_camera", tmp_path / "checkpoint")
        shutil.copytree(CASES / name, folder, dirs_exist_ok=True)
    io = load_file(folder / "io.safetensors")
    inputs = {key.removeprefix("in."): x for key, x in io.items() if key.startswith("in.")}
    inputs = inputs or reference.robot_inputs()
    batch = {key: x.float() / 255 if x.dtype == torch.uint8 else x for key, x in inputs.items()}
    texts = json.loads((folder / "io.json").read_text())["instructions"]
    monkeypatch.setattr(sampling, "draw_noise", lambda seed, query, shape: io["noise"][seed].numpy())
    policy = LeRobotPolicy(folder)
    batch = policy.preprocess(batch | {"task": texts})
    assert (batch["observation.language.tokens"] == io["tokens"]).all()
    chunk = policy.infer([batch], [(idx, 0) for idx in range(len(texts))])
    assert np.abs(chunk - io["actions"].numpy()).max() < 1e-5


@pytest.mark.parametrize("scheduler", ["DDPM", "DDIM"])
@pytest.mark.parametrize("batch", [False, True])
def test_diffusion_queried_every_step_equals_lerobots_loop(tmp_path, scheduler, batch):
    folder = checkpoints.diffusion(tmp_path / "diffusion", noise_scheduler_type=scheduler)
    policy = LeRobotPolicy(folder, batch=batch)
    policy.on_attach(attached(execute=1))
    # The second env starts a new episode at step 6.
    messages = [
        observe([step, 100 + step], [step, step - 6 if step >= 6 else step], seeds=[1, 2], execute=1)
        for step in range(11)
    ]
    found = [[rows[0] for rows in policy(found)] for found in messages]
    for env_idx, starts in enumerate([[0], [0, 6]]):
        theirs = DiffusionPolicy.from_pretrained(folder)
        preprocess, postprocess = make_pre_post_processors(theirs.config, pretrained_path=str(folder))
        for step, sent in enumerate(messages):
            if step in starts:
                theirs.reset()
            batch_of_one = preprocess(policy.batch(sent, slice(env_idx, env_idx + 1)))
            with sampling.drawing_from(theirs.diffusion, [(sent.policy_seeds[env_idx], sent.queries[env_idx])]):
                action = postprocess(theirs.select_action(batch_of_one))[0].numpy()
            assert np.abs(found[step][env_idx] - action).max() < (1e-5 if batch else 1e-7), (step, env_idx)


def test_diffusion_queried_rarely_receives_queried_observations(folders, caplog):
    policy = LeRobotPolicy(folders("diffusion"))
    with pytest.raises(
        RunRefused, match="n_obs_steps is 3, .* only every 30 control steps; add --execute 1 to the run"
    ):
        policy.on_attach(attached())
    with caplog.at_level(logging.INFO, "hypogeum"):
        policy.on_attach(attached(execute=4))
    assert "executes 4 of 4 rows per query" in caplog.text and "3 observations, which are that far apart" in caplog.text
    chunks = [policy(observe([content], [query]))[0] for query, content in enumerate([1, 2, 3, 4])]
    assert [len(chunk) for chunk in chunks] == [4] * 4
    fed = [step[STATE] for step in policy.memory.observations(0)]
    single = [policy.preprocess(policy.batch(observe([content]), slice(0, 1)))[STATE] for content in (2, 3, 4)]
    assert all((x == y).all() for x, y in zip(fed, single))
    with pytest.raises(HistoryError, match="slot 0: query is 9, expected 4, or 0 for a new episode"):
        policy(observe([1], [9]))
    # In ensemble mode every query needs a whole chunk.
    policy.on_attach(attached(mode="ensemble"))
    assert [len(policy(observe([1], [query]))[0]) for query in range(3)] == [4] * 3


@pytest.mark.parametrize("kind", KINDS)
def test_observations_are_neither_copied_nor_retained(folders, kind):
    policy = LeRobotPolicy(folders(kind))
    found = observe([1, 2])
    state = policy.batch(found, slice(0, 2))[STATE]
    assert state.data_ptr() == found.states.__array_interface__["data"][0] and state.shape == (2, 25)
    policy(found)
    pages = weakref.ref(found.states.base)
    del found, state
    gc.collect()
    assert pages() is None


def test_tokenizer_json_equals_the_sentencepiece_model(folders):
    from hypogeum.tokenizer import Tokenizer, read_tokenizer

    vlm = folders("smolvla") / "vlm"
    ours, length = read_tokenizer(vlm), 12
    theirs = checkpoints.PreTrainedTokenizerFast.from_pretrained(vlm)
    texts = ["lift", "raise the cube\n"]
    for padding in ("longest", "max_length"):
        options = dict(max_length=length, padding=padding, truncation=True)
        expected = theirs(texts, padding_side="right", return_tensors="pt", **options)
        found = ours(texts, **options)
        assert (found["attention_mask"] == expected["attention_mask"]).all()
        assert (found["input_ids"] * found["attention_mask"] == expected["input_ids"] * found["attention_mask"]).all()
    pieces = Tokenizer.from_sentencepiece(reference.train_tokenizer())
    found = pieces(["lift" * 50, ""], max_length=5)
    assert found["input_ids"][:, 0].tolist() == [2, 2] and found["attention_mask"].sum(1).tolist() == [5, 1]


def rewrite(path, **values):
    path.write_text(json.dumps(json.loads(path.read_text()) | values))


def drop_tensor(folder):
    tensors = load_file(folder / "model.safetensors")
    del tensors["model.action_in_proj.bias"]
    save_file(tensors, folder / "model.safetensors")


def shorten_tensor(folder):
    tensors = load_file(folder / "model.safetensors")
    tensors["model.action_in_proj.bias"] = torch.zeros(3)
    save_file(tensors, folder / "model.safetensors")


def enlarge_vocabulary(folder):
    tensors = load_file(folder / "model.safetensors")
    for name in tensors:
        if name.endswith(("embed_tokens.weight", "lm_head.weight")):
            tensors[name] = tensors[name][:300].clone()
    save_file(tensors, folder / "model.safetensors")


INVALID = {
    "weights": (lambda folder: (folder / "model.safetensors").unlink(), "has neither model.safetensors nor"),
    "config": (lambda folder: (folder / "config.json").write_text("{}"), "LeRobot cannot read"),
    "processor": (lambda folder: (folder / "policy_preprocessor.json").unlink(), "has no policy_preprocessor.json"),
    "tensor": (drop_tensor, "lacks model.action_in_proj.bias"),
    "shape": (shorten_tensor, "size mismatch for model.action_in_proj.bias"),
    "damaged": (lambda folder: (folder / "model.safetensors").write_bytes(b"12"), "is not a safetensors file"),
    "vocabulary": (enlarge_vocabulary, "tokens, the network's embedding has 300 entries"),
    "tokenizer": (lambda folder: (folder / "tokenizer.model").write_bytes(b"x"), "tokenizer.model is not a vocabulary"),
    "no tokenizer": (
        lambda folder: (folder / "tokenizer.model").unlink(),
        "copy its tokenizer.model or tokenizer.json",
    ),
    "heads": (lambda folder: (folder / "hypogeum.json").unlink(), "has width 24, which 16 heads do not divide"),
    "prompt": (lambda folder: rewrite(folder / "hypogeum.json", prompt_state="long"), "`prompt_state` is 'long'"),
}


@pytest.mark.parametrize("case", INVALID)
def test_invalid_checkpoint_is_described(folders, tmp_path, case):
    damage, words = INVALID[case]
    folder = shutil.copytree(folders("pi05"), tmp_path / "checkpoint")
    damage(folder)
    with pytest.raises(MappingError) as error:
        LeRobotPolicy(folder)
    assert words in str(error.value)


def test_options_that_do_not_fit_are_rejected(folders, tmp_path, monkeypatch):
    with pytest.raises(MappingError, match="device 'abacus' cannot be used"):
        LeRobotPolicy(folders("pi05"), device="abacus")
    other = shutil.copytree(folders("smolvla"), tmp_path / "other")
    (other / "hypogeum.json").write_text('{"prompt_state": "padded"}')
    with pytest.raises(MappingError, match="applies to type 'pi05'"):
        LeRobotPolicy(other)
    rewrite(other / "config.json", vlm_model_name="nobody/nothing")
    (other / "hypogeum.json").unlink()
    with pytest.raises(MappingError, match='set `vlm_model_name` in config.json to "vlm"'):
        LeRobotPolicy(other)
    monkeypatch.setattr("hypogeum.lerobot.policy.BATCHABLE", ("act",))
    with pytest.raises(MappingError, match="type 'pi05' cannot be batched, expected act"):
        LeRobotPolicy(folders("pi05"), batch=True)


@pytest.mark.skipif(not HYPOGEUM, reason="HYPOGEUM is not set to the binary")
class TestRun:
    @pytest.fixture
    def play(self):
        """Run two episodes of a policy, and return the executed actions and the host's output."""
        # Short enough for sockets.
        folder = Path(tempfile.mkdtemp(prefix="hyp"))
        children = []
        env = {**os.environ, "XDG_RUNTIME_DIR": str(folder), "PYTHONPATH": os.pathsep.join(sys.path)}

        def start(command):
            pipes = dict(stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            children.append(subprocess.Popen(command, cwd=folder, env=env, **pipes))
            return children[-1]

        def play(policy, checkpoint, execute, *options):
            host = None
            if policy == "attach:mine":
                host = start([sys.executable, "-m", "hypogeum.lerobot", "mine", checkpoint, "--threads", "1", *options])
            results = folder / f"{len(children)}.db"
            run = f"run --tasks RaiseCube --episodes 2 --keep-actions --execute {execute} --policy p={policy}"
            child = start([HYPOGEUM, *run.split(), "--db", results])
            _, err = child.communicate(timeout=LIMIT_S)
            assert child.returncode == 0, err
            log = host.communicate(timeout=LIMIT_S) if host else ("", "")
            with sqlite3.connect(results) as found:
                rows = found.execute("select error, actions from episodes order by episode").fetchall()
            assert [error for error, _ in rows] == [None, None]
            return [np.frombuffer(actions[:-8], "<f4").reshape(-1, 7) for _, actions in rows], "".join(log)

        yield play
        for child in children:
            child.kill()
            child.communicate()
        shutil.rmtree(folder)

    @pytest.mark.parametrize("kind", KINDS)
    def test_policies_of_every_kind_are_served(self, folders, play, kind):
        _, log = play("attach:mine", folders(kind), 4, "--batch")
        assert "failed=0" in log and "keep copies" not in log
        assert ("which are that far apart" in log) == (kind == "diffusion")
        if kind == "diffusion":
            _, log = play("attach:mine", folders(kind), 1)
            assert "failed=0" in log and "observes every control step" in log

    def test_pi05_equals_the_built_in_one(self, play):
        checkpoint = CASES / "robot"
        ours, log = play("attach:mine", checkpoint, 10)
        assert "state unpadded in the prompt" in log
        built_in, _ = play(f"pi05:{checkpoint}", checkpoint, 10)
        # Later chunks depend on what the first one did.
        assert all(np.abs(x[:10] - y[:10]).max() < 1e-4 for x, y in zip(ours, built_in))
