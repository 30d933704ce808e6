"""Results files and comparisons. Set HYPOGEUM to the `hypogeum` binary."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

HYPOGEUM = os.environ.get("HYPOGEUM")
pytestmark = pytest.mark.skipif(not HYPOGEUM, reason="HYPOGEUM is not set to the binary")

import hypogeum  # noqa: E402
from hypogeum.comparison import Comparison  # noqa: E402

SHORT = {"options": ("--threads", "1"), "quiet": True}


def run(db, *policies, episodes=12, tasks="RaiseCube", options=()):
    named = [word for policy in policies for word in ("--policy", policy)]
    words = [*named, "--tasks", tasks, "--episodes", str(episodes), "--threads", "1", "--db", db, "--quiet", *options]
    subprocess.run([HYPOGEUM, "run", *words], check=True, capture_output=True)
    return db


@pytest.fixture(scope="module")
def db(tmp_path_factory):
    """Results of an expert and of a policy that does nothing."""
    return run(tmp_path_factory.mktemp("results") / "r.db", "good=expert", "bad=idle")


def test_cells_are_the_programs(db):
    words = "run --json --policy good=expert --policy bad=idle --tasks RaiseCube --episodes 12 --db".split()
    done = subprocess.run([HYPOGEUM, *words, db], check=True, capture_output=True, text=True)
    expected = json.loads(done.stdout)["cells"]
    cells = hypogeum.Results(db).cells
    assert [[cell.low, cell.high] for cell in sorted(cells, key=lambda cell: -cell.rate)] == [
        cell["wilson95"] for cell in expected
    ]
    [good] = hypogeum.Results(db, policy="good").cells
    assert (good.task, good.perturbation, good.n, good.successes, good.rate, good.errors) == (
        "RaiseCube", "None", 12, 12, 1.0, 0,
    )  # fmt: skip
    assert 0.7 < good.low < good.high <= 1


def test_package_has_the_rows_of_its_file(db, tmp_path):
    package = tmp_path / "r.zip"
    subprocess.run([HYPOGEUM, "pack", db, "-o", package], check=True)
    results, packed = hypogeum.Results(db), hypogeum.Results(package)
    assert packed.cells == results.cells and {row["file"] for row in packed.episodes} == {str(package)}
    assert packed.episodes == [row | {"file": str(package)} for row in results.episodes]


def test_tables_have_all_cells(db):
    results = hypogeum.Results(db)
    assert "good" in str(results) and "100.0 %" in str(results)
    assert results._repr_html_().count("<tr>") == 3 and "<td>RaiseCube</td>" in results._repr_html_()


def test_frame_has_a_row_per_episode(db, monkeypatch):
    pandas = pytest.importorskip("pandas")
    frame = hypogeum.Results(db).frame()
    assert len(frame) == 24 and frame.groupby("policy").success_once.mean().to_dict() == {"good": 1, "bad": 0}
    assert not {"actions", "checksum"} & set(frame.columns) and isinstance(frame, pandas.DataFrame)
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ModuleNotFoundError, match="pip install pandas"):
        hypogeum.Results(db).frame()


def test_better_policy_is_found(db):
    good, bad = hypogeum.Results(db, policy="good"), hypogeum.Results(db, policy="bad")
    gain, loss = good.compare(bad), bad.compare(good)
    assert (gain.verdict, loss.verdict) == ("better", "not better")
    assert gain.difference == -loss.difference == 1 and gain.interval[0] > 0 > loss.interval[1]
    assert [flip.episode for flip in gain.flips] == list(range(12)) and all(flip.gained for flip in gain.flips)
    assert not any(flip.gained for flip in loss.flips)
    assert str(gain).startswith("good is better than bad: +100.0 points (95 % interval +")
    assert "12 newly solved and 0 no longer" in str(gain)


def test_same_policy_is_not_better(tmp_path):
    first, second = (hypogeum.Results(run(tmp_path / name, "p=idle", episodes=100)) for name in ("a.db", "b.db"))
    comparison = second.compare(first)
    assert comparison.verdict == "not better" and comparison.flips == [] and comparison.difference == 0
    few = second.compare(first, margin=0.01)
    assert few.verdict == "undecided" and "more episodes" in str(few)


def test_policies_of_one_name_are_told_apart(db, tmp_path):
    results = hypogeum.Results(run(tmp_path / "o.db", "bad=random"))
    comparison = results.compare(hypogeum.Results(db, policy="good"))
    assert comparison.verdict == "not better" and comparison.difference == -1
    again = hypogeum.Results(db, policy="bad").compare(results)
    assert again.verdict == "undecided" and "the previous bad" in str(again) and again.n == 12


def test_mean_over_cells_decides(tmp_path):
    results = hypogeum.Results(run(tmp_path / "m.db", "a=expert", "b=idle", tasks="RaiseCube,StackCube", episodes=12))
    with pytest.raises(hypogeum.EvaluationError, match="policy=NAME"):
        results.compare(results)
    sides = [hypogeum.Results(results.paths[0], policy=name) for name in "ab"]
    comparison = sides[0].compare(sides[1])
    assert comparison.verdict == "better" and comparison.n == 24 and "in 2 cells" in str(comparison)


def test_cells_that_ended_early_have_no_mean(tmp_path):
    options = ("--until-decided", "a,b")
    early = run(tmp_path / "e.db", "a=expert", "b=idle", tasks="RaiseCube,StackCube", episodes=30, options=options)
    comparison = hypogeum.Results(early, policy="a").compare(hypogeum.Results(early, policy="b"))
    assert comparison.verdict == "undecided" and comparison.difference is None and comparison.interval is None
    assert "undecided" in str(comparison)
    assert {cell["verdict"]["decision"] for cell in comparison.data["cells"]} == {"a_better"}


def test_options_that_differ_are_refused(db, tmp_path):
    other = hypogeum.Results(run(tmp_path / "s.db", "good=expert", options=("--seed", "5")))
    with pytest.raises(hypogeum.EvaluationError, match="seed is 0 in the first"):
        hypogeum.Results(db, policy="good").compare(other)
    both = hypogeum.Results(db, other.paths[0], policy="good", across=["seed"])
    assert [cell.n for cell in both.cells] == [24] and len(both.episodes) == 24


def test_replay_shows_the_episode(db):
    pytest.importorskip("PIL")
    results = hypogeum.Results(db, policy="good")
    frames = results.replay(3)
    steps = results.episodes[3]["steps"]
    assert frames.dtype == np.uint8 and frames.ndim == 4 and frames.shape[3] == 3 and len(frames) == steps + 1
    assert (frames[0] != frames[-1]).any() and frames.std() > 10
    assert np.array_equal(results.replay(3, stride=4), frames[::4])
    flip = results.compare(hypogeum.Results(db, policy="bad")).flips[3]
    assert np.array_equal(results.replay(flip, stride=20)[:-1], frames[:-1:20])
    assert results.replay(3, stride=20, scale=2).shape[2] > 1.9 * frames.shape[2]


def test_damaged_file_is_refused(db, tmp_path):
    damaged = tmp_path / "d.db"
    damaged.write_bytes(Path(db).read_bytes().replace(b"RaiseCube", b"RaiseCubf"))
    for read in (lambda results: results.cells, lambda results: results.episodes):
        with pytest.raises(hypogeum.EvaluationError):
            read(hypogeum.Results(damaged))
    with pytest.raises(hypogeum.EvaluationError, match="nowhere.db"):
        hypogeum.Results(tmp_path / "nowhere.db").cells  # noqa: B018


def test_rates_and_table_are_logged(db):
    class Tracker:
        Table = SimpleNamespace

        def log(self, values, step=None):
            self.values, self.step = values, step

    tracker = Tracker()
    hypogeum.Results(db, policy="good").log(tracker, step=7)
    assert tracker.step == 7
    assert tracker.values == {"eval/success_once": 1, "eval/success_once/RaiseCube": 1, "eval/errors": 0}
    hypogeum.Results(db).log(tracker, prefix="test")
    assert tracker.values["test/success_once/bad/RaiseCube"] == 0 and tracker.values["test/success_once"] == 0.5
    tracker.__name__ = __name__
    sys.modules[__name__].Table = SimpleNamespace
    hypogeum.Results(db).log(tracker)
    assert len(tracker.values["eval/cells"].data) == 2 and tracker.values["eval/cells"].columns[0] == "policy"


@pytest.mark.parametrize("tracker", ["wandb", "trackio"])
def test_trackers_take_the_values(tracker, db, tmp_path, monkeypatch):
    module = pytest.importorskip(tracker)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TRACKIO_DIR", str(tmp_path))
    options = {"mode": "offline", "dir": str(tmp_path)} if tracker == "wandb" else {}
    started = module.init(project="hypogeum-test", **options)
    hypogeum.Results(db).log(started, step=0)
    hypogeum.Results(db).log(module, step=1)
    if tracker == "wandb":
        assert started.summary["eval/success_once"] == 0.5 and started.summary["eval/cells"]["nrows"] == 2
    module.finish()


def test_comparison_reads_a_file_without_flips():
    data = {"cells": [], "groups": [], "flips": [], "levels": {"alpha": 0.05}}
    assert str(Comparison(data, "a", "b")) == (
        "whether a is better than b is undecided, 0 matched episodes, 0 newly solved and 0 no longer"
    )
