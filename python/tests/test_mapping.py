"""Mapping of checkpoint features, and its error messages."""

import json

import pytest

from hypogeum.mapping import Feature, MappingError, make_mapping, read_settings

EXTERNAL, HAND = Feature("VISUAL", (3, 224, 224)), Feature("VISUAL", (3, 128, 128))


def features(**others):
    given = {"images.external1": EXTERNAL, "images.hand_camera": HAND, "state": Feature("STATE", (25,)), **others}
    return {f"observation.{name}": feature for name, feature in given.items() if feature is not None}


def test_mapping_follows_names_and_widths():
    found = make_mapping(features(), 7, {})
    assert (found.morphology, found.control_mode) == ("single", "pd_ee_delta_pose")
    assert found.images["observation.images.external1"] == ("external1_camera", 224, 224)
    assert found.images["observation.images.hand_camera"] == ("hand_camera", 128, 128)
    assert found.states["observation.state"] == [slice(0, 9), slice(9, 18), slice(18, 25)]


@pytest.mark.parametrize(
    "action_dim, width, slices",
    [
        (7, 9, [slice(0, 9)]),
        (8, 18, [slice(0, 9), slice(9, 18)]),
        (16, 18, [slice(0, 18)]),
        (14, 36, [slice(0, 18), slice(18, 36)]),
    ],
)
def test_narrow_state_maps_to_qpos_then_qvel(action_dim, width, slices):
    found = make_mapping({"observation.state": Feature("STATE", (width,))}, action_dim, {})
    assert found.states["observation.state"] == slices
    assert found.control_mode == ("pd_joint_pos" if action_dim in (8, 16) else "pd_ee_delta_pose")


def test_settings_take_precedence():
    settings = {
        "control_mode": "pd_ee_pose",
        "mapping": {
            "observation.images.front": "external2_camera",
            "observation.state": ["tcp_pose", "qpos"],
            "observation.environment_state": "language",
        },
        "language": {"encoder": "hashed", "dim": 64},
    }
    given = features(state=Feature("STATE", (16,)), environment_state=Feature("ENV", (64,)))
    given["observation.images.front"] = Feature("VISUAL", (3, 96, 96))
    given["observation.images.empty_camera_0"] = EXTERNAL
    found = make_mapping(given, 7, settings)
    assert found.control_mode == "pd_ee_pose" and found.languages == {"observation.environment_state": 64}
    assert found.images["observation.images.front"] == ("external2_camera", 96, 96)
    assert found.states["observation.state"] == [slice(18, 25), slice(0, 9)]
    assert "observation.images.empty_camera_0" not in found.images


def test_short_names_and_env_feature_are_mapped():
    given = features(state=Feature("STATE", (9,)), environment_state=Feature("ENV", (64,)))
    settings = {
        "mapping": {"observation.images.external1": "external2", "observation.state": "qpos"},
        "language": {"encoder": "hashed", "dim": 64},
    }
    found = make_mapping(given, 7, settings)
    assert found.images["observation.images.external1"] == ("external2_camera", 224, 224)
    assert found.states["observation.state"] == [slice(0, 9)]
    assert found.languages == {"observation.environment_state": 64}
    with pytest.raises(MappingError, match='it can only be mapped to "language"'):
        make_mapping(given, 7, {"mapping": {"observation.environment_state": ["qpos"]}})


def test_slices_of_the_state_are_mapped():
    settings = {"mapping": {"observation.state": ["qpos[0:8]", "tcp_pose", "qvel[8:9]"]}}
    found = make_mapping(features(state=Feature("STATE", (16,))), 7, settings)
    assert found.states["observation.state"] == [slice(0, 8), slice(18, 25), slice(17, 18)]


def test_rename_map_gives_sources_unless_settings_do():
    given = {name: EXTERNAL for name in ("observation.images.base", "observation.images.wrist")}
    given["observation.state"] = Feature("STATE", (9,))
    saved = {
        "observation.images.external1": "observation.images.base",
        "observation.images.hand": "observation.images.wrist",
    }
    found = make_mapping(given, 7, {}, rename_map=saved)
    assert found.images["observation.images.base"] == ("external1_camera", 224, 224)
    assert found.images["observation.images.wrist"] == ("hand_camera", 224, 224)
    settings = {"mapping": {"observation.images.wrist": "external2_camera"}}
    found = make_mapping(given, 7, settings, rename_map=saved | {"observation.images.up": "observation.images.wrist"})
    assert found.images["observation.images.wrist"][0] == "external2_camera"


def test_swapped_cameras_are_swapped():
    swap = ["observation.images.external1", "observation.images.hand_camera"]
    found = make_mapping(features(), 7, {}, rename_map=dict(zip(swap, swap[::-1])))
    assert [found.images[name] for name in swap] == [("hand_camera", 224, 224), ("external1_camera", 128, 128)]


def test_rename_map_without_source_lists_both_sides():
    saved = {"observation.images.front": "observation.images.external1", "observation.effort": "observation.state"}
    saved |= {"observation.images.external2": "observation.images.hand_camera", "x": "observation.images.hand_camera"}
    with pytest.raises(MappingError) as error:
        make_mapping(features(), 7, {}, rename_map=saved)
    for words in (
        "external1: rename_map takes it from observation.images.front: there is no camera 'front' or 'front_camera'",
        "observation.state: rename_map takes it from observation.effort: map it to a list of state parts",
        "hand_camera: rename_map takes it from observation.images.external2 and from x",
        "cameras of the single robot: external1_camera",
        "observation.images.external1 VISUAL",
    ):
        assert words in str(error.value)


def test_recorded_encoder_needs_no_settings():
    name = "observation.environment_state"
    given = features(environment_state=Feature("ENV", (64,)))
    assert make_mapping(given, 7, {}, hashed={name}).languages == {name: 64}
    with pytest.raises(MappingError, match="`language.dim` is 32, the feature has width 64"):
        make_mapping(given, 7, {"language": {"encoder": "hashed", "dim": 32}}, hashed={name})


def test_error_lists_problems_and_available_sources():
    given = {
        **features(state=Feature("STATE", (14,)), environment_state=Feature("ENV", (64,))),
        "observation.images.top": EXTERNAL,
    }
    with pytest.raises(MappingError) as error:
        make_mapping(given, 7, {"mapping": {"observation.images.left": "external1_camera"}})
    for words in (
        "observation.images.left: hypogeum.json maps it, but the checkpoint has no such feature",
        "observation.images.top: there is no camera 'top' or 'top_camera'",
        "observation.images.top VISUAL [3, 224, 224]",
        "observation.state: map it to a list of state parts of total width 14 (the whole state has 25)",
        """observation.environment_state: "language" needs {"language": {"encoder": "hashed", "dim": 64}}""",
        "external1_camera, external2_camera, hand_camera",
        "qpos 9, qvel 9, tcp_pose 7",
    ):
        assert words in str(error.value)


@pytest.mark.parametrize(
    "action_dim, settings, words",
    [
        (6, {}, "width 6 and `morphology` is None"),
        (7, {"morphology": "bimanual"}, "control mode 'pd_ee_delta_pose' of a bimanual robot"),
        (8, {"control_mode": "pd_ee_pose"}, "control mode 'pd_ee_pose' of a single robot"),
        (7, {"mapping": {"observation.state": ["qpos", "ee1_pose"]}}, "has no part 'ee1_pose'"),
        (7, {"mapping": {"observation.state": ["ee1_pose[0:3]"]}}, "has no part 'ee1_pose'"),
        (7, {"mapping": {"observation.state": ["qpos[0:10]"]}}, "'qpos[0:10]' needs bounds 0 <= start < stop <= 9"),
        (7, {"mapping": {"observation.state": ["qpos[3:3]"]}}, "'qpos[3:3]' needs bounds 0 <= start < stop <= 9"),
        (7, {"mapping": {"observation.state": ["qpos[:8]"]}}, "'qpos[:8]' is neither a part of the state nor a slice"),
        (7, {"mapping": {"observation.state": ["qpos[-1:8]"]}}, "'qpos[-1:8]' is neither a part of the state nor a"),
        (
            7,
            {"language": {"encoder": "hashed", "dim": 8}},
            "`language` in hypogeum.json: this policy reads no embedding",
        ),
        (7, {"mapping": {"observation.state": ["qpos"]}}, "qpos has width 9, the feature has 25"),
        (7, {"mapping": {"observation.images.external1": "front"}}, "there is no camera 'front'"),
        (7, {"mapping": {"observation.state": "language"}}, "has no part 'language'"),
        (7, {"mapping": {"observation.state": "qpos"}}, "qpos has width 9, the feature has 25"),
    ],
)
def test_inconsistent_settings_are_rejected(action_dim, settings, words):
    with pytest.raises(MappingError) as error:
        make_mapping(features(), action_dim, settings)
    assert words in str(error.value)


def test_missing_camera_is_left_out_if_the_policy_masks_it():
    settings = {"mapping": {"observation.images.external1": "none"}}
    found = make_mapping(features(), 7, settings, masks_cameras=True)
    assert list(found.images) == ["observation.images.hand_camera"]
    with pytest.raises(
        MappingError, match='external1: it cannot be mapped to "none": this policy needs all its cameras'
    ):
        make_mapping(features(), 7, settings)
    settings["mapping"]["observation.images.hand_camera"] = "none"
    with pytest.raises(MappingError, match="all cameras are missing"):
        make_mapping(features(), 7, settings, masks_cameras=True)


@pytest.mark.parametrize(
    "text, words",
    [
        ('{"prompt_state": "padding"}', "`prompt_state` is 'padding', expected unpadded or padded"),
        ('{"vision_heads": 0}', "`vision_heads` is 0, expected a positive integer"),
        ('{"ignore": "dropout"}', "`ignore` is 'dropout', expected a list of keys"),
        ('{"mapping": ["qpos"]}', "`mapping` is ['qpos'], expected an object"),
        ('{"vision_heads": true}', "`vision_heads` is True, expected a positive integer"),
        ("[]", "contains list, expected an object"),
        ("{", "is not valid JSON"),
    ],
)
def test_invalid_setting_is_named(tmp_path, text, words):
    (tmp_path / "hypogeum.json").write_text(text)
    with pytest.raises(MappingError) as error:
        read_settings(tmp_path)
    assert words in str(error.value)


def test_settings_file_is_optional_and_rejects_unknown_keys(tmp_path):
    assert read_settings(tmp_path) == {}
    (tmp_path / "hypogeum.json").write_text(json.dumps({"morphology": "single"}))
    assert read_settings(tmp_path) == {"morphology": "single"}
    (tmp_path / "hypogeum.json").write_text(json.dumps({"robot": "single"}))
    with pytest.raises(MappingError, match="robot"):
        read_settings(tmp_path)
