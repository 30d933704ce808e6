"""Execution of a checkpoint's chunks in a run, and descriptors of runs."""

import json
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from messages import attached

from hypogeum import endpoint, host
from hypogeum.execution import ChunkSettings, Requested, RunRefused
from hypogeum.layout import MAX_HORIZON, SCHEMA_HASH


@pytest.mark.parametrize(
    "settings, options, n_rows, note",
    [
        (ChunkSettings(8, None, 16), {}, 8, "executes 8 of 16 rows per query (n_action_steps of the checkpoint)"),
        (ChunkSettings(30, None, 100), {}, 30, "executes 30 of 100 rows per query (n_action_steps of the checkpoint)"),
        (
            ChunkSettings(8, None, 16),
            dict(execute=4),
            None,
            "4 of 16 rows per query (--execute; its own n_action_steps is 8)",
        ),
        (ChunkSettings(8, None, 16), dict(execute=50), None, "executes 16 of 16 rows per query (--execute; its own"),
        (ChunkSettings(8, None, 16), dict(execute=50), None, "is 8, but 50 is more than a chunk has)"),
        (ChunkSettings(8, None, 16), dict(execute=8), None, "executes 8 of 16 rows per query (--execute)"),
        (ChunkSettings(8, None, 16), dict(mode="chunk"), 8, "executes 8 of 16 rows per query (n_action_steps of the"),
        (
            ChunkSettings(1, 0.05, 70),
            dict(mode="chunk"),
            30,
            "30 of 70 rows per query (the default; its own temporal_ens",
        ),
        (ChunkSettings(1, 0.05, 70), dict(execute=9), None, "its own temporal_ensemble_coeff of 0.05 is not used)"),
        (ChunkSettings(1, 0.05, 70), dict(mode="ensemble"), None, "averaged (temporal_ensemble_coeff 0.05)"),
        (ChunkSettings(8, None, 16), dict(mode="ensemble"), None, "by default; its own n_action_steps is 8)"),
        (ChunkSettings(), {}, 30, "executes 30 rows per query (the default)"),
    ],
)
def test_request_wins_over_checkpoint_over_default(settings, options, n_rows, note):
    found = settings.resolve(attached(**options))
    assert found.n_rows == n_rows and note in found.note


@pytest.mark.parametrize(
    "settings, options, words",
    [
        (ChunkSettings(60, None, 90), {}, ("n_action_steps is 60", "executes 30 rows", "add --execute 60 to")),
        (ChunkSettings(60, None, 90), dict(mode="chunk"), ("n_action_steps is 60", "add --execute 60 to")),
        (ChunkSettings(500, None, 500), {}, (f"at most {MAX_HORIZON} rows", f"add --execute {MAX_HORIZON} to")),
        (ChunkSettings(1, 0.01, 100), {}, ("temporal_ensemble_coeff is 0.01", "--mode ensemble", "--mode chunk")),
    ],
)
def test_unrequested_difference_is_refused_by_name(settings, options, words):
    with pytest.raises(RunRefused) as error:
        settings.resolve(attached(**options))
    assert all(word in str(error.value) for word in words) and "\n" not in str(error.value)


class Choosy:
    """Policy that refuses every run but one."""

    def on_attach(self, run):
        if run.path != "accepted":
            raise RunRefused(f"not {run.path}")


@pytest.mark.parametrize("forever", [False, True])
def test_refused_run_is_left_alone(monkeypatch, caplog, forever):
    runs = iter([SimpleNamespace(path=path, root=path, mode="chunk") for path in ("refused", "accepted")])

    def attach(run):
        raise InterruptedError(run.path)

    monkeypatch.setitem(sys.modules, "hypogeum.link", SimpleNamespace(Lane=attach, RunEnded=TimeoutError))
    monkeypatch.setattr(host, "wait_for_endpoint", lambda *_: next(runs))
    with pytest.raises(InterruptedError if forever else RunRefused, match="accepted" if forever else "not refused"):
        host.serve(Choosy(), forever=forever)
    assert ("refused the run in refused: not refused" in caplog.text) == forever


def descriptor(**changes):
    lane = dict(lane=0, policy="p", max_envs=4, block_pages=87, in_flight=2)
    return dict(
        domain=dict(root="/runs/0123456789ab", prefix=f"hyp_{os.getuid()}_0123456789ab_"), lane=lane, run=7, schema_hash=f"{SCHEMA_HASH:016x}",
        morphologies=["single"], images="224x224,wrist=128x128", answer_timeout_s=120, execute=30, mode="chunk", requested=dict(mode=None, execute=12),
    ) | changes  # fmt: skip


def test_descriptor_tells_what_was_requested():
    found = endpoint.parse(Path("/runs/0123456789ab/attach/mine.json"), json.dumps(descriptor()))
    assert found.requested == Requested(None, 12) and (found.mode, found.execute) == ("chunk", 30)


def test_descriptor_of_another_version_is_named(tmp_path):
    older = descriptor(schema_hash="0000000000000005")
    del older["requested"]
    with pytest.raises(
        endpoint.EndpointError, match="schema 0x0000000000000005, this package uses 0x.*install the package"
    ):
        endpoint.parse(tmp_path, json.dumps(older))
