"""Observations as views of a message, and validation of messages and answers."""

import numpy as np
import pytest
from messages import message, observation

from hypogeum import AnswerError, FrameError, Observation
from hypogeum.checksum import DamagedError, check_checksum, checksum
from hypogeum.host import as_chunks
from hypogeum.layout import MAX_HORIZON, ObservationHeader


def test_arrays_share_memory_with_the_message():
    for morphology, hands in (("single", 1), ("bimanual", 2)):
        header, pages = message(n_envs=3, morphology=morphology)
        found = Observation(header, pages)
        assert found.external.shape == (3, 2, 224, 224, 3) and found.hand.shape == (3, hands, 128, 128, 3)
        for array in (found.states, found.external, found.hand, *found.cameras.values(), found[1].state, found[2].hand):
            assert np.shares_memory(array, pages)
        assert [int(images[2].min()) for images in found.cameras.values()] == [3] * (2 + hands)
        assert (found.states[:, 1] == [1, 101, 201]).all() and (found[2].state == found.states[2]).all()
        assert found.instructions == ["lift"] * 3 and [env.slot for env in found] == [0, 1, 2]


def test_images_are_none_when_not_rendered():
    found = observation(images=False)
    assert found.external is None and found.hand is None and found.cameras == {} and found[0].external is None


def test_torch_tensors_share_memory():
    pytest.importorskip("torch")
    found = observation()
    for name, tensor in found.torch().items():
        array = found.states if name == "state" else found.cameras[name]
        assert tensor.data_ptr() == array.__array_interface__["data"][0] and tuple(tensor.shape) == array.shape


def test_images_have_the_sizes_in_the_header():
    found = observation(morphology="bimanual", sizes=((640, 480), (99, 65)))
    assert found.external.shape == (2, 2, 480, 640, 3) and found.hand.shape == (2, 2, 65, 99, 3)
    assert (found.hand[1] == 2).all() and found[0].cameras["panda2_hand_camera"].shape == (65, 99, 3)


@pytest.mark.parametrize(
    "field, value, words",
    [
        ("schema_hash", 5, ("schema", "0x0000000000000005")),
        ("morphology", 2, ("morphology",)),
        ("control_mode", 3, ("control_mode",)),
        ("images", 2, ("images",)),
        ("image_sizes", (0, 0, 0, 0), ("image_sizes", "64x64 to 1280x960")),
        ("image_sizes", (1281, 224, 128, 128), ("image_sizes", "1281")),
        ("image_sizes", (224, 240, 128, 128), ("block_pages",)),
        ("n_envs", 0, ("n_envs",)),
        ("n_envs", 3, ("bytes", "implies")),
        ("block_pages", 99, ("block_pages", "87")),
    ],
)
def test_invalid_header_field_is_named(field, value, words):
    header, pages = message()
    setattr(header, field, value)
    with pytest.raises(FrameError) as error:
        Observation(header, pages)
    assert all(word in str(error.value) for word in words)


INVALID_FIELDS = [("state_dim", 24), ("instruction_len", 1025), ("execute", 0), ("execute", MAX_HORIZON + 1)]


@pytest.mark.parametrize("field, value", INVALID_FIELDS)
def test_invalid_record_field_is_named(field, value):
    with pytest.raises(FrameError, match=f"env 1: `{field}` is {value}"):
        observation(records=({}, {field: value}))


def test_invalid_utf8_instruction_is_rejected():
    with pytest.raises(FrameError, match="env 0: the instruction is not valid UTF-8"):
        observation(records=({"instruction": np.full(1024, 0xFF)},))


def test_changed_bytes_do_not_match_the_checksum():
    header, pages = message(n_envs=1)
    check_checksum(header, pages)
    header.has_checksum = 1
    header.checksum = checksum(header, pages)
    check_checksum(header, pages)
    pages[-1] ^= 1
    with pytest.raises(DamagedError, match="checksum"):
        check_checksum(header, pages)
    pages[-1] ^= 1
    header.sequence += 1
    with pytest.raises(DamagedError):
        check_checksum(header, pages)


def test_checksum_is_that_of_the_simulator():
    header = ObservationHeader(1, 2, 3, 4, 1, 1, 0, 0, 0, has_checksum=1)
    assert checksum(header, np.arange(4096, dtype=np.uint32).astype(np.uint8)) == 0x95C97948


def test_chunks_of_any_float_dtype_are_converted():
    found = observation()
    for dtype in (np.float16, np.float32, np.float64):
        chunks = as_chunks(np.ones((2, 30, 7), dtype), found)
        assert [chunk.shape for chunk in chunks] == [(30, 7)] * 2 and chunks[0].dtype == np.float32
    chunks = as_chunks([np.ones((3, 7)), np.ones((MAX_HORIZON, 7))], found)
    assert [len(chunk) for chunk in chunks] == [3, MAX_HORIZON]
    torch = pytest.importorskip("torch")
    assert as_chunks(torch.ones(2, 4, 7, dtype=torch.bfloat16), found)[1].shape == (4, 7)


def test_oversized_chunk_is_truncated_to_executed_rows():
    assert [len(chunk) for chunk in as_chunks(np.ones((2, MAX_HORIZON + 1, 7)), observation())] == [30, 30]


@pytest.mark.parametrize(
    "answer",
    [
        None,
        3.0,
        "rows",
        np.ones((2, 30, 6)),
        np.ones((1, 30, 7)),
        np.ones((2, 7)),
        np.ones((2, 0, 7)),
        [np.ones((30, 7))],
        [np.ones((30, 7)), np.ones(7)],
        np.full((2, 30, 7), None),
        np.ones((2, 30, 7), complex),
        {"actions": np.ones((2, 30, 7))},
    ],
)
def test_invalid_answer_is_rejected(answer):
    with pytest.raises(AnswerError, match="the policy function returned"):
        as_chunks(answer, observation())
