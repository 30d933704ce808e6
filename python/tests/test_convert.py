"""Conversion of a tiny checkpoint, saved as the benchmark's training saves it."""

import argparse
import json

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("safetensors")
pytest.importorskip("xxhash")

from convert_act_checkpoint import ConversionError, convert  # noqa: E402
from make_act_checkpoint import ROBOTS, TINY, Act, generated_tensor  # noqa: E402
from safetensors.numpy import load_file  # noqa: E402

from hypogeum import clip  # noqa: E402


def tower(dtype=np.float32):
    """Return the tensors of a minimal text tower by their canonical names."""
    shapes = clip.canonical_shapes(n_layers=1, width=64, dim=512)
    return {name: np.asarray(generated_tensor(name, shape)).astype(dtype) for name, shape in shapes.items()}


def agent(morphology="single", encoder=None, wrapper=""):
    """Return a network's tensors under the benchmark's names, including those of a language encoder."""
    torch.manual_seed(1)
    net = Act(TINY | ROBOTS[morphology] | dict(dec_layers=2, language=dict(dim=512)))
    state = {f"model.{name}": tensor for name, tensor in net.state_dict().items()}
    encoder = clip.to_openai(tower()) if encoder is None else encoder
    encoder = encoder | {"visual.conv1.weight": np.zeros((2, 3, 4, 4), np.float32), "logit_scale": np.float32(1)}
    return state | {f"model.lang_encoder.{wrapper}{name}": torch.from_numpy(np.array(x)) for name, x in encoder.items()}


def save(path, **contents):
    torch.save(dict(norm_stats=None, agent={}, ema_agent={}) | contents, path)
    return path


def statistics(state_dim, action_dim):
    return dict(
        state_mean=np.zeros(state_dim, np.float32), state_std=np.ones((1, state_dim)),
        action_mean=torch.zeros(action_dim), action_std=torch.ones(action_dim), example_state=np.float32(3),
    )


def test_configuration_is_inferred_from_tensors(tmp_path):
    raw, averaged = agent(), agent()
    averaged["model.action_head.bias"] = torch.full((7,), 2.0)
    config = convert(save(tmp_path / "a.pt", agent=raw, ema_agent=averaged), tmp_path / "out", nheads=4)
    assert config == json.loads((tmp_path / "out/config.json").read_text())
    assert config == dict(
        TINY, **ROBOTS["single"], type="act_colosseum", morphology="single", dec_layers=2,
        language=dict(encoder="clip-vit-b-32", weights="clip", fingerprint=clip.fingerprint(tower())),
    )
    tensors = load_file(tmp_path / "out/model.safetensors")
    assert (tensors["action_head.bias"] == 2).all()
    assert set(tensors) == {name[6:] for name in raw if not name.startswith("model.lang_encoder.")}
    assert set(load_file(tmp_path / "out/clip/model.safetensors")) == set(clip.to_openai(tower()))
    convert(tmp_path / "a.pt", tmp_path / "raw", weights="raw")
    assert not (load_file(tmp_path / "raw/model.safetensors")["action_head.bias"] == 2).any()


def test_statistics_are_converted_from_numpy_and_torch(tmp_path):
    path = save(tmp_path / "a.pt", norm_stats=statistics(64, 16), ema_agent=agent("bimanual"))
    config = convert(path, tmp_path / "out")
    assert (config["morphology"], config["control_mode"], config["n_cameras"]) == ("bimanual", "pd_joint_pos", 4)
    tensors = load_file(tmp_path / "out/model.safetensors")
    assert tensors["norm_stats.state_std"].shape == (64,) and tensors["norm_stats.action_mean"].shape == (16,)
    path = save(tmp_path / "b.pt", norm_stats=statistics(25, 7), ema_agent=agent())
    assert convert(path, tmp_path / "out")["control_mode"] == "pd_ee_pose"


@pytest.mark.parametrize("wrapper", ["", "clip.", "model."])
@pytest.mark.parametrize("naming", [dict, clip.to_openai])
def test_clip_is_found_in_any_wrapper_and_form(tmp_path, wrapper, naming):
    half = tower(np.float16)
    path = save(tmp_path / "a.pt", ema_agent=agent(encoder=naming(half), wrapper=wrapper))
    config = convert(path, tmp_path / "out")
    assert config["language"]["fingerprint"] == clip.fingerprint(half)
    stored = load_file(tmp_path / "out/clip/model.safetensors")
    assert set(stored) == set(naming(half)) and stored[next(iter(stored))].dtype == np.float16


def test_invalid_checkpoints_are_rejected(tmp_path):
    def assert_rejected(match, **contents):
        with pytest.raises(ConversionError, match=match):
            convert(save(tmp_path / "a.pt", **contents), tmp_path / "out")

    torch.save({"state_dict": {}}, tmp_path / "other.pt")
    with pytest.raises(ConversionError, match="it contains state_dict; expected `ema_agent`"):
        convert(tmp_path / "other.pt", tmp_path / "out")
    (tmp_path / "text.pt").write_text("not a checkpoint")
    with pytest.raises(ConversionError, match="it contains more than data, or is not a checkpoint"):
        convert(tmp_path / "text.pt", tmp_path / "out")
    assert_rejected("more than data.*argparse.Namespace", agent=argparse.Namespace())
    assert_rejected("contain policy.x; expected tensors named `model...", ema_agent={"policy.x": torch.zeros(1)})
    assert_rejected("`model.input_proj_robot_state.weight` is missing", ema_agent={"model.x": torch.zeros(1)})
    assert_rejected("`norm_stats` contains mean; expected state_mean", norm_stats=dict(mean=0), ema_agent=agent())
    assert_rejected("no `model.lang_encoder.`", ema_agent={k: v for k, v in agent().items() if "lang_encoder" not in k})
    broken = {k: v for k, v in clip.to_openai(tower()).items() if k != "ln_final.bias"}
    assert_rejected("text tower lacks 'ln_final.bias'", ema_agent=agent(encoder=broken))
    assert not (tmp_path / "out").exists()
