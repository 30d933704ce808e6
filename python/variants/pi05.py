"""Variants of LeRobot's π0.5."""

import json
from functools import partial

from . import CONSTANT, CONSTANT_ENTRY, Base, Variant, announced, config, own_config, refused
from .common import EXTERNAL, HAND, rename_maps, shared_config, statistics, training
from .edits import CONFIG, POST, PRE, PRE_STATE, delete, fill, pick, set_value, write
from .processors import missing_statistics, norm_maps, normalisers, other_steps

PRE_STEPS = [
    "rename_observations_processor",
    "to_batch_processor",
    "relative_actions_processor",
    "normalizer_processor",
    "pi05_prepare_state_tokenizer_processor_step",
    "tokenizer_processor",
    "device_processor",
]
POST_STEPS = ["unnormalizer_processor", "absolute_actions_processor", "device_processor"]
RELATIVE, NORMALISER, PROMPT, TOKENIZER = 2, 3, 4, 5
CHUNK, SIDE, MAX_TOKENS = 10, 56, 160
# Fewer tokens than the prompt of the recorded observations has.
SHORT = 48

BASES = {
    "pi05": Base(
        "pi05/robot",
        [
            set_value(CONFIG, ["n_action_steps"], 4),
            *statistics(
                ("q01", "min", 1.2),
                ("q99", "max", 1.2),
                ("q01", "q10", 0.8),
                ("q99", "q90", 0.8),
                ("q99", "mean", 0.1),
                ("q99", "std", 0.5),
            ),
        ],
        n_steps=6,
    )
}
"""Weights of three cameras and 16 state entries; every kind of statistics; queries at steps 0 and 4."""

RANGES = dict(MIN_MAX=dict(min=-1.0, max=1.0), QUANTILES=dict(q01=-1.0, q99=1.0), QUANTILE10=dict(q10=-1.0, q90=1.0))
TRAINING = dict(
    time_sampling_beta_alpha=1.0,
    time_sampling_beta_beta=1.5,
    time_sampling_scale=0.9,
    time_sampling_offset=0.01,
    gradient_checkpointing=True,
    compile_mode="default",
    freeze_vision_encoder=True,
    train_expert_only=True,
    optimizer_lr=1e-4,
    optimizer_betas=[0.8, 0.9],
    optimizer_eps=1e-6,
    optimizer_weight_decay=0.1,
    optimizer_grad_clip_norm=2.0,
    scheduler_warmup_steps=1,
    scheduler_decay_steps=2,
    scheduler_decay_lr=1e-6,
)


def variants():
    """Return all variants of π0.5."""
    unless_identity = lambda mode: "honoured" if mode == "IDENTITY" else refused("VISUAL")  # noqa: E731
    honoured = lambda _: "honoured"  # noqa: E731
    kinds = dict(VISUAL=unless_identity, STATE=honoured, ACTION=honoured)
    return [
        *shared_config("pi05"),
        *training("pi05", TRAINING),
        *features(),
        *network(),
        *execution(),
        *relative_actions(),
        *prompt(),
        *later_versions(),
        *rename_maps("pi05"),
        *missing_statistics("pi05", NORMALISER, "QUANTILES"),
        *[
            Variant(
                "pi05",
                "normalizer_processor state",
                f"an entry without range, {mode}",
                [
                    set_value(PRE, ["steps", NORMALISER, "config", "norm_map", "STATE"], mode),
                    *[fill(PRE_STATE, f"observation.state.{part}", [16], constant(x)) for part, x in parts.items()],
                ],
            )
            for mode, parts in RANGES.items()
        ],
        *with_image_statistics(norm_maps("pi05", NORMALISER, kinds)),
        *normalisers("pi05", NORMALISER),
        *other_steps("pi05", PRE_STEPS, POST_STEPS),
    ]


def constant(x):
    """Return values of a statistic with 16 entries, equal at the entry of the state that never changes."""
    return [x if idx != CONSTANT_ENTRY else CONSTANT for idx in range(16)]


def with_image_statistics(variants):
    """Add statistics of images to the variants of their mode, which LeRobot's π0.5 otherwise does not compute."""
    values = dict(mean=0.45, std=0.25, min=0.0, max=1.0, q01=0.05, q99=0.95, q10=0.1, q90=0.9)
    edits = [
        fill(PRE_STATE, f"{name}.{part}", [3, 1, 1], [x]) for name in (*EXTERNAL, HAND) for part, x in values.items()
    ]
    for variant in variants:
        if variant.change.startswith("VISUAL"):
            variant.edits += edits
    return variants


def features():
    """Return variants of the inputs and of the normalisation that `config.json` repeats."""
    inputs = lambda change, edits, verdict="honoured": Variant(  # noqa: E731
        "pi05", "config.json input_features", change, edits, verdict=verdict
    )
    mapping = lambda **modes: dict(VISUAL="IDENTITY", STATE="QUANTILES", ACTION="QUANTILES") | modes  # noqa: E731
    environment = {"type": "ENV", "shape": [16]}
    return [
        inputs("without the hand's camera", [delete(CONFIG, ["input_features", HAND])]),
        inputs("cameras in another order", [write(CONFIG, reordered())]),
        inputs(
            "without the state", [delete(CONFIG, ["input_features", "observation.state"])], refused("observation.state")
        ),
        inputs(
            "an environment state",
            [set_value(CONFIG, ["input_features", "observation.environment_state"], environment)],
        ),
        inputs(
            "images of another aspect",
            [set_value(CONFIG, ["input_features", EXTERNAL[0], "shape"], [3, 480, 640])],
            announced("instead of 640x480"),
        ),
        # LeRobot takes the modes from the processors.
        config("pi05", "normalization_mapping", mapping(STATE="MIN_MAX", ACTION="MIN_MAX")),
        config("pi05", "normalization_mapping", mapping(STATE="MEDIAN"), refused("MEDIAN")),
        Variant("pi05", "config.json normalization_mapping", "absent", [delete(CONFIG, ["normalization_mapping"])]),
        config(
            "pi05",
            "normalization_mapping",
            dict.fromkeys(("VISUAL", "STATE", "ACTION"), "IDENTITY"),
            edits=[delete(file, ["steps", idx, "state_file"]) for file, idx in ((PRE, NORMALISER), (POST, 0))]
            + [
                set_value(
                    file, ["steps", idx, "config", "norm_map"], dict.fromkeys(("VISUAL", "STATE", "ACTION"), "IDENTITY")
                )
                for file, idx in ((PRE, NORMALISER), (POST, 0))
            ],
            change="IDENTITY everywhere, and no statistics",
        ),
    ]


def reordered():
    """Return a `config.json` with the cameras in another order, and otherwise like the base's."""
    image = lambda side: {"type": "VISUAL", "shape": [3, side, side]}  # noqa: E731
    inputs = {HAND: image(128), "observation.state": {"type": "STATE", "shape": [16]}}
    inputs |= {name: image(224) for name in EXTERNAL[::-1]}
    outputs = {"action": {"type": "ACTION", "shape": [7]}}
    values = dict(
        type="pi05",
        input_features=inputs,
        output_features=outputs,
        device="cpu",
        chunk_size=CHUNK,
        n_action_steps=4,
        image_resolution=[SIDE, SIDE],
        tokenizer_max_length=MAX_TOKENS,
        use_relative_actions=False,
    )
    return json.dumps(values, indent=2) + "\n"


def network():
    """Return variants of the network."""
    one = lambda key, value, *args, **options: config("pi05", key, value, *args, **options)  # noqa: E731
    empty = {"type": "VISUAL", "shape": [3, SIDE, SIDE]}
    return [
        one("type", "smolvla", refused("smolvla")),
        one("paligemma_variant", "gemma_300m"),
        one("action_expert_variant", "gemma_2b"),
        # A precision in which LeRobot computes.
        own_config("pi05", "dtype", "bfloat16", announced("dtype")),
        one("dtype", "float32"),
        one("max_state_dim", 20),
        one("max_state_dim", 8, refused("at most 8 entries")),
        one("max_action_dim", 16, refused("max_action_dim")),
        one("num_inference_steps", 1),
        one("num_inference_steps", 7),
        one("num_inference_steps", 0, refused("num_inference_steps")),
        one("min_period", 0.02),
        one("max_period", 2.0),
        one("image_resolution", [84, 84], refused("image_resolution")),
        one("image_resolution", [56, 84], refused("image_resolution")),
        one("empty_cameras", 1),
        one(
            "empty_cameras",
            2,
            edits=[
                set_value(CONFIG, ["input_features", f"observation.images.empty_camera_{idx}"], empty)
                for idx in range(2)
            ],
            change="2, and they are among the inputs",
        ),
        # Compiled code computes the same, but takes minutes to compile.
        own_config("pi05", "compile_model", True),
        Variant(
            "pi05",
            "config.json image_resolution",
            "absent",
            [delete(CONFIG, ["image_resolution"])],
            verdict=refused("image_resolution"),
        ),
    ]


def execution():
    """Return variants of the chunk and its use."""
    one = lambda key, value, *args, **options: config("pi05", key, value, *args, **options)  # noqa: E731
    rows = lambda n: [set_value(CONFIG, ["n_action_steps"], n)]  # noqa: E731
    rtc = dict(
        enabled=True,
        prefix_attention_schedule="LINEAR",
        max_guidance_weight=10.0,
        execution_horizon=10,
        debug=False,
        debug_maxlen=100,
    )
    return [
        one("n_action_steps", 1, n_steps=3),
        one("n_action_steps", CHUNK, n_steps=CHUNK + 2),
        one("n_action_steps", CHUNK + 1, refused("n_action_steps")),
        one("n_action_steps", 0, refused("n_action_steps")),
        Variant(
            "pi05",
            "config.json n_action_steps",
            "absent",
            [delete(CONFIG, ["n_action_steps"])],
            verdict=refused("n_action_steps"),
        ),
        one("chunk_size", 5),
        one("chunk_size", 70, edits=rows(70), n_steps=72),
        one("chunk_size", 150),
        one("chunk_size", 150, refused("n_action_steps"), rows(150), change="150, and n_action_steps too"),
        Variant("pi05", "config.json chunk_size", "absent", [delete(CONFIG, ["chunk_size"])]),
        one("rtc_config", rtc, refused("rtc_config"), change="enabled"),
        one("rtc_config", rtc | dict(enabled=False), change="not enabled"),
        one("rtc_config", rtc | dict(enabled=False, unknown_key=1), refused("rtc_config"), change="an unknown key"),
        Variant(
            "pi05",
            "config.json temporal_ensemble_coeff",
            "0.01, n_action_steps 1",
            [set_value(CONFIG, ["temporal_ensemble_coeff"], 0.01), set_value(CONFIG, ["n_action_steps"], 1)],
            verdict=refused("temporal_ensemble_coeff"),
        ),
    ]


def relative_actions():
    """Return variants of actions relative to the state."""
    relative = lambda key, value: set_value(PRE, ["steps", RELATIVE, "config", key], value)  # noqa: E731
    steps = [relative("enabled", True), set_value(POST, ["steps", 1, "config", "enabled"], True)]
    enabled = [*steps, set_value(CONFIG, ["use_relative_actions"], True)]
    step = lambda name, key, change, edits, verdict="honoured": Variant(  # noqa: E731
        "pi05", f"{name} {key}", change, edits, verdict=verdict
    )
    names = [f"joint{idx}" for idx in range(6)] + ["gripper"]
    return [
        config("pi05", "use_relative_actions", True, refused("use_relative_actions")),
        config("pi05", "relative_exclude_joints", []),
        config("pi05", "action_feature_names", names),
        step("relative_actions_processor", "enabled", "true, as in the other step and in config.json", enabled),
        step(
            "relative_actions_processor",
            "enabled",
            "1, as in the other step",
            [relative("enabled", 1), set_value(POST, ["steps", 1, "config", "enabled"], 1), enabled[2]],
        ),
        step("relative_actions_processor", "enabled", "true in both steps", steps, refused("use_relative_actions")),
        step("relative_actions_processor", "enabled", "true", [steps[0]], refused("relative_actions_processor")),
        step("absolute_actions_processor", "enabled", "true", [steps[1]], refused("absolute_actions_processor")),
        step(
            "policy_preprocessor.json",
            "steps",
            "without relative_actions_processor, relative actions",
            [*enabled, pick(PRE, [0, 1, 3, 4, 5, 6])],
            refused("relative_actions_processor"),
        ),
        step(
            "absolute_actions_processor",
            "relative_step",
            "null",
            [set_value(POST, ["steps", 1, "config", "relative_step"], None)],
            refused("relative_step"),
        ),
        step(
            "absolute_actions_processor",
            "unknown_key",
            "1",
            [set_value(POST, ["steps", 1, "config", "unknown_key"], 1)],
            refused("unknown_key"),
        ),
        step("relative_actions_processor", "exclude_joints", "none", [relative("exclude_joints", [])]),
        step(
            "relative_actions_processor",
            "exclude_joints",
            "none, relative actions",
            [*enabled, relative("exclude_joints", []), relative("action_names", names)],
        ),
        step(
            "relative_actions_processor",
            "exclude_joints",
            "a part of two names, in capitals, and no name",
            [
                *enabled,
                relative("exclude_joints", ["INT1", "", "gripper"]),
                relative("action_names", ["joint1", "x", "Joint10", "y", "z", "w", "gripper"]),
            ],
        ),
        step(
            "relative_actions_processor",
            "exclude_joints",
            "null",
            [*enabled, relative("exclude_joints", None), relative("action_names", names)],
        ),
        step("relative_actions_processor", "action_names", "names of joints", [relative("action_names", names)]),
        step(
            "relative_actions_processor",
            "action_names",
            "names of joints, relative actions",
            [*enabled, relative("action_names", names)],
        ),
        step(
            "relative_actions_processor",
            "action_names",
            "fewer than entries",
            [*enabled, relative("exclude_joints", ["joint1"]), relative("action_names", names[:3])],
        ),
        step(
            "relative_actions_processor",
            "action_names",
            "more than entries",
            [*enabled, relative("exclude_joints", ["joint1"]), relative("action_names", [*names, "joint1", "joint1"])],
        ),
        step(
            "policy_preprocessor.json", "steps", "without relative_actions_processor", [pick(PRE, [0, 1, 3, 4, 5, 6])]
        ),
        step("policy_postprocessor.json", "steps", "without absolute_actions_processor", [pick(POST, [0, 2])]),
    ]


def prompt():
    """Return variants of the two steps that write the prompt and split it."""

    def step(idx, name, key, value, verdict="honoured", edits=(), change=None):
        put = set_value(PRE, ["steps", idx, "config", key], value)
        return Variant("pi05", f"{name} {key}", change or json.dumps(value), [put, *edits], verdict=verdict)

    tokens = partial(step, TOKENIZER, "tokenizer_processor")
    text = partial(step, PROMPT, "pi05_prepare_state_tokenizer_processor_step")
    both = [set_value(PRE, ["steps", TOKENIZER, "config", "task_key"], "instruction")]
    return [
        config("pi05", "tokenizer_max_length", SHORT),
        config("pi05", "tokenizer_max_length", 500),
        tokens("max_length", 500),
        tokens("max_length", SHORT),
        tokens("max_length", 0, refused("max_length")),
        tokens("tokenizer_name", "google/paligemma-3b-pt-224"),
        tokens("tokenizer_name", "google/gemma-2b", announced("google/gemma-2b")),
        tokens("tokenizer", None, refused("tokenizer")),
        tokens("task_key", "instruction", refused("task_key")),
        tokens("padding_side", "left"),
        tokens("padding", "longest"),
        tokens("truncation", False),
        *[
            Variant("pi05", f"tokenizer_processor {key}", "absent", [delete(PRE, ["steps", TOKENIZER, "config", key])])
            for key in ("max_length", "task_key", "padding_side", "padding", "truncation")
        ],
        text("task_key", "instruction", refused("task_key")),
        text("task_key", "instruction", refused("task_key"), both, change="instruction, in both steps"),
        text("max_state_dim", 64),
        text("max_state_dim", 8),
        Variant(
            "pi05",
            "policy_preprocessor.json steps",
            "without the prompt's",
            [pick(PRE, [0, 1, 2, 3, 5, 6])],
            verdict=refused("pi05_prepare_state_tokenizer_processor_step"),
        ),
        Variant(
            "pi05",
            "policy_preprocessor.json steps",
            "without the tokenizer's",
            [pick(PRE, [0, 1, 2, 3, 4, 6])],
            verdict=refused("tokenizer_processor"),
        ),
        Variant(
            "pi05",
            "policy_preprocessor.json steps",
            "the prompt before normalisation",
            [pick(PRE, [0, 1, 2, 4, 3, 5, 6])],
            verdict=refused("steps"),
        ),
        Variant(
            "pi05",
            "policy_preprocessor.json steps",
            "tokens before the prompt",
            [pick(PRE, [0, 1, 2, 3, 5, 4, 6])],
            verdict=refused("steps"),
        ),
    ]


def later_versions():
    """Return variants of settings that LeRobot has after 0.6.1: values that leave the actions alone, and others."""
    state = lambda value: [set_value(PRE, ["steps", PROMPT, "config", "include_state_in_prompt"], value)]  # noqa: E731
    later = lambda key, value, verdict="honoured": own_config("pi05", key, value, verdict)  # noqa: E731
    step, key = "pi05_prepare_state_tokenizer_processor_step", "include_state_in_prompt"
    return [
        later("use_visual_memory", False),
        later("use_visual_memory", True, refused("use_visual_memory")),
        later("use_proprioceptive_memory", False),
        later("use_proprioceptive_memory", True, refused("use_proprioceptive_memory")),
        later("memory_frames", 3),
        later("memory_stride", 10),
        later("memory_temporal_attention_every", 2),
        later("rtc_training_max_delay", 0),
        later("rtc_training_max_delay", 4),
        Variant("pi05", f"{step} {key}", "true", own=state(True)),
        Variant("pi05", f"{step} {key}", "false", own=state(False), verdict=refused(key)),
    ]
