"""Variants of LeRobot's ACT."""

from . import CONSTANT, CONSTANT_ENTRY, Base, Variant, announced, config, refused
from .common import EXTERNAL, HAND, rename_maps, shared_config, statistics, training
from .edits import CONFIG, POST, POST_STATE, PRE, PRE_STATE, WEIGHTS, copy, delete, drop, fill, pick, resize, set_value
from .processors import missing_statistics, norm_maps, normalisers, other_steps

PRE_STEPS = ["rename_observations_processor", "to_batch_processor", "device_processor", "normalizer_processor"]
POST_STEPS = ["unnormalizer_processor", "device_processor"]
NORMALISER = 3
CHUNK, QUERIES = 70, "model.decoder_pos_embed.weight"
WIDTH, STATE_DIM, ACTION_DIM = 32, 25, 7

BASES = {
    "act": Base(
        "lerobot/robot",
        [
            set_value(CONFIG, ["temporal_ensemble_coeff"], None),
            set_value(CONFIG, ["n_action_steps"], 5),
            *statistics(("min", "q01", 0.9), ("max", "q99", 0.9), ("min", "q10", 0.5), ("max", "q90", 0.5)),
        ],
        n_steps=12,
    )
}
"""Weights of three cameras, 25 state entries and an instruction; all statistics; queries at steps 0, 5 and 10."""

TRAINING = dict(
    pretrained_backbone_weights="ResNet18_Weights.IMAGENET1K_V1",
    use_vae=False,
    n_vae_encoder_layers=3,
    dropout=0.5,
    kl_weight=1.0,
    optimizer_lr=1e-4,
    optimizer_weight_decay=0.1,
    optimizer_lr_backbone=1e-4,
)
# Keys of `config.json` whose values in the base are LeRobot's defaults.
DEFAULTS = [
    "n_obs_steps",
    "device",
    "use_amp",
    "use_peft",
    "push_to_hub",
    "normalization_mapping",
    "vision_backbone",
    "replace_final_stride_with_dilation",
    "pre_norm",
    "feedforward_activation",
    "n_decoder_layers",
    "use_vae",
    "temporal_ensemble_coeff",
    "dropout",
    "kl_weight",
    "optimizer_lr",
    "optimizer_weight_decay",
    "optimizer_lr_backbone",
]


def variants():
    """Return all variants of ACT."""
    # The network's size is in the file twice: once in `config.json` and once in the shapes of the tensors.
    honoured_mode = lambda _: "honoured"  # noqa: E731
    kinds = dict.fromkeys(("VISUAL", "STATE", "ENV", "ACTION"), honoured_mode)
    return [
        *shared_config("act"),
        *training("act", TRAINING),
        *features(),
        *architecture(),
        *execution(),
        *rename_maps("act"),
        *missing_statistics("act", NORMALISER, "MEAN_STD"),
        *norm_maps("act", NORMALISER, kinds),
        *normalisers("act", NORMALISER),
        *ranges(),
        *other_steps("act", PRE_STEPS, POST_STEPS),
    ]


def features():
    """Return variants of the inputs and of the normalisation that `config.json` repeats."""
    inputs = lambda change, edits, verdict="honoured": Variant(  # noqa: E731
        "act", "config.json input_features", change, edits, verdict=verdict
    )
    mapping = lambda value, verdict="honoured", edits=(): config(  # noqa: E731
        "act", "normalization_mapping", value, verdict, edits
    )
    identity = dict.fromkeys(("VISUAL", "STATE", "ACTION"), "IDENTITY")
    return [
        inputs("absent", [delete(CONFIG, ["input_features"])], refused("input_features")),
        inputs("null", [set_value(CONFIG, ["input_features"], None)], refused("input_features")),
        inputs("without the hand's camera", [delete(CONFIG, ["input_features", HAND])]),
        inputs(
            "without the state",
            [
                delete(CONFIG, ["input_features", "observation.state"]),
                drop(WEIGHTS, "robot_state_input_proj"),
                drop(WEIGHTS, "vae_encoder_pos_enc"),
                resize(WEIGHTS, "model.encoder_1d_feature_pos_embed.weight", [2, WIDTH]),
            ],
        ),
        inputs(
            "images of another aspect",
            [set_value(CONFIG, ["input_features", EXTERNAL[0], "shape"], [3, 96, 128])],
            announced("instead of 128x96"),
        ),
        inputs(
            "images of the robot's size", [set_value(CONFIG, ["input_features", EXTERNAL[0], "shape"], [3, 224, 224])]
        ),
        inputs(
            "images with four channels",
            [set_value(CONFIG, ["input_features", HAND, "shape"], [4, 64, 64])],
            refused(HAND),
        ),
        Variant(
            "act",
            "config.json output_features",
            "absent",
            [delete(CONFIG, ["output_features"])],
            verdict=refused("output_features"),
        ),
        # LeRobot takes the modes from the processors.
        mapping(dict(VISUAL="MEAN_STD", STATE="MIN_MAX", ACTION="MIN_MAX")),
        mapping(dict(VISUAL="MEDIAN", STATE="MEAN_STD", ACTION="MEAN_STD"), refused("MEDIAN")),
        Variant("act", "config.json normalization_mapping", "absent", [delete(CONFIG, ["normalization_mapping"])]),
        Variant(
            "act",
            "config.json normalization_mapping",
            "IDENTITY, and no steps that normalise",
            [set_value(CONFIG, ["normalization_mapping"], identity), pick(PRE, [0, 1, 2]), pick(POST, [1])],
        ),
        Variant(
            "act",
            "config.json normalization_mapping",
            "IDENTITY everywhere, and no statistics",
            [
                set_value(CONFIG, ["normalization_mapping"], identity),
                set_value(PRE, ["steps", NORMALISER, "config", "norm_map"], identity),
                set_value(POST, ["steps", 0, "config", "norm_map"], identity),
                delete(PRE, ["steps", NORMALISER, "state_file"]),
                delete(POST, ["steps", 0, "state_file"]),
            ],
        ),
    ]


def architecture():
    """Return variants of the network."""
    one = lambda key, value, *args, **options: config("act", key, value, *args, **options)  # noqa: E731
    # ResNet-34 has 3, 4, 6 and 3 blocks in place of 2 each.
    blocks = [(1, 2), (2, 2), (2, 3), (3, 2), (3, 3), (3, 4), (3, 5), (4, 2)]
    deeper = [copy(WEIGHTS, f"backbone.layer{stage}.1.", f"backbone.layer{stage}.{idx}.") for stage, idx in blocks]
    return [
        Variant(
            "act", "config.json", "without keys whose values are defaults", [delete(CONFIG, [key]) for key in DEFAULTS]
        ),
        Variant("act", "config.json n_heads", "absent", [delete(CONFIG, ["n_heads"])]),
        Variant("act", "config.json dim_model", "absent", [delete(CONFIG, ["dim_model"])], verdict=refused("model.")),
        one("type", "diffusion", refused("diffusion")),
        one("vision_backbone", "resnet34", edits=deeper),
        one("vision_backbone", "resnet34", refused("layer"), change="resnet34, with weights of another"),
        one("vision_backbone", "resnet50", refused("vision_backbone")),
        one("vision_backbone", "vit_b_16", refused("vision_backbone")),
        one("replace_final_stride_with_dilation", True, refused("replace_final_stride_with_dilation")),
        one("replace_final_stride_with_dilation", 0),
        one("pre_norm", True, refused("pre_norm")),
        one("dim_model", 64, refused("model.")),
        one("n_heads", 2),
        one("n_heads", 5, refused("number of heads, 5")),
        one("dim_feedforward", 64, refused("linear1")),
        one("feedforward_activation", "gelu", refused("feedforward_activation")),
        one("feedforward_activation", "glu", refused("feedforward_activation")),
        one("feedforward_activation", "tanh", refused("feedforward_activation")),
        one("n_encoder_layers", 1, refused("encoder.layers.1")),
        one("n_encoder_layers", 3, refused("encoder.layers.2")),
        one(
            "n_encoder_layers",
            3,
            edits=[copy(WEIGHTS, "model.encoder.layers.1.", "model.encoder.layers.2.")],
            change="3, with weights",
        ),
        one("n_decoder_layers", 2, edits=[copy(WEIGHTS, "model.decoder.layers.0.", "model.decoder.layers.1.")]),
        # The latent is zero at inference, so that only the size of an unused tensor changes.
        one(
            "latent_dim",
            8,
            edits=[
                resize(WEIGHTS, "model.encoder_latent_input_proj.weight", [WIDTH, 8]),
                drop(WEIGHTS, "vae_encoder_latent_output_proj"),
            ],
        ),
    ]


def execution():
    """Return variants of the chunk and its use."""
    one = lambda key, value, *args, **options: config("act", key, value, *args, **options)  # noqa: E731
    chunk = lambda rows: [resize(WEIGHTS, QUERIES, [rows, WIDTH]), drop(WEIGHTS, "vae_encoder_pos_enc")]  # noqa: E731
    steps = lambda n: [set_value(CONFIG, ["n_action_steps"], n)]  # noqa: E731
    return [
        one("n_action_steps", 1),
        one("n_action_steps", 7),
        one("n_action_steps", CHUNK, n_steps=CHUNK + 2),
        one("n_action_steps", CHUNK + 1, refused("n_action_steps")),
        one("n_action_steps", 0, refused("n_action_steps")),
        # LeRobot's default of 100 rows exceeds the chunk.
        Variant(
            "act",
            "config.json n_action_steps",
            "absent",
            [delete(CONFIG, ["n_action_steps"])],
            verdict=refused("n_action_steps"),
        ),
        one("chunk_size", 3, edits=[*chunk(3), *steps(3)]),
        one("chunk_size", 100, edits=[*chunk(100), *steps(100)], n_steps=102),
        one("chunk_size", 150, edits=chunk(150)),
        one(
            "chunk_size",
            150,
            refused("n_action_steps"),
            [*chunk(150), *steps(150)],
            change="150, and n_action_steps too",
        ),
        one("chunk_size", 150, edits=[*chunk(150), *steps(127)], n_steps=129, change="150, of which 127 are executed"),
        one("chunk_size", 20, refused(QUERIES)),
        Variant(
            "act",
            "config.json chunk_size",
            "absent",
            [delete(CONFIG, ["chunk_size"])],
            verdict=refused("decoder_pos_embed"),
        ),
        Variant(
            "act",
            "config.json chunk_size",
            "absent, and n_action_steps too; 100 rows",
            [delete(CONFIG, ["chunk_size"]), delete(CONFIG, ["n_action_steps"]), *chunk(100)],
            n_steps=102,
        ),
        *[one("temporal_ensemble_coeff", value, edits=steps(1)) for value in (0.01, 0.0, -0.1, 0.05)],
        one(
            "temporal_ensemble_coeff",
            0.01,
            edits=[*steps(1), *chunk(4), set_value(CONFIG, ["chunk_size"], 4)],
            change="0.01, chunk_size 4",
        ),
        one(
            "temporal_ensemble_coeff",
            0.01,
            edits=[*steps(1), *chunk(150), set_value(CONFIG, ["chunk_size"], 150)],
            change="0.01, chunk_size 150",
        ),
        one("temporal_ensemble_coeff", 0.01, refused("temporal_ensemble_coeff"), change="0.01, n_action_steps 5"),
    ]


def ranges():
    """Return variants whose statistics leave an entry no range, and of the shape of images' statistics."""
    mode = lambda mode: [set_value(PRE, ["steps", NORMALISER, "config", "norm_map", "STATE"], mode)]  # noqa: E731
    constant = lambda low, high, value: [  # noqa: E731
        fill(
            PRE_STATE,
            f"observation.state.{low}",
            [STATE_DIM],
            [-1.0] * CONSTANT_ENTRY + [value] + [-1.0] * (STATE_DIM - 1 - CONSTANT_ENTRY),
        ),
        fill(
            PRE_STATE,
            f"observation.state.{high}",
            [STATE_DIM],
            [1.0] * CONSTANT_ENTRY + [value] + [1.0] * (STATE_DIM - 1 - CONSTANT_ENTRY),
        ),
    ]
    eps = [set_value(PRE, ["steps", NORMALISER, "config", "eps"], 0.25)]
    variant = lambda change, edits: Variant("act", "normalizer_processor state", change, edits)  # noqa: E731
    action = lambda low, high, part: (
        [fill(POST_STATE, f"action.{name}", [ACTION_DIM], [0.25]) for name in (low, high)]
        + [  # noqa: E731
            set_value(POST, ["steps", 0, "config", "norm_map", "ACTION"], part)
        ]
    )
    return [
        variant("an entry without range, MIN_MAX", [*mode("MIN_MAX"), *constant("min", "max", CONSTANT)]),
        variant("an entry without range, QUANTILES", [*mode("QUANTILES"), *constant("q01", "q99", CONSTANT)]),
        variant(
            "an entry without range, QUANTILE10, eps 0.25", [*mode("QUANTILE10"), *constant("q10", "q90", 0.0), *eps]
        ),
        variant(
            "standard deviation 0",
            [
                fill(PRE_STATE, "observation.state.mean", [STATE_DIM], [CONSTANT]),
                fill(PRE_STATE, "observation.state.std", [STATE_DIM], [1.0] * CONSTANT_ENTRY + [0.0] + [1.0] * 16),
            ],
        ),
        Variant("act", "unnormalizer_processor state", "no range, MIN_MAX", action("min", "max", "MIN_MAX")),
        Variant("act", "unnormalizer_processor state", "no range, QUANTILES", action("q01", "q99", "QUANTILES")),
        Variant(
            "act",
            "normalizer_processor state",
            "images' statistics without the axes of pixels",
            [fill(PRE_STATE, f"{HAND}.{part}", [3], [0.4, 0.5, 0.6]) for part in ("mean", "std")],
        ),
        Variant(
            "act",
            "normalizer_processor state",
            "one statistic of another width",
            verdict=refused("observation.state"),
            edits=[fill(PRE_STATE, "observation.state.mean", [7], [0.4])],
        ),
        Variant("act", "normalizer_processor norm_map", "all of them MIN_MAX", in_both_maps("MIN_MAX")),
    ]


def in_both_maps(mode):
    """Return edits that give all features one mode."""
    modes = dict.fromkeys(("VISUAL", "STATE", "ENV", "ACTION"), mode)
    return [
        set_value(PRE, ["steps", NORMALISER, "config", "norm_map"], modes),
        set_value(POST, ["steps", 0, "config", "norm_map"], modes),
    ]
