"""Serves any policy that LeRobot has saved: `python -m hypogeum.lerobot NAME CHECKPOINT`.

The folder holds `config.json`, `model.safetensors` and LeRobot's pre- and post-processors. `hypogeum.mapping` tells how
its input features are fed.
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

# Policies without random numbers and without a past: their answers may be computed together.
BATCHABLE = ("act",)


class LeRobotPolicy:
    """A policy function for `hypogeum.serve`.

    An env's answer is a function of its own observation and, where the policy draws noise, of its seed and query. Envs
    are answered one after another, because matrix products of another batch size may round otherwise; `batched` answers
    them together all the same, for ACT.
    """

    def __init__(self, folder, device="cpu", batched=False):
        if not (Path(folder) / "config.json").is_file():
            raise MappingError(f"{folder} has no config.json; give the folder that LeRobot calls pretrained_model")
        config = PreTrainedConfig.from_pretrained(folder)
        config.device = device
        if batched and config.type not in BATCHABLE:
            raise MappingError(f"a policy of type {config.type!r} cannot be batched, only {', '.join(BATCHABLE)}")
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
        # A policy that looks at several observations keeps them in queues of its own.
        self.n_rows = config.n_action_steps if keeps_observations(self.policy) else None
        if self.n_rows is not None:
            log.warning(
                "%s looks at several successive observations, but is shown only those it is asked at: every query is "
                "answered as the first of an episode",
                config.type,
            )

    def __call__(self, observation):
        mapping = self.mapping
        asked = (observation.morphology, observation.control_mode)
        if asked != (mapping.morphology, mapping.control_mode):
            raise MappingError(
                f"the checkpoint drives a {mapping.morphology} robot by {mapping.control_mode}, the run asks for "
                f"{' by '.join(asked)}; choose its tasks and --control-mode accordingly"
            )
        if observation.external is None and mapping.images:
            raise MappingError("the checkpoint looks at images, the run draws none")
        if self.batched:
            return self.infer(self.batch(observation, slice(None)))
        return [self.answer(observation, env_idx) for env_idx in range(observation.n_envs)]

    def answer(self, observation, env_idx):
        """`[n_rows, action_dim] f32` for one env."""
        env = observation[env_idx]
        torch.manual_seed(noise_seed(env.policy_seed, env.query))
        return self.infer(self.batch(observation, slice(env_idx, env_idx + 1)))[0]

    def batch(self, observation, envs):
        """What LeRobot's preprocessor wants of some envs."""
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
        """`[n, n_rows, action_dim] f32` on the CPU."""
        batch = self.preprocess(batch)
        if self.n_rows is None:
            chunk = self.policy.predict_action_chunk(batch)
        else:
            self.policy.reset()
            chunk = torch.stack([self.policy.select_action(batch) for _ in range(self.n_rows)], dim=1)
        # Row by row of the chunk, as LeRobot does after selecting one.
        rows = [self.postprocess(chunk[:, idx]) for idx in range(chunk.shape[1])]
        return torch.stack(rows, dim=1).float().cpu().numpy()


def keeps_observations(policy):
    """Whether a policy answers from queues that only its own episode loop fills."""
    return policy.config.n_obs_steps > 1 or any(name != "action" for name in getattr(policy, "_queues", {}))


def noise_seed(policy_seed, query):
    """A 64-bit seed for the noise of one query."""
    digest = hashlib.blake2b(f"{policy_seed}/{query}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little")


def main(argv=None):
    parser = argparse.ArgumentParser(prog="python -m hypogeum.lerobot", description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("name", help="NAME of `hypogeum run --policy ...=attach:NAME`")
    parser.add_argument("checkpoint", type=Path, help="folder that LeRobot has saved")
    parser.add_argument("--device", default="cpu", help="torch device (default: cpu)")
    batched = "compute all envs together (ACT only): faster on a GPU, but not the same bits for every batch"
    parser.add_argument("--batched", action="store_true", help=batched)
    parser.add_argument("--threads", type=int, help="torch's threads")
    parser.add_argument("--forever", action="store_true", help="go on with the next run")
    parser.add_argument("--base", type=Path, help="folder under which runs live")
    parser.add_argument("--timeout", type=float, metavar="S", help="give up when no run has come after S seconds")
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    if args.threads:
        torch.set_num_threads(args.threads)
    try:
        policy = LeRobotPolicy(args.checkpoint, args.device, args.batched)
        own = getattr(policy.policy.config, "temporal_ensemble_coeff", None)
        coeff = DEFAULT_COEFF if own is None else own
        waits = dict(base=args.base, timeout_s=args.timeout, forever=args.forever)
        print(serve(policy, args.name, ensemble_coeff=coeff, **waits))
    except (MappingError, TimeoutError) as error:
        sys.exit(f"error: {error}")
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
