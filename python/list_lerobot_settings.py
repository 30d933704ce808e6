#!/usr/bin/env python3
"""List the settings that a LeRobot checkpoint of ACT or π0.5 can contain, for policy-host's tests.

    list_lerobot_settings.py OUT

Writes OUT as JSON: LeRobot's version; the fields of the two configurations with their defaults; the processor steps
that LeRobot puts into the pipelines of these policies, with the fields that their configuration can set; the names of
all other registered steps; and the kinds and modes of normalisation. The test `variants` of policy-host fails if one of
them is in no variant of `make_variants.py`, so that a setting of a new LeRobot needs a decision. Needs `lerobot[pi]`.
"""

import argparse
import dataclasses
import importlib
import json
import pkgutil
from enum import Enum
from pathlib import Path

import lerobot
from lerobot.configs.types import FeatureType, NormalizationMode
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.factory import make_pre_post_processors
from lerobot.policies.pi05 import processor_pi05
from lerobot.policies.pi05.configuration_pi05 import PI05Config
from lerobot.policies.rtc.configuration_rtc import RTCConfig
from lerobot.processor import ProcessorStepRegistry

CONFIGS = dict(act=ACTConfig, pi05=PI05Config)


def as_json(value):
    """Return a default as LeRobot writes it to a configuration."""
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, dict):
        return {as_json(key): as_json(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [as_json(item) for item in value]
    return value


def fields_of(cls):
    """Return the fields of a dataclass that its constructor takes, with their defaults; "required" without one."""
    defaults = {}
    for field in dataclasses.fields(cls):
        if field.init:
            has_factory = field.default_factory is not dataclasses.MISSING
            default = field.default_factory() if has_factory else field.default
            is_step = dataclasses.is_dataclass(default)
            required = default is dataclasses.MISSING
            defaults[field.name] = "required" if required else type(default).__name__ if is_step else as_json(default)
    return defaults


def pipelines_of(config):
    """Return LeRobot's pre- and postprocessor for a configuration, with a tokenizer that needs no download."""
    step = processor_pi05.TokenizerProcessorStep
    processor_pi05.TokenizerProcessorStep = lambda tokenizer_name, **options: step(tokenizer=object(), **options)
    try:
        return make_pre_post_processors(config)
    finally:
        processor_pi05.TokenizerProcessorStep = step


def settings():
    """Return all settings as JSON values."""
    for module in pkgutil.walk_packages(lerobot.__path__, "lerobot."):
        if "processor" in module.name:
            importlib.import_module(module.name)
    steps, pipelines = {}, {}
    for policy, config in CONFIGS.items():
        pipelines[policy] = {}
        for pipeline in pipelines_of(config(device="cpu")):
            names = [type(step)._registry_name for step in pipeline.steps]
            pipelines[policy][pipeline.name] = names
            steps |= {name: fields_of(type(step)) for name, step in zip(names, pipeline.steps, strict=True)}
    return dict(
        lerobot=lerobot.__version__,
        configs={policy: fields_of(config) for policy, config in CONFIGS.items()}
        | {"rtc_config": fields_of(RTCConfig)},
        pipelines=pipelines,
        steps=dict(sorted(steps.items())),
        other_steps=sorted(set(ProcessorStepRegistry.list()) - set(steps)),
        feature_types=[kind.value for kind in FeatureType],
        normalization_modes=[mode.value for mode in NormalizationMode],
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("out", type=Path, help="output file")
    out = parser.parse_args().out
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(settings(), indent=1) + "\n")


if __name__ == "__main__":
    main()
