"""Errors about LeRobot's checkpoints that cannot run as they were trained. Needs what `test_lerobot` needs."""

import os
import shutil
from types import SimpleNamespace

import pytest

os.environ.setdefault("HF_HUB_OFFLINE", "1")
torch = pytest.importorskip("torch")
pytest.importorskip("sentencepiece")
pytest.importorskip("diffusers")
pytest.importorskip("lerobot.policies.pi05.modeling_pi05", exc_type=ImportError)

from lerobot.configs.policies import PreTrainedConfig  # noqa: E402
from lerobot_checkpoints import change_statistics, configure, configure_step, rewrite, setting, state_of  # noqa: E402
from safetensors.torch import load_file, save_file  # noqa: E402

from hypogeum.lerobot import LeRobotPolicy, kinds  # noqa: E402
from hypogeum.mapping import MappingError  # noqa: E402

STATE = "observation.state"
PRE, POST = "policy_preprocessor", "policy_postprocessor"


def without_step(processor, name):
    def remove(contents):
        contents["steps"] = [step for step in contents["steps"] if step["registry_name"] != name]

    return lambda folder: rewrite(folder / f"{processor}.json", remove)


def without_state_file(processor, name):
    return lambda folder: configure_step(folder, processor, name, lambda step: step.pop("state_file"))


STATISTICS = {
    "no state file": (
        without_state_file(PRE, "normalizer_processor"),
        ("(normalizer_processor, without a state_file) of policy_preprocessor.json", "external1.mean"),
    ),
    "no state file of actions": (
        without_state_file(POST, "unnormalizer_processor"),
        ("(unnormalizer_processor, without a state_file) of policy_postprocessor.json", "statistics found are none"),
    ),
    "empty": (change_statistics(POST, lambda found: {}), ("needs action.mean", "unnormalizer_processor.safetensors)")),
    "prefix": (
        change_statistics(POST, lambda found: {f"so100.{name}": tensor for name, tensor in found.items()}),
        ("needs action.mean", "so100.action.max"),
    ),
    "other mode": (
        lambda folder: configure_step(
            folder, POST, "unnormalizer_processor",
            lambda step: step["config"]["norm_map"].update(ACTION="QUANTILES"),
        ),
        ("normalised by QUANTILES, which needs action.q01; the statistics found are action.max, action.mean",),
    ),
    "width": (
        change_statistics(PRE, lambda found: found | {f"{STATE}.mean": torch.zeros(9)}),
        ("observation.state.mean has shape [9], the feature has [25]",),
    ),
    "not finite": (
        change_statistics(PRE, lambda found: found | {f"{STATE}.std": torch.full((25,), torch.inf)}),
        ("observation.state.std is not finite: inf",),
    ),
    "no step": (
        without_step(PRE, "normalizer_processor"),
        ("policy_preprocessor.json has no step that normalises observation.images.external1",),
    ),
    "no step for actions": (
        without_step(POST, "unnormalizer_processor"), ("policy_postprocessor.json has no step that normalises action",)
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", STATISTICS)
def test_missing_normalisation_is_refused_by_name(copy, case):
    change, words = STATISTICS[case]
    change(copy)
    with pytest.raises(MappingError) as error:
        LeRobotPolicy(copy)
    assert all(word in str(error.value) for word in words)


def test_missing_processor_is_not_blamed_on_weights(copy):
    (copy / "model.safetensors").unlink()
    (copy / f"{POST}.json").unlink()
    with pytest.raises(MappingError, match="has no policy_postprocessor.json"):
        LeRobotPolicy(copy)


def test_every_type_of_lerobot_is_classified():
    known = {*kinds.CURRENT, *kinds.HISTORY, *kinds.REFUSED}
    registered = set(PreTrainedConfig.get_known_choices())
    assert known <= registered and registered - known <= {"rtc"}, registered ^ known


@pytest.mark.parametrize(
    "config, words",
    [
        (dict(type="lingbot_va"), "type 'lingbot_va' cannot be served: its cache of earlier frames"),
        (dict(type="tdmpc"), "type 'tdmpc' cannot be served: each of its plans starts from the previous one"),
        (dict(type="novelty"), "type 'novelty' cannot be served: it is unknown whether they remember anything"),
        (dict(type="pi05", use_visual_memory=True), "use_visual_memory of the checkpoint cannot be served"),
        (dict(type="act", observation_delta_indices=[-1, 0]), "observation_delta_indices of the checkpoint cannot be"),
    ],
)
def test_policy_with_a_memory_is_refused(config, words):
    with pytest.raises(MappingError) as error:
        kinds.check_memory(SimpleNamespace(**config))
    assert words in str(error.value)
    kinds.check_memory(SimpleNamespace(type="diffusion", observation_delta_indices=[-1, 0]))


def jax(folder):
    (folder / "params").mkdir()
    (folder / "params/_METADATA").touch()


def openpi(folder):
    (folder / "assets").mkdir()
    configure(folder)
    rewrite(folder / "config.json", lambda contents: contents.pop("type"))


def both_robots(folder):
    for name in ("single", "bimanual"):
        (folder / name).mkdir()
        shutil.copy(folder / "config.json", folder / name)


def adapter(folder):
    (folder / "adapter_config.json").write_text('{"base_model_name_or_path": "somebody/base"}')


FOREIGN = {
    "jax": (jax, "convert it with openpi's own examples/convert_jax_model_to_pytorch.py"),
    "openpi": (openpi, "is a checkpoint of openpi and not of LeRobot; serve it with the built-in policy"),
    "both robots": (both_robots, "has a checkpoint for each morphology; serve"),
    "adapter": (adapter, "hf download somebody/base --local-dir base; then set base_model_name_or_path in"),
    "unknown key": (lambda folder: configure(folder, novelty=3), "`novelty` are not valid for ACTConfig; use a newer"),
    "unknown step": (
        lambda folder: configure_step(
            folder, PRE, "to_batch_processor", lambda step: step.update(registry_name="novelty")
        ),
        "novelty",
    ),
    "dilation": (
        lambda folder: configure(folder, replace_final_stride_with_dilation=True),
        "replace_final_stride_with_dilation is true, but a ResNet-18 has no",
    ),
    "lost state": (lambda folder: state_of(folder, PRE).unlink(), "normalizer_processor.safetensors"),
    "no action": (lambda folder: configure(folder, output_features={}), "has no output feature 'action'"),
    "prompt": (
        setting(prompt_state="padded"),
        "`prompt_state` in hypogeum.json applies to type 'pi05', the checkpoint",
    ),
    "heads": (setting(vision_heads=4), "`vision_heads` in hypogeum.json applies to type 'pi0' or 'pi05'"),
    "chunk": (setting(chunk_size=4), "`chunk_size` in hypogeum.json belongs to openpi's layout"),
    "language": (setting(language={"encoder": "hashed", "dim": 8}), "this policy reads no embedding"),
}


@pytest.mark.parametrize("case", FOREIGN)
def test_error_names_the_next_step(copy, case):
    change, words = FOREIGN[case]
    change(copy)
    with pytest.raises(MappingError) as error:
        LeRobotPolicy(copy)
    assert words in str(error.value)


def test_network_is_never_partly_random(copy):
    path = copy / "model.safetensors"
    tensors = load_file(path)
    save_file({name: tensor for name, tensor in tensors.items() if name != "model.action_head.weight"}, path)
    with pytest.raises(MappingError, match="lacks model.action_head.weight$"):
        LeRobotPolicy(copy)
    save_file(tensors | {"model.extra": torch.zeros(1)}, path)
    with pytest.raises(MappingError, match="has unexpected tensors model.extra$"):
        LeRobotPolicy(copy)
