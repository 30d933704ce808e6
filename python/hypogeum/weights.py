"""Tensors of a safetensors file by the names that a policy gives them."""

import re

from safetensors.torch import load_file

from .mapping import MappingError

# What torch.compile and DistributedDataParallel add to the names of tensors.
ADDED = re.compile(r"^(module\.)+|\b_orig_mod\.")
# Maximum number of tensors that an error names.
MAX_NAMED = 5


def plain_name(name):
    """Return the name of a tensor without what wrappers of a module add to it."""
    return ADDED.sub("", name)


def load_tensors(path):
    """Return the tensors of a file by their plain names."""
    return {plain_name(name): tensor for name, tensor in load_file(path).items()}


def load_complete(policy, path):
    """Load the weights of a policy from a file.

    LeRobot's own loading keeps random weights where the file has no tensor.

    Raises:
        MappingError: The file lacks a tensor, has one that the policy does not know, or one of another shape.
    """
    tensors = load_tensors(path)
    try:
        missing, unexpected = policy.load_state_dict(tensors, strict=False)
    except RuntimeError as error:
        raise MappingError(f"{path}: {error}") from error
    # A tensor shared by several modules is saved under one of their names.
    state = policy.state_dict()
    loaded = {tensor.data_ptr() for name, tensor in state.items() if name in tensors}
    report(path, [name for name in missing if state[name].data_ptr() not in loaded], unexpected)


def report(where, missing, unexpected):
    """Raise `MappingError` if tensors are missing or unexpected."""
    found = [f"lacks {', '.join(missing[:MAX_NAMED])}"] if missing else []
    found += [f"has unexpected tensors {', '.join(unexpected[:MAX_NAMED])}"] if unexpected else []
    if found:
        raise MappingError(f"the checkpoint in {where} {' and '.join(found)}")
