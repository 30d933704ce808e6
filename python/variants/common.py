"""Variants of what both policies have in `config.json`, and of the names of features."""

from . import Variant, announced, config, own_config, refused
from .edits import CONFIG, POST, POST_STATE, PRE, PRE_STATE, SIDECAR, copy, delete, rename, set_value

STATES = {PRE: PRE_STATE, POST: POST_STATE}
EXTERNAL = ["observation.images.external1", "observation.images.external2"]
HAND = "observation.images.hand"


def in_both(edit, *args, **kwargs):
    """Return an edit of the statistics of both processors."""
    return [edit(state, *args, **kwargs) for state in STATES.values()]


def statistics(*derived):
    """Return edits that derive statistics from others: `(from, to, factor)`, the factor positive."""
    return [edit for part, to, scale in derived for edit in in_both(copy, f".{part}", f".{to}", scale)]


def shared_config(base):
    """Return variants of the keys that every policy of LeRobot has in `config.json`."""
    return [
        config(base, "n_obs_steps", 2, refused("n_obs_steps")),
        config(base, "device", "cuda"),
        config(base, "device", None),
        config(base, "use_amp", False),
        # Mixed precision changes LeRobot's rounding alone.
        own_config(base, "use_amp", True, announced("use_amp")),
        config(base, "use_peft", True, refused("use_peft")),
        config(base, "push_to_hub", False),
        config(base, "repo_id", "someone/policy"),
        config(base, "private", True),
        config(base, "tags", ["robotics"]),
        config(base, "license", "mit"),
        config(base, "pretrained_path", "outputs/train/checkpoints/last/pretrained_model"),
        config(base, "pretrained_revision", "main"),
        config(base, "unknown_key", 1, refused("unknown_key")),
        Variant(
            base,
            "hypogeum.json ignore",
            "an unknown key of config.json",
            verdict=announced("unknown_key"),
            own=[set_value(CONFIG, ["unknown_key"], 1), set_value(SIDECAR, ["ignore"], ["unknown_key"])],
        ),
        config(base, "input_features", {}, refused(dict(act="is empty", pi05="observation.state")[base])),
        config(base, "output_features", {}, refused(dict(act="output_features", pi05="actions have 32 entries")[base])),
        Variant(
            base,
            "config.json output_features",
            "an action of another width",
            verdict=refused("action"),
            edits=[set_value(CONFIG, ["output_features", "action", "shape"], [5])],
        ),
        Variant(
            base,
            "config.json input_features",
            "an input of type REWARD",
            verdict=refused("`REWARD`"),
            edits=[set_value(CONFIG, ["input_features", "observation.reward"], {"type": "REWARD", "shape": [1]})],
        ),
        Variant(
            base,
            "config.json input_features",
            "an input of type LANGUAGE",
            verdict=refused("`LANGUAGE`"),
            edits=[set_value(CONFIG, ["input_features", "observation.language"], {"type": "LANGUAGE", "shape": [1]})],
        ),
        Variant(
            base,
            "config.json input_features",
            "a camera that the robot does not have",
            verdict=refused("observation.images.nose"),
            edits=[
                set_value(
                    CONFIG, ["input_features", "observation.images.nose"], {"type": "VISUAL", "shape": [3, 96, 96]}
                )
            ],
        ),
    ]


def training(base, values):
    """Return variants of the keys of `config.json` that only training reads."""
    return [config(base, key, value) for key, value in values.items()]


def rename_maps(base):
    """Return variants of the map from the robot's names to the policy's."""
    setting, path = "rename_observations_processor rename_map", ["steps", 0, "config", "rename_map"]
    variant = lambda change, names, edits=(), **others: Variant(  # noqa: E731
        base, setting, change, [set_value(PRE, path, names), *edits], **others
    )
    first, second = EXTERNAL
    own_names = {name: f"observation.images.camera{idx}" for idx, name in enumerate([*EXTERNAL, HAND])}
    renamed = [
        edit
        for name, own in own_names.items()
        for edit in (rename(PRE_STATE, name, own), rename(POST_STATE, name, own))
    ]
    return [
        variant("two cameras swapped", {first: second, second: first}),
        variant("all cameras to the policy's own names", own_names, [*renamed, *renamed_features(base, own_names)]),
        variant("a camera that the robot does not have", {"observation.images.nose": "observation.images.mouth"}),
        variant(
            "a camera to a name that is no input", {first: "observation.images.nowhere"}, verdict=refused("rename_map")
        ),
        variant(
            "the state to a name that is no input",
            {"observation.state": "observation.qpos"},
            verdict=refused("rename_map"),
        ),
        variant("two cameras to one name", {first: second}, verdict=refused("rename_map")),
        variant("a list", ["a", "b"], verdict=refused("rename_map")),
    ]


def renamed_features(base, names):
    """Return edits that put new features in place of the cameras, in `config.json` and in the processor's list."""
    sides = {"act": (96, 96, 64), "pi05": (224, 224, 128)}[base]
    paths = [(CONFIG, ["input_features"]), (PRE, ["steps", 3, "config", "features"])]
    return [
        edit
        for (old, new), side in zip(names.items(), sides, strict=True)
        for file, path in paths
        for edit in (
            delete(file, [*path, old]),
            set_value(file, [*path, new], {"type": "VISUAL", "shape": [3, side, side]}),
        )
    ]
