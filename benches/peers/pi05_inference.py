"""LeRobot's π0.5 as the peer of `cargo bench -p benches --bench pi05 -- --peer PYTHON`.

Usage: `pi05_inference.py CHECKPOINT_DIR N_THREADS`. Loads the checkpoint (bf16, in shards) into LeRobot's own network, with the precision
that LeRobot itself chooses for `dtype="bfloat16"`. A request is a line `N_IMAGES N_PROMPT N_STEPS` on standard input; the response is a
line with the elapsed time in s of one query. Images are resized and normalised already; the prompt is padded to 200 tokens, as LeRobot
does. Requirements: `python -m pip install 'lerobot[pi]==0.6.1'` on Python 3.12.
"""

import json
import sys
import time
from pathlib import Path

import torch
from lerobot.policies.pi05 import modeling_pi05
from lerobot.policies.pi05.configuration_pi05 import PI05Config
from safetensors import safe_open


def load(folder):
    """Returns LeRobot's network with the weights of a checkpoint, without initialising any at random."""
    stored = json.loads((folder / "config.json").read_text())
    config = PI05Config(dtype="bfloat16", chunk_size=stored["chunk_size"], n_action_steps=stored["chunk_size"], device="cpu")
    with torch.device("meta"):
        network = modeling_pi05.PI05Pytorch(config)
    expected = {name: parameter.dtype for name, parameter in network.named_parameters()}
    weights = {}
    index = json.loads((folder / "model.safetensors.index.json").read_text())["weight_map"]
    for shard in sorted(set(index.values())):
        with safe_open(folder / shard, "pt") as file:
            for name in file.keys():
                own = name.removeprefix("model.")
                weights[own] = file.get_tensor(name).to(expected[own])
    result = network.load_state_dict(weights, strict=False, assign=True)
    assert not result.unexpected_keys, result.unexpected_keys
    # What the checkpoint leaves out (output layers over words, the last norm) does not reach the actions.
    modules = dict(network.named_modules())
    for name in result.missing_keys:
        parent, _, leaf = name.rpartition(".")
        parameter = torch.nn.Parameter(torch.zeros(expected_shape(network, name), dtype=expected[name])) if leaf == "weight" else None
        setattr(modules[parent], leaf, parameter)
    # Buffers are computed, not stored; those on the meta device have to be computed again.
    for module in network.modules():
        if hasattr(module, "inv_freq"):
            fresh = type(module)(module.config)
            module.register_buffer("inv_freq", fresh.inv_freq, persistent=False)
            module.original_inv_freq = fresh.inv_freq
        for name, buffer in list(module.named_buffers(recurse=False)):
            if buffer.is_meta and name == "position_ids":
                module.register_buffer(name, torch.arange(buffer.shape[-1]).expand(buffer.shape), persistent=False)
            elif buffer.is_meta and name == "embed_scale":
                module.register_buffer(name, torch.tensor(module.scalar_embed_scale), persistent=False)
    return network.eval()


def expected_shape(network, name):
    """Returns the shape of a parameter that was not loaded; output layers over words get no rows."""
    shape = dict(network.named_parameters())[name].shape
    return (0, *shape[1:]) if "lm_head" in name else shape


def main():
    torch.set_num_threads(int(sys.argv[2]))
    started = time.perf_counter()
    network = load(Path(sys.argv[1]))
    side, horizon, width = 224, network.config.chunk_size, network.config.max_action_dim
    print(f"torch {torch.__version__}, loaded in {time.perf_counter() - started:.1f} s", flush=True)
    random = torch.Generator().manual_seed(0)
    for request in sys.stdin:
        n_images, n_prompt, n_steps = map(int, request.split())
        images = [2 * torch.rand((1, 3, side, side), generator=random) - 1 for _ in range(n_images)]
        tokens = torch.randint(4, 300, (1, 200), generator=random)
        mask = (torch.arange(200) < n_prompt)[None]
        noise = torch.randn((1, horizon, width), generator=random)
        started = time.perf_counter()
        with torch.inference_mode():
            network.sample_actions(images, [torch.ones(1, dtype=torch.bool)] * n_images, tokens, mask, noise=noise, num_steps=n_steps)
        print(time.perf_counter() - started, flush=True)


if __name__ == "__main__":
    main()
