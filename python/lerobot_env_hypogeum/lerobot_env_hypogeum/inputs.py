"""The features that a policy reads: those of its checkpoint, or those of a dataset that `hypogeum demos` records."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lerobot.configs.policies import PreTrainedConfig
from safetensors import safe_open

from hypogeum.layout import MORPHOLOGIES
from hypogeum.lerobot.kinds import FLOW
from hypogeum.lerobot.processors import HASHED, PREPROCESSOR, read_steps
from hypogeum.lerobot.settings import read_features
from hypogeum.mapping import IMAGES, STATE, Feature, Mapping, MappingError, make_mapping, read_settings

ENVIRONMENT_STATE = "observation.environment_state"
# Width of the instruction's embedding in a dataset.
EMBEDDING_DIM = 64
# Names of the evaluations, see docs/protocols.md, and the image size by which the second one is known.
ACT, LEROBOT = "act", "lerobot"
LEROBOT_SIZE = (480, 640)


@dataclass(frozen=True)
class Inputs:
    """Input features of a policy and what is known of their meaning."""

    features: dict[str, Feature]
    action_dim: int
    settings: dict[str, Any] = field(default_factory=dict)
    """Contents of `hypogeum.json`."""
    rename_map: dict[str, str] = field(default_factory=dict)
    hashed: frozenset[str] = frozenset()
    """Names of the features that are hashed embeddings of the instruction."""
    resizes_images: bool = False
    """Whether the policy resizes images itself."""

    @property
    def protocol(self) -> str | None:
        """The protocol that the policy was trained for, or None if it says nothing of it."""
        sizes = {feature.shape[1:] for feature in self.features.values() if feature.kind == "VISUAL"}
        named: str | None = self.settings.get("protocol")
        return named or (LEROBOT if sizes == {LEROBOT_SIZE} else None)

    def mapping(self, control_mode: str | None) -> Mapping:
        """Return the sources of the features.

        Args:
            control_mode: Control mode, or None for the one that the width of the actions says.

        Raises:
            MappingError: A feature has no source, or the actions fit no control mode.
        """
        settings = self.settings | ({"control_mode": control_mode} if control_mode else {})
        found: Mapping = make_mapping(
            self.features, self.action_dim, settings, self.resizes_images, self.rename_map, self.hashed
        )
        strange = [name for name in found.images if not name.startswith(IMAGES)]
        if strange:
            raise MappingError(f"{strange[0]}: lerobot-eval reads cameras as {IMAGES}NAME only")
        return found


def checkpoint_inputs(path: str) -> Inputs:
    """Return the inputs of a checkpoint: a folder, or a repository on the hub without a `hypogeum.json`.

    Raises:
        MappingError: A file is missing or invalid.
    """
    folder = Path(path)
    is_local = folder.is_dir()
    config = PreTrainedConfig.from_pretrained(path)
    if config.action_feature is None:
        raise MappingError(f"{path} has no output feature 'action'")
    renames: dict[str, str] = {}
    for step in read_steps(folder, PREPROCESSOR) if is_local else []:
        renames |= step.get("config", {}).get("rename_map") or {}
    return Inputs(
        features=read_features(config),
        action_dim=config.action_feature.shape[0],
        settings=read_settings(folder) if is_local else {},
        rename_map=renames,
        hashed=frozenset(name for path in folder.glob("policy_preprocessor_*.safetensors") for name in _hashed(path)),
        resizes_images=config.type in FLOW and getattr(config, "resize_imgs_with_padding", True) is not None,
    )


def dataset_inputs(
    protocol: str, morphology: str, sizes: dict[str, tuple[int, int]], action_dim: int, shrink: int
) -> Inputs:
    """Return the features of a dataset that `hypogeum demos` records, see docs/demonstrations.md.

    Args:
        protocol: Name of the protocol.
        morphology: Name of the morphology.
        sizes: Height and width of each camera's images.
        action_dim: Width of an action row.
        shrink: Divisor of heights and widths, as `--shrink` of `hypogeum demos`.
    """
    is_short = protocol != LEROBOT
    parts = dict(MORPHOLOGIES[morphology].state_parts)
    features = {
        f"{IMAGES}{camera.removesuffix('_camera') if is_short else camera}": Feature(
            "VISUAL", (3, height // shrink, width // shrink)
        )
        for camera, (height, width) in sizes.items()
    }
    features[STATE] = Feature("STATE", (sum(parts.values()) if is_short else parts["qpos"],))
    if is_short:
        features[ENVIRONMENT_STATE] = Feature("ENV", (EMBEDDING_DIM,))
    # The width of the actions may be that of two control modes and two morphologies.
    return Inputs(features, action_dim, {"morphology": morphology}, hashed=frozenset([ENVIRONMENT_STATE]))


def _hashed(path: Path) -> list[str]:
    with safe_open(path, "numpy") as file:
        return [name.removesuffix(f".{HASHED}") for name in file.keys() if name.endswith(f".{HASHED}")]
