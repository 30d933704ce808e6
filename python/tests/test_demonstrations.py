"""Demonstrations as the training scripts read them, and the schedule of a training. Set HYPOGEUM to the binary."""

import io
import os
import subprocess

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pq = pytest.importorskip("pyarrow.parquet")
Image = pytest.importorskip("PIL.Image")

from hypogeum.demonstrations import ACTION, IMAGES, STATE, TrainingFrames, prefetched  # noqa: E402
from hypogeum.images import to_network  # noqa: E402
from hypogeum.training import Schedule  # noqa: E402

HYPOGEUM = os.environ.get("HYPOGEUM")
needs_binary = pytest.mark.skipif(not HYPOGEUM, reason="HYPOGEUM is not set to the binary")
LIMIT_S = 300
N_EPISODES = 2


def record(folder, *options, tasks="RaiseCube,OpenDrawer", episodes=N_EPISODES):
    command = [HYPOGEUM, "demos", "-o", folder, "--tasks", tasks, "--episodes", str(episodes), "--images", "png"]
    subprocess.run([*command, *options], check=True, timeout=LIMIT_S)
    return folder / "single"


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    return record(tmp_path_factory.mktemp("demos"))


def read(root, cache, tasks=None, factor=2, **options):
    cache.mkdir()
    return TrainingFrames(root, tasks, cache, size_of=lambda *sides: [side // factor for side in sides], **options)


def rows(root, tasks):
    """All rows of the dataset's files whose task is among these."""
    names = {row["task_index"]: row for row in pq.read_table(root / "meta/tasks.parquet").to_pylist()}
    assert len(names) == 2
    found = [row for path in sorted(root.glob("data/*/*.parquet")) for row in pq.read_table(path).to_pylist()]
    episodes = {"RaiseCube": {0, 1}, "OpenDrawer": {2, 3}}
    return [row for row in found if any(row["episode_index"] in episodes[task] for task in tasks)]


@needs_binary
def test_images_are_those_of_the_network(root, tmp_path):
    data = read(root, tmp_path / "cache", ["OpenDrawer"])
    expected = rows(root, ["OpenDrawer"])
    assert data.n_frames == len(data.observed) == len(expected) and data.tasks == ["OpenDrawer"]
    for name, values in data.vectors.items():
        assert np.array_equal(values, np.array([row[name] for row in expected], np.float32)), name
    for name, images in data.images.items():
        for idx in range(0, len(expected), 7):
            pixels = np.asarray(Image.open(io.BytesIO(expected[idx][name]["bytes"])))
            network = to_network(pixels[None], *data.cameras[name][1:])
            assert torch.equal(images[idx].permute(2, 0, 1) / 255, network[0]), (name, idx)


@needs_binary
def test_images_equal_those_shrunk_before_storing(root, tmp_path):
    shrunk = read(record(tmp_path, "--shrink", "2"), tmp_path / "shrunk", factor=1)
    whole = read(root, tmp_path / "whole")
    for name, images in whole.images.items():
        assert torch.equal(images, shrunk.images[name]), name


@needs_binary
def test_cache_is_independent_of_processes(root, tmp_path):
    one, three = (read(root, tmp_path / f"{n}", processes=n) for n in (1, 3))
    for parts in ("images", "vectors"):
        for name, values in getattr(one, parts).items():
            assert torch.equal(values, getattr(three, parts)[name]), name


@needs_binary
def test_stride_keeps_actions_dense(root, tmp_path):
    dense = read(root, tmp_path / "dense")
    hand = f"{IMAGES}hand"
    strided = read(root, tmp_path / "strided", stride=5, cameras=[hand], vectors=(STATE, ACTION))
    assert list(strided.images) == [hand] and set(strided.vectors) == {STATE, ACTION}
    assert torch.equal(strided.vectors[ACTION], dense.vectors[ACTION])
    ages = strided.observed - strided.starts[strided.observed]
    assert set(ages % 5) == {0} and (ages == 0).sum() == 2 * N_EPISODES
    assert torch.equal(strided.images[hand], dense.images[hand][strided.observed])
    strided.place("cpu")
    assert torch.equal(strided.gather([3, 1])[hand], dense.gather(strided.observed[[3, 1]])[hand])


@needs_binary
def test_dataset_of_another_protocol_is_refused(tmp_path):
    root = record(tmp_path / "demos", "--protocol", "lerobot", tasks="OpenDrawer", episodes=1)
    with pytest.raises(SystemExit, match="has no observation.environment_state.*without --protocol lerobot"):
        read(root, tmp_path / "cache")


def test_prefetched_batches_keep_their_order():
    assert list(prefetched(lambda step: 2 * step, range(3, 20))) == list(range(6, 40, 2))


def test_schedule_cools_down_within_its_time():
    now = 100.0
    schedule = Schedule(2.0, 1000, warm_up=10, cool_down=0.25, seconds=200, clock=lambda: now)
    rates = []
    for step in range(1000):
        progress = schedule.progress(step)
        if progress >= 1:
            break
        rates.append(schedule.rate_at(step, progress))
        now += 1
    assert step == 200 and rates[:2] == [0.2, 0.4] and rates[10:150] == [2.0] * 140
    assert np.allclose(rates[150:], np.linspace(2, 0, 50, endpoint=False))


def test_schedule_without_time_follows_steps():
    schedule = Schedule(1.0, 200, warm_up=1, cool_down=0.5)
    assert [schedule.rate_at(step, schedule.progress(step)) for step in (0, 99, 150, 200)] == [1, 1, 0.5, 0]
    spent = Schedule(1.0, 200, warm_up=1, cool_down=0.5, seconds=-1)
    assert spent.progress(0) == 1
