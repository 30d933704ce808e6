"""Image resizing and the hashed language encoder."""

import numpy as np
import pytest

from hypogeum.language import hashed_embedding

torch = pytest.importorskip("torch")


def test_image_of_target_size_is_only_scaled():
    from hypogeum.images import to_network

    images = np.random.default_rng(0).integers(0, 256, (2, 8, 8, 3), np.uint8)
    found = to_network(images, 8, 8)
    assert found.shape == (2, 3, 8, 8) and found.dtype == torch.float32
    assert (found.numpy().transpose(0, 2, 3, 1) == images.astype(np.float32) / np.float32(255)).all()


def test_resized_image_is_rounded_with_halves_up():
    from hypogeum.images import to_network

    images = np.zeros((1, 2, 4, 3), np.uint8)
    images[0, :, :, 0] = [[10, 11, 10, 11], [10, 11, 10, 11]]
    images[0, :, :, 1] = 255
    found = to_network(images, 2, 8) * 255
    assert (found == found.round()).all()
    assert (found[0, 1] == 255).all() and (found[0, 2] == 0).all()
    for pair, up in (([10, 11], 11), ([11, 12], 12)):
        halves = np.array(pair, np.uint8).reshape(1, 1, 2, 1).repeat(3, 3)
        assert to_network(halves, 1, 1)[0, 0, 0, 0] * 255 == up


def test_embedding_has_unit_norm_and_reflects_shared_words():
    embed = lambda text: hashed_embedding(text, 512)  # noqa: E731
    assert abs(np.linalg.norm(embed("pick up the cube and raise it")) - 1) < 0.2
    assert (embed("Raise the cube!") == embed("raise  the cube")).all()
    assert embed("raise the red cube") @ embed("raise the cube") > 0.5
    assert (embed(" ,!") == 0).all() and embed("").dtype == np.float32
