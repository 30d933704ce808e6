"""LeRobot's policy types, by what their action chunks depend on.

A host answers for many episodes at a time, so a policy may remember nothing but what this package gives it back for
each episode. Determined from the sources of LeRobot 0.6.1 and of its main branch in August 2026; other types are
refused.
"""

from ..mapping import MappingError

# Policies that turn a given noise into actions by flow matching.
FLOW = ("pi0", "pi05", "smolvla")
# Policies whose noise is drawn for each env on its own, so that envs may be computed as one batch.
BATCHABLE = ("act", "diffusion", *FLOW)
# Policies whose chunk is a function of the current observation and of noise.
CURRENT = (
    "act", "eo1", "evo1", "fastwam", "groot", "molmoact2", "pi0_fast", "vla_jepa", "wall_x", "xvla", *FLOW,
)  # fmt: skip
# Policies whose chunk is a function of the last observations, which `hypogeum.history` keeps.
HISTORY = ("diffusion", "multi_task_dit", "vqbet")
REFUSED = {
    "gaussian_actor": "it selects single actions and predicts no chunks",
    "lingbot_va": "its cache of earlier frames and actions belongs to a single episode",
    "tdmpc": "each of its plans starts from the previous one, which belongs to a single episode",
}
# Policies that read an environment state; LeRobot's others ignore it.
READS_ENVIRONMENT_STATE = ("act", "diffusion")
# Policies whose chunks have `n_action_steps` rows.
SHORT_CHUNKS = (*HISTORY, "molmoact2", "pi0_fast")
# Properties of a configuration that list the observations for training, relative to the current one.
OBSERVATIONS = ("observation_delta_indices", "image_observation_delta_indices", "state_observation_delta_indices")
# Settings that give a type in `CURRENT` a memory.
MEMORIES = ("use_visual_memory", "use_proprioceptive_memory")


def check_memory(config):
    """Raise `MappingError` if a policy remembers what this package does not keep for each episode.

    Args:
        config: LeRobot's configuration of the policy.
    """
    kind = config.type
    if kind in REFUSED:
        raise MappingError(f"policies of type {kind!r} cannot be served: {REFUSED[kind]}")
    if kind not in CURRENT and kind not in HISTORY:
        raise MappingError(
            f"policies of type {kind!r} cannot be served: it is unknown whether they remember anything between "
            f"queries, which would mix episodes; known types: {', '.join(sorted(CURRENT + HISTORY))}"
        )
    settings = [name for name in MEMORIES if getattr(config, name, False)]
    earlier = [name for name in OBSERVATIONS if any(idx < 0 for idx in getattr(config, name, None) or ())]
    if kind in CURRENT and (settings or earlier):
        raise MappingError(
            f"{' and '.join(settings or earlier)} of the checkpoint cannot be served: the policy would remember "
            "earlier observations of a single episode, and this host answers for many"
        )
