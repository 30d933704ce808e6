"""Variants of the processor steps that both policies have, and of the lists of steps."""

from . import Variant, refused
from .common import EXTERNAL, HAND, STATES
from .edits import POST, PRE, copy, delete, drop, insert, pick, remove, rename, set_value


def missing_statistics(base, pre_idx, action_mode):
    """Return variants whose statistics are absent, empty, incomplete or under other names."""
    pre = missing_of("normalizer_processor", base, PRE, pre_idx, "observation.state", action_mode)
    return pre + missing_of("unnormalizer_processor", base, POST, 0, "action", action_mode)


def missing_of(step, base, file, idx, feature, mode):
    """Return those of one step, for statistics of `feature` that a mode needs."""
    state = STATES[file]
    needed = dict(MEAN_STD=("mean", "std"), QUANTILES=("q01", "q99"))[mode]
    variant = lambda change, edits, verdict: Variant(base, f"{step} state", change, edits, verdict=verdict)  # noqa: E731
    return [
        variant("state_file absent", [delete(file, ["steps", idx, "state_file"])], refused("state_file")),
        variant("state_file null", [set_value(file, ["steps", idx, "state_file"], None)], refused("state_file")),
        variant(
            "no file of this name",
            [set_value(file, ["steps", idx, "state_file"], "s.safetensors")],
            refused("s.safetensors"),
        ),
        variant("no statistics", [drop(state, ".")], refused("statistics of `")),
        variant("no statistics of one feature", [drop(state, f"{feature}.")], refused(feature)),
        variant(
            "a prefix as of several datasets",
            [rename(state, feature, f"so100.buffer.{feature}")],
            refused(f"so100.buffer.{feature}"),
        ),
        variant("another prefix", [rename(state, feature, f"libero.{feature}")], refused(f"libero.{feature}")),
        variant("further statistics", [copy(state, f"{feature}.", f"libero.{feature}.", 3.0)], "honoured"),
        variant("the values are not finite", [copy(state, f"{feature}.", f"{feature}.", 1e39)], refused(feature)),
        variant(
            "only statistics of other modes",
            [drop(state, f".{part}") for part in needed],
            refused("statistics of `"),
        ),
    ]


def norm_maps(base, pre_idx, kinds):
    """Return variants of the mode of every kind of feature. `kinds` is the verdict for those that are not honoured."""
    variants = []
    for kind, verdicts in kinds.items():
        for mode in ("IDENTITY", "MEAN_STD", "MIN_MAX", "QUANTILES", "QUANTILE10"):
            file, idx, step = (PRE, pre_idx, "normalizer_processor")
            if kind == "ACTION":
                file, idx, step = (POST, 0, "unnormalizer_processor")
            edits = [set_value(file, ["steps", idx, "config", "norm_map", kind], mode)]
            variants.append(Variant(base, f"{step} norm_map", f"{kind}: {mode}", edits, verdict=verdicts(mode)))
    return variants


def normalisers(base, pre_idx):
    """Return variants of the other keys of the two steps that normalise."""
    own_keys = ["steps", pre_idx, "config", "normalize_observation_keys"]
    keys = lambda value: [set_value(PRE, own_keys, value)]  # noqa: E731
    return [
        *keys_of("normalizer_processor", base, PRE, pre_idx, "observation.state", "STATE"),
        *keys_of("unnormalizer_processor", base, POST, 0, "action", "ACTION"),
        Variant(
            base,
            "normalizer_processor normalize_observation_keys",
            "all inputs but the state",
            keys([*EXTERNAL, HAND, "observation.environment_state"]),
        ),
        Variant(
            base,
            "normalizer_processor normalize_observation_keys",
            "none",
            keys([]),
        ),
        Variant(
            base,
            "normalizer_processor features",
            "without the state",
            verdict=refused("features"),
            edits=[delete(PRE, ["steps", pre_idx, "config", "features", "observation.state"])],
        ),
        Variant(
            base,
            "normalizer_processor features",
            "the state as ENV",
            edits=[set_value(PRE, ["steps", pre_idx, "config", "features", "observation.state", "type"], "ENV")],
        ),
        Variant(
            base,
            "unnormalizer_processor features",
            "without the action",
            edits=[delete(POST, ["steps", 0, "config", "features", "action"])],
        ),
    ]


def keys_of(step, base, file, idx, feature, kind):
    """Return variants of the keys of one step, which normalises `feature` among others."""
    path = ["steps", idx, "config"]
    put = lambda key, value: [set_value(file, [*path, key], value)]  # noqa: E731

    def variant(key, change, edits, verdict="honoured"):
        return Variant(base, f"{step} {key}", change, edits, verdict=verdict)

    return [
        variant("eps", "0.25", put("eps", 0.25)),
        variant("eps", "absent", [delete(file, [*path, "eps"])]),
        variant("features", "absent", [delete(file, [*path, "features"])], refused("features")),
        variant("norm_map", "absent", [delete(file, [*path, "norm_map"])], refused("norm_map")),
        variant(
            "norm_map", "an unknown mode", [set_value(file, [*path, "norm_map", kind], "MEDIAN")], refused("MEDIAN")
        ),
        variant(
            "norm_map",
            "an unknown kind",
            [set_value(file, [*path, "norm_map", "SOUND"], "MEAN_STD")],
            refused("SOUND"),
        ),
        variant("norm_map", "REWARD: MIN_MAX", [set_value(file, [*path, "norm_map", "REWARD"], "MIN_MAX")]),
        variant("norm_map", "LANGUAGE: IDENTITY", [set_value(file, [*path, "norm_map", "LANGUAGE"], "IDENTITY")]),
        variant("stats", "null", put("stats", None), refused("stats")),
        variant(
            "stats",
            "given beside the file",
            put("stats", {feature: {"mean": [0.0], "std": [1.0]}}),
            refused("stats"),
        ),
        variant("device", "cpu", put("device", "cpu"), refused("device")),
        variant("dtype", "null", put("dtype", None), refused("dtype")),
        variant("normalize_observation_keys", "null", put("normalize_observation_keys", None)),
        variant("unknown_key", "1", put("unknown_key", 1), refused("unknown_key")),
    ]


def other_steps(base, pre, post):
    """Return variants of the steps without statistics, and of the lists of steps. `pre` and `post` are their names."""
    device, post_device, normaliser = (
        pre.index("device_processor"),
        post.index("device_processor"),
        pre.index("normalizer_processor"),
    )
    step = lambda name, **options: dict(registry_name=name, config=options)  # noqa: E731
    without = lambda names, idx: [other for other in range(len(names)) if other != idx]  # noqa: E731
    float_dtype = lambda file, idx, value, verdict: Variant(  # noqa: E731
        base,
        "device_processor float_dtype",
        f"{value} in {file}",
        verdict=verdict,
        edits=[set_value(file, ["steps", idx, "config", "float_dtype"], value)],
    )
    unknown = [
        Variant(
            base,
            f"{name} unknown_key",
            "1",
            [set_value(PRE, ["steps", idx, "config", "unknown_key"], 1)],
            verdict=refused("unknown_key"),
        )
        for idx, name in enumerate(pre)
        if name != "normalizer_processor"
    ]
    # The first step that is missed.
    first = dict(act="normalizer_processor", pi05="pi05_prepare_state_tokenizer_processor_step")[base]
    without_config = [
        Variant(base, f"{name}", "without config", [delete(PRE, ["steps", idx, "config"])])
        for idx, name in enumerate(pre)
        if name != "normalizer_processor"
    ]
    files = [
        variant
        for file in (PRE, POST)
        for variant in (
            Variant(base, f"{file}", "absent", [remove(file)], verdict=refused(file)),
            Variant(base, f"{file} name", "another", [set_value(file, ["name"], "another")]),
            Variant(
                base, f"{file} unknown_key", "1", [set_value(file, ["unknown_key"], 1)], verdict=refused("unknown_key")
            ),
            Variant(
                base,
                f"{file} steps",
                "a step with an unknown key",
                [set_value(file, ["steps", 0, "unknown_key"], 1)],
                verdict=refused("unknown_key"),
            ),
        )
    ]
    return (
        unknown
        + without_config
        + files
        + [
            float_dtype(PRE, device, "float32", "honoured"),
            float_dtype(POST, post_device, "float32", "honoured"),
            float_dtype(PRE, device, "float16", refused("float_dtype")),
            float_dtype(PRE, device, "bfloat16", refused("float_dtype")),
            float_dtype(POST, post_device, "float16", refused("float_dtype")),
            float_dtype(POST, post_device, "bfloat16", refused("float_dtype")),
            float_dtype(PRE, device, "float12", refused("float_dtype")),
            Variant(
                base, "device_processor device", "cuda", [set_value(PRE, ["steps", device, "config", "device"], "cuda")]
            ),
            Variant(
                base,
                "to_batch_processor to_batch_action_processor",
                "{}",
                verdict=refused("to_batch_action_processor"),
                edits=[set_value(PRE, ["steps", 1, "config", "to_batch_action_processor"], {})],
            ),
            Variant(
                base,
                "to_batch_processor to_batch_observation_processor",
                "{}",
                verdict=refused("to_batch_observation_processor"),
                edits=[set_value(PRE, ["steps", 1, "config", "to_batch_observation_processor"], {})],
            ),
            Variant(
                base,
                "to_batch_processor to_batch_complementary_data_processor",
                "{}",
                verdict=refused("to_batch_complementary_data_processor"),
                edits=[set_value(PRE, ["steps", 1, "config", "to_batch_complementary_data_processor"], {})],
            ),
            Variant(base, f"{PRE} steps", "without to_batch_processor", [pick(PRE, without(pre, 1))]),
            Variant(base, f"{PRE} steps", "without rename_observations_processor", [pick(PRE, without(pre, 0))]),
            Variant(base, f"{PRE} steps", "without device_processor", [pick(PRE, without(pre, device))]),
            Variant(
                base,
                f"{PRE} steps",
                "without normalizer_processor",
                [pick(PRE, without(pre, normaliser))],
                verdict=refused("normalizer_processor"),
            ),
            Variant(
                base,
                f"{PRE} steps",
                "normalizer_processor twice",
                verdict=refused("normalizer_processor"),
                edits=[pick(PRE, [*range(normaliser + 1), *range(normaliser, len(pre))])],
            ),
            Variant(base, f"{PRE} steps", "device_processor first", [pick(PRE, [device, *without(pre, device)])]),
            Variant(
                base,
                f"{PRE} steps",
                "normalizer_processor before the names change",
                verdict=refused("steps"),
                edits=[
                    set_value(
                        PRE, ["steps", 0, "config", "rename_map"], dict(zip(EXTERNAL, EXTERNAL[::-1], strict=True))
                    ),
                    pick(PRE, [normaliser, *without(pre, normaliser)]),
                ],
            ),
            Variant(
                base,
                f"{PRE} steps",
                "unnormalizer_processor among them",
                verdict=refused("unnormalizer_processor"),
                edits=[set_value(PRE, ["steps", normaliser, "registry_name"], "unnormalizer_processor")],
            ),
            Variant(
                base,
                f"{PRE} steps",
                "an unknown step",
                [insert(PRE, 1, step("lens_correction_processor"))],
                verdict=refused("lens_correction_processor"),
            ),
            Variant(
                base,
                f"{PRE} steps",
                "a class outside the registry",
                verdict=refused("steps"),
                edits=[insert(PRE, 1, {"class": "someone.LensCorrection", "config": {}})],
            ),
            Variant(base, f"{PRE} steps", "none", [pick(PRE, [])], verdict=refused(first)),
            Variant(
                base,
                f"{POST} steps",
                "without unnormalizer_processor",
                [pick(POST, without(post, 0))],
                verdict=refused("unnormalizer_processor"),
            ),
            Variant(base, f"{POST} steps", "without device_processor", [pick(POST, without(post, post_device))]),
            Variant(
                base,
                f"{POST} steps",
                "device_processor first",
                [pick(POST, [post_device, *without(post, post_device)])],
            ),
            Variant(
                base,
                f"{POST} steps",
                "unnormalizer_processor twice",
                [pick(POST, [0, *range(len(post))])],
                verdict=refused("unnormalizer_processor"),
            ),
            Variant(
                base,
                f"{POST} steps",
                "normalizer_processor among them",
                verdict=refused("normalizer_processor"),
                edits=[set_value(POST, ["steps", 0, "registry_name"], "normalizer_processor")],
            ),
            Variant(
                base,
                f"{POST} steps",
                "an unknown step",
                [insert(POST, 1, step("clip_actions_processor"))],
                verdict=refused("clip_actions_processor"),
            ),
        ]
    )
