"""Names of a camera's axes where an offset along or about one is told: each says what a positive offset is."""

PLACES = "camera to the right (x)", "camera down (y)", "camera forward (z)"
"""Offsets of the camera's centre along its axes."""
TURNS = "pitch, looks down (about x)", "yaw, looks left (about y)", "roll, leans left (about z)"
"""Offsets of the rotation about them. A positive angle turns what the camera sees, as a twist on the left of
T_camera_lidar does, so that the camera itself turns the other way."""
AXIS_NAMES = *PLACES, *TURNS
CHECK_NAMES = dict(
    zip(
        (*(f"camera centre {axis}" for axis in "xyz"), *(f"rotation {axis}" for axis in "xyz")),
        AXIS_NAMES,
        strict=True,
    )
) | {"clock": "pictures later (clock)"}
"""The same by the names of checks."""
