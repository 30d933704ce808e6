"""Serve any policy saved by LeRobot: `python -m hypogeum.lerobot NAME CHECKPOINT`.

The checkpoint folder contains `config.json`, `model.safetensors` and LeRobot's pre- and post-processors.
`hypogeum.mapping` determines the sources of its input features.
"""

import argparse
import hashlib
import logging
import sys
from pathlib import Path

import numpy as np
import torch

from lerobot.configs.policies import PreTrainedConfig
from lerobot.policies.factory import get_policy_class, make_pre_post_processors

from .backbone import resnet18_of, width_of
from .ensemble import DEFAULT_COEFF
from .host import serve
from .images import to_network
from .language import hashed_embedding
from .mapping import Feature, MappingError, make_mapping, read_settings

log = logging.getLogger("hypogeum")

# Policies that are deterministic and stateless, so that envs may be computed as one batch.
BATCHABLE = ("act",)


class LeRobotPolicy:
    """Policy function for `hypogeum.serve` that runs a LeRobot checkpoint.

    An env's answer depends only on its own observation and, if the policy samples noise, on its seed and query. Envs
    are computed one at a time, because matrix products of a different batch size may round differently.

    Args:
        folder: Checkpoint folder.
        device: Torch device.
        batched: Whether to compute all envs as one batch nevertheless; ACT only.

    Raises:
        MappingError: The checkpoint's inputs or actions do not fit the benchmark.
    """

    def __init__(self, folder, device="cpu", batched=False):
        if not (Path(folder) / "config.json").is_file():
            raise MappingError(f"{folder} has no config.json; expected a folder that LeRobot names pretrained_model")
        config = PreTrainedConfig.from_pretrained(folder)
        config.device = device
        if batched and config.type not in BATCHABLE:
            raise MappingError(f"a policy of type {config.type!r} cannot be batched, expected {', '.join(BATCHABLE)}")
        features = {
            name: Feature(feature.type.value, tuple(feature.shape)) for name, feature in config.input_features.items()
        }
        self.mapping = make_mapping(features, config.action_feature.shape[0], read_settings(folder))
        with resnet18_of(width_of(folder)):
            self.policy = get_policy_class(config.type).from_pretrained(folder, config=config)
        self.device = torch.device(device)
        self.batched = batched
        self.preprocess, self.postprocess = make_pre_post_processors(
            config, pretrained_path=str(folder), preprocessor_overrides={"device_processor": {"device": device}}
        )
        # A policy that conditions on several observations stores them in its own queues.
        self.n_rows = config.n_action_steps if has_observation_queue(self.policy) else None
        if self.n_rows is not None:
            log.warning(
                "%s conditions on several successive observations, but receives only those at which it is queried; "
                "every query is treated as the first of an episode",
                config.type,
            )

    def __call__(self, observation):
        mapping = self.mapping
        found, expected = (observation.morphology, observation.control_mode), (mapping.morphology, mapping.control_mode)
        if found != expected:
            raise MappingError(
                f"the run uses morphology {found[0]} with control mode {found[1]}, the checkpoint expects "
                f"{expected[0]} with {expected[1]}; choose --tasks and --control-mode accordingly"
            )
        if observation.external is None and mapping.images:
            raise MappingError("the checkpoint needs images, but the run renders none")
        if self.batched:
            return self.infer(self.batch(observation, slice(None)))
        return [self.answer(observation, env_idx) for env_idx in range(observation.n_envs)]

    def answer(self, observation, env_idx):
        """Return the action chunk for one env, `[n_rows, action_dim] f32`."""
        env = observation[env_idx]
        torch.manual_seed(noise_seed(env.policy_seed, env.query))
        return self.infer(self.batch(observation, slice(env_idx, env_idx + 1)))[0]

    def batch(self, observation, envs):
        """Return the input of LeRobot's preprocessor for `envs`, a slice of the message's envs."""
        batch = {"task": observation.instructions[envs]}
        for name, (camera, height, width) in self.mapping.images.items():
            batch[name] = to_network(observation.cameras[camera][envs], height, width)
        states = observation.states[envs]
        for name, parts in self.mapping.states.items():
            batch[name] = torch.from_numpy(np.concatenate([states[:, part] for part in parts], axis=1))
        for name, dim in self.mapping.languages.items():
            embeddings = [hashed_embedding(instruction, dim) for instruction in batch["task"]]
            batch[name] = torch.from_numpy(np.stack(embeddings))
        return batch

    @torch.inference_mode()
    def infer(self, batch):
        """Return the action chunks for a batch of `n` envs, `[n, n_rows, action_dim] f32`, as a numpy array."""
        batch = self.preprocess(batch)
        if self.n_rows is None:
            chunk = self.policy.predict_action_chunk(batch)
        else:
            self.policy.reset()
            chunk = torch.stack([self.policy.select_action(batch) for _ in range(self.n_rows)], dim=1)
        # Postprocess row by row, as LeRobot does with each selected action.
        rows = [self.postprocess(chunk[:, idx]) for idx in range(chunk.shape[1])]
        return torch.stack(rows, dim=1).float().cpu().numpy()


def has_observation_queue(policy):
    """Return whether a policy conditions on queues that only LeRobot's own episode loop fills."""
    return policy.config.n_obs_steps > 1 or any(name != "action" for name in getattr(policy, "_queues", {}))


def noise_seed(policy_seed, query):
    """Return a 64-bit seed for the noise of one query."""
    digest = hashlib.blake2b(f"{policy_seed}/{query}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little")


def main(argv=None):
    parser = argparse.ArgumentParser(prog="python -m hypogeum.lerobot", description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("name", help="NAME of `hypogeum run --policy ...=attach:NAME`")
    parser.add_argument("checkpoint", type=Path, help="checkpoint folder saved by LeRobot")
    parser.add_argument("--device", default="cpu", help="torch device (default: cpu)")
    batched = "compute all envs as one batch (ACT only): faster on a GPU, but rounding depends on the batch size"
    parser.add_argument("--batched", action="store_true", help=batched)
    parser.add_argument("--threads", type=int, help="number of torch threads")
    parser.add_argument("--forever", action="store_true", help="serve the next run when one ends")
    parser.add_argument("--base", type=Path, help="folder that contains the runs")
    parser.add_argument("--timeout", type=float, metavar="S", help="exit if no run appears within S seconds")
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    if args.threads:
        torch.set_num_threads(args.threads)
    try:
        policy = LeRobotPolicy(args.checkpoint, args.device, args.batched)
        configured = getattr(policy.policy.config, "temporal_ensemble_coeff", None)
        coeff = DEFAULT_COEFF if configured is None else configured
        options = dict(base=args.base, timeout_s=args.timeout, forever=args.forever)
        print(serve(policy, args.name, ensemble_coeff=coeff, **options))
    except (MappingError, TimeoutError) as error:
        sys.exit(f"error: {error}")
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
