"""Endpoints of other users, and endpoints that name files of others."""

import copy
import fcntl
import json
import os
import random

import pytest

from hypogeum.endpoint import EndpointError, find_endpoint, wait_for_endpoint
from hypogeum.layout import SCHEMA_HASH
from hypogeum.trust import TrustError, own_segments

TAG = "0123456789ab"


@pytest.fixture
def base(tmp_path):
    """A base folder with one run in progress, which offers the endpoint `mine`."""
    base = tmp_path / "hypogeum"
    root = base / TAG
    (root / "attach").mkdir(parents=True)
    base.chmod(0o700)
    write(root, descriptor(root))
    with open(root / "claim.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_SH)
        yield base


def descriptor(root):
    return {
        "domain": {"root": str(root), "prefix": f"hyp_{os.getuid()}_{TAG}_"},
        "run": 7,
        "lane": {"lane": 0, "policy": "p", "max_envs": 4, "block_pages": 87, "in_flight": 2},
        "schema_hash": f"{SCHEMA_HASH:#018x}",
        "morphologies": ["single"],
        "images": "224x224,wrist=128x128",
        "answer_timeout_s": 120,
        "execute": 30,
        "mode": "chunk",
        "requested": {"mode": None, "execute": None},
    }


def write(root, fields):
    (root / "attach/mine.json").write_text(fields if isinstance(fields, str) else json.dumps(fields))


def test_own_endpoint_is_found(base):
    found = find_endpoint("mine", base)
    assert (found.root, found.prefix, found.max_envs) == (base / TAG, f"hyp_{os.getuid()}_{TAG}_", 4)


def test_folder_that_others_can_change_is_refused(base, tmp_path):
    base.chmod(0o770)
    with pytest.raises(TrustError, match="mode 0770"):
        find_endpoint("mine", base)
    base.chmod(0o700)
    tmp_path.chmod(0o777)
    with pytest.raises(TrustError, match="everybody can replace folders"):
        find_endpoint("mine", base)
    tmp_path.chmod(0o1777)
    assert find_endpoint("mine", base) is not None


def test_link_to_a_folder_is_refused(base, tmp_path):
    link = tmp_path / "link"
    link.symlink_to(base)
    with pytest.raises(TrustError, match="a symbolic link"):
        find_endpoint("mine", link)
    (base / "ba9876543210").symlink_to(base / TAG)
    os.utime(base / TAG / "attach/mine.json")
    assert find_endpoint("mine", base).root == base / TAG


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give files away")
def test_files_of_another_user_are_ignored(base, tmp_path):
    os.chown(base / TAG / "attach/mine.json", 1234, 1234)
    assert find_endpoint("mine", base) is None
    os.chown(base / TAG / "attach/mine.json", 0, 0)
    os.chown(base / TAG, 1234, 1234)
    assert find_endpoint("mine", base) is None
    os.chown(base, 1234, 1234)
    with pytest.raises(TrustError, match="belongs to user 1234"):
        find_endpoint("mine", base)


def test_folder_with_another_name_is_no_run(base):
    (base / TAG).rename(base / "other")
    assert find_endpoint("mine", base) is None


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("domain.root", "/", "domain.root"),
        ("domain.prefix", "", "domain.prefix"),
        ("domain.prefix", "*", "domain.prefix"),
        ("domain.prefix", "psm_", "domain.prefix"),
        ("run", -1, "run is -1, expected a whole number from 0"),
        ("lane.lane", True, "lane.lane is True"),
        ("lane.policy", "../x", "lane.policy"),
        ("lane.max_envs", 1e9, "lane.max_envs"),
        ("lane.max_envs", 1 << 40, "lane.max_envs"),
        ("lane.block_pages", 0, "lane.block_pages is 0, expected a whole number from 1"),
        ("lane.in_flight", "2", "lane.in_flight"),
        ("morphologies", ["triple"], "morphologies is 'triple', expected 'single' or 'bimanual'"),
        ("morphologies", 3, "not iterable"),
        ("images", 1, "images is 1, expected null or sizes"),
        ("images", "224", "images is '224', expected null or sizes"),
        ("answer_timeout_s", 0, "answer_timeout_s is 0, expected a whole number from 1"),
        ("execute", 128, "execute is 128, expected a whole number from 1 to 127"),
        ("mode", "x" * 1000, "mode is 'xxx"),
        ("requested.execute", 0, "requested.execute is 0"),
        ("schema_hash", "0x1", "link schema"),
        ("domain", None, "not an endpoint descriptor"),
        ("lane", [], "not an endpoint descriptor"),
    ],
)
def test_wrong_values_are_named(base, key, value, message):
    fields = descriptor(base / TAG)
    place = fields
    *path, last = key.split(".")
    for part in path:
        place = place[part]
    place[last] = value
    write(base / TAG, fields)
    with pytest.raises(EndpointError) as error:
        find_endpoint("mine", base)
    assert message in str(error.value) and len(str(error.value)) < 600


def test_missing_keys_are_named(base):
    complete = descriptor(base / TAG)
    for key in complete:
        fields = copy.deepcopy(complete)
        del fields[key]
        write(base / TAG, fields)
        with pytest.raises(EndpointError, match=f"'{key}' is missing"):
            find_endpoint("mine", base)


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '"x"', "[" * 100000, "x" * 70000, "\udcff"])
def test_damaged_descriptor_is_an_error(base, text):
    (base / TAG / "attach/mine.json").write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(EndpointError, match="not an endpoint descriptor"):
        find_endpoint("mine", base)


def test_special_file_is_ignored(base):
    path = base / TAG / "attach/mine.json"
    path.unlink()
    os.mkfifo(path)
    assert find_endpoint("mine", base) is None


@pytest.mark.parametrize("name", ["", ".", "../x", "a/b", "*", "x" * 65])
def test_names_are_checked(base, name):
    with pytest.raises(EndpointError, match="no name of an endpoint"):
        wait_for_endpoint(name, base, timeout_s=0)


def test_segments_are_matched_literally(tmp_path):
    for name in ("hyp_0_a_1", "hyp_0_b_1", "hyp_0_?_1", "other"):
        (tmp_path / name).touch()
    (tmp_path / "hyp_0_a_link").symlink_to(tmp_path / "other")
    assert own_segments(tmp_path, "hyp_0_a_") == [tmp_path / "hyp_0_a_1"]
    assert own_segments(tmp_path, "hyp_0_?_") == [tmp_path / "hyp_0_?_1"]


def test_mutated_descriptors_are_read_or_refused(base):
    rng = random.Random(46)
    path, original = base / TAG / "attach/mine.json", json.dumps(descriptor(base / TAG)).encode()
    tokens = [b"null", b"-1", b"1e999", b"9" * 400, b'""', b"[]", b"{}", b"NaN", b"true", b"../", b"\\u0000", b"\xff", b'"', b","]
    n_refused = 0
    for _ in range(3000):
        mutated = bytearray(original)
        for _ in range(rng.choice([1, 1, 2, 5])):
            start = rng.randrange(len(mutated) + 1)
            end = min(len(mutated), start + rng.choice([0, 1, 1, 2, 8, 40]))
            mutated[start:end] = rng.choice([b"", rng.choice(tokens), bytes([rng.randrange(256)]), mutated[start:end] * 2])
        path.write_bytes(mutated)
        try:
            found = find_endpoint("mine", base)
        except EndpointError as error:
            assert len(str(error)) < 600
            n_refused += 1
        else:
            assert (found.root, found.prefix) == (base / TAG, f"hyp_{os.getuid()}_{TAG}_")
            assert 1 <= found.max_envs <= 1 << 20 and found.policy.strip("./") and found.morphologies != "single"
    assert n_refused > 1000
