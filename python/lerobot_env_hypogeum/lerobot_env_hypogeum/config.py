"""The env type `hypogeum`: `lerobot-eval --env.type=hypogeum --env.task=RaiseCube`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from draccus.utils import ParsingError
from gymnasium.vector import VectorEnv
from lerobot.configs import FeatureType, PolicyFeature, parser
from lerobot.envs.configs import EnvConfig
from lerobot.utils.constants import ACTION

from hypogeum.envs.conditions import TASKS, Condition, conditions
from hypogeum.envs.vector import HypogeumVectorEnv
from hypogeum.lerobot.settings import announce_sizes
from hypogeum.mapping import Mapping

from .evaluation import EXTERNAL_CAMERA, EvaluationEnv, key_of
from .inputs import ACT, checkpoint_inputs, dataset_inputs


@EnvConfig.register_subclass("hypogeum")
@dataclass
class HypogeumEnvConfig(EnvConfig):
    """Conditions to evaluate a policy under.

    Each condition is a suite of its own, named after its task, or TASK_PERTURBATION. An episode has the horizon of its
    task. Options that are None are those of `hypogeum run`.

    Args:
        task: Name of a task, or several separated by commas, of the same robot.
        perturbation: Name, names joined by `+` for several at once, or several of those separated by commas.
        seed: Suite seed, as `--seed` of a run.
        protocol: `act` or `lerobot`; by default that of the checkpoint's training, or `act`.
        control_mode: By default that of the width of the checkpoint's actions.
        image_size, instructions, end, profile, strength, renderer, threads: As the flags of `hypogeum run`.
        checkpoint: The policy whose features the observations have; by default the one of `--policy.path`. Without
            one, they have those of a dataset of `hypogeum demos`.
        shrink: Divisor of the image size without a checkpoint, as `--shrink` of `hypogeum demos`.

    Raises:
        ParsingError: A name or an option is wrong, a perturbation does not apply to a task, or the features of the
            checkpoint cannot be provided.
    """

    task: str | None = "RaiseCube"
    fps: int = 20
    perturbation: str = "None"
    seed: int = 0
    protocol: str | None = None
    control_mode: str | None = None
    image_size: str | None = None
    instructions: str | None = None
    end: str | None = None
    profile: str | None = None
    strength: float | None = None
    renderer: str | None = None
    threads: int | None = None
    checkpoint: str | None = None
    shrink: int = 1

    def __post_init__(self) -> None:
        """Determine the features, and start an episode of each condition to find what is wrong now."""
        try:
            self._determine()
        except ValueError as error:
            # LeRobot's parser replaces the text of every other error.
            raise ParsingError(str(error)) from error

    def _determine(self) -> None:
        if self.max_parallel_tasks != 1:
            raise ValueError(
                f"max_parallel_tasks is {self.max_parallel_tasks}, expected 1: a policy of LeRobot keeps one queue of "
                "actions, which several tasks at a time would mix"
            )
        if self.shrink < 1:
            raise ValueError(f"shrink is {self.shrink}, expected a positive integer")
        chosen = self._conditions()
        morphology = TASKS[chosen[0].task]["morphology"]
        self.checkpoint = self.checkpoint or parser.get_path_arg("policy")
        inputs = checkpoint_inputs(self.checkpoint) if self.checkpoint else None
        if inputs:
            mapping = inputs.mapping(self.control_mode)
            if mapping.morphology != morphology:
                raise ValueError(
                    f"the checkpoint is for a {mapping.morphology} robot, and {chosen[0].task} is a task of a "
                    f"{morphology} one"
                )
            self.protocol, self.control_mode = self.protocol or inputs.protocol, mapping.control_mode
        self.protocol = self.protocol or ACT
        sizes, action_dim, self.control_mode = self._probe(chosen)
        inputs = inputs or dataset_inputs(self.protocol, morphology, sizes, action_dim, self.shrink)
        mapping = inputs.mapping(self.control_mode)
        announce_sizes(mapping, tuple(sizes[camera][::-1] for camera in (EXTERNAL_CAMERA, list(sizes)[-1])))
        if inputs.resizes_images:
            cameras = {name: (camera, *sizes[camera]) for name, (camera, *_) in mapping.images.items()}
            mapping = replace(mapping, images=cameras)
        self._mapping: Mapping = mapping
        self._describe(mapping, action_dim)

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Options of `hypogeum.make_vec`."""
        names = (
            "seed", "protocol", "control_mode", "image_size", "instructions", "end", "profile", "strength",
            "renderer", "threads",
        )  # fmt: skip
        return {name: getattr(self, name) for name in names}

    def create_envs(self, n_envs: int, use_async_envs: bool = False) -> dict[str, dict[int, VectorEnv]]:
        """Return a vector env of each condition, `{suite: {0: env}}`.

        Args:
            n_envs: Number of envs of each.
            use_async_envs: Without effect: the envs of a vector env are stepped by threads of this process.
        """
        return {
            _suite(condition): {0: EvaluationEnv(condition, n_envs, self._mapping, self.gym_kwargs)}
            for condition in self._conditions()
        }

    def _conditions(self) -> list[Condition]:
        tasks, perturbations = (text.split(",") for text in (self.task or "", self.perturbation))
        return conditions([it.strip() for it in tasks], [it.strip() for it in perturbations])

    def _probe(self, chosen: list[Condition]) -> tuple[dict[str, tuple[int, int]], int, str]:
        """Start an episode of each condition; return the sizes of images, the width of actions and the control mode."""
        tasks, perturbations = ([*dict.fromkeys(names)] for names in zip(*chosen, strict=True))
        probe = HypogeumVectorEnv(tasks, perturbation=perturbations, **self.gym_kwargs)
        try:
            observation, _ = probe.reset()
            images = {name: array for name, array in observation.items() if name != "state"}
            sizes = {name: (array.shape[1], array.shape[2]) for name, array in images.items()}
            return sizes, probe.single_action_space.shape[0], probe.control_mode
        finally:
            probe.close()

    def _describe(self, mapping: Mapping, action_dim: int) -> None:
        features = {ACTION: (ACTION, PolicyFeature(FeatureType.ACTION, (action_dim,)))}
        for name, (_, height, width) in mapping.images.items():
            features[name] = name, PolicyFeature(FeatureType.VISUAL, (height, width, 3))
        for name, parts in mapping.states.items():
            width = sum(part.stop - part.start for part in parts)
            features[key_of(name)] = name, PolicyFeature(FeatureType.STATE, (width,))
        for name, width in mapping.languages.items():
            features[key_of(name)] = name, PolicyFeature(FeatureType.ENV, (width,))
        self.features = {key: feature for key, (_, feature) in features.items()}
        self.features_map = {key: name for key, (name, _) in features.items()}


def _suite(condition: Condition) -> str:
    return condition.task if condition.perturbation == "None" else f"{condition.task}_{condition.perturbation}"
