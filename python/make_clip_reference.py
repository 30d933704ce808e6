#!/usr/bin/env python3
"""Write PyTorch's embeddings from a small CLIP text tower whose weights are computed from tensor names.

    make_clip_reference.py OUT            write OUT/reference.json (texts, tokens, fingerprint of the weights)
                                          and OUT/reference.safetensors (embeddings)
    ... --layers 12 --width 512           use a tower of another size (here that of CLIP ViT-B/32)
    ... --weights huggingface|openai      also write OUT/model.safetensors in that form
    ... --time                            print PyTorch's time per text

The texts are edge cases and the suite's instructions. The tokens are those of open_clip, which cleans texts with ftfy.
Needs `torch`, `transformers`, `open_clip_torch`, `safetensors` and `xxhash`.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
import torch
from open_clip.tokenizer import SimpleTokenizer
from safetensors.numpy import save_file
from transformers import CLIPTextConfig, CLIPTextModelWithProjection

from hypogeum.clip import HEAD_WIDTH, canonical_shapes, fingerprint, to_openai
from make_act_checkpoint import generated_tensor

PARAPHRASES = Path(__file__).parents[1] / "sim/src/tasks/paraphrases"
# Capitals, contractions, digits, white space, other scripts, punctuation, more than 77 tokens, empty texts.
EDGE_CASES = [
    "",
    "   ",
    "Raise the Red CUBE!",
    "don't drop it; it's the robot's, they've said we'll go",
    "I'D say “quoted” and ‘single’, it’s",
    "move 12 cm, then 3.5 (½ ²)",
    "two  spaces\tand a tab\nand a line",
    "Öffne die Schublade – Käse, naïve café",
    "立方体を持ち上げる 🤖 robot",
    "a/b-c_d [e] {f} <g>!!! ???",
    "word " * 100,
    "x" * 300,
]


def suite_texts(per_task):
    """Yield the first `per_task` instructions of every task."""
    for path in sorted(PARAPHRASES.glob("*.txt")):
        yield from [line for line in path.read_text().splitlines() if line][:per_task]


def tokens(texts):
    """Return the token ids of every text, up to and including the first end-of-text token."""
    end = 49407
    rows = SimpleTokenizer()(texts).tolist()
    return [row[: row.index(end) + 1] for row in rows]


def make_net(tensors, n_layers, width, dim):
    """Return the transformers implementation of the text tower with these weights."""
    config = CLIPTextConfig(
        hidden_size=width, intermediate_size=4 * width, num_hidden_layers=n_layers, projection_dim=dim,
        num_attention_heads=width // HEAD_WIDTH,
    )
    net = CLIPTextModelWithProjection(config).eval()
    net.load_state_dict({name: torch.from_numpy(np.ascontiguousarray(x)) for name, x in tensors.items()})
    return net


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="output folder")
    parser.add_argument("--layers", type=int, default=3)
    parser.add_argument("--width", type=int, default=128)
    parser.add_argument("--dim", type=int, default=512, help="width of an embedding")
    parser.add_argument("--per-task", type=int, default=1, metavar="N", help="instructions of each task")
    parser.add_argument("--weights", choices=("huggingface", "openai"), help="also write the weights")
    parser.add_argument("--time", action="store_true")
    args = parser.parse_args()

    shapes = canonical_shapes(args.layers, args.width, args.dim)
    tensors = {name: np.asarray(generated_tensor(name, shape), np.float32) for name, shape in shapes.items()}
    net = make_net(tensors, args.layers, args.width, args.dim)
    texts = [*EDGE_CASES, *suite_texts(args.per_task)]
    ids = tokens(texts)
    start = time.perf_counter()
    with torch.no_grad():
        embeddings = torch.cat([net(torch.tensor([row])).text_embeds for row in ids]).numpy()
    if args.time:
        print(f"{(time.perf_counter() - start) / len(texts) * 1e3:.1f} ms per text")

    args.out.mkdir(parents=True, exist_ok=True)
    rows = ",\n".join("  " + json.dumps({"text": text, "ids": row}) for text, row in zip(texts, ids))
    head = f'"fingerprint": "{fingerprint(tensors)}"'
    (args.out / "reference.json").write_text(f'{{{head}, "texts": [\n{rows}\n]}}\n')
    save_file({"embeddings": embeddings}, args.out / "reference.safetensors")
    if args.weights:
        save_file(tensors if args.weights == "huggingface" else to_openai(tensors), args.out / "model.safetensors")


if __name__ == "__main__":
    main()
