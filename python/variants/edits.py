"""Changes of a checkpoint folder, as data: `make_variants.py` applies them for LeRobot, policy-host's tests for us."""

import json

import numpy as np
from safetensors.numpy import load_file, save_file

CONFIG, SIDECAR, WEIGHTS = "config.json", "hypogeum.json", "model.safetensors"
PRE, POST = "policy_preprocessor.json", "policy_postprocessor.json"
PRE_STATE = "policy_preprocessor_step_3_normalizer_processor.safetensors"
POST_STATE = "policy_postprocessor_step_0_unnormalizer_processor.safetensors"


def set_value(file, path, value):
    """Set the value at a path of keys and indices, creating the last key."""
    return dict(op="set", file=file, path=path, value=value)


def delete(file, path):
    """Delete the key at a path."""
    return dict(op="delete", file=file, path=path)


def insert(file, idx, step):
    """Insert a processor step before another."""
    return dict(op="insert", file=file, idx=idx, step=step)


def pick(file, indices):
    """Replace the processor steps by those at `indices`."""
    return dict(op="pick", file=file, indices=indices)


def write(file, text):
    """Replace the contents of a file."""
    return dict(op="write", file=file, text=text)


def remove(file):
    """Delete a file."""
    return dict(op="remove", file=file)


def copy(file, part, to, scale=1.0):
    """Store every tensor whose name contains `part` again, multiplied by `scale`, with `to` in place of `part`."""
    return dict(op="copy", file=file, part=part, to=to, scale=scale)


def rename(file, part, to):
    """Put `to` in place of `part` in the names of all tensors."""
    return dict(op="rename", file=file, part=part, to=to)


def drop(file, part):
    """Remove all tensors whose name contains `part`."""
    return dict(op="drop", file=file, part=part)


def resize(file, name, shape):
    """Give a tensor another shape; its values repeat from the first if there are too few."""
    return dict(op="resize", file=file, name=name, shape=shape)


def fill(file, name, shape, values):
    """Store a tensor with these values, which repeat if there are too few."""
    return dict(op="fill", file=file, name=name, shape=shape, values=values)


def apply(folder, edits):
    """Apply edits to the files in a folder."""
    for edit in edits:
        path = folder / edit["file"]
        if edit["op"] == "write":
            path.write_text(edit["text"])
        elif edit["op"] == "remove":
            path.unlink()
        elif path.suffix == ".json":
            value = json.loads(path.read_text())
            edit_json(value, edit)
            path.write_text(json.dumps(value, indent=2))
        else:
            save_file(edited_tensors(load_file(path), edit), path)


def edit_json(value, edit):
    if edit["op"] in ("insert", "pick"):
        steps = value["steps"]
        if edit["op"] == "insert":
            steps.insert(edit["idx"], edit["step"])
        else:
            value["steps"] = [json.loads(json.dumps(steps[idx])) for idx in edit["indices"]]
        return
    *parents, last = edit["path"]
    for key in parents:
        value = value[key]
    if edit["op"] == "set":
        value[last] = edit["value"]
    else:
        del value[last]


def edited_tensors(tensors, edit):
    """Return the tensors of a file, all of them f32, after one edit."""
    cycled = lambda values, shape: np.resize(np.asarray(values, np.float32).ravel(), shape)  # noqa: E731
    match edit["op"]:
        case "fill":
            return tensors | {edit["name"]: cycled(edit["values"], edit["shape"])}
        case "resize":
            return tensors | {edit["name"]: cycled(tensors[edit["name"]], edit["shape"])}
    part = edit["part"]
    matching = {name for name in tensors if part in name}
    match edit["op"]:
        case "copy":
            with np.errstate(over="ignore", invalid="ignore"):
                scale = np.float32(edit["scale"])
                scaled = {name: tensors[name] * scale for name in matching}
            return tensors | {name.replace(part, edit["to"]): x for name, x in scaled.items()}
        case "rename":
            return {name.replace(part, edit["to"]): x for name, x in tensors.items()}
        case "drop":
            return {name: x for name, x in tensors.items() if name not in matching}
    raise ValueError(f"unknown edit {edit}")
