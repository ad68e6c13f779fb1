"""Many calibrations of one rig: what they agree on, which ones disagree, and whether the rig has changed."""
