"""What may tie the images of a drive to the moments of its sweeps."""

from typing import Literal, TypeAlias

Synchronization: TypeAlias = Literal["hardware", "stamps", "unknown"]
"""One triggers the other, or one signal both; they were paired by recorded times; or nothing is known."""
