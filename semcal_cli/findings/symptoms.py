"""Topics of findings that come up because of something else, for checks to state what they explain."""

from __future__ import annotations

CLOCKS = "clocks"
"""Topic of the finding that states the offset of the clock, or why it is not known."""
UNTIED_CLOCKS = "untied-clocks"
"""Topic of the finding that nothing ties the clocks."""
LOOKS_LIKE = "looks-like"
"""Topic of a mistake that a transform looks like."""
MOVED_SENSOR = "moved-sensor"
"""Topic of a displacement of one sensor of a rig that explains all transforms that fail."""
OF_A_WRONG_CLOCK: frozenset[str] = frozenset(
    {
        "camera-motion",
        "focal-length",
        "frames-disagree",
        "intrinsics",
        "moved-camera",
        "odd-frames",
        "polish-rejected",
        "wide-interval",
        "wrong-pairing",
    }
)
"""What images of another moment look like: frames at other speeds need other poses, and fit their sweeps less well. The
interval includes what the offset costs."""
OF_A_WRONG_POSE: frozenset[str] = OF_A_WRONG_CLOCK | frozenset(
    {
        "chance",
        "clocks",
        "cues-disagree",
        "no-direction",
        "not-determined",
        "other-azimuth",
        "other-mounting",
        "other-pose",
        "overlap",
        "polish-not-settled",
        "polish-not-tested",
        "refinement-not-settled",
        "seeds",
    }
)
"""What is measured at a pose that is wrong or hardly determined, and means nothing there."""
OF_A_WRONG_K: frozenset[str] = frozenset(
    {
        "far-start",
        "focal-length",
        "frames-disagree",
        "no-direction",
        "other-pose",
        "polish-not-settled",
        "polish-rejected",
        "wide-interval",
    }
)
"""What a wrong K looks like: the pose cannot imitate it everywhere, and settles where no pose fits well."""
OF_A_LOST_POSE: frozenset[str] = frozenset({"other-azimuth", "wrong-pairing"})
"""What says that points and images do not fit at all, so that nothing around the pose means anything."""
OF_THE_DRIVE: frozenset[str] = frozenset({"few-scenes", "motion", "shutter"})
"""What speaks against every pose of a drive alike, so that no search for another pose helps."""
