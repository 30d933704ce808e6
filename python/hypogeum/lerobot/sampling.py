"""Sampling of action chunks from LeRobot's policies, with noise that depends on the env's episode and query alone."""

import hashlib
from contextlib import contextmanager

import numpy as np
import torch
from lerobot.policies.utils import populate_queues

from ..generated import draw_noise
from .kinds import FLOW, HISTORY

# LeRobot's names of the queues of actions and of images.
ACTION, IMAGES = "action", "observation.images"


def sample(policy, history, seeds):
    """Return action chunks before the postprocessor, `[n, n_rows, action_dim]`.

    Args:
        policy: LeRobot's policy.
        history: Preprocessed observations of `n` envs, oldest first: one, or as many as the policy's `n_obs_steps`.
        seeds: (policy seed, query) of each env. `n` is 1 unless the policy is `BATCHABLE`.
    """
    config = policy.config
    if config.type in FLOW:
        noise = stacked_noise(seeds, (config.chunk_size, config.max_action_dim), config.device)
        return policy.predict_action_chunk(history[-1], noise=noise)
    if config.type == "diffusion":
        with drawing_from(policy.diffusion, seeds):
            return play(policy, history)
    torch.manual_seed(noise_seed(*seeds[0]))
    if config.type in HISTORY:
        return play(policy, history)
    return policy.predict_action_chunk(history[-1])


def play(policy, history):
    """Return the rows that a policy selects at successive control steps after observing `history`."""
    policy.reset()
    for batch in history[:-1]:
        if policy.config.image_features:
            images = torch.stack([batch[name] for name in policy.config.image_features], dim=-4)
            batch = batch | {IMAGES: images}
        populate_queues(policy._queues, batch)
    rows = [policy.select_action(dict(history[-1]))]
    while policy._queues[ACTION]:
        rows.append(policy.select_action(dict(history[-1])))
    return torch.stack(rows, dim=1)


@contextmanager
def drawing_from(network, seeds):
    """Make a diffusion model start from the noise of `seeds` and draw later noise from one generator per env."""
    config, device = network.config, next(network.parameters()).device
    noise = stacked_noise(seeds, (config.horizon, config.action_feature.shape[0]), device)
    generators = [torch.Generator().manual_seed(noise_seed(*seed)) for seed in seeds]
    original = network.conditional_sample

    def conditional_sample(batch_size, global_cond=None, **_):
        return original(batch_size, global_cond=global_cond, generator=generators, noise=noise)

    network.conditional_sample = conditional_sample
    try:
        yield
    finally:
        del network.conditional_sample


def stacked_noise(seeds, shape, device):
    """Return standard normal noise, `[n, *shape] f32`, equal on all devices."""
    return torch.from_numpy(np.stack([draw_noise(*seed, shape) for seed in seeds])).to(device)


def noise_seed(policy_seed, query):
    """Return a 64-bit seed for the noise of one query."""
    digest = hashlib.blake2b(f"{policy_seed}/{query}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little")
