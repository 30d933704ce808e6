"""One episode of a checkpoint in the loop of `lerobot-eval`, on observations that policy-host's tests also generate."""

import contextlib
import functools
import json
from dataclasses import dataclass

import numpy as np
import torch
import torchvision
from lerobot.configs.policies import PreTrainedConfig
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig
from lerobot.envs.utils import preprocess_observation
from lerobot.policies.factory import make_policy, make_pre_post_processors
from lerobot.policies.pi05.modeling_pi05 import PI05Policy
from lerobot.processor import RelativeActionsProcessorStep
from make_act_checkpoint import INSTRUCTIONS, generated_observation
from torchvision.models.resnet import BasicBlock, ResNet

from hypogeum import pi05
from hypogeum.generated import draw_noise
from hypogeum.images import to_network
from hypogeum.language import hashed_embedding
from hypogeum.tokenizer import Tokenizer

from . import CONSTANT, CONSTANT_ENTRY
from .edits import PRE

POLICY_SEED = 7
ENV_STATE, STATE, ACTION = "observation.environment_state", "observation.state", "action"
IMAGES, CAMERAS = "observation.images.", ("external1", "external2", "hand")
# Entries of the robot's state for each width that a base has.
STATES = {25: list(range(25)), 16: [*range(9), *range(18, 25)], 9: list(range(9))}
BACKBONE_WIDTH = 8


class PaddingTokenizer(Tokenizer):
    """`Tokenizer` with the options of transformers that the processor step passes."""

    def __call__(self, texts, max_length, padding, truncation, padding_side, **_):
        rows = [self.encode(text)[: max_length if truncation else None] for text in texts]
        longest = max(map(len, rows))
        widths = {True: longest, "longest": longest, False: longest, "do_not_pad": longest}
        width = max(longest, max_length) if padding == "max_length" else widths[padding]
        pad = lambda row, x: (
            [x] * (width - len(row)) + row if padding_side == "left" else row + [x] * (width - len(row))
        )  # noqa: E731
        tokens = torch.tensor([pad(row, 0) for row in rows])
        return dict(input_ids=tokens, attention_mask=torch.tensor([pad([1] * len(row), 0) for row in rows]))


@EnvConfig.register_subclass("hypogeum")
@dataclass
class HypogeumEnv(EnvConfig):
    """The benchmark's single arm, for the checks of `make_policy`."""

    task: str | None = "RaiseCube"
    state_dim: int = 25
    action_dim: int = 7

    def __post_init__(self):
        self.features = {
            ACTION: PolicyFeature(FeatureType.ACTION, (self.action_dim,)),
            "agent_pos": PolicyFeature(FeatureType.STATE, (self.state_dim,)),
        }
        self.features_map = {ACTION: ACTION, "agent_pos": STATE}
        for camera in CAMERAS:
            side = 128 if camera == "hand" else 224
            self.features[f"pixels/{camera}"] = PolicyFeature(FeatureType.VISUAL, (side, side, 3))
            self.features_map[f"pixels/{camera}"] = IMAGES + camera

    @property
    def gym_kwargs(self):
        return {}


def narrow_resnet(depths):
    """Return a function that builds a ResNet of basic blocks with an eighth of torchvision's channels."""

    def make(weights=None, **options):
        network = ResNet(BasicBlock, depths, **options)
        network.inplanes = BACKBONE_WIDTH
        network.conv1 = torch.nn.Conv2d(3, BACKBONE_WIDTH, 7, 2, 3, bias=False)
        network.bn1 = options["norm_layer"](BACKBONE_WIDTH)
        for stage, depth in enumerate(depths):
            stride, dilate = (1, False) if stage == 0 else (2, options["replace_stride_with_dilation"][stage - 1])
            layer = network._make_layer(BasicBlock, BACKBONE_WIDTH << stage, depth, stride=stride, dilate=dilate)
            setattr(network, f"layer{stage + 1}", layer)
        network.fc = torch.nn.Linear(BACKBONE_WIDTH << 3, 1)
        return network

    return make


@contextlib.contextmanager
def small_networks():
    """Make LeRobot build networks of the committed checkpoints' sizes, and fail where π0.5's weights do not fit."""
    models = torchvision.models
    originals = models.resnet18, models.resnet34, PI05Policy.from_pretrained
    models.resnet18, models.resnet34 = narrow_resnet([2, 2, 2, 2]), narrow_resnet([3, 4, 6, 3])
    PI05Policy.from_pretrained = lambda pretrained_name_or_path, config, **_: pi05.load(
        PI05Policy, pretrained_name_or_path, config
    )
    try:
        yield
    finally:
        models.resnet18, models.resnet34, PI05Policy.from_pretrained = originals


@functools.cache
def generated(step):
    """Return the generated observation of a control step, with an entry of the state that never changes."""
    external, hand, state = generated_observation(step, "single")
    state[CONSTANT_ENTRY] = CONSTANT
    return external, hand, state


def observation(step, instruction, sizes, state_dim):
    """Return the observation of a control step as an environment of LeRobot gives it, with images of these sizes."""
    external, hand, state = generated(step)
    pixels = dict(zip(CAMERAS, (*external, *hand), strict=True))
    resized = {}
    for camera, image in pixels.items():
        planes = to_network(image[None], *sizes.get(camera, image.shape[:2]))
        resized[camera] = (planes * 255).round().to(torch.uint8).permute(0, 2, 3, 1).numpy()
    return dict(pixels=resized, agent_pos=state[STATES[state_dim]][None])


def run(folder, n_steps, instruction=INSTRUCTIONS[0]):
    """Return the actions `[n_steps, action_dim] f32` that LeRobot's loop executes.

    Relative actions are added to the state of their query, as in training and in LeRobot's asynchronous inference;
    `lerobot-eval` adds them to the state of the control step in which they are executed.
    `lerobot-eval` insists on steps for devices and names, because it overrides them; here they may be absent. Its
    command line repeats the map of names that the preprocessor contains.
    """
    steps = {
        step.get("registry_name"): step.get("config", {}) for step in json.loads((folder / PRE).read_text())["steps"]
    }
    rename_map = steps.get("rename_observations_processor", {}).get("rename_map", {})
    overrides = {"device_processor": {"device": "cpu"}, "rename_observations_processor": {"rename_map": rename_map}}
    if (folder / "tokenizer.model").is_file():
        model = (folder / "tokenizer.model").read_bytes()
        overrides["tokenizer_processor"] = {"tokenizer": PaddingTokenizer.from_sentencepiece(model)}
    config = PreTrainedConfig.from_pretrained(folder)
    config.pretrained_path = folder
    is_act = config.type == "act"
    state_dim = config.input_features[STATE].shape[0] if STATE in config.input_features else 25
    env = HypogeumEnv(state_dim=state_dim, action_dim=config.output_features[ACTION].shape[0])
    with small_networks():
        policy = make_policy(config, env_cfg=env, rename_map=rename_map).eval()
    preprocess, postprocess = make_pre_post_processors(
        config,
        pretrained_path=str(folder),
        preprocessor_overrides={name: options for name, options in overrides.items() if name in steps},
    )
    images = {name: feature.shape[1:] for name, feature in config.image_features.items() if is_act}
    sizes = {camera: images.get(rename_map.get(IMAGES + camera, IMAGES + camera)) for camera in CAMERAS}
    sizes = {camera: size for camera, size in sizes.items() if size}
    queries = iter(range(n_steps))
    if not is_act:
        policy.model.sample_noise = lambda shape, _: torch.from_numpy(draw_noise(POLICY_SEED, next(queries), shape))
    relative = next((step for step in preprocess.steps if isinstance(step, RelativeActionsProcessorStep)), None)
    actions, origin = [], None
    policy.reset()
    with torch.inference_mode():
        for step in range(n_steps):
            inputs = preprocess_observation(observation(step, instruction, sizes, state_dim))
            if config.env_state_feature:
                width = config.env_state_feature.shape[0]
                inputs[ENV_STATE] = torch.from_numpy(hashed_embedding(instruction, width)).float()[None]
            inputs["task"] = [instruction]
            inputs = preprocess(inputs)
            if relative:
                origin = origin if policy._action_queue else relative.get_cached_state()
                relative._last_state = origin
            actions.append(postprocess(policy.select_action(inputs)).numpy()[0].copy())
    actions = np.stack(actions)
    if not np.isfinite(actions).all():
        raise ValueError("an action is not finite")
    return actions
