"""LeRobot's policies as policy functions."""

import logging
from contextlib import nullcontext

import numpy as np
import torch
from lerobot.processor import ProcessorStep

from ..ensemble import DEFAULT_COEFF
from ..execution import CHUNK, RunRefused
from ..folder import resolve_checkpoint
from ..history import EpisodeMemory
from ..images import to_network
from ..language import hashed_embedding
from ..mapping import MappingError, make_mapping, read_settings
from .checkpoint import load_policy, read_config
from .kinds import BATCHABLE, FLOW, HISTORY, check_memory
from .processors import Processors
from .sampling import sample
from .settings import announce_differences, announce_sizes, check_settings, chunk_settings, pad_prompt, plan_execution, read_features

log = logging.getLogger("hypogeum")


class LeRobotPolicy:
    """Policy function for `hypogeum.serve` that runs a LeRobot checkpoint.

    An env's answer depends only on the observations of its own episode and, if the policy samples noise, on its seed
    and query. Envs are computed one at a time, because matrix products of a different batch size may round differently.

    Args:
        folder: Checkpoint folder.
        device: Torch device.
        batch: Whether to compute all envs as one batch nevertheless, for policies that are `BATCHABLE`.

    Raises:
        MappingError: The checkpoint is incomplete, or its inputs or actions do not fit the benchmark.
    """

    def __init__(self, folder, device="cpu", batch=False):
        folder = resolve_checkpoint(folder)
        settings = read_settings(folder)
        config = self.config = read_config(folder, device, settings.get("ignore", ()))
        check_settings(settings, config.type)
        check_memory(config)
        if batch and config.type not in BATCHABLE:
            raise MappingError(f"a policy of type {config.type!r} cannot be batched, expected {', '.join(BATCHABLE)}")
        processors = Processors(folder, config)
        self.mapping = make_mapping(
            read_features(config), config.action_feature.shape[0], settings, config.type in FLOW,
            processors.take_rename_map(), processors.hashed_features(),
        )  # fmt: skip
        processors.check_statistics(config, self.mapping.inputs())
        is_padded = config.type == "pi05" and pad_prompt(processors.preprocess, config, settings, folder)
        self.policy = load_policy(folder, config)
        if is_padded:
            # Imported here, because the module needs LeRobot's π0.5.
            from ..pi05 import scale_padding_twice

            scale_padding_twice(self.policy)
        self.preprocess, self.postprocess = processors.preprocess, processors.postprocess
        self.device = torch.device(device)
        self.is_batched = batch
        # The other policies need images in the size of their features.
        self.resizes_images = config.type in FLOW and getattr(config, "resize_imgs_with_padding", True) is not None
        # Other policies may write to their inputs, which would kill the process, or need them on the CPU.
        self.reads_in_place = config.type in BATCHABLE and not getattr(config, "adapt_to_pi_aloha", False)
        self.memory = EpisodeMemory(config.n_obs_steps) if config.type in HISTORY else None
        self.executes_plans = False
        self.n_rows = None
        announce_differences(self)

    @property
    def ensemble_coeff(self):
        """Coefficient with which a run with `--mode ensemble` is ensembled."""
        configured = getattr(self.config, "temporal_ensemble_coeff", None)
        return DEFAULT_COEFF if configured is None else configured

    def on_attach(self, run):
        """Prepare for a run; `serve` calls this with the run's `EndpointDescriptor`.

        A policy that conditions on several observations behaves as in LeRobot's own loop if the run queries it at every
        control step: it observes every step, and computes a chunk whenever the last one has been executed.

        Raises:
            RunRefused: The run would execute the policy otherwise than its checkpoint says, although nobody asked for
                that.
        """
        mapping = self.mapping
        if mapping.morphology not in run.morphologies:
            raise RunRefused(
                f"the checkpoint is for a {mapping.morphology} robot, the run has no task for one; choose --tasks"
            )
        if mapping.images and not run.images:
            raise RunRefused("the checkpoint needs images, but the run renders none")
        if mapping.images:
            announce_sizes(mapping, run.images)
        settings = chunk_settings(self.config)
        if self.memory is None:
            self.n_rows, note = settings.resolve(run)
        else:
            self.memory = EpisodeMemory(self.config.n_obs_steps)
            self.executes_plans = run.mode == CHUNK and run.execute == 1
            self.n_rows, note = plan_execution(settings, run, self.config.n_obs_steps)
        log.info("%s %s", self.config.type, note)

    def __call__(self, observation):
        self.check(observation)
        if self.is_batched:
            return self.answer(observation, slice(None))
        return [self.answer(observation, slice(idx, idx + 1))[0] for idx in range(observation.n_envs)]

    def check(self, observation):
        """Raise `MappingError` if the checkpoint cannot act on these observations."""
        mapping = self.mapping
        found, expected = (observation.morphology, observation.control_mode), (mapping.morphology, mapping.control_mode)
        if found != expected:
            advice = "choose --tasks" if found[0] != expected[0] else f"add --control-mode {expected[1]} to the run"
            raise MappingError(
                f"the run uses morphology {found[0]} with control mode {found[1]}, the checkpoint expects "
                f"{expected[0]} with {expected[1]}; {advice}"
            )
        if observation.external is None and mapping.images:
            raise MappingError("the checkpoint needs images, but the run renders none")

    @torch.inference_mode()
    def answer(self, observation, selection):
        """Return the action chunks for some envs of a message, a list of `[n_rows, action_dim] f32`.

        Args:
            observation: The `Observation`.
            selection: Slice of its envs.
        """
        envs = list(observation)[selection]
        amp = torch.autocast(self.device.type) if self.config.use_amp else nullcontext()
        try:
            with amp:
                return self.compute(observation, selection, envs)
        finally:
            release(self.preprocess.steps)

    def compute(self, observation, selection, envs):
        """Return the action chunks for `envs`, those that `selection` selects, see `answer`."""
        batch = self.preprocess(self.batch(observation, selection))
        if self.memory is None:
            return list(self.infer([batch], [seed(env) for env in envs]))
        return self.follow(batch, envs)

    def follow(self, batch, envs):
        """Remember a preprocessed batch of observations and return the action chunks for its envs."""
        memory = self.memory
        tensors = {name: x for name, x in batch.items() if isinstance(x, torch.Tensor)}
        for idx, env in enumerate(envs):
            memory.push(env, {name: x[idx : idx + 1].clone() for name, x in tensors.items()})
        due = [env for env in envs if not (self.executes_plans and memory.has_plan(env.slot))]
        if due:
            steps = zip(*(memory.observations(env.slot) for env in due))
            history = [{name: torch.cat([x[name] for x in step]) for name in step[0]} for step in steps]
            for env, rows in zip(due, self.infer(history, [seed(env) for env in due])):
                memory.plan(env.slot, rows)
        return [memory.next_rows(env.slot) for env in envs]

    def batch(self, observation, envs):
        """Return the input of LeRobot's preprocessor for `envs`, a slice of the message's envs."""
        batch = {"task": observation.instructions[envs]}
        tensors = observation.torch()
        device = self.device if self.reads_in_place else "cpu"
        for name, (camera, *size) in self.mapping.images.items():
            size = () if self.resizes_images else size
            batch[name] = to_network(tensors[camera][envs], *size, device=device)
        states = tensors["state"][envs]
        for name, parts in self.mapping.states.items():
            batch[name] = select_parts(states, parts, self.reads_in_place)
        for name, dim in self.mapping.languages.items():
            embeddings = [hashed_embedding(instruction, dim) for instruction in batch["task"]]
            batch[name] = torch.from_numpy(np.stack(embeddings))
        return batch

    @torch.inference_mode()
    def infer(self, history, seeds):
        """Return action chunks, `[n_envs, n_rows, action_dim] f32`, as a numpy array.

        Args:
            history: Preprocessed batches of observations, oldest first; see `sample`.
            seeds: (policy seed, query) per env.
        """
        chunk = sample(self.policy, history, seeds)[:, : self.n_rows]
        # Postprocess row by row, as LeRobot does with each selected action.
        rows = [self.postprocess(chunk[:, idx]) for idx in range(chunk.shape[1])]
        return torch.stack(rows, dim=1).float().cpu().numpy()


def seed(env):
    """Return the policy seed and the query of an env, of which its noise is a function."""
    return env.policy_seed, env.query


def select_parts(states, parts, share):
    """Return the concatenation of slices of `states`, sharing its memory if they are adjacent and `share` is set."""
    is_adjacent = all(first.stop == second.start for first, second in zip(parts, parts[1:]))
    if share and is_adjacent:
        return states[:, parts[0].start : parts[-1].stop]
    return torch.cat([states[:, part] for part in parts], dim=1)


def release(steps):
    """Drop the references of LeRobot's processor steps to their last batch, which is only valid during a query."""
    for step in steps:
        for name in ("_current_transition", "_last_state"):
            if getattr(step, name, None) is not None:
                setattr(step, name, None)
        release(value for value in vars(step).values() if isinstance(value, ProcessorStep))
