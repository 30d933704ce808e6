"""LeRobot's reading of datasets written by `hypogeum demos`.

Set HYPOGEUM to the binary, and install lerobot[dataset].
"""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

HYPOGEUM = os.environ.get("HYPOGEUM")
pytestmark = pytest.mark.skipif(not HYPOGEUM, reason="HYPOGEUM is not set to the binary")
lerobot_dataset = pytest.importorskip("lerobot.datasets.lerobot_dataset", exc_type=ImportError)

LIMIT_S = 300
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
STATE, INSTRUCTION = "observation.state", "observation.environment_state"
CASES = [("single", "RaiseCube,OpenDrawer", 25, 7, 3), ("bimanual", "DualArmDrawerOpen", 64, 16, 4)]


@pytest.fixture(scope="module")
def demos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demos")
    tasks = ",".join(tasks for _, tasks, *_ in CASES)
    subprocess.run([HYPOGEUM, "demos", "-o", folder, "--tasks", tasks, "--episodes", "2"], check=True, timeout=LIMIT_S)
    return folder


@pytest.mark.parametrize("morphology, tasks, state_dim, action_dim, n_cameras", CASES)
def test_lerobot_reads_dataset_with_equal_statistics(demos, morphology, tasks, state_dim, action_dim, n_cameras):
    from lerobot.datasets.compute_stats import aggregate_stats, compute_episode_stats

    dataset = lerobot_dataset.LeRobotDataset(f"hypogeum/{morphology}", root=demos / morphology)
    n_tasks = len(tasks.split(","))
    assert dataset.num_episodes == 2 * n_tasks and len(dataset.meta.tasks) == n_tasks and dataset.fps == 20
    cameras = [name for name in dataset.features if name.startswith("observation.images.")]
    assert len(cameras) == n_cameras

    frames = [dataset[idx] for idx in range(len(dataset))]
    assert [int(frame["index"]) for frame in frames] == list(range(dataset.num_frames))
    for frame in (frames[0], frames[-1]):
        assert frame[STATE].shape == (state_dim,) and frame["action"].shape == (action_dim,)
        assert frame[INSTRUCTION].shape == (64,)
        for camera in cameras:
            height, width, _ = dataset.features[camera]["shape"]
            assert frame[camera].shape == (3, height, width) and 0.01 < float(frame[camera].mean()) < 0.99
    assert frames[0]["task"] != frames[-1]["task"] or n_tasks == 1

    episodes = []
    for episode in dataset.meta.episodes:
        episode_frames = frames[episode["dataset_from_index"] : episode["dataset_to_index"]]
        assert len(episode_frames) == episode["length"]
        assert {int(frame["episode_index"]) for frame in episode_frames} == {episode["episode_index"]}
        names = (STATE, INSTRUCTION, "action")
        numbers = {name: np.stack([frame[name].numpy() for frame in episode_frames]) for name in names}
        episodes.append(compute_episode_stats(numbers, {name: dataset.features[name] for name in names}))
    for name, theirs in aggregate_stats(episodes).items():
        ours = dataset.meta.stats[name]
        numbers = np.stack([frame[name].numpy() for frame in frames]).astype(np.float64)
        np.testing.assert_allclose(ours["mean"], numbers.mean(0), rtol=0, atol=1e-9, err_msg=name)
        np.testing.assert_allclose(ours["std"], numbers.std(0), rtol=0, atol=1e-9, err_msg=name)
        for quantile, q in QUANTILES.items():
            np.testing.assert_allclose(ours[quantile], np.quantile(numbers, q, axis=0), rtol=0, atol=1e-12)
        # Interpolation leaves at most one more frame on either side.
        assert ((numbers < ours["q01"]) | (numbers > ours["q99"])).mean() <= 0.02 + 2 / len(numbers), name
        # LeRobot derives quantiles from histograms, and deviations from differences of large numbers.
        for statistic, tolerance in {"min": 0, "max": 0, "mean": 1e-5, "std": 1e-3, "count": 0}.items():
            np.testing.assert_allclose(ours[statistic], theirs[statistic], rtol=1e-4, atol=tolerance, err_msg=name)
    for camera in cameras:
        pixels = np.stack([frame[camera].numpy() for frame in frames])
        np.testing.assert_allclose(np.ravel(dataset.meta.stats[camera]["mean"]), pixels.mean((0, 2, 3)), atol=0.01)
        for quantile, q in QUANTILES.items():
            # JPEG changes single pixels.
            expected = np.quantile(pixels, q, axis=(0, 2, 3))
            np.testing.assert_allclose(np.ravel(dataset.meta.stats[camera][quantile]), expected, atol=0.02)


def test_lerobot_train_names_the_encoder(demos, tmp_path):
    """Train with LeRobot's own command, as docs/demonstrations.md shows it, and read what it writes."""
    from safetensors.numpy import load_file

    from lerobot.datasets.compute_stats import aggregate_stats
    from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata

    meta = LeRobotDatasetMetadata("hypogeum/single", root=demos / "single")
    assert meta.features[INSTRUCTION]["info"] == {"encoder": "hashed", "version": 1}
    aggregated = aggregate_stats([meta.stats])[INSTRUCTION]
    np.testing.assert_allclose(aggregated["q99"], meta.stats[INSTRUCTION]["q99"])

    small = {
        "dim_model": 32, "n_heads": 2, "dim_feedforward": 32, "n_encoder_layers": 1, "n_vae_encoder_layers": 1,
        "chunk_size": 20, "n_action_steps": 20, "pretrained_backbone_weights": "null",
    }  # fmt: skip
    command = [
        sys.executable, "-m", "lerobot.scripts.lerobot_train", "--dataset.repo_id=mine/single",
        f"--dataset.root={demos / 'single'}", "--policy.type=act", "--policy.device=cpu", "--policy.push_to_hub=false",
        *(f"--policy.{name}={value}" for name, value in small.items()),
        "--batch_size=2", "--steps=2", "--num_workers=0", f"--output_dir={tmp_path / 'act'}",
    ]  # fmt: skip
    subprocess.run(command, check=True, timeout=LIMIT_S, env=os.environ | {"HF_HUB_OFFLINE": "1"})
    checkpoint = tmp_path / "act/checkpoints/last/pretrained_model"
    steps = json.loads((checkpoint / "policy_preprocessor.json").read_text())["steps"]
    [state] = [step["state_file"] for step in steps if step["registry_name"] == "normalizer_processor"]
    assert load_file(checkpoint / state)[f"{INSTRUCTION}.hashed"].tolist() == [1.0]
