"""Demonstrations of `hypogeum demos` for training.

A dataset is read once: processes decode its images and resize them to the network's input size. The result is a cache
of memory-mapped files, from which a training script takes its batches.
"""

import io
import json
import multiprocessing
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from functools import lru_cache

import numpy as np

from .dataset import ACTION, IMAGES, STATE, stored_episodes
from .images import resize

INSTRUCTION = "observation.environment_state"
# Images that a process decodes before it resizes them together.
N_TOGETHER = 64
# Seconds between two lines of progress.
PROGRESS_S = 5
# Upper bound on the images' share of a device's free memory. A second training may run on the same device.
DEVICE_SHARE = 0.4
# Batches that are gathered ahead.
N_AHEAD = 3


@lru_cache(maxsize=1)
def shuffled(n, seed, epoch):
    """Return the order of the frames in an epoch, a permutation of `range(n)`."""
    return np.random.default_rng([seed, epoch]).permutation(n)


class TrainingFrames:
    """Frames of some tasks: vectors in memory, images memory-mapped in the network's input size.

    Args:
        root: Folder of a dataset of one morphology.
        tasks: Task names, or None for all.
        cache: Folder for the decoded images.
        size_of: Function from the height and width of a camera's images to those of the network's input.
        stride: Every nth frame of an episode is observed: it has images, and examples start there.
        cameras: Features of the cameras to read; all of them by default.
        vectors: Features of the vectors to read.
        processes: Number of processes that decode images.

    Attributes:
        settings: Settings of the dataset.
        tasks: Sorted task names.
        cameras: {feature: shape of the network's input, `[3, height, width]`}.
        starts, ends: First frame of a frame's episode, and the one after its last, `[n_frames] i64`.
        task_of: Index of a frame's task, `[n_frames] i64`.
        observed: Observed frames, `[n_observed] i64`.
        images: {feature: `[n_observed, height, width, 3] u8`}.
        vectors: {feature: `[n_frames, width] f32`}.
    """

    def __init__(
        self, root, tasks, cache, *, size_of, stride=1, cameras=None, vectors=(STATE, INSTRUCTION, ACTION), processes=1
    ):
        import torch
        from safetensors.torch import load_file

        if not (root / "meta/hypogeum.jsonl").exists():
            sys.exit(f"{root} has no meta/hypogeum.jsonl: expected a dataset of `hypogeum demos`, such as demos/single")
        self.settings = json.loads((root / "meta/hypogeum.json").read_text())
        stored = stored_episodes(root)
        known = {episode["task"] for _, _, episode in stored}
        self.tasks = sorted(set(tasks or known))
        if set(self.tasks) - known:
            sys.exit(f"{root} has no episodes of {', '.join(sorted(set(self.tasks) - known))}")
        features = json.loads((root / "meta/info.json").read_text())["features"]
        cameras = cameras or [name for name in features if name.startswith(IMAGES)]
        missing = [name for name in (*cameras, *vectors) if name not in features]
        if missing:
            sys.exit(
                f"{root} has no {', '.join(missing)}, but {', '.join(features)}; "
                "record it with `hypogeum demos` and without --protocol lerobot"
            )
        self.cameras = {name: [3, *size_of(*features[name]["shape"][:2])] for name in cameras}

        chosen = [it for it in stored if it[2]["task"] in self.tasks]
        lengths = np.array([episode["n_frames"] for _, _, episode in chosen])
        ends = np.cumsum(lengths)
        self.n_frames = int(ends[-1])
        self.starts, self.ends = np.repeat(ends - lengths, lengths), np.repeat(ends, lengths)
        self.task_of = np.repeat([self.tasks.index(episode["task"]) for _, _, episode in chosen], lengths)
        self.observed = np.flatnonzero((np.arange(self.n_frames) - self.starts) % stride == 0)

        paths = {name: cache / f"{name}-{'-'.join(map(str, shape[1:]))}.npy" for name, shape in self.cameras.items()}
        numbers = cache / "vectors.safetensors"
        if not all(path.exists() for path in [*paths.values(), numbers]):
            jobs = {}
            for (path, group, _), end, length in zip(chosen, ends, lengths):
                first = int(end - length)
                jobs.setdefault(path, []).append((group, first, int(np.searchsorted(self.observed, first))))
            self.fill(jobs, stride, paths, {name: features[name]["shape"][0] for name in vectors}, numbers, processes)
        # Copy-on-write, because torch warns of arrays that it must not write.
        self.images = {name: torch.from_numpy(np.load(path, mmap_mode="c")) for name, path in paths.items()}
        self.vectors = load_file(numbers)
        found = {len(values) for values in self.images.values()}, {len(values) for values in self.vectors.values()}
        if found != ({len(self.observed)}, {self.n_frames}):
            sys.exit(f"{cache} was made from another dataset or other tasks, or with another stride; remove it")

    def fill(self, jobs, stride, paths, widths, numbers, processes):
        """Decode every observed image once. The vectors are written last and mark the cache as complete."""
        import torch
        from safetensors.torch import save_file

        numbers.unlink(missing_ok=True)
        for name, path in paths.items():
            np.lib.format.open_memmap(path, "w+", np.uint8, (len(self.observed), *self.cameras[name][1:], 3))
        vectors = {name: np.empty((self.n_frames, width), np.float32) for name, width in widths.items()}
        start = reported = time.monotonic()
        n_decoded = 0
        # Children only decode; they use neither threads nor devices of this process.
        context = multiprocessing.get_context("fork")
        with ProcessPoolExecutor(processes, context, initializer=torch.set_num_threads, initargs=(1,)) as pool:
            decoding = [pool.submit(decode, path, groups, stride, paths, list(widths)) for path, groups in jobs.items()]
            try:
                for done in as_completed(decoding):
                    for first, rows in done.result():
                        for name, values in rows.items():
                            vectors[name][first : first + len(values)] = values
                        n_decoded += len(values)
                    now = time.monotonic()
                    if now - reported > PROGRESS_S or n_decoded == self.n_frames:
                        print(f"decoded {n_decoded} of {self.n_frames} frames, {now - start:.0f} s", flush=True)
                        reported = now
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
        save_file({name: torch.from_numpy(values) for name, values in vectors.items()}, numbers)

    def place(self, device):
        """Move vectors to a device, and images as bytes if they fit. Return whether the images are there."""
        import torch

        self.observed, self.ends = (torch.as_tensor(values).to(device) for values in (self.observed, self.ends))
        self.vectors = {name: values.to(device) for name, values in self.vectors.items()}
        if torch.device(device).type == "cuda":
            n_bytes = sum(values.numel() for values in self.images.values())
            if n_bytes > DEVICE_SHARE * torch.cuda.mem_get_info(device)[0]:
                print(f"{n_bytes / 2**30:.1f} GiB of images stay in main memory", flush=True)
                return False
            self.images = {name: values.to(device) for name, values in self.images.items()}
        return True

    def gather(self, observed):
        """Return images of observed frames, `{feature: [n, 3, height, width] u8}`, where the vectors are."""
        import torch

        device, images = self.vectors[STATE].device, {}
        for name, values in self.images.items():
            rows = values.index_select(0, torch.as_tensor(observed).to(values.device, non_blocking=True))
            if rows.device != device:
                rows = rows.pin_memory().to(device, non_blocking=True)
            images[name] = rows.permute(0, 3, 1, 2)
        return images


def decode(path, groups, stride, images, vectors):
    """Decode the observed images of some episodes into memory-mapped arrays.

    Args:
        path: Data file.
        groups: For each episode its row group, first frame and first observed frame.
        stride: Every nth frame of an episode is observed.
        images: {feature: path of its array}.
        vectors: Features of the vectors to read.

    Returns:
        For each episode its first frame and its vectors, `{feature: [n_frames, width] f32}`.
    """
    import pyarrow.parquet as pq
    import torch
    from PIL import Image

    arrays = {name: np.load(array, mmap_mode="r+") for name, array in images.items()}
    file, found = pq.ParquetFile(path), []
    for group, first, first_observed in groups:
        table = file.read_row_group(group, columns=[*images, *vectors], use_threads=False)
        for name, array in arrays.items():
            files = table.column(name).combine_chunks().field("bytes")[::stride]
            for start in range(0, len(files), N_TOGETHER):
                some = files[start : start + N_TOGETHER]
                pixels = np.stack([np.asarray(Image.open(io.BytesIO(file.as_buffer()))) for file in some])
                at = first_observed + start
                if pixels.shape[1:] != array.shape[1:]:
                    resized = resize(torch.from_numpy(pixels), *array.shape[1:3])
                    pixels = resized.to(torch.uint8).permute(0, 2, 3, 1).numpy()
                array[at : at + len(pixels)] = pixels
        rows = {name: table.column(name).combine_chunks().flatten().to_numpy() for name in vectors}
        found.append((first, {name: values.reshape(len(table), -1) for name, values in rows.items()}))
    return found


def prefetched(make, steps):
    """Yield `make(step)` for each of the steps, computed ahead by another thread."""
    with ThreadPoolExecutor(1) as thread:
        ahead = []
        for step in steps:
            ahead.append(thread.submit(make, step))
            if len(ahead) > N_AHEAD:
                yield ahead.pop(0).result()
        for last in ahead:
            yield last.result()
