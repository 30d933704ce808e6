"""What training π0.5 from random weights needs: prompts, initial weights, losses, and the parameters for Muon."""

import io
import math
import sys

import numpy as np
import sentencepiece
import torch
import torch.nn.functional as F
from lerobot.policies.pi05.modeling_pi05 import PI05Policy
from torch import nn
from transformers.models.gemma.modeling_gemma import apply_rotary_pos_emb

from .pi05 import UNUSED, narrow

# State numbers in a prompt are bins of an entry's range.
N_BINS = 256
BOS = 2


def prompt(instruction, bins):
    """Return LeRobot's prompt for an instruction and the bins of a normalised state."""
    return f"Task: {instruction}, State: {' '.join(map(str, bins))};\nAction: "


def train_tokenizer(instructions, vocabulary):
    """Return a SentencePiece model with Gemma's conventions, except that each state number is one token."""
    random = np.random.default_rng(0)
    sentences = [sentence for texts in instructions.values() for sentence in texts]
    corpus = [prompt(sentence, random.permutation(N_BINS)) for sentence in sentences]
    model = io.BytesIO()
    sentencepiece.SentencePieceTrainer.train(
        sentence_iterator=iter(corpus), model_writer=model, model_type="bpe", vocab_size=vocabulary,
        byte_fallback=True, add_dummy_prefix=False, remove_extra_whitespaces=False, split_digits=False,
        normalization_rule_name="identity", character_coverage=1.0, user_defined_symbols=["\n", ";", ","],
        num_threads=1, pad_id=0, eos_id=1, bos_id=BOS, unk_id=3, bos_piece="<bos>", eos_piece="<eos>", minloglevel=2,
        hard_vocab_limit=False, max_sentence_length=100_000,
    )  # fmt: skip
    tokenizer = sentencepiece.SentencePieceProcessor(model_proto=model.getvalue())
    split = [n for n in range(N_BINS) if len(tokenizer.encode(f" {n}")) != 1]
    if split:
        sys.exit(f"the tokenizer splits the numbers {split}; increase --vocabulary")
    return model.getvalue()


def scaled(values, stats):
    """Scale values to [-1, 1] as LeRobot does by quantiles."""
    return (values - stats["q01"]) / (stats["q99"] - stats["q01"]) * 2 - 1


def distance(predicted, targets):
    """Return a loss that is linear in large errors."""
    return F.smooth_l1_loss(predicted.float(), targets, beta=0.1)


def tokenize(tokenizer, texts, states, length):
    """Return the tokens of prompts and their mask, `[n, length]`."""
    bins = np.digitize(states.cpu().numpy(), np.linspace(-1, 1, N_BINS + 1)[:-1]) - 1
    prompts = [prompt(text, row) for text, row in zip(texts, bins)]
    batch = tokenizer(prompts, max_length=length)
    return batch["input_ids"].to(states.device), batch["attention_mask"].bool().to(states.device)


def random_policy(widths, config, tokenizer):
    """Return a randomly initialised `PI05Policy` whose vision tower knows places and whose embeddings know numbers.

    Args:
        widths: Sizes of the network.
        config: LeRobot's `PI05Config`.
        tokenizer: Tokenizer with one token for each state number.
    """
    with narrow(widths):
        policy = PI05Policy(config)
    prefix = policy.model.paligemma_with_expert.paligemma.model
    with torch.no_grad():
        for name, parameter in policy.named_parameters():
            if name.endswith("layernorm.dense.bias") or name.endswith("norm.dense.bias"):
                # Scale and shift start neutral, gates open.
                parameter.copy_(torch.tensor([0.0, 0.0, 1.0]).repeat_interleave(len(parameter) // 3))
        embedding = prefix.language_model.embed_tokens.weight
        width = embedding.shape[1]
        embedding.normal_(std=width**-0.5)
        numbers = [tokenizer.encode(f" {n}")[-1] for n in range(N_BINS)]
        embedding[numbers] = curve(N_BINS, width) * width**-0.5
        positions = prefix.vision_tower.vision_model.embeddings.position_embedding.weight
        positions.copy_(grid(math.isqrt(len(positions)), positions.shape[1]) * 0.5)
    return policy


def curve(n, width):
    """Return `n` points of unit variance on a smooth random curve, `[n, width] f32`."""
    frequencies = torch.tensor([0.25, 0.5, 1, 2, 4, 8, 16])
    phases = 2 * math.pi * frequencies * torch.arange(n)[:, None] / n
    waves = torch.cat([phases.sin(), phases.cos()], dim=1)
    points = waves @ torch.randn(waves.shape[1], width) * len(frequencies) ** -0.5
    return points + 0.1 * torch.randn(n, width)


def grid(side, width):
    """Return sines and cosines of a patch's row and column, `[side², width] f32`."""
    frequencies = math.pi * 2 ** torch.linspace(-1, 2.5, width // 4)
    place = (torch.arange(side) + 0.5)[:, None] / side * frequencies
    waves = torch.cat([place.sin(), place.cos()], dim=1)
    rows, columns = waves[:, None].expand(-1, side, -1), waves[None].expand(side, -1, -1)
    return torch.cat([rows, columns], dim=2).reshape(side * side, -1)


def heads(projection, x, head_dim):
    """Project `[n, length, width]` to heads, `[n, n_heads, length, head_dim]`."""
    return projection(x).unflatten(-1, (-1, head_dim)).transpose(1, 2)


def attend(q, k, v, mask=None):
    """Attend from all query heads to one key and value head; return `[n, length, n_heads · head_dim]`.

    The heads become one long sequence, because they share keys and values.
    """
    n, n_heads, length, head_dim = q.shape
    out = F.scaled_dot_product_attention(q.reshape(n, 1, n_heads * length, head_dim), k, v, attn_mask=mask)
    return out.view(n, n_heads, length, head_dim).transpose(1, 2).flatten(2)


class Auxiliary(nn.Module):
    """Linear heads that shape the network and are not part of its checkpoint.

    `summary` reads the prompt's last token, `[n, width]`. `places` reads the patches with one matrix per task.

    Args:
        width: Width of the prefix.
        n_summary: Number of values to predict from the prompt's last token.
        n_tasks: Number of tasks.
        n_patches: Number of patches of all cameras.
        n_places: Number of values to predict from the patches.
    """

    def __init__(self, width, n_summary, n_tasks, n_patches, n_places):
        super().__init__()
        self.summary = nn.Linear(width, n_summary)
        self.weight = nn.Parameter(torch.zeros(n_tasks, n_patches * width, n_places))
        self.bias = nn.Parameter(torch.zeros(n_tasks, n_places))

    def places(self, patches, tasks):
        """Predict from patches `[n, n_patches, width]` and the indices of their tasks, a list; `[n, n_places] f32`."""
        features = F.layer_norm(patches.float(), patches.shape[-1:]).flatten(1) * self.weight.shape[1] ** -0.5
        matrices = self.weight.unbind()
        return torch.stack([row @ matrices[task] for row, task in zip(features, tasks, strict=True)]) + self.bias[tasks]


def see(network, images):
    """Return the patches of all cameras' images, `[n, n_patches, width]`.

    Args:
        network: LeRobot's `PI05Pytorch`.
        images: `[n, n_cameras, 3, side, side] f32` in [-1, 1].
    """
    patches = network.paligemma_with_expert.embed_image(images.flatten(0, 1))
    return patches.unflatten(0, images.shape[:2]).flatten(1, 2)


def flow_loss(network, patches, tokens, mask, actions, noise, t):
    """Compute the flow-matching loss with several draws of noise and time per observation.

    Args:
        network: LeRobot's `PI05Pytorch`.
        patches: Those of the images, `[n, n_patches, width]`.
        tokens: `[n, n_tokens] i64`.
        mask: `[n, n_tokens] bool`, False in padding.
        actions: Scaled chunks, `[n, chunk, action_dim] f32`.
        noise: `[n, draws, chunk, action_dim] f32`.
        t: Times, `[n, draws] f32`, where 1 is noise and 0 is the actions.

    Returns:
        Squared errors `[n, draws, chunk, action_dim]`, and the normalised last hidden state of the prompt's last token,
        `[n, width]`.
    """
    both = network.paligemma_with_expert
    gemma, expert = both.paligemma.model.language_model, both.gemma_expert.model
    n = len(patches)
    prefix = torch.cat([patches, both.embed_language_tokens(tokens)], dim=1)
    valid = torch.cat([mask.new_ones(patches.shape[:2]), mask], dim=1)
    n_valid = valid.sum(1)
    place = valid.cumsum(1) - 1

    draws = noise.shape[1]
    noisy = t[..., None, None] * noise + (1 - t[..., None, None]) * actions[:, None]
    suffix, _, _, condition = network.embed_suffix(noisy.flatten(0, 1), t.flatten())

    cos, sin = gemma.rotary_emb(prefix, place)
    chunk = actions.shape[1]
    cos_s, sin_s = gemma.rotary_emb(suffix, n_valid[:, None] + torch.arange(chunk, device=n_valid.device))
    cos_s, sin_s = (x.repeat_interleave(draws, 0) for x in (cos_s, sin_s))
    mask_p = valid[:, None, None]
    mask_s = F.pad(mask_p, (0, chunk), value=True).repeat_interleave(draws, 0)
    last = n_valid - 1

    for layer_p, layer_s in zip(gemma.layers, expert.layers, strict=True):
        head_dim, is_last = layer_p.self_attn.head_dim, layer_p is gemma.layers[-1]
        x, _ = layer_p.input_layernorm(prefix)
        q, k, v = (heads(getattr(layer_p.self_attn, f"{name}_proj"), x, head_dim) for name in "qkv")
        q, k = apply_rotary_pos_emb(q, k, cos, sin)
        y, gate = layer_s.input_layernorm(suffix, condition)
        q_s, k_s, v_s = (heads(getattr(layer_s.self_attn, f"{name}_proj"), y, head_dim) for name in "qkv")
        q_s, k_s = apply_rotary_pos_emb(q_s, k_s, cos_s, sin_s)
        if is_last:
            # Of the last layer's output, only the last token is read.
            rows = torch.arange(n, device=last.device)
            q, prefix = q[rows, :, last][:, :, None], prefix[rows, last][:, None]
        prefix = prefix + layer_p.self_attn.o_proj(attend(q, k, v, mask_p))
        prefix = prefix + layer_p.mlp(layer_p.post_attention_layernorm(prefix)[0])
        keys, values = (torch.cat([a.repeat_interleave(draws, 0), b], dim=2) for a, b in ((k, k_s), (v, v_s)))
        suffix = suffix + layer_s.self_attn.o_proj(attend(q_s, keys, values, mask_s)) * gate
        y, gate = layer_s.post_attention_layernorm(suffix, condition)
        suffix = suffix + layer_s.mlp(y) * gate
    velocity = network.action_out_proj(expert.norm(suffix, condition)[0])
    target = noise - actions[:, None]
    return (velocity.view_as(target) - target).square(), gemma.norm(prefix[:, 0])[0]


def used(policy):
    """Return the names and parameters that are trained."""
    return [(name, parameter) for name, parameter in policy.named_parameters() if not name.endswith(UNUSED)]


def split(policy, auxiliary):
    """Return the parameters for Muon, which are the matrices of all layers, and those for AdamW."""
    matrices, others = [], list(auxiliary.parameters())
    for name, parameter in used(policy):
        # `dense` computes a layer norm's scale and shift from the time.
        is_matrix = ".layers." in name and parameter.ndim == 2 and ".dense." not in name
        (matrices if is_matrix else others).append(parameter)
    return matrices, others
