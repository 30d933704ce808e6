"""PyTorch and ONNX Runtime as the peers of `cargo bench -p benches --bench policy -- --peer PYTHON`.

Usage: `act_inference.py CHECKPOINT_DIR N_THREADS`. Loads the checkpoint into the plain PyTorch network of
`python/make_act_checkpoint.py` and exports it to ONNX. A request is a line `ENGINE BATCH_SIZE` on standard input, where ENGINE is
`torch`, `onnxruntime` or `onnxruntime-int8`; the response is a line with the elapsed time in s of the second of two batches.

All engines start from bytes, `[n, n_cameras, 3, 224, 224] u8`. Scaling and normalisation are part of the measured time; upsampling
the hand camera images is not, although our implementation does that too. All compute only the decoder layer that reaches the
output. `onnxruntime-int8` is the same network after ONNX Runtime's static quantisation (8-bit weights per channel, 8-bit activations
calibrated on the inputs that are timed). Requirements: `python -m pip install numpy safetensors torch onnx onnxruntime`.
"""

import json
import logging
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np
import onnxruntime
import torch
from safetensors.torch import load_file

sys.path.insert(0, str(Path(__file__).parents[2] / "python"))

from make_act_checkpoint import Act  # noqa: E402
from onnxruntime import quantization  # noqa: E402


class Calibration(quantization.CalibrationDataReader):
    """Yields the given batches."""

    def __init__(self, batches):
        self.batches = iter(batches)

    def get_next(self):
        return next(self.batches, None)


class FromBytes(torch.nn.Module):
    """ACT with the conversion from u8 images to normalised inputs in front."""

    def __init__(self, net):
        super().__init__()
        self.net = net
        self.register_buffer("mean", torch.tensor([0.485, 0.456, 0.406])[:, None, None])
        self.register_buffer("std", torch.tensor([0.229, 0.224, 0.225])[:, None, None])

    def forward(self, images, state, embedding):
        return self.net((images.float() / 255 - self.mean) / self.std, state, embedding)[0]


class Peers:
    def __init__(self, folder, n_threads):
        torch.set_num_threads(n_threads)
        self.config = json.loads((folder / "config.json").read_text())
        net = Act(self.config)
        missing = net.load_state_dict(load_file(folder / "model.safetensors"), strict=False).unexpected_keys
        assert not missing, missing
        self.net = FromBytes(net).eval()
        with tempfile.TemporaryDirectory() as scratch:
            path = str(Path(scratch) / "act.onnx")
            names = ["images", "state", "embedding"]
            torch.onnx.export(
                self.net, self.inputs(2), path, input_names=names, output_names=["actions"], dynamo=False,
                dynamic_axes={name: {0: "n"} for name in [*names, "actions"]},
            )
            quantised = str(Path(scratch) / "act-int8.onnx")
            prepared = str(Path(scratch) / "prepared.onnx")
            quantization.shape_inference.quant_pre_process(path, prepared, skip_symbolic_shape=True)
            quantization.quantize_static(
                prepared, quantised, Calibration([self.named_inputs(n) for n in (1, 8)]), per_channel=True,
                quant_format=quantization.QuantFormat.QDQ,
            )
            options = onnxruntime.SessionOptions()
            options.intra_op_num_threads = n_threads
            self.sessions = {
                engine: onnxruntime.InferenceSession(file, options, providers=["CPUExecutionProvider"])
                for engine, file in (("onnxruntime", path), ("onnxruntime-int8", quantised))
            }

    def inputs(self, n):
        c, random = self.config, np.random.default_rng(0)
        images = random.integers(0, 256, (n, c["n_cameras"], 3, 224, 224), np.uint8)
        state = random.uniform(-1, 1, (n, c["state_dim"])).astype(np.float32)
        embedding = random.uniform(-1, 1, (n, c["language"]["dim"])).astype(np.float32)
        return tuple(map(torch.from_numpy, (images, state, embedding)))

    def named_inputs(self, n):
        return {name: x.numpy() for name, x in zip(("images", "state", "embedding"), self.inputs(n))}

    def run(self, engine, n):
        inputs, named = self.inputs(n), self.named_inputs(n)
        for _ in range(2):
            start = time.perf_counter()
            if engine == "torch":
                with torch.inference_mode():
                    self.net(*inputs)
            else:
                self.sessions[engine].run(None, named)
        return time.perf_counter() - start

    def difference(self):
        """Returns the maximum absolute difference between the actions of the two engines."""
        with torch.inference_mode():
            found = self.net(*self.inputs(2)).numpy()
        return float(np.abs(found - self.sessions["onnxruntime"].run(None, self.named_inputs(2))[0]).max())


def main():
    warnings.filterwarnings("ignore")
    logging.disable(logging.WARNING)
    peers = Peers(Path(sys.argv[1]), int(sys.argv[2]))
    versions = f"torch {torch.__version__}, onnxruntime {onnxruntime.__version__}"
    print(f"{versions}, actions differ by {peers.difference():.1e}", flush=True)
    for request in sys.stdin:
        engine, n = request.split()
        print(peers.run(engine, int(n)), flush=True)


if __name__ == "__main__":
    main()
