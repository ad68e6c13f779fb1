"""LiDAR-camera extrinsic calibration from semantic labels, without targets or a start guess."""


def __getattr__(name: str) -> str:
    """Look the version up on first use: reading package metadata would slow every import."""
    if name != "__version__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib.metadata import version

    return version("semcal")
