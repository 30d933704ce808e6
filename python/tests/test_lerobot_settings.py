"""Settings of LeRobot's checkpoints: honoured as in LeRobot's own loop, or announced.

Needs what `test_lerobot` needs, and for one of the tests peft.
"""

import logging
import os
from contextlib import nullcontext

import numpy as np
import pytest

os.environ.setdefault("HF_HUB_OFFLINE", "1")
torch = pytest.importorskip("torch")
pytest.importorskip("sentencepiece")
pytest.importorskip("diffusers")
pytest.importorskip("lerobot.policies.pi05.modeling_pi05", exc_type=ImportError)

import lerobot_checkpoints as checkpoints  # noqa: E402
from lerobot.configs.types import FeatureType, PolicyFeature  # noqa: E402
from lerobot.policies.act.modeling_act import ACTPolicy  # noqa: E402
from lerobot.policies.factory import make_pre_post_processors  # noqa: E402
from lerobot_checkpoints import change_statistics, configure, configure_step, rewrite, setting  # noqa: E402
from messages import attached, message  # noqa: E402
from safetensors.torch import load_file, save_file  # noqa: E402
from test_lerobot import observe  # noqa: E402

from hypogeum import Observation, TemporalEnsemble  # noqa: E402
from hypogeum.backbone import resnet18_of, width_of  # noqa: E402
from hypogeum.execution import RunRefused  # noqa: E402
from hypogeum.images import to_network  # noqa: E402
from hypogeum.language import hashed_embedding  # noqa: E402
from hypogeum.lerobot import LeRobotPolicy  # noqa: E402
from hypogeum.mapping import MappingError  # noqa: E402

EXTERNAL, HAND, STATE = "observation.images.external1", checkpoints.HAND, checkpoints.STATE
ENVIRONMENT = "observation.environment_state"
CAMERAS = {EXTERNAL: "external1_camera", HAND: "hand_camera"}
PRE, POST = "policy_preprocessor", "policy_postprocessor"
N_STEPS = 11


def lerobots_rows(folder):
    """Return the rows that LeRobot's own loop executes for observations 0, 1, … of an episode."""
    with resnet18_of(width_of(folder)):
        policy = ACTPolicy.from_pretrained(folder)
    preprocess, postprocess = make_pre_post_processors(policy.config, pretrained_path=str(folder))
    policy.reset()
    rows = []
    for step in range(N_STEPS):
        sent = observe([step])
        batch = {name: to_network(sent.cameras[camera], 64, 64) for name, camera in CAMERAS.items()}
        batch |= {STATE: torch.from_numpy(sent.states.copy()), "task": sent.instructions}
        with torch.inference_mode(), torch.autocast("cpu") if policy.config.use_amp else nullcontext():
            rows.append(postprocess(policy.select_action(preprocess(batch)))[0].float().numpy())
    return np.array(rows)


def executed_rows(folder, run):
    """Return the rows that a run executes for the same observations, querying a host when its last answer ends."""
    policy = LeRobotPolicy(folder)
    policy.on_attach(run)
    coeff = policy.config.temporal_ensemble_coeff
    fn = TemporalEnsemble(policy, coeff) if run.mode == "ensemble" else policy
    rows, query = [], 0
    while len(rows) < N_STEPS:
        found = observe([len(rows)], [query], execute=run.execute, steps=[len(rows)])
        rows.extend(fn(found)[0][: run.execute])
        query += 1
    return np.array(rows[:N_STEPS])


def swap_cameras(folder):
    swap = {EXTERNAL: HAND, HAND: EXTERNAL}
    configure_step(folder, PRE, "rename_observations_processor", lambda step: step["config"].update(rename_map=swap))


EXECUTED = {
    "all rows of a chunk": (lambda folder: configure(folder, n_action_steps=8), {}),
    "half of a chunk": (lambda folder: None, {}),
    "a single row": (lambda folder: configure(folder, n_action_steps=1), {}),
    "ensemble": (
        lambda folder: configure(folder, n_action_steps=1, temporal_ensemble_coeff=0.3), dict(mode="ensemble"),
    ),
    "swapped cameras": (swap_cameras, {}),
    "mixed precision": (lambda folder: configure(folder, use_amp=True), {}),
}  # fmt: skip


@pytest.mark.parametrize("case", EXECUTED)
def test_executed_rows_equal_those_of_lerobots_loop(copy, case):
    change, options = EXECUTED[case]
    before = lerobots_rows(copy)
    change(copy)
    expected = lerobots_rows(copy)
    assert np.abs(executed_rows(copy, attached(**options)) - expected).max() < 1e-5
    assert case == "half of a chunk" or np.abs(expected - before).max() > 1e-4


def test_differing_execution_is_refused_or_announced(copy, caplog):
    configure(copy, n_action_steps=1, temporal_ensemble_coeff=0.3)
    with pytest.raises(RunRefused, match="temporal_ensemble_coeff is 0.3, .* add --mode ensemble to the run"):
        LeRobotPolicy(copy).on_attach(attached())
    with caplog.at_level(logging.INFO, "hypogeum"):
        policy = LeRobotPolicy(copy)
        policy.on_attach(attached(execute=5))
    assert len(policy(observe([1]))[0]) == 8
    assert (
        "act executes 5 of 8 rows per query (--execute; its own temporal_ensemble_coeff of 0.3 is not used)"
        in caplog.text
    )


def test_run_for_another_robot_is_refused(act):
    policy = LeRobotPolicy(act)
    for run, words in (
        (attached(morphologies=("bimanual",)), "is for a single robot, the run has no task for one; choose --tasks"),
        (attached(images=False), "needs images, but the run renders none"),
    ):
        with pytest.raises(RunRefused, match=words):
            policy.on_attach(run)
    with pytest.raises(MappingError, match="add --control-mode pd_ee_delta_pose to the run"):
        policy(Observation(*message(control_mode=1)))


def test_complete_rename_map_is_the_mapping(copy):
    expected = executed_rows(copy, attached())
    base, wrist = "observation.images.base", "observation.images.wrist"
    names = {EXTERNAL: base, HAND: wrist}

    def rename(features):
        return {names.get(name, name): feature for name, feature in features.items()}

    rewrite(copy / "config.json", lambda contents: contents.update(input_features=rename(contents["input_features"])))
    for processor, name in ((PRE, "normalizer_processor"), (POST, "unnormalizer_processor")):
        configure_step(
            copy, processor, name, lambda step: step["config"].update(features=rename(step["config"]["features"]))
        )
        for path in copy.glob(f"{processor}_step_*"):
            tensors = load_file(path)
            for old, new in names.items():
                tensors = {key.replace(old, new): tensor for key, tensor in tensors.items()}
            save_file(tensors, path)
    with pytest.raises(MappingError, match="there is no camera 'base' or 'base_camera'"):
        LeRobotPolicy(copy)
    configure_step(copy, PRE, "rename_observations_processor", lambda step: step["config"].update(rename_map=names))
    assert (executed_rows(copy, attached()) == expected).all()


def test_ignored_key_is_announced(copy, caplog):
    expected = executed_rows(copy, attached())
    configure(copy, novelty=3)
    setting(ignore=["novelty", "typo"])(copy)
    with caplog.at_level(logging.INFO, "hypogeum"):
        assert (executed_rows(copy, attached()) == expected).all()
    assert "novelty of config.json is ignored, as hypogeum.json says: 3" in caplog.text
    assert "typo in `ignore` of hypogeum.json has no effect" in caplog.text


def test_settings_that_are_not_used_are_announced(tmp_path, caplog):
    folder = checkpoints.diffusion(tmp_path / "diffusion", compile_model=True)
    configure(folder, device="cuda")
    with caplog.at_level(logging.INFO, "hypogeum"):
        LeRobotPolicy(folder)
    assert "computes on cpu; the checkpoint names cuda" in caplog.text
    assert "compile_model of the checkpoint is not used" in caplog.text


@pytest.mark.parametrize("wrapped", ["module.model.", "model._orig_mod.", "module._orig_mod.model."])
def test_wrapped_names_of_tensors_are_read(copy, wrapped):
    expected = executed_rows(copy, attached())
    path = copy / "model.safetensors"
    save_file({name.replace("model.", wrapped, 1): tensor for name, tensor in load_file(path).items()}, path)
    assert (executed_rows(copy, attached()) == expected).all()


def test_weights_before_training_are_not_downloaded(copy, monkeypatch):
    expected = executed_rows(copy, attached())
    configure(copy, pretrained_backbone_weights="ResNet18_Weights.IMAGENET1K_V1")
    monkeypatch.setattr("torchvision.models._api.load_state_dict_from_url", None)
    assert (executed_rows(copy, attached()) == expected).all()


def test_images_of_another_size_are_announced(tmp_path, caplog):
    wide = {"observation.images.external2": PolicyFeature(FeatureType.VISUAL, (3, 48, 64))}
    with caplog.at_level(logging.INFO, "hypogeum"):
        LeRobotPolicy(checkpoints.act(tmp_path / "act", wide)).on_attach(attached())
    assert "external2_camera 224x224 instead of 64x48" in caplog.text


def test_recorded_encoder_needs_no_hypogeum_json(tmp_path):
    folder = checkpoints.act(tmp_path / "act", {ENVIRONMENT: PolicyFeature(FeatureType.ENV, (32,))})
    with pytest.raises(MappingError, match='"language" needs'):
        LeRobotPolicy(folder)
    change_statistics(PRE, lambda found: found | {f"{ENVIRONMENT}.hashed": torch.ones(1)})(folder)
    policy = LeRobotPolicy(folder)
    batch = policy.preprocess(policy.batch(observe([1]), slice(0, 1)))
    assert np.array_equal(batch[ENVIRONMENT][0].numpy(), hashed_embedding("lift", 32))


def test_pi05_ignores_environment_state(tmp_path, caplog):
    folder = checkpoints.pi05(tmp_path / "pi05")
    expected = LeRobotPolicy(folder)(observe([1]))[0]
    env = {ENVIRONMENT: {"type": "ENV", "shape": [32]}}
    rewrite(folder / "config.json", lambda contents: contents["input_features"].update(env))
    with caplog.at_level(logging.INFO, "hypogeum"):
        found = LeRobotPolicy(folder)(observe([1]))[0]
    assert (found == expected).all() and f"{ENVIRONMENT} is left out" in caplog.text


def test_cut_prompt_is_announced(tmp_path, caplog):
    folder = checkpoints.pi05(tmp_path / "pi05")
    configure_step(folder, PRE, "tokenizer_processor", lambda step: step["config"].update(max_length=5))
    with caplog.at_level(logging.INFO, "hypogeum"):
        policy = LeRobotPolicy(folder)
        policy(observe([1]))
        policy(observe([2]))
    assert caplog.text.count("prompts are cut off at 5 tokens (max_length of the tokenizer step)") == 1


def test_adapter_is_merged_into_its_base(act, copy):
    peft = pytest.importorskip("peft")
    base = LeRobotPolicy(act)
    adapted = peft.get_peft_model(
        LeRobotPolicy(act).policy, peft.LoraConfig(r=2, target_modules=r".*linear1", init_lora_weights=False)
    )
    (copy / "model.safetensors").unlink()
    adapted.save_pretrained(copy)
    rewrite(copy / "adapter_config.json", lambda contents: contents.update(base_model_name_or_path=str(act)))
    found = LeRobotPolicy(copy)
    sent = observe([1])
    batch = found.preprocess(found.batch(sent, slice(0, 1)))
    with torch.inference_mode():
        expected = adapted.base_model.model.predict_action_chunk(dict(batch))
        assert (found.policy.predict_action_chunk(dict(batch)) - expected).abs().max() < 1e-5
        assert (base.policy.predict_action_chunk(dict(batch)) - expected).abs().max() > 1e-3
