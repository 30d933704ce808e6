"""The text tower of CLIP as a file of tensors: names, shapes, identity.

Hugging Face's names, order of axes and separate projections are the canonical ones; OpenAI keeps queries, keys and
values of a layer in one tensor and the last projection transposed. Arrays are numpy's.
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
    """{name: shape} of the canonical tensors, in the order of the fingerprint."""
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
    """{OpenAI's name: the canonical names of what it holds}; several lie one below the other."""
    names = {OPENAI_TOKENS: [TOKENS], "positional_embedding": [POSITIONS]}
    for idx in range(n_layers):
        own, layer = OPENAI_LAYER.format(idx), LAYER.format(idx)
        for part in ("weight", "bias"):
            names[f"{own}attn.in_proj_{part}"] = [f"{layer}self_attn.{x}_proj.{part}" for x in "qkv"]
            for ours, theirs in (
                ("ln_1", "layer_norm1"), ("ln_2", "layer_norm2"), ("attn.out_proj", "self_attn.out_proj"),
                ("mlp.c_fc", "mlp.fc1"), ("mlp.c_proj", "mlp.fc2"),
            ):
                names[f"{own}{ours}.{part}"] = [f"{layer}{theirs}.{part}"]
    for part in ("weight", "bias"):
        names[f"ln_final.{part}"] = [f"{FINAL_NORM}.{part}"]
    names["text_projection"] = [PROJECTION]
    return names


def to_openai(tensors):
    """Canonical tensors by OpenAI's names and in its shapes."""
    names = openai_names(count_layers(tensors, LAYER)).items()
    stored = {own: np.concatenate([tensors[name] for name in held]) for own, held in names}
    stored["text_projection"] = np.ascontiguousarray(stored["text_projection"].T)
    return stored


def to_canonical(stored):
    """The canonical tensors of a text tower in either naming. Raises ValueError if one is missing or misshapen."""
    openai = OPENAI_TOKENS in stored
    tokens, projection = (OPENAI_TOKENS, "text_projection") if openai else (TOKENS, PROJECTION)
    for name in (tokens, projection):
        if name not in stored:
            raise ValueError(f"the text tower lacks {name!r}")
    n_layers = count_layers(stored, OPENAI_LAYER if openai else LAYER)
    width, dim = stored[tokens].shape[-1], stored[projection].shape[1 if openai else 0]
    tensors = dict(stored)
    if openai:
        for own, held in openai_names(n_layers).items():
            if own not in stored:
                raise ValueError(f"the text tower lacks {own!r}")
            tensors.update(zip(held, np.split(stored[own], len(held))))
        tensors[PROJECTION] = stored["text_projection"].T
    shapes = canonical_shapes(n_layers, width, dim)
    for name, shape in shapes.items():
        found = tuple(tensors[name].shape) if name in tensors else "missing"
        if found != shape:
            raise ValueError(f"the text tower's {name!r} is {found}, expected {shape}")
    return {name: tensors[name] for name in shapes}


def stored_names(stored):
    """The names, in their own naming, of the tensors of the text tower."""
    if OPENAI_TOKENS in stored:
        return list(openai_names(count_layers(stored, OPENAI_LAYER)))
    width, dim = stored[TOKENS].shape[1], stored[PROJECTION].shape[0]
    return list(canonical_shapes(count_layers(stored, LAYER), width, dim))


def count_layers(tensors, pattern):
    """Layers of the names that fit a pattern of one number."""
    prefix = pattern.split("{}")[0]
    numbers = [name[len(prefix) :].split(".")[0] for name in tensors if name.startswith(prefix)]
    return max((int(number) + 1 for number in numbers if number.isdigit()), default=1)


def fingerprint(tensors):
    """16 hex digits over canonical tensors: xxh3-64 of name, a zero byte and f32 numbers of each. Needs `xxhash`."""
    import xxhash

    state = xxhash.xxh3_64()
    for name, tensor in tensors.items():
        state.update(name.encode() + b"\0")
        state.update(np.ascontiguousarray(tensor, dtype="<f4").tobytes())
    return state.hexdigest()
