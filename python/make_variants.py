#!/usr/bin/env python3
"""Write variants of tiny LeRobot checkpoints and the actions that LeRobot executes for them, for policy-host's tests.

    make_variants.py DATA

DATA is policy-host's folder of test data, in which the base checkpoints lie. Writes `variants/variants.json`: the bases,
and for every variant its changes, its verdict, and what LeRobot does with it; and `variants/variants.safetensors`: the
actions of every variant that has some, each array once. The table of variants is in the package `variants` beside this
script, the list of settings that it must cover is the output of `list_lerobot_settings.py`. Needs `lerobot[pi]==0.6.1`
and Python 3.12.
"""

import argparse
import contextlib
import hashlib
import io
import json
import logging
import os
import shutil
import tempfile
from pathlib import Path

os.environ["HF_HUB_OFFLINE"] = "1"

import lerobot
import torch
from safetensors.numpy import load_file, save_file
from variants import act, pi05
from variants.edits import apply
from variants.loop import run

BASES = act.BASES | pi05.BASES
VARIANTS, ARRAYS = "variants.json", "variants.safetensors"


def outcome(data, variant):
    """Return the actions that LeRobot executes for a variant, or the name of its error."""
    base = BASES[variant.base]
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder) / "checkpoint"
        shutil.copytree(data / base.folder, folder)
        torch.manual_seed(0)
        try:
            apply(folder, base.edits + variant.edits)
            with contextlib.redirect_stdout(io.StringIO()):
                return run(folder, variant.n_steps or base.n_steps), None
        # LeRobot refuses by exceptions of many types.
        except Exception as error:
            logging.getLogger("variants").info("%s: %s: %r", variant.setting, variant.change, error)
            return None, type(error).__name__


def is_refused(variant):
    return isinstance(variant.verdict, dict) and "refused" in variant.verdict


def key_of(base, edits):
    """Return a text that says what LeRobot sees."""
    return json.dumps([base, edits])


class Recorded:
    """Outcomes in existing files, which are reused for variants with the same changes."""

    def __init__(self, folder):
        self.arrays, self.rows = {}, {}
        if (folder / VARIANTS).is_file():
            old = json.loads((folder / VARIANTS).read_text())
            if old["bases"] == described_bases():
                # Of several with the same changes, one that has actions.
                rows = sorted(old["variants"], key=lambda row: "actions" in row)
                self.rows = {key_of(row["base"], row.get("edits", [])): row for row in rows}
                self.arrays = load_file(folder / ARRAYS)

    def find(self, variant):
        """Return the actions and the error of a variant, or None. The actions of a refused one are not needed."""
        row = self.rows.get(key_of(variant.base, variant.edits))
        if row is None:
            return None
        if row["lerobot"] != "runs":
            return None, row["lerobot"]
        if is_refused(variant):
            return None, None
        actions = self.arrays.get(row.get("actions"))
        n_steps = variant.n_steps or BASES[variant.base].n_steps
        return None if actions is None or len(actions) != n_steps else (actions, None)


def described_bases():
    return {name: dict(folder=base.folder, edits=base.edits) for name, base in BASES.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("data", type=Path, help="policy-host's folder of test data")
    parser.add_argument("--reuse", action="store_true", help="run only the variants whose changes are not recorded yet")
    parser.add_argument("--verbose", action="store_true", help="show LeRobot's errors")
    args = parser.parse_args()
    logging.basicConfig(level=logging.ERROR)
    logging.getLogger("variants").setLevel(logging.INFO if args.verbose else logging.ERROR)
    torch.set_num_threads(1)
    out = args.data / "variants"
    out.mkdir(exist_ok=True)
    recorded = Recorded(out if args.reuse else Path("none"))

    arrays, rows, failures = {}, [], []
    for variant in [*act.variants(), *pi05.variants()]:
        actions, error = recorded.find(variant) or outcome(args.data, variant)
        row = dict(base=variant.base, setting=variant.setting, change=variant.change, verdict=variant.verdict)
        row |= {key: edits for key, edits in (("edits", variant.edits), ("own", variant.own)) if edits}
        row["lerobot"] = error or "runs"
        if error and not is_refused(variant):
            failures.append(f"{variant.base}, {variant.setting}, {variant.change}: LeRobot fails with {error}")
        elif not is_refused(variant):
            row["actions"] = hashlib.sha256(actions.tobytes()).hexdigest()[:12]
            arrays[row["actions"]] = actions
        rows.append(row)
    lines = ",\n".join(json.dumps(row, ensure_ascii=False) for row in rows)
    text = f'{{\n"lerobot": "{lerobot.__version__}",\n"bases": {json.dumps(described_bases())},\n"variants": [\n{lines}\n]\n}}\n'
    (out / VARIANTS).write_text(text)
    save_file(arrays, out / ARRAYS)
    print(f"{len(rows)} variants, {len(arrays)} different actions")
    if failures:
        raise SystemExit("\n".join(["variants that LeRobot does not run cannot be honoured:", *failures]))


if __name__ == "__main__":
    main()
