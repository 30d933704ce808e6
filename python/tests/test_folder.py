"""Resolution of a path to a checkpoint folder."""

import logging

import pytest

from hypogeum.folder import resolve_checkpoint
from hypogeum.mapping import MappingError


@pytest.fixture
def run(tmp_path):
    """A folder of lerobot-train with the checkpoints 5, 10 and 200."""
    for step in ("000005", "000010", "000200"):
        folder = tmp_path / "run/checkpoints" / step / "pretrained_model"
        folder.mkdir(parents=True)
        (folder / "config.json").write_text("{}")
    return tmp_path / "run"


@pytest.mark.parametrize("path", ["", "checkpoints", "checkpoints/000010", "checkpoints/000010/pretrained_model"])
@pytest.mark.parametrize("has_last", [False, True])
def test_training_run_stands_for_a_checkpoint(run, path, has_last, caplog):
    if has_last:
        (run / "checkpoints/last").symlink_to("000010", target_is_directory=True)
    step = "000010" if has_last or "000010" in path else "000200"
    with caplog.at_level(logging.INFO, "hypogeum"):
        found = resolve_checkpoint(run / path)
    assert found == run / "checkpoints" / step / "pretrained_model"
    assert (f"is {found}" in caplog.text) == ("pretrained_model" not in path)


def test_last_checkpoint_is_resolved_once(run):
    last = run / "checkpoints/last"
    last.symlink_to("000010", target_is_directory=True)
    found = resolve_checkpoint(last / "pretrained_model")
    last.unlink()
    last.symlink_to("000200", target_is_directory=True)
    assert found.parent.name == "000010"


def test_home_is_expanded(run, monkeypatch):
    monkeypatch.setenv("HOME", str(run))
    assert resolve_checkpoint("~/checkpoints/000005").parent.name == "000005"
    assert resolve_checkpoint("~").parent.name == "000200"


@pytest.mark.parametrize(
    "path, words",
    [
        ("lerobot/act_aloha", "hf download lerobot/act_aloha --local-dir act_aloha"),
        ("./lerobot/act_aloha", "lerobot/act_aloha does not exist"),
        ("~/nowhere/act", "nowhere/act does not exist"),
        ("a/b/c", "a/b/c does not exist"),
    ],
)
def test_missing_folder_is_told_from_hub_id(tmp_path, monkeypatch, path, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MappingError) as error:
        resolve_checkpoint(path)
    assert words in str(error.value)


def test_file_is_rejected(tmp_path):
    (tmp_path / "model.safetensors").touch()
    with pytest.raises(MappingError, match="model.safetensors is a file, expected the folder"):
        resolve_checkpoint(tmp_path / "model.safetensors")
