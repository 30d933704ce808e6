"""What the benchmark calls its cameras and the parts of its state vectors."""

# By morphology, in the order of the images in a message: external ones first.
CAMERAS = {
    "single": ("external1_camera", "external2_camera", "hand_camera"),
    "bimanual": ("external1_camera", "external2_camera", "panda1_hand_camera", "panda2_hand_camera"),
}

# By morphology, in the order of the state vector: (name, width). Positions are in rad and m, poses are position then
# quaternion (w, x, y, z) in the world frame; the joints of the two arms are interleaved.
STATE_PARTS = {
    "single": (("qpos", 9), ("qvel", 9), ("tcp_pose", 7)),
    "bimanual": (
        ("qpos", 18),
        ("qvel", 18),
        ("ee1_pose", 7),
        ("ee2_pose", 7),
        ("left_arm_tcp", 7),
        ("right_arm_tcp", 7),
    ),
}


def state_slice(morphology, part):
    """Where a part lies in the state vector."""
    start = 0
    for name, width in STATE_PARTS[morphology]:
        if name == part:
            return slice(start, start + width)
        start += width
    known = ", ".join(name for name, _ in STATE_PARTS[morphology])
    raise ValueError(f"a {morphology} robot's state has no part {part!r}; it has {known}")
