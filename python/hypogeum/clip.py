"""Tensor names, shapes and fingerprint of CLIP's text tower.

The canonical form is Hugging Face's: its names, axis order and separate projections. OpenAI's form stores the query,
key and value projections of a layer in one tensor and transposes the final projection. All arrays are numpy arrays.
"""

import numpy as np

VOCABULARY, MAX_TOKENS, HEAD_WIDTH = 49408, 77, 64
TOKENS = "text_model.embeddings.token_embedding.weight"
POSITIONS = "text_model.embeddings.position_embedding.weight"
FINAL_NORM = "text_model.final_layer_norm"
PROJECTION = "text_projection.weight"
LAYER = "text_model.encoder.layers.{}."
OPENAI_TOKENS = "token_embedding.weight"
OPENAI_LAYER = "transformer.resblocks.{}."


def canonical_shapes(n_layers, width, dim):
    """Return {name: shape} of the canonical tensors, in fingerprint order."""
    shapes = {TOKENS: (VOCABULARY, width), POSITIONS: (MAX_TOKENS, width)}

    def linear(name, n_out, n_in):
        shapes.update({f"{name}.weight": (n_out, n_in), f"{name}.bias": (n_out,)})

    def norm(name):
        shapes.update({f"{name}.weight": (width,), f"{name}.bias": (width,)})

    for idx in range(n_layers):
        layer = LAYER.format(idx)
        norm(layer + "layer_norm1")
        for part in ("q_proj", "k_proj", "v_proj", "out_proj"):
            linear(f"{layer}self_attn.{part}", width, width)
        norm(layer + "layer_norm2")
        linear(layer + "mlp.fc1", 4 * width, width)
        linear(layer + "mlp.fc2", width, 4 * width)
    norm(FINAL_NORM)
    shapes[PROJECTION] = (dim, width)
    return shapes


def openai_names(n_layers):
    """Return {OpenAI name: canonical names}; several canonical tensors are concatenated along the first axis."""
    names = {OPENAI_TOKENS: [TOKENS], "positional_embedding": [POSITIONS]}
    for idx in range(n_layers):
        block, layer = OPENAI_LAYER.format(idx), LAYER.format(idx)
        for part in ("weight", "bias"):
            names[f"{block}attn.in_proj_{part}"] = [f"{layer}self_attn.{x}_proj.{part}" for x in "qkv"]
            for openai, canonical in (
                ("ln_1", "layer_norm1"), ("ln_2", "layer_norm2"), ("attn.out_proj", "self_attn.out_proj"),
                ("mlp.c_fc", "mlp.fc1"), ("mlp.c_proj", "mlp.fc2"),
            ):
                names[f"{block}{openai}.{part}"] = [f"{layer}{canonical}.{part}"]
    for part in ("weight", "bias"):
        names[f"ln_final.{part}"] = [f"{FINAL_NORM}.{part}"]
    names["text_projection"] = [PROJECTION]
    return names


def to_openai(tensors):
    """Convert canonical tensors to OpenAI's names and shapes."""
    names = openai_names(count_layers(tensors, LAYER)).items()
    stored = {openai: np.concatenate([tensors[name] for name in canonical]) for openai, canonical in names}
    stored["text_projection"] = np.ascontiguousarray(stored["text_projection"].T)
    return stored


def to_canonical(stored):
    """Convert a text tower in either form to canonical tensors.

    Raises:
        ValueError: A tensor is missing or has the wrong shape.
    """
    openai = OPENAI_TOKENS in stored
    tokens, projection = (OPENAI_TOKENS, "text_projection") if openai else (TOKENS, PROJECTION)
    for name in (tokens, projection):
        if name not in stored:
            raise ValueError(f"the text tower lacks {name!r}")
    n_layers = count_layers(stored, OPENAI_LAYER if openai else LAYER)
    width, dim = stored[tokens].shape[-1], stored[projection].shape[1 if openai else 0]
    tensors = dict(stored)
    if openai:
        for name, canonical in openai_names(n_layers).items():
            if name not in stored:
                raise ValueError(f"the text tower lacks {name!r}")
            tensors.update(zip(canonical, np.split(stored[name], len(canonical))))
        tensors[PROJECTION] = stored["text_projection"].T
    shapes = canonical_shapes(n_layers, width, dim)
    for name, shape in shapes.items():
        found = tuple(tensors[name].shape) if name in tensors else "missing"
        if found != shape:
            raise ValueError(f"the text tower's {name!r} is {found}, expected {shape}")
    return {name: tensors[name] for name in shapes}


def stored_names(stored):
    """Return the names of the text tower's tensors in the form in which `stored` holds them."""
    if OPENAI_TOKENS in stored:
        return list(openai_names(count_layers(stored, OPENAI_LAYER)))
    width, dim = stored[TOKENS].shape[1], stored[PROJECTION].shape[0]
    return list(canonical_shapes(count_layers(stored, LAYER), width, dim))


def count_layers(tensors, pattern):
    """Return the number of layers among `tensors`, whose names start with `pattern` up to its layer number `{}`."""
    prefix = pattern.split("{}")[0]
    numbers = [name[len(prefix) :].split(".")[0] for name in tensors if name.startswith(prefix)]
    return max((int(number) + 1 for number in numbers if number.isdigit()), default=1)


def fingerprint(tensors):
    """Return the fingerprint of canonical tensors as 16 hex digits.

    It is the xxh3-64 of every tensor's name, a zero byte and its f32 values, in order. Needs `xxhash`.
    """
    import xxhash

    state = xxhash.xxh3_64()
    for name, tensor in tensors.items():
        state.update(name.encode() + b"\0")
        state.update(np.ascontiguousarray(tensor, dtype="<f4").tobytes())
    return state.hexdigest()
