"""Many calibrations of one rig: what they agree on, which do not, and whether the rig has changed."""
